"""Raw trajectories in; rows of the interaction model's variables out."""

from harness.model.trajectories.counting import REASONS, Counts
from harness.model.trajectories.extraction import (
    Extraction,
    extract,
    read_clips,
    summary,
    write_rows,
)
from harness.model.trajectories.extraction_rules import ROW_COLUMNS, ExtractionRules
from harness.model.trajectories.formats import FORMATS, Format
from harness.model.trajectories.tracks import Clip, Sighting, Track, VehicleTrack

__all__ = [
    "FORMATS",
    "REASONS",
    "ROW_COLUMNS",
    "Clip",
    "Counts",
    "Extraction",
    "ExtractionRules",
    "Format",
    "Sighting",
    "Track",
    "VehicleTrack",
    "extract",
    "read_clips",
    "summary",
    "write_rows",
]
