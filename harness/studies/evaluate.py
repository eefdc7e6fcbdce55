"""Evaluates a list of candidates on the same people, and returns their numbers as a frame."""

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.documents import as_plain
from harness.core.errors import InputError, checked, refused_at, whole_number
from harness.core.vocabulary import Arm, Ending
from harness.encounter.arms import arm_key
from harness.results.cell_findings import cell_findings
from harness.results.estimators import CONFIDENCE
from harness.results.result import flat
from harness.scenario import Cell, EngineName, Scenario, Setting, check_effects
from harness.strategies.registry import source_digests
from harness.studies.running import workers as local
from harness.studies.running.run import checked_models, scenario_file
from harness.studies.running.tasks import Task, but_for_drivers
from harness.studies.running.workers import OwnExecutor, submitted

if TYPE_CHECKING:
    import pandas as pd

MOST_REFERENCES = 16
"""Number of references whose episodes are kept; the oldest is forgotten first."""

_MOST_PAIRS = 50
"""Most pairs of a task."""

_references: OrderedDict[str, pa.Table] = OrderedDict()
"""The rows of references by what they depend on."""


@checked
def evaluate(
    scenario: Scenario | str | Path,
    candidates: Sequence[Mapping[str, Any]],
    pairs: int | range,
    *,
    settings: Mapping[str, Any] | None = None,
    intervals: bool = False,
    workers: int | None = None,
    engine: EngineName = "sumo",
) -> "pd.DataFrame":
    """The numbers of each candidate on the same pairs; nothing is written.

    The episodes of a shipped reference are simulated once and kept between calls, as long as what
    they depend on stays the same.  The workers stay open between calls too; Ctrl-C ends them.

    Args:
        scenario: a scenario, a file, or the name of a shipped scenario.
        candidates: the settings of each candidate by dotted key, e.g.
            ``{"strategies.gap_yield.critical_gap_s": 1.5}``.  NumPy's numbers are accepted.
        pairs: number of pairs, or a range of their numbers.
        settings: further settings of every candidate.
        intervals: whether the frame has intervals; computing them takes longer.
        workers: number of processes; None uses all cores; 0 uses this process alone, without time
            limits.
        engine: ``sumo``, or ``plain`` for the same kinematics without SUMO.

    Returns:
        A row for each candidate, in order: its settings, the columns of ``summary.csv``, and its
        first ``failure``.

    Raises:
        InputError: there is no candidate, or one is refused; the message has its number in the
            list.

    >>> gaps = [{"strategies.gap_yield.critical_gap_s": gap} for gap in (1.0, 3.0)]
    >>> frame = evaluate("cctc_flow", gaps, 4, settings={"arms.av": "gap_yield"}, engine="plain")
    >>> frame[["pairs", "failed"]].to_dict("list")
    {'pairs': [4, 4], 'failed': [0, 0]}
    """
    import pandas as pd

    numbers = pairs if isinstance(pairs, range) else range(whole_number("pairs", pairs, 1))
    if not numbers or numbers.step != 1 or numbers.start < 0:
        raise InputError("pairs", f"{pairs!r} is not accepted", "a range of numbers from 0, step 1")
    tasks = _tasks(scenario, candidates, settings or {}, numbers, engine)
    own = {name for task in tasks for name in task.code}
    # All processes start at once: they serve later calls too.
    executor = local.executor_for(workers, own, local.QUICK_PAIRS * local.default_workers())
    try:
        humans = [_reference(task, executor) for task in tasks]
        driven = _driven([replace(task, arms=(Arm.AV,)) for task in tasks], executor)
    except BaseException:
        executor.abort()
        raise
    executor.shutdown()  # its processes go on waiting for tasks
    while len(_references) > MOST_REFERENCES:
        _references.popitem(last=False)
    order = np.arange(2 * len(numbers)).reshape(2, -1).T.ravel()
    frame, confidence = [], CONFIDENCE if intervals else 0.0
    for given, task, human, av in zip(candidates, tasks, humans, driven, strict=True):
        rows = pa.concat_tables([av, human]).take(order).combine_chunks()
        found = cell_findings(task.cells[0], {"episodes": rows}, confidence).findings
        values = flat(found) if intervals else {key: each.value for key, each in found.items()}
        known: dict[str, Any] = {k: math.nan if one is None else one for k, one in values.items()}
        failed = rows.filter(pc.equal(rows["ending"], Ending.FAILED.value)).to_pylist()
        whys = (f"pair {row['pair']} {row['arm']}: {row['reason']}" for row in failed)
        frame.append({**as_plain(given), **known, "failure": next(whys, None)})
    return pd.DataFrame(frame)


def _tasks(
    scenario: Scenario | str | Path,
    candidates: Sequence[Mapping[str, Any]],
    settings: Mapping[str, Any],
    pairs: range,
    engine: EngineName,
) -> list[Task]:
    """A task of all pairs for each candidate."""
    file, scenarios = scenario_file(scenario, settings), list[Scenario]()
    people = file.cell().experiment
    if not candidates:
        raise InputError("candidates", "there is none", "one or more")
    for number, given in enumerate(candidates):
        with refused_at(where := f"candidates[{number}]"):
            each = file.cell([Setting(key, value, where) for key, value in given.items()])
            if (each.experiment.seed, each.experiment.pairs) != (people.seed, people.pairs):
                allowed = "the seed in `settings`, and `pairs`"
                raise InputError(where, "would meet other people", allowed)
            if (drawn := len(each.pedestrians.drawn)) and pairs.stop > drawn:
                raise InputError("pairs", f"pair {pairs.stop - 1}", f"at most {drawn} are drawn")
        scenarios.append(each)
    with refused_at("candidates"):
        check_effects(scenarios)
    models, tasks = checked_models(scenarios, engine, "candidates"), list[Task]()
    code = source_digests(name for each in scenarios for name in each.arms.model_dump().values())
    for number, (each, model) in enumerate(zip(scenarios, models, strict=True)):
        cells = (Cell(number, {}, each, valid=True),)
        tasks.append(Task(cells, model, pairs.start, len(pairs), engine=engine, code=code))
    return tasks


def _reference(task: Task, executor: OwnExecutor) -> pa.Table:
    """The reference's rows of ``episodes`` by pair; those that are known are not driven again."""
    scenario = task.cells[0].scenario
    drives = arm_key(scenario, Arm.HUMAN)
    key = repr((but_for_drivers(scenario), drives, task.model.sha256, task.engine, task.pairs))
    if drives is None or key not in _references:
        (_references[key],) = _driven([replace(task, arms=(Arm.HUMAN,))], executor)
    _references.move_to_end(key)
    return _references[key]


def _driven(tasks: Sequence[Task], executor: OwnExecutor) -> list[pa.Table]:
    """The rows of ``episodes`` of one arm of each task by pair."""
    pairs = sum(task.count for task in tasks)
    size = max(1, min(_MOST_PAIRS, -(-pairs // executor.at_once)))
    parts = [
        replace(task, first=first, count=min(size, task.pairs.stop - first))
        for task in tasks
        for first in task.pairs[::size]
    ]
    found: dict[int, list[pa.Table]] = {}
    for part, future in [(part, submitted(executor, part)) for part in parts]:
        number = part.cells[0].number
        found.setdefault(number, []).append(future.result().tables[number]["episodes"])
    return [pa.concat_tables(tables) for tables in found.values()]
