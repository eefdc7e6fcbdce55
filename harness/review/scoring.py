"""Recomputes a run's measures and summary from its kept traces, without simulating."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.batch.batch import recall_batch
from harness.batch.finish import finish
from harness.encounter import Arm, Arrival, Ending, Leg, Side, Trace, Walk
from harness.errors import InputError
from harness.measures import Outcome, measure
from harness.measures.table import COLUMNS
from harness.results.reading import read_finished_manifest, read_table
from harness.results.run_folder import RunFolder, claim_folder
from harness.results.shards import DamagedShardError
from harness.results.tables import episode_rows
from harness.scenario import Cell, Scenario

_PART_PAIRS = 500
"""Pairs scored together: what is in memory at once."""


def score(run: Path, out: Path) -> Path:
    """Write a run folder whose measures come from the traces of another.

    Args:
        run: a finished run that kept its traces.
        out: a new or empty folder.

    Raises:
        InputError: no finished run, no traces, or ``out`` is refused.
    """
    document = read_finished_manifest(run)
    if not (run / "traces.parquet").is_file():
        raise InputError(str(run), "kept no traces", "a run with --traces")
    batch = recall_batch(document)
    folder = RunFolder(claim_folder(out, batch.study.name))
    try:
        folder.drop_shards()
        for cell in batch.study.cells:
            names = ("episodes", "pedestrians", "traces")
            # Measures are worked out anew: those added since the run need not be there.
            tables = {name: read_table(run, name, cell.number, optional=COLUMNS) for name in names}
            pairs = _pairs(run, tables["episodes"])
            for first in range(0, pairs, _PART_PAIRS):
                last = min(first + _PART_PAIRS, pairs) - 1
                part = {name: _pairs_of(table, first, last) for name, table in tables.items()}
                rows = _score(run, part, cell)
                folder.write_shard(cell.number, first, last - first + 1, rows)
        finish(folder, batch)
    except BaseException as error:
        # Nothing here can go on: what is half done would only be in the way.
        folder.drop_shards()
        if isinstance(error, DamagedShardError):
            raise InputError(str(run), "its traces give no measures", "a run's traces") from None
        raise
    finally:
        folder.close()
    return out


def _pairs(run: Path, episodes: pa.Table) -> int:
    """How many pairs a cell has: numbered from 0 on, the AV's arm of each before the human's."""
    pairs, arms = episodes["pair"].to_numpy(), episodes["arm"].to_pylist()
    count = len(pairs) // 2
    whole = count > 0 and np.array_equal(pairs, np.repeat(np.arange(count), 2))
    if not whole or arms != [Arm.AV.value, Arm.HUMAN.value] * count:
        raise InputError(str(run), "its episodes are not two arms of each pair", "a whole run")
    return count


def _pairs_of(table: pa.Table, first: int, last: int) -> pa.Table:
    pair = table["pair"]
    return table.filter(pc.and_(pc.greater_equal(pair, first), pc.less_equal(pair, last)))


def _score(run: Path, tables: dict[str, pa.Table], cell: Cell) -> dict[str, dict[str, Any]]:
    """All rows of some pairs, the measures worked out anew."""
    stored = tables["episodes"].to_pydict()
    scored = episode_rows(cell.number, _outcomes(run, tables, cell.scenario))
    for row, ending in enumerate(stored["ending"]):
        if ending == Ending.ENGINE_FAILED:
            # There is nothing to measure where a worker died.
            for name in stored:
                scored[name][row] = stored[name][row]
    kept = {name: tables[name].to_pydict() for name in ("pedestrians", "traces")}
    return {"episodes": scored, **kept}


def _outcomes(run: Path, tables: dict[str, pa.Table], scenario: Scenario) -> Iterator[Outcome]:
    episodes = tables["episodes"].to_pylist()
    walks = _walks(tables["pedestrians"])
    states = _ego_states(tables["traces"])
    rebuilt = []
    for row in episodes:
        key = (row["pair"], row["arm"])
        if key not in states and row["ending"] != Ending.ENGINE_FAILED:
            raise InputError(str(run), f"no trace of pair {key[0]}, arm {key[1]}", "a whole run")
        x, speed = states.get(key, (np.empty(0), np.empty(0)))
        ending = Ending(row["ending"])
        rebuilt.append(
            Trace(
                vehicle=scenario.vehicle(),
                crossing=scenario.crosswalk(),
                step_s=scenario.experiment.step_s,
                x_m=x,
                speed_mps=speed,
                walks=tuple(walks.get(key, ())),
                # How the engine left off is gone after a contact; the contact itself is found anew.
                ending=Ending.TIMED_OUT if ending is Ending.CRASHED else ending,
                reason=row["reason"],
                sumo_collision=row["sumo_collision"],
                fallback=row["fallback"],
            )
        )
    for row, trace, record in zip(episodes, rebuilt, measure(rebuilt), strict=True):
        yield Outcome(row["pair"], Arm(row["arm"]), row["strategy"], record, trace)


def _ego_states(traces: pa.Table) -> dict[tuple[int, str], tuple[np.ndarray, np.ndarray]]:
    table = traces.filter(pc.equal(traces["object"], "ego"))
    pairs, arms = table["pair"].to_numpy(), np.array(table["arm"].to_pylist())
    x, speed = table["x_m"].to_numpy(), table["speed_mps"].to_numpy()
    if not len(pairs):
        return {}
    begins = np.flatnonzero(
        np.concatenate(([True], (pairs[1:] != pairs[:-1]) | (arms[1:] != arms[:-1])))
    )
    ends = np.append(begins[1:], len(pairs))
    return {
        (int(pairs[begin]), str(arms[begin])): (x[begin:end], speed[begin:end])
        for begin, end in zip(begins, ends, strict=True)
    }


def _walks(pedestrians: pa.Table) -> dict[tuple[int, str], list[Walk]]:
    walks: dict[tuple[int, str], list[Walk]] = {}
    for row in pedestrians.to_pylist():
        arrival = Arrival(row["index"], row["arrival_s"], Side(row["side"]), row["quantile"])
        legs = row["legs"]
        walk = Walk(
            arrival,
            row["start_s"],
            row["speed_mps"],
            row["range_m"],
            row["vehicle_speed_mps"],
            None if legs is None else tuple(Leg(**leg) for leg in legs),
        )
        walks.setdefault((row["pair"], row["arm"]), []).append(walk)
    return walks
