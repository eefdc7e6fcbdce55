"""Judges an automated vehicle's strategy at an unsignalized crosswalk, in SUMO."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.review.run_data import RunData

__all__ = ["load_run"]


def load_run(path: "str | Path") -> "RunData":
    """Open a run folder, finished or not: see ``harness.review.run_data.RunData``.

    Raises:
        InputError: it is no run folder, of another format version, incomplete, or damaged.
    """
    # `harness --help` must not wait for pandas.
    from harness.review.run_data import load_run as load

    return load(path)
