"""Model files in; the fitted distribution of walking and driving speeds at an encounter out."""

from harness.model.interaction.file import load_model, read_model, write_model
from harness.model.interaction.model import (
    DRIVING_GIVEN,
    INVERSE_RANGE,
    INVERSE_TIME_ADVANTAGE,
    PEDESTRIAN_SPEED,
    VARIABLES,
    VEHICLE_SPEED,
    WALKING_GIVEN,
    InteractionModel,
    ModelUseCounter,
    check_support,
)

__all__ = [
    "DRIVING_GIVEN",
    "INVERSE_RANGE",
    "INVERSE_TIME_ADVANTAGE",
    "PEDESTRIAN_SPEED",
    "VARIABLES",
    "VEHICLE_SPEED",
    "WALKING_GIVEN",
    "InteractionModel",
    "ModelUseCounter",
    "check_support",
    "load_model",
    "read_model",
    "write_model",
]
