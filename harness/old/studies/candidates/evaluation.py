"""Evaluates a list of candidates on the same people and returns their numbers as a frame."""

import atexit
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.core.encounter import FloatArray
from harness.core.errors import InputError, refused_at
from harness.old.statistics import CONFIDENCE, ENCOUNTERS, Findings, row_of
from harness.old.store.kinds import kind_of
from harness.old.studies.candidates.session import Session
from harness.scenario import Cell, EngineName, Scenario, ScenarioFile, Setting, read_scenario_file
from harness.scenario.file import apply_setting, as_plain
from harness.scenario.options import whole_number

if TYPE_CHECKING:
    import pandas as pd

WALL_TIMES = ("decision_wall_s_mean", "decision_wall_s_p99")
"""The columns that are not reproducible."""

Candidate = Mapping[str, Any]
"""Settings by dotted key."""

_sessions: dict[tuple[int | None, EngineName], Session] = {}
"""The sessions of this process that stay open between calls."""


def evaluate(
    candidates: Sequence[Candidate],
    scenario: Scenario | str | Path,
    pairs: int | range,
    *,
    settings: Mapping[str, Any] | None = None,
    intervals: bool = False,
    workers: int | None = None,
    engine: EngineName = "sumo",
) -> "pd.DataFrame":
    """The numbers of each candidate on the same pairs; nothing is written.

    The reference's episodes are simulated once and kept between calls, as long as what they depend
    on stays the same.  The workers stay open between calls too; they end with this process, and
    Ctrl-C ends them at once.

    Args:
        candidates: the settings of each candidate by dotted key, e.g.
            ``{"strategies.gap_yield.critical_gap_s": 1.5}``.  NumPy's numbers are accepted.
        scenario: the scenario that they change: a Scenario, a file, or a shipped one's name.
        pairs: number of pairs, or a range of their numbers.
        settings: further settings of every candidate.
        intervals: whether the frame has intervals; computing them takes longer.
        workers: number of processes; None uses all cores; 0 uses this process alone, without time
            limits.
        engine: ``sumo``, or ``plain`` for the same kinematics without SUMO.

    Returns:
        A row for each candidate, in order: its settings, the numbers of ``summary.csv``, its first
        ``failure``, and the mean and the 99 % quantile of the wall time that the AV's strategy took
        for one decision, in s.  ``frame.attrs["not_reproducible"]`` names these two columns, which
        differ from call to call.  What is undefined is missing.

    Raises:
        InputError: there is no candidate, or one is refused; the message has its number in the
            list.

    >>> gaps = [{"strategies.gap_yield.critical_gap_s": gap} for gap in (1.0, 3.0)]
    >>> frame = evaluate(gaps, "cctc_flow", 4, settings={"arms.av": "gap_yield"}, engine="plain")
    >>> frame[["pairs", "failed"]].to_dict("list")
    {'pairs': [4, 4], 'failed': [0, 0]}
    """
    import pandas as pd

    file, numbers = file_of(scenario, settings or {}), _numbers(pairs)
    scenarios = scenarios_of(file, candidates, numbers)
    key = (workers, engine)
    if key not in _sessions:
        _sessions[key] = Session(workers, engine)
    drive = partial(_sessions[key].drive, timed=True, numbered=True)
    driven = drive(scenarios, numbers)
    confidence = CONFIDENCE if intervals else 0.0
    rows = []
    for candidate, each, episodes in zip(candidates, scenarios, driven, strict=True):
        findings = kind_of(each).findings(episodes.rows, Cell(0, {}, each), confidence)
        times = dict(zip(WALL_TIMES, _wall_times(episodes.decisions_s), strict=True))
        reported = {**_reported(findings, intervals), "failure": episodes.failure, **times}
        rows.append({**as_plain(candidate), **reported})
    frame = pd.DataFrame(rows)
    frame.attrs["not_reproducible"] = list(WALL_TIMES)
    return frame


@atexit.register
def _close_all() -> None:
    for session in _sessions.values():
        session.close()


def file_of(scenario: Scenario | str | Path, settings: Mapping[str, Any]) -> ScenarioFile:
    """The scenario that candidates change, as a file; ``settings`` apply to all of them."""
    if not isinstance(scenario, Scenario):
        return read_scenario_file(scenario, settings)
    given = tuple(Setting(key, value, "settings") for key, value in settings.items())
    return ScenarioFile("scenario", "scenario", scenario.model_dump(), None, given, Path.cwd())


def scenarios_of(
    file: ScenarioFile, candidates: Sequence[Candidate], pairs: range
) -> list[Scenario]:
    """The checked scenario of each candidate.

    Raises:
        InputError: a candidate is refused, is not a scenario of encounters, or lacks a pair.
    """
    if isinstance(candidates, Mapping | str) or not isinstance(candidates, Sequence):
        raise InputError("candidates", f"{type(candidates).__name__}", "a list of settings")
    if not candidates:
        raise InputError("candidates", "the list is empty", "at least one candidate; {} is one")
    scenarios = []
    for number, candidate in enumerate(candidates):
        where = f"candidates[{number}]"
        if not isinstance(candidate, Mapping):
            raise InputError(where, f"{candidate!r} is not accepted", "settings by dotted key")
        if odd := [key for key in candidate if not isinstance(key, str)]:
            raise InputError(where, f"{odd[0]!r} is not accepted", "dotted keys as text")
        for key in candidate:
            refuse_other_people(where, key, "the seed of `settings` and `pairs` choose the people")
        with refused_at(where):
            settings = [Setting(key, value, where) for key, value in candidate.items()]
            scenarios.append(scenario_of(file, settings, pairs))
    return scenarios


def refuse_other_people(source: str, key: str, instead: str) -> None:
    """Refuse a candidate's key that would set the seed or the pairs, and so choose other people.

    Raises:
        InputError: the key is no dotted key or sets them; ``instead`` says what chooses the people.
    """
    tree: dict[str, Any] = {}
    apply_setting(tree, Setting(key, None, source))
    section = tree.get("experiment", {})
    if section is None or {"seed", "pairs"} & section.keys():
        problem = "is the same for all candidates, who meet the same people"
        raise InputError(f"{source} {key}", problem, f"another key; {instead}")


def scenario_of(file: ScenarioFile, settings: Sequence[Setting], pairs: range) -> Scenario:
    """The checked scenario of one candidate.

    Raises:
        InputError: it is refused, is not a scenario of encounters, or lacks a pair.
    """
    scenario = file.scenario(settings)
    if section := kind_of(scenario).section:
        raise InputError(file.source, f"has {section}", "a scenario of encounters")
    if (drawn := len(scenario.pedestrians.drawn)) and pairs.stop > drawn:
        raise InputError("pairs", f"pair {pairs.stop - 1}", f"at most {drawn} pairs are drawn")
    return scenario


def _numbers(pairs: int | range) -> range:
    if not isinstance(pairs, range):
        return range(whole_number("pairs", pairs, 1))
    if not pairs or pairs.step != 1 or pairs.start < 0:
        raise InputError("pairs", f"{pairs!r} is not accepted", "a range of numbers from 0, step 1")
    return pairs


def _reported(findings: Findings, intervals: bool) -> dict[str, Any]:
    row = row_of(ENCOUNTERS, findings)
    kept = row if intervals else [name for name in findings if name != "confidence"]
    return {name: math.nan if row[name] is None else row[name] for name in kept}


def _wall_times(decisions_s: FloatArray) -> tuple[float | None, float | None]:
    """Mean and 99 % quantile in s; None if nothing was decided."""
    if not len(decisions_s):
        return None, None
    return float(decisions_s.mean()), float(np.quantile(decisions_s, 0.99))
