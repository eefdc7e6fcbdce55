"""Options for SUMO's own outputs of an arm that is repeated."""

import os
from collections.abc import Mapping
from pathlib import Path

SUMO_FILES = {
    "--fcd-output": "fcd.xml",
    "--tripinfo-output": "tripinfo.xml",
    "--collision-output": "collisions.xml",
}

PRECISION = "6"
"""Number of decimals in the outputs."""

_FURTHER_OPTIONS = {
    "--fcd-output.acceleration": "true",
    "--tripinfo-output.write-unfinished": "true",
    "--precision": PRECISION,
    # The harness places the pedestrians, so SUMO's records of their walks would be meaningless.
    "--personinfo-output": os.devnull,
}


def outputs_in(folder: Path, files: Mapping[str, str] = SUMO_FILES) -> dict[str, str]:
    """Return the options with which SUMO writes these files into a folder."""
    return {option: str(folder / name) for option, name in files.items()} | _FURTHER_OPTIONS
