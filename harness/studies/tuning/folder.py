"""A search, its folder, and its result read from there.

The folder has ``tune.json`` (what is searched), ``trials.jsonl`` (a line for each finished trial),
``result.json`` and, if a trial keeps every limit, ``best.toml``, a scenario to run.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from harness.core.documents import JsonObject, parse_json
from harness.core.errors import InputError, resume_command
from harness.core.files import read_file, write_file
from harness.core.versions import versions_of_runs
from harness.model.interaction import load_model
from harness.scenario import EngineName, Scenario, ScenarioFile, Setting
from harness.statistics import ENCOUNTERS, EncounterColumns, Finding
from harness.statistics.entries import Entry
from harness.statistics.limits import (
    JudgedLimit,
    Limit,
    all_judged,
    binding,
    numbers_of,
    unless_failed,
)
from harness.store.reading import TUNE
from harness.strategies.registry import source_digests
from harness.studies.candidates.evaluation import scenario_of
from harness.studies.tuning.search import (
    Goal,
    Parameter,
    Trial,
    best_of,
    front_of,
    import_optuna,
)

TRIALS, RESULT = "trials.jsonl", "result.json"

FREE = ("name", "budget")
"""Keys of ``tune.json`` that do not determine the trials."""

NAMES = numbers_of(ENCOUNTERS)
"""The numbers that can be searched and limited."""


@dataclass(frozen=True)
class Search:
    """What is searched: pairs 0 to ``pairs`` − 1 steer, the ``fresh`` pairs after them judge."""

    file: ScenarioFile
    parameters: tuple[Parameter, ...]
    goal: Goal
    trials: int
    pairs: int
    fresh: int
    engine: EngineName = "sumo"

    def scenario(self, candidate: JsonObject) -> Scenario:
        """The checked scenario of a candidate."""
        settings = [Setting(key, value, "--parameter") for key, value in candidate.items()]
        return scenario_of(self.file, settings, range(self.pairs + self.fresh))

    def document(self) -> JsonObject:
        """The search as ``tune.json`` has it: all except ``FREE`` determines the trials."""
        scenario = self.file.scenario()
        model = load_model(*scenario.model.file_and_refits)
        named = {*scenario.arms.model_dump().values()}
        return {
            "name": self.file.name,
            "scenario": scenario.model_dump(mode="json"),
            "parameters": [asdict(parameter) for parameter in self.parameters],
            "goal": asdict(self.goal),
            "pairs": self.pairs,
            "budget": {"trials": self.trials, "fresh": self.fresh},
            "engine": self.engine,
            "model": model.sha256,
            "versions": {**versions_of_runs(), "optuna": import_optuna().__version__},
            "strategies": source_digests(named),
        }


@dataclass(frozen=True)
class Judged:
    """The result: all trials, the best one, and what fresh pairs show of it.

    ``findings`` are those of the best trial on the fresh pairs, with intervals whose ends are
    one-sided 95 % bounds.  ``fresh`` is the number of these pairs, and ``failure`` the first
    failure among them.
    """

    folder: Path
    fresh: int
    trials: tuple[Trial, ...]
    front: tuple[Trial, ...]
    best: Trial | None
    findings: dict[str, Finding]
    failure: str | None
    goal: Goal

    @property
    def failed_av(self) -> int:
        """The number of the AV's fresh episodes that failed."""
        return self.findings["failed_av"].count if self.findings else 0

    @property
    def any_failed(self) -> bool:
        """Whether an episode of a trial or of the fresh pairs failed."""
        return any((self.failure, *(trial.failure for trial in self.trials)))

    @property
    def verdicts(self) -> tuple[JudgedLimit, ...]:
        """Each limit with its verdict; empty without a best trial."""
        if not self.findings:
            return ()
        return unless_failed(all_judged(self.goal.limits, self.findings), self.failed_av)


def judged_of(
    folder: Path,
    search: Search,
    trials: Sequence[Trial],
    findings: dict[str, Finding],
    failure: str | None,
) -> Judged:
    """The result of finished trials, with findings and first failure of the best on fresh pairs."""
    goal = search.goal
    best, front = best_of(goal, trials), tuple(front_of(goal, trials))
    return Judged(folder, search.fresh, tuple(trials), front, best, findings, failure, goal)


def read_search(folder: Path) -> Search:
    """The search of a folder, with its budget.

    Raises:
        InputError: ``tune.json`` is missing or damaged.
    """
    try:
        document = parse_json(read_file(folder / TUNE))
        goal, budget = document["goal"], document["budget"]
        limits = tuple(Limit(**limit) for limit in goal["limits"])
        return Search(
            ScenarioFile(document["name"], TUNE, document["scenario"], None, (), folder),
            tuple(Parameter(**parameter) for parameter in document["parameters"]),
            Goal(goal["objective"], goal["direction"], limits),
            budget["trials"],
            document["pairs"],
            budget["fresh"],
            document["engine"],
        )
    except (ValueError, TypeError, KeyError) as error:
        raise _damaged(folder, error) from None


def read_trials(folder: Path) -> list[Trial]:
    """The finished trials of a folder.

    Raises:
        InputError: they are damaged.
    """
    path = folder / TRIALS
    try:
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        return [Trial(**parse_json(line)) for line in lines]
    except (ValueError, TypeError) as error:
        raise _damaged(folder, error) from None


def is_finished(folder: Path, search: Search) -> bool:
    """Whether ``result.json`` is that of the search's budget."""
    result = _read_result(folder)
    return (result.get("trials"), result.get("fresh_pairs")) == (search.trials, search.fresh)


def read_judged(folder: Path, search: Search) -> Judged:
    """The result of a finished search.

    Raises:
        InputError: it is not finished or damaged.
    """
    if not is_finished(folder, search):
        raise InputError(str(folder), "is not finished", f"`{resume_command(folder)}` finishes it")
    try:
        result = _read_result(folder)
        findings = {name: Finding(**found) for name, found in result["fresh"].items()}
        trials = read_trials(folder)[: search.trials]
        return judged_of(folder, search, trials, findings, result["fresh_failure"])
    except (AttributeError, TypeError, KeyError) as error:
        raise _damaged(folder, error) from None


def _read_result(folder: Path) -> JsonObject:
    path = folder / RESULT
    try:
        return parse_json(read_file(path)) if path.is_file() else {}
    except ValueError as error:
        raise _damaged(folder, error) from None


def _damaged(folder: Path, error: Exception) -> InputError:
    return InputError(str(folder), f"is damaged ({error})", "as harness tune writes it")


def result_document(judged: Judged) -> JsonObject:
    """The content of ``result.json`` and the output of ``--json``."""
    binds = binding(judged.verdicts)
    return {
        "trials": len(judged.trials),
        "fresh_pairs": judged.fresh,
        "best": None if judged.best is None else asdict(judged.best),
        "front_of_search_data": [trial.number for trial in judged.front],
        "fresh": {name: asdict(found) for name, found in judged.findings.items()},
        "fresh_failure": judged.failure,
        "verdicts": {
            str(each.limit): {"verdict": each.shown.value, "reason": each.reason}
            for each in judged.verdicts
        },
        "binding": None if binds is None else str(binds.limit),
    }


def entry_of(name: str) -> Entry[EncounterColumns]:
    """The entry of the catalogue that has a number."""
    return next(entry for entry in ENCOUNTERS if name in entry.names)


def write_trials(folder: Path, trials: Sequence[Trial]) -> None:
    """Write a line for each finished trial."""
    lines = (json.dumps(asdict(trial), allow_nan=False) + "\n" for trial in trials)
    write_file(folder / TRIALS, "".join(lines).encode())


def as_json(document: JsonObject) -> bytes:
    """A document as the folder's files have it."""
    return (json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()
