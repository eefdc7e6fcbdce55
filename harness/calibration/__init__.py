"""From extracted rows to a fitted interaction model with its card."""

from harness.calibration.calibrate import Calibration, Candidate, Settings, calibrate
from harness.calibration.card import card
from harness.calibration.choice import CHOICES, by_bic, by_held_out, by_rule
from harness.calibration.sample import (
    BOX_LOWER,
    BOX_UPPER,
    RowFile,
    Sample,
    make_sample,
    read_rows,
)
from harness.calibration.scores import HeldOut, speed_log_scores, vehicle_folds

__all__ = [
    "BOX_LOWER",
    "BOX_UPPER",
    "CHOICES",
    "Calibration",
    "Candidate",
    "HeldOut",
    "RowFile",
    "Sample",
    "Settings",
    "by_bic",
    "by_held_out",
    "by_rule",
    "calibrate",
    "card",
    "make_sample",
    "read_rows",
    "speed_log_scores",
    "vehicle_folds",
]
