"""Recomputes a run's measures and summary from its traces, without simulation."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.documents import JsonObject
from harness.core.encounter import Arm, Ending, Trace, Walk
from harness.core.errors import InputError
from harness.measures import Outcome, measure
from harness.measures.catalogue import COLUMNS
from harness.scenario import Cell, Scenario, Setting, set_thresholds, study_from
from harness.store.episode_tables import episode_rows
from harness.store.manifest import options_of, scored_now
from harness.store.reading import MANIFEST, read_finished_manifest, read_table
from harness.store.run_folder import RunFolder, claim_folder
from harness.store.schemas import MODEL_USE, encounter_tables
from harness.store.shards import DamagedShardError
from harness.store.tables import table_of
from harness.store.walk_rows import stored_walk
from harness.studies.batch.finish import finish
from harness.studies.batch.hour_scoring import score_hours
from harness.studies.batch.plan import Plan
from harness.studies.batch.simulation_scoring import score_simulations

_AFTER_CONTACT = ("pass_time_ignoring_contact_s",)
"""Measures that depend on the part of the passage after a contact."""

_PART_PAIRS = 500
"""Number of pairs in memory at once."""


def score(run: Path, out: Path, settings: Sequence[Setting] = ()) -> Path:
    """Write a run folder with measures recomputed from the traces of another run.

    Args:
        run: a finished run with traces.  A run without traces is accepted if settings are given;
            its stored measures then stay.
        out: a new or empty folder.
        settings: other conflict thresholds (``conflicts.…``).

    Raises:
        InputError: the run is not finished, kept no traces, ``out`` is refused, or a setting is
            not a threshold.
    """
    document = read_finished_manifest(run)
    traced = (run / "traces.parquet").is_file()
    if not traced and not settings:
        raise InputError(str(run), "kept no traces", "a run with --traces")
    _apply(settings, document)
    study = study_from(document, str(run / MANIFEST))
    # Model and strategies are not needed, because the traces contain their effects.
    origin = {name: document[name] for name in ("know_the_model", "simulated_with")}
    # SUMO's outputs belong to the simulated run.
    options = options_of(document)
    plan = Plan(study, {}, options, {**origin, "scored_with": scored_now()})
    folder = RunFolder(claim_folder(out, plan.study.name))
    finished = False
    try:
        folder.drop_shards()
        for cell in plan.study.cells:
            for first, count, tables in SCORERS[plan.kind.name](run, cell, traced):
                folder.write_shard(cell.number, first, count, tables)
        finish(folder, plan)
        finished = True
    except BaseException as error:
        # Scoring cannot be resumed, so unfinished work is removed.
        folder.drop_shards()
        if isinstance(error, DamagedShardError):
            raise InputError(str(run), "its traces cannot be scored", "a run's traces") from None
        raise
    finally:
        folder.close()
        if not finished and not any(out.iterdir()):
            out.rmdir()
    return out


def _score_encounters(
    run: Path, cell: Cell, traced: bool
) -> Iterator[tuple[int, int, dict[str, pa.Table]]]:
    """Yield first pair, number of pairs and tables, part by part."""
    names = encounter_tables(traces=traced)
    # Older runs may lack columns, but the measures are recomputed anyway.
    optional = COLUMNS if traced else ()
    tables = {name: read_table(run, name, cell.number, optional=optional) for name in names}
    pairs = _pairs(run, tables["episodes"])
    for first in range(0, pairs, _PART_PAIRS):
        last = min(first + _PART_PAIRS, pairs) - 1
        part = {name: _pairs_of(table, first, last) for name, table in tables.items()}
        yield first, last - first + 1, _score(run, part, cell) if traced else part


SCORERS = {
    "encounters": _score_encounters,
    "hours of traffic": score_hours,
    "own simulations": score_simulations,
}
"""The function that scores a cell, by kind."""


def _apply(settings: Sequence[Setting], document: JsonObject) -> None:
    """Change conflict thresholds in a manifest."""
    set_thresholds(document["scenario"], settings, MANIFEST)
    for setting in settings:
        if setting.key in document["cells"][0]:
            where, allowed = setting.source, "a threshold that is the same in all cells"
            raise InputError(f"{where} {setting.key}", "varies in this run", allowed)


def _pairs(run: Path, episodes: pa.Table) -> int:
    """Return the number of pairs.

    Raises:
        InputError: pairs are not numbered from 0, or a pair lacks an arm or has the human's first.
    """
    pairs, arms = episodes["pair"].to_numpy(), episodes["arm"].to_pylist()
    count = len(pairs) // 2
    whole = count > 0 and np.array_equal(pairs, np.repeat(np.arange(count), 2))
    if not whole or arms != [Arm.AV.value, Arm.HUMAN.value] * count:
        raise InputError(str(run), "does not have both arms of every pair", "a whole run")
    return count


def _pairs_of(table: pa.Table, first: int, last: int) -> pa.Table:
    pair = table["pair"]
    return table.filter(pc.and_(pc.greater_equal(pair, first), pc.less_equal(pair, last)))


def _score(run: Path, tables: dict[str, pa.Table], cell: Cell) -> dict[str, pa.Table]:
    """Return the tables of some pairs with recomputed measures."""
    rows = []
    scored = episode_rows(cell.number, _outcomes(run, tables, cell.scenario)).to_pylist()
    for old, new in zip(tables["episodes"].to_pylist(), scored, strict=True):
        if old["ending"] == Ending.ENGINE_FAILED:
            rows.append(old)  # a failed episode has nothing to measure
            continue
        # Stored traces end at the contact; the part after it is known only during the run.
        crashed = old["ending"] == Ending.CRASHED
        kept = (*MODEL_USE, *_AFTER_CONTACT) if crashed else MODEL_USE
        rows.append(new | {name: old[name] for name in kept if name in old})
    return {**tables, "episodes": table_of("episodes", rows)}


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
                vehicle=scenario.vehicle(Arm(row["arm"])),
                crossing=scenario.crosswalk(),
                step_s=scenario.experiment.step_s,
                x_m=x,
                speed_mps=speed,
                walks=tuple(walks.get(key, ())),
                # After a contact the engine's ending is not stored; measuring finds the contact.
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
        walks.setdefault((row["pair"], row["arm"]), []).append(stored_walk(row))
    return walks
