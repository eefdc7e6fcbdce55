"""Names of what a page shows."""

from harness.studies.runs.run_data import RunData


def pair_name(run: RunData, cell: int, pair: int) -> str:
    """``cell 2, pair 7``, or ``pair 7`` where the run has one cell."""
    return f"cell {cell}, pair {pair}" if run.varied_keys else f"pair {pair}"
