"""Paired statistics of cells: aligned columns in, numbers with intervals out."""

from harness.comparison.allowed import (
    AllowedInterval,
    Judgement,
    Limits,
    SweepVerdict,
    SweptValue,
    Verdict,
    allowed_interval,
    swept_value,
)
from harness.comparison.intervals import (
    CONFIDENCE,
    INDICATIVE_BELOW,
    INDICATIVE_COMPARED_BELOW,
    Interval,
    Proportion,
    bootstrap_mean,
    bootstrap_mean_and_cv,
    bootstrap_ratio,
    clustered_proportion,
    proportion,
    student_mean,
    zero_bound,
)
from harness.comparison.pair_columns import PairColumns
from harness.comparison.paired import CrashTest, holm, mcnemar, paired_difference
from harness.comparison.pareto import (
    Place,
    Relation,
    Standing,
    pareto_front,
    relation_of_crashes,
    relation_of_times,
)
from harness.comparison.summary import Summary, summarise

__all__ = [
    "CONFIDENCE",
    "INDICATIVE_BELOW",
    "INDICATIVE_COMPARED_BELOW",
    "AllowedInterval",
    "CrashTest",
    "Interval",
    "Judgement",
    "Limits",
    "PairColumns",
    "Place",
    "Proportion",
    "Relation",
    "Standing",
    "Summary",
    "SweepVerdict",
    "SweptValue",
    "Verdict",
    "allowed_interval",
    "bootstrap_mean",
    "bootstrap_mean_and_cv",
    "bootstrap_ratio",
    "clustered_proportion",
    "holm",
    "mcnemar",
    "paired_difference",
    "pareto_front",
    "proportion",
    "relation_of_crashes",
    "relation_of_times",
    "student_mean",
    "summarise",
    "swept_value",
    "zero_bound",
]
