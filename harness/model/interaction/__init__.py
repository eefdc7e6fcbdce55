"""Model files in; the fitted distribution of walking and driving speeds at an encounter out."""

from harness.model.interaction.file import load_model, read_model, write_model
from harness.model.interaction.model import (
    INVERSE_RANGE,
    INVERSE_TIME_ADVANTAGE,
    PEDESTRIAN_SPEED,
    VARIABLES,
    VEHICLE_SPEED,
    InteractionModel,
    ModelUseCounter,
    Refits,
    check_support,
)
from harness.model.interaction.refit_file import (
    FEWEST_REFITS,
    Refit,
    RefitFile,
    read_refits,
    refits_beside,
    write_refits,
)

__all__ = [
    "FEWEST_REFITS",
    "INVERSE_RANGE",
    "INVERSE_TIME_ADVANTAGE",
    "PEDESTRIAN_SPEED",
    "VARIABLES",
    "VEHICLE_SPEED",
    "InteractionModel",
    "ModelUseCounter",
    "Refit",
    "RefitFile",
    "Refits",
    "check_support",
    "load_model",
    "read_model",
    "read_refits",
    "refits_beside",
    "write_model",
    "write_refits",
]
