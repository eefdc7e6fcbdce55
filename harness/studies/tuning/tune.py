"""Carries out a search in a folder: trials, the verdict on fresh pairs, and the best scenario.

The folder has ``tune.json`` (what is searched), ``trials.jsonl`` (a line for each finished trial),
``result.json`` and, if a trial keeps every limit, ``best.toml``, a scenario to run.
"""

import json
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import tomlkit

from harness.core.documents import JsonObject, parse_json
from harness.core.errors import HarnessError, InputError, InterruptedRunError
from harness.core.files import read_file, write_file
from harness.core.versions import versions_of_runs
from harness.model.interaction import load_model
from harness.scenario import Cell, EngineName, Scenario, ScenarioFile, Setting
from harness.statistics import ENCOUNTERS, EncounterColumns, Finding
from harness.statistics.entries import Entry, Form
from harness.statistics.limits import ONE_SIDED, Shown
from harness.store.kinds import kind_of
from harness.store.reading import MANIFEST, RISK
from harness.store.run_folder import RunFolder, claim_folder
from harness.strategies.registry import source_digests
from harness.studies.candidates.evaluation import scenarios_of
from harness.studies.candidates.session import Session
from harness.studies.tuning.search import (
    Goal,
    Parameter,
    Trial,
    best_of,
    front_of,
    import_optuna,
    next_candidate,
)
from harness.studies.workers.tasks import ExecutorLostError

SETTINGS, TRIALS, RESULT, BEST = "tune.json", "trials.jsonl", "result.json", "best.toml"

NAMES = {
    name
    for entry in ENCOUNTERS
    if entry.form is not Form.WORD and entry.key != "confidence"
    for name in filter(None, entry.names)
}
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
        (scenario,) = scenarios_of(
            replace(self.file, settings=(*self.file.settings, *settings)),
            [{}],
            range(self.pairs + self.fresh),
        )
        return scenario

    def document(self) -> JsonObject:
        """Everything that determines the trials, as ``tune.json`` has it."""
        scenario = self.file.scenario()
        model = load_model(*scenario.model.file_and_refits)
        named = {*scenario.arms.model_dump().values()}
        return {
            "scenario": scenario.model_dump(mode="json"),
            "parameters": [asdict(parameter) for parameter in self.parameters],
            "goal": asdict(self.goal),
            "pairs": self.pairs,
            "engine": self.engine,
            "model": model.sha256,
            "versions": {**versions_of_runs(), "optuna": import_optuna().__version__},
            "strategies": source_digests(named),
        }


@dataclass(frozen=True)
class Judged:
    """The result: all trials, the best one, and what fresh pairs show of it.

    ``findings`` are those of the best trial on the fresh pairs, with intervals whose ends are
    one-sided 95 % bounds.
    """

    folder: Path
    trials: tuple[Trial, ...]
    front: tuple[Trial, ...]
    best: Trial | None
    findings: dict[str, Finding]
    verdicts: dict[str, tuple[Shown, str]]


def tune(
    search: Search,
    *,
    out: Path | None,
    workers: int | None,
    progress: Callable[[int, int, str], None],
) -> Judged:
    """Search, or go on with an interrupted search of the same folder, and judge the best trial.

    Raises:
        InputError: something is refused, or the folder holds another search.
    """
    document = json.loads(json.dumps(search.document()))
    with Session(workers, search.engine) as session:
        _check(search, session)
        folder = claim_folder(out, f"{search.file.name}-tune")
        with _held(folder):
            trials = _begun(folder, document)[: search.trials]
            while len(trials) < search.trials:
                trials.append(_trial(search, trials, session))
                _write_trials(folder, trials)
                progress(len(trials), search.trials, "trials")
            return _judged(folder, search, trials, session)


def _check(search: Search, session: Session) -> None:
    """Refuse what the strategy refuses at either end of the ranges, before anything is written."""
    for end in ("low", "high"):
        ends = {
            parameter.key: int(value) if parameter.whole else value
            for parameter in search.parameters
            for value in [getattr(parameter, end)]
        }
        session.drive([search.scenario(ends)], range(1))


def _begun(folder: Path, document: JsonObject) -> list[Trial]:
    path = folder / SETTINGS
    if any((folder / other).is_file() for other in (MANIFEST, RISK)):
        raise InputError(f"--out {folder}", "holds something else", "a new folder")
    if not path.is_file():
        write_file(path, _json(document))
        return []
    try:
        before = parse_json(read_file(path))
        lines = (folder / TRIALS).read_text().splitlines() if (folder / TRIALS).is_file() else []
        trials = [Trial(**parse_json(line)) for line in lines]
    except (ValueError, TypeError) as error:
        raise InputError(
            str(folder), f"is damaged ({error})", "as harness tune writes it"
        ) from None
    if before != document:
        changed = next(key for key in document if before.get(key) != document[key])
        problem = f"holds another search ({changed} differs)"
        raise InputError(f"--out {folder}", problem, "the same command, or a new folder")
    return trials


def _trial(search: Search, trials: Sequence[Trial], session: Session) -> Trial:
    seed = search.file.scenario().experiment.seed
    candidate = next_candidate(search.parameters, search.goal, trials, seed)
    number = len(trials)
    try:
        found = _findings(search, candidate, range(search.pairs), session, 0.0)
    except InputError as error:
        return Trial(number, candidate, {}, str(error))
    numbers = {name: found[name].number for name in search.goal.names}
    return Trial(number, candidate, numbers)


def _findings(
    search: Search, candidate: JsonObject, pairs: range, session: Session, confidence: float
) -> dict[str, Finding]:
    scenario = search.scenario(candidate)
    (driven,) = session.drive([scenario], pairs)
    return kind_of(scenario).findings(driven.rows, Cell(0, {}, scenario), confidence)


def _judged(folder: Path, search: Search, trials: Sequence[Trial], session: Session) -> Judged:
    best, goal = best_of(search.goal, trials), search.goal
    findings: dict[str, Finding] = {}
    if best is not None:
        fresh = range(search.pairs, search.pairs + search.fresh)
        found = _findings(search, dict(best.candidate), fresh, session, ONE_SIDED)
        findings = {name: found[name] for name in (*goal.names, "failed", "timed_out_av")}
        tree = search.scenario(dict(best.candidate)).model_dump(mode="json", exclude_none=True)
        write_file(folder / BEST, tomlkit.dumps(tree).encode())
    verdicts = {str(limit): limit.judged(findings[limit.name]) for limit in goal.limits if findings}
    front = tuple(front_of(goal, trials))
    judged = Judged(folder, tuple(trials), front, best, findings, verdicts)
    write_file(folder / RESULT, _json(result_document(judged)))
    return judged


def result_document(judged: Judged) -> JsonObject:
    """The content of ``result.json`` and the output of ``--json``."""
    return {
        "trials": len(judged.trials),
        "best": None if judged.best is None else asdict(judged.best),
        "front_of_search_data": [trial.number for trial in judged.front],
        "fresh": {name: asdict(found) for name, found in judged.findings.items()},
        "verdicts": {
            limit: {"verdict": shown.value, "reason": reason}
            for limit, (shown, reason) in judged.verdicts.items()
        },
    }


def entry_of(name: str) -> Entry[EncounterColumns]:
    """The entry of the catalogue that has a number."""
    return next(entry for entry in ENCOUNTERS if name in entry.names)


def _write_trials(folder: Path, trials: Sequence[Trial]) -> None:
    lines = (json.dumps(asdict(trial), allow_nan=False) + "\n" for trial in trials)
    write_file(folder / TRIALS, "".join(lines).encode())


def _json(document: JsonObject) -> bytes:
    return (json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    lock = RunFolder(folder)
    try:
        yield
    except KeyboardInterrupt:
        again = f"the same command with --out {shlex.quote(str(folder))}"
        raise InterruptedRunError(folder, again) from None
    except ExecutorLostError as error:
        raise HarnessError(f"{error}; finished trials are kept in {folder}") from None
    finally:
        lock.close()
