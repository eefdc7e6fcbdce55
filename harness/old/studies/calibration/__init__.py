"""Takes extracted rows and returns a fitted interaction model and its card."""

from harness.old.studies.calibration.calibrate import Calibration, Candidate, calibrate
from harness.old.studies.calibration.card import card
from harness.old.studies.calibration.choice import by_bic, by_held_out, by_rule
from harness.old.studies.calibration.jobs import Settings
from harness.old.studies.calibration.refits import (
    RefitSettings,
    check_refits,
    make_refits,
    recipe_of,
)
from harness.old.studies.calibration.sample import (
    BOX_LOWER,
    BOX_UPPER,
    RowFile,
    Sample,
    make_sample,
    read_rows,
)
from harness.old.studies.calibration.scores import (
    HeldOut,
    by_vehicle,
    driving_log_scores,
    vehicle_folds,
    walking_log_scores,
)

__all__ = [
    "BOX_LOWER",
    "BOX_UPPER",
    "Calibration",
    "Candidate",
    "HeldOut",
    "RefitSettings",
    "RowFile",
    "Sample",
    "Settings",
    "by_bic",
    "by_held_out",
    "by_rule",
    "by_vehicle",
    "calibrate",
    "card",
    "check_refits",
    "driving_log_scores",
    "make_refits",
    "make_sample",
    "read_rows",
    "recipe_of",
    "vehicle_folds",
    "walking_log_scores",
]
