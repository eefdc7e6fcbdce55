"""Raw trajectories in; rows of the interaction model's variables out."""

from harness.model.trajectories.counting import REASONS, Tally
from harness.model.trajectories.extraction import (
    FORMATS,
    Extraction,
    Format,
    extract,
    read_clips,
    write_rows,
)
from harness.model.trajectories.extraction_rules import ROW_COLUMNS, ExtractionRules
from harness.model.trajectories.tracks import Clip, Track, VehicleTrack

__all__ = [
    "FORMATS",
    "REASONS",
    "ROW_COLUMNS",
    "Clip",
    "Extraction",
    "ExtractionRules",
    "Format",
    "Tally",
    "Track",
    "VehicleTrack",
    "extract",
    "read_clips",
    "write_rows",
]
