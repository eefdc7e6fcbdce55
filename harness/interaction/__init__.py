"""The interaction model: a mixture with a meaning, the file it is kept in, and its readings."""

from harness.interaction.file import load_model, read_model, write_model
from harness.interaction.model import (
    INVERSE_RANGE,
    INVERSE_TIME_ADVANTAGE,
    PEDESTRIAN_SPEED,
    VARIABLES,
    VEHICLE_SPEED,
    InteractionModel,
)
from harness.interaction.support import Asked, check_support

__all__ = [
    "INVERSE_RANGE",
    "INVERSE_TIME_ADVANTAGE",
    "PEDESTRIAN_SPEED",
    "VARIABLES",
    "VEHICLE_SPEED",
    "Asked",
    "InteractionModel",
    "check_support",
    "load_model",
    "read_model",
    "write_model",
]
