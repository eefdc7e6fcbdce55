"""Takes the settings of a risk estimate and writes its folder, or resumes it.

The folder contains ``risk.json`` (the settings), ``result.json`` (the findings),
``failures.parquet`` (the draws that ended in the event, with their weights) and ``critical.toml``.
The last is a scenario whose pairs are the likeliest of these draws.  Any strategy can run on it.
"""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from harness.core.documents import Form, check_form, parse_json
from harness.core.errors import HarnessError, InputError, InterruptedRunError, resume_command
from harness.core.files import read_file, write_file
from harness.core.seeding import resampling
from harness.old.studies.risk.asking import Question, Settings, SettingsDocument, question_of
from harness.old.studies.risk.estimation import estimate_probability
from harness.old.studies.risk.findings import RiskFindings
from harness.old.studies.risk.running import Evaluation, Progress
from harness.old.studies.risk.writing import RESULT, as_json, write_findings
from harness.old.studies.workers.executor import Executor, ExecutorLostError
from harness.old.studies.workers.pool import LocalPool, default_workers
from harness.results.folder import RunFolder, claim_folder

RISK = "risk.json"
"""The settings of a risk estimate, in its folder."""

_BATCHES = "batches"

MakeExecutor = Callable[[int], Executor]


def estimate_risk(
    settings: Settings,
    *,
    out: Path | None = None,
    workers: int | None = None,
    progress: Progress = lambda _done, _planned, _what: None,
    make_executor: MakeExecutor | None = None,
) -> Path:
    """Estimate the probability that an episode ends in the event.

    Args:
        settings: the user's settings.
        out: the folder; default ``runs/<name>-risk-<next free number>``.
        workers: number of processes; default: all cores.  Results do not depend on it.
        progress: called with the progress of each batch.
        make_executor: makes the executor of the episodes for a number of workers.

    Returns:
        The folder.

    Raises:
        InputError: the scenario, strategy or event is invalid; nothing has been written.
    """
    question = question_of(settings)
    folder = claim_folder(out, f"{settings.name}-risk")
    with _held(folder):
        write_file(folder / RISK, as_json(settings.document().model_dump(mode="json")))
        _carry_out(folder, settings, question, workers, progress, make_executor)
    return folder


def resume_risk(
    folder: Path,
    *,
    workers: int | None = None,
    progress: Progress = lambda _done, _planned, _what: None,
    make_executor: MakeExecutor | None = None,
) -> None:
    """Continue an interrupted risk estimate.  A finished one stays as it is.

    Raises:
        InputError: the folder has no risk estimate, or versions or the model differ.
    """
    with _held(folder):
        document = read_settings(folder)
        settings = document.settings(RISK)
        if document != settings.document():
            raise InputError(
                str(folder), "was begun with other versions or another model", "the same versions"
            )
        if not (folder / RESULT).is_file():
            _carry_out(folder, settings, question_of(settings), workers, progress, make_executor)


def read_settings(folder: Path) -> SettingsDocument:
    """Read ``risk.json`` of a folder.

    Raises:
        InputError: the file is missing or damaged.
    """
    return _read(folder, RISK, SettingsDocument)


def read_risk(folder: Path) -> RiskFindings:
    """Read the findings of a finished risk estimate.

    Raises:
        InputError: the folder has no finished risk estimate, or ``result.json`` is damaged.
    """
    if (folder / RISK).is_file() and not (folder / RESULT).is_file():
        raise InputError(str(folder), "is not finished", resume_command(folder))
    return _read(folder, RESULT, RiskFindings)


def _read(folder: Path, name: str, form: type[Form]) -> Form:
    path = folder / name
    if not path.is_file():
        raise InputError(str(folder), f"has no {name}", "a folder of harness risk")
    try:
        document = parse_json(read_file(path))
    except ValueError as error:
        raise InputError(str(path), f"is damaged ({error})", "as harness risk writes it") from None
    return check_form(form, document, str(path))


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    if not folder.is_dir():
        raise InputError(str(folder), "is not a folder", "a folder of harness risk")
    lock = RunFolder(folder)
    try:
        yield
    except KeyboardInterrupt:
        raise InterruptedRunError(folder) from None
    except ExecutorLostError as error:
        raise HarnessError(f"{error}; finished work is kept: {resume_command(folder)}") from None
    finally:
        lock.close()


def _carry_out(
    folder: Path,
    settings: Settings,
    question: Question,
    workers: int | None,
    progress: Progress,
    make_executor: MakeExecutor | None,
) -> None:
    count = workers or default_workers()
    executor = (
        LocalPool(count, imports="harness.old.studies.risk.episodes")
        if make_executor is None
        else make_executor(count)
    )
    try:
        evaluation = Evaluation(question, folder / _BATCHES, executor, progress)
        rng = resampling(settings.scenario.experiment.seed, "risk")
        layout = question.space.layout
        estimation = estimate_probability(
            evaluation, layout, rng, settings.target_cv, settings.most_episodes
        )
        evaluation.tell(estimation.z, estimation.numbers)
    finally:
        executor.stop()
    write_findings(folder, settings, estimation, evaluation, rng)
    shutil.rmtree(folder / _BATCHES)
