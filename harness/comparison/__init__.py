"""Paired statistics of cells: aligned columns in, numbers with intervals out."""

from harness.comparison.intervals import (
    CONFIDENCE,
    INDICATIVE_BELOW,
    Interval,
    Proportion,
    bootstrap_mean_and_cv,
    proportion,
    zero_bound,
)
from harness.comparison.summary import PairColumns, Summary, summarise

__all__ = [
    "CONFIDENCE",
    "INDICATIVE_BELOW",
    "Interval",
    "PairColumns",
    "Proportion",
    "Summary",
    "bootstrap_mean_and_cv",
    "proportion",
    "summarise",
    "zero_bound",
]
