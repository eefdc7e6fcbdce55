"""Carries out a search in a folder: trials, the verdict on fresh pairs, and the best scenario."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import tomlkit

from harness.core.documents import JsonObject, parse_json
from harness.core.errors import HarnessError, InputError, InterruptedRunError, resume_command
from harness.core.files import read_file, write_file
from harness.scenario import Cell
from harness.statistics import Finding
from harness.statistics.limits import ONE_SIDED
from harness.store.kinds import kind_of
from harness.store.reading import BEST, TUNE, kind_of_folder
from harness.store.run_folder import RunFolder, claim_folder
from harness.studies.candidates.session import Session
from harness.studies.tuning.folder import (
    FREE,
    RESULT,
    Judged,
    Search,
    as_json,
    is_finished,
    judged_of,
    read_judged,
    read_search,
    read_trials,
    result_document,
    write_trials,
)
from harness.studies.tuning.search import Trial, best_of, next_candidate
from harness.studies.workers.executor import ExecutorLostError


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
    with Session(workers, search.engine) as session:
        _check(search, session)
        begun = out is not None and kind_of_folder(out) == "tune"
        folder = out if begun and out else claim_folder(out, f"{search.file.name}-tune")
        with _held(folder):
            trials = _begun(folder, search)[: search.trials]
            while len(trials) < search.trials:
                trials.append(_trial(search, trials, session))
                write_trials(folder, trials)
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


def resume_tune(
    folder: Path, *, workers: int | None, progress: Callable[[int, int, str], None]
) -> tuple[Search, Judged]:
    """Go on with an interrupted search; a finished one is only read.

    Raises:
        InputError: the folder is damaged, or versions, the model or a strategy differ.
    """
    search = read_search(folder)
    if is_finished(folder, search):
        return search, read_judged(folder, search)
    return search, tune(search, out=folder, workers=workers, progress=progress)


def _begun(folder: Path, search: Search) -> list[Trial]:
    """The finished trials of the same search in this folder; note what is searched now."""
    path, document = folder / TUNE, json.loads(json.dumps(search.document()))
    trials = []
    if path.is_file():
        read_search(folder)
        before = parse_json(read_file(path))
        changed = [key for key in document if before.get(key) != document[key]]
        for key in changed:
            if key not in FREE:
                problem = f"holds another search ({key} differs)"
                raise InputError(str(folder), problem, "the same command, or a new folder")
        trials = read_trials(folder)
        if not changed:
            return trials
    write_file(path, as_json(document))
    return trials


def _trial(search: Search, trials: Sequence[Trial], session: Session) -> Trial:
    seed = search.file.scenario().experiment.seed
    candidate = next_candidate(search.parameters, search.goal, trials, seed)
    number = len(trials)
    try:
        found, failure = _findings(search, candidate, range(search.pairs), session, 0.0)
    except InputError as error:
        return Trial(number, candidate, {}, str(error))
    numbers = {name: found[name].number for name in search.goal.names}
    return Trial(number, candidate, numbers, None, found["failed_av"].count, failure)


def _findings(
    search: Search, candidate: JsonObject, pairs: range, session: Session, confidence: float
) -> tuple[dict[str, Finding], str | None]:
    """The findings of a candidate that the result needs, and its first failure."""
    scenario = search.scenario(candidate)
    (driven,) = session.drive([scenario], pairs)
    names = (*search.goal.names, "failed", "failed_av", "timed_out_av")
    found = kind_of(scenario).findings(driven.rows, Cell(0, {}, scenario), confidence, names)
    return {name: found[name] for name in names}, driven.failure


def _judged(folder: Path, search: Search, trials: Sequence[Trial], session: Session) -> Judged:
    best, findings = best_of(search.goal, trials), dict[str, Finding]()
    failure = None
    if best is None:
        (folder / BEST).unlink(missing_ok=True)
    else:
        fresh = range(search.pairs, search.pairs + search.fresh)
        findings, failure = _findings(search, dict(best.candidate), fresh, session, ONE_SIDED)
        tree = search.scenario(dict(best.candidate)).model_dump(mode="json", exclude_none=True)
        write_file(folder / BEST, tomlkit.dumps(tree).encode())
    judged = judged_of(folder, search, trials, findings, failure)
    write_file(folder / RESULT, as_json(result_document(judged)))
    return judged


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    lock = RunFolder(folder)
    try:
        yield
    except KeyboardInterrupt:
        raise InterruptedRunError(folder) from None
    except ExecutorLostError as error:
        raise HarnessError(f"{error}; finished trials are kept: {resume_command(folder)}") from None
    finally:
        lock.close()
