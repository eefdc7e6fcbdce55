"""The names of cells and pairs on a page."""

from harness.old.studies.runs.run_data import RunData


def pair_name(run: RunData, cell: int, pair: int) -> str:
    """Return ``cell 2, pair 7``, or ``pair 7`` if the run has one cell."""
    return f"cell {cell}, pair {pair}" if run.varied_keys else f"pair {pair}"
