"""Recomputes the conflicts of users' own simulations with other thresholds."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from harness.scenario import Cell
from harness.store.hour_tables import passage_counts
from harness.store.reading import read_table
from harness.store.schemas import SIMULATION_TRACES
from harness.store.tables import Row, Tables, table_of


def score_simulations(run: Path, cell: Cell, traced: bool) -> Iterator[tuple[int, int, Tables]]:
    """Yield the tables of a cell pair by pair, with recomputed counts.  The measures stay.

    Args:
        run: a finished run of a user's own simulation.
        cell: the cell with the new conflict thresholds.
        traced: whether the run keeps traces, which stay.

    Raises:
        InputError: a table cannot be read.
    """
    rows = read_table(run, "simulations", cell.number)
    for pair in dict.fromkeys(rows["pair"].to_pylist()):
        passages = read_table(run, "passages_over", cell.number, pair)
        arms = read_table(run, "simulations", cell.number, pair).to_pylist()
        counted = [_counted(row, passages.to_pylist(), cell) for row in arms]
        tables = {"simulations": table_of("simulations", counted), "passages_over": passages}
        for name in SIMULATION_TRACES if traced else ():
            tables[name] = read_table(run, name, cell.number, pair)
        yield pair, 1, tables


def _counted(row: Row, passages: Sequence[Row], cell: Cell) -> Row:
    """Return the row of an arm with recounted passages, in total and by crosswalk."""
    if row["reason"] is not None:
        return row
    over = [each for each in passages if each["arm"] == row["arm"]]
    limits = cell.scenario.conflicts

    def counts(part: Sequence[Row]) -> Row:
        whole = passage_counts([each | {"approach_stops": 0} for each in part], limits)
        return {name: value for name, value in whole.items() if name != "stops_per_vehicle"}

    crosswalks = [
        each | counts([passed for passed in over if passed["crosswalk"] == each["crosswalk"]])
        for each in row["crosswalks"]
    ]
    return row | counts(over) | {"crosswalks": crosswalks}
