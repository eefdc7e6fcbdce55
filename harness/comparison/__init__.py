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
from harness.comparison.bootstrap import (
    Resampled,
    bootstrap_mean,
    bootstrap_mean_and_cv,
    bootstrap_ratio,
)
from harness.comparison.intervals import (
    CONFIDENCE,
    Interval,
    Proportion,
    clustered_proportion,
    proportion,
    student_mean,
    student_ratio,
    zero_bound,
)
from harness.comparison.pair_columns import PairColumns
from harness.comparison.paired import (
    CrashTest,
    Difference,
    holm,
    mcnemar,
    paired_difference,
    ratio_difference,
    sign_flip_p,
)
from harness.comparison.pareto import (
    Place,
    Relation,
    Standing,
    pareto_front,
    relation_of_crashes,
    relation_of_times,
)
from harness.comparison.reliability import RELIABLE_FROM, unreliable
from harness.comparison.summary import Summary, summarise

__all__ = [
    "CONFIDENCE",
    "RELIABLE_FROM",
    "AllowedInterval",
    "CrashTest",
    "Difference",
    "Interval",
    "Judgement",
    "Limits",
    "PairColumns",
    "Place",
    "Proportion",
    "Relation",
    "Resampled",
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
    "ratio_difference",
    "relation_of_crashes",
    "relation_of_times",
    "sign_flip_p",
    "student_mean",
    "student_ratio",
    "summarise",
    "swept_value",
    "unreliable",
    "zero_bound",
]
