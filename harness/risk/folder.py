"""A risk from question to folder: begun, interrupted, gone on with, finished.

The folder holds ``risk.json`` (what was asked), ``result.json``, ``failures.parquet`` (the draws
that ended in the event, with their weights) and ``critical.toml``: a scenario whose pairs are the
likeliest of them, on which any strategy can be run.
"""

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from harness.documents import check_form, parse_json
from harness.encounter import Arm
from harness.errors import HarnessError, InputError, InterruptedRunError, resume_command
from harness.files import read_file, write_file
from harness.results.run_folder import RunFolder, claim_folder
from harness.risk.asking import Settings, question_of
from harness.risk.episodes import Question
from harness.risk.estimation import estimate_probability
from harness.risk.forms import AskedForm, ResultForm
from harness.risk.running import Evaluation, Progress
from harness.risk.writing import RESULT, as_json, write_findings
from harness.scenario import validate
from harness.seeding import resampling
from harness.workers.pool import LocalPool, default_workers
from harness.workers.tasks import Executor, ExecutorLostError

ASKED = "risk.json"

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
        settings: what is asked.
        out: the folder; default ``runs/<name>-risk-<next free number>``.
        workers: processes; default: all cores.  Results do not depend on it.
        progress: told how far each batch is.
        make_executor: makes what runs the episodes, for a number of workers.

    Returns:
        The folder.

    Raises:
        InputError: scenario, strategy or event are refused; nothing has been written then.
    """
    question = question_of(settings)
    folder = claim_folder(out, f"{settings.name}-risk")
    if (folder / ASKED).exists():
        raise InputError(f"--out {folder}", "holds a risk already", "a new or empty folder")
    with _held(folder):
        write_file(folder / ASKED, as_json(settings.document()))
        _carry_out(folder, settings, question, workers, progress, make_executor)
    return folder


def resume_risk(
    folder: Path,
    *,
    workers: int | None = None,
    progress: Progress = lambda _done, _planned, _what: None,
    make_executor: MakeExecutor | None = None,
) -> None:
    """Go on with a risk that was interrupted; nothing is done where it is finished.

    Raises:
        InputError: the folder holds no risk, or versions or model differ.
    """
    with _held(folder):
        document = read_risk(folder, ASKED)
        settings = Settings(
            document["name"],
            validate(document["scenario"], ASKED),
            Arm(document["arm"]),
            document["event"],
            document["target_cv"],
            document["most_episodes"],
            document["in_sumo"],
        )
        if document != json.loads(as_json(settings.document())):
            raise InputError(
                str(folder), "was begun with other versions or another model", "the same ones"
            )
        if not (folder / RESULT).is_file():
            question = question_of(settings)
            _carry_out(folder, settings, question, workers, progress, make_executor)


def read_risk(folder: Path, name: str = RESULT) -> dict[str, Any]:
    """What ``risk.json`` or ``result.json`` of a folder holds.

    Raises:
        InputError: there is none, the risk is not finished, the file is damaged, or it is of a
            version that did not bound the ways to the event that the exploration did not find.
    """
    if not (folder / name).is_file():
        if name == RESULT and (folder / ASKED).is_file():
            raise InputError(str(folder), "is not finished", resume_command(folder))
        raise InputError(str(folder), f"has no {name}", "a folder of harness risk")
    try:
        document: dict[str, Any] = parse_json(read_file(folder / name))
    except ValueError as error:
        what = f"is damaged ({error})"
        raise InputError(str(folder / name), what, "as harness risk writes it") from None
    if isinstance(document, dict) and "events" in document and "nominal_high" not in document:
        raise InputError(str(folder), "is of an earlier harness risk", "one estimated again")
    check_form(ResultForm if name == RESULT else AskedForm, document, str(folder / name))
    return document


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    if not folder.is_dir():
        raise InputError(str(folder), "is no folder", "a folder of harness risk")
    lock = RunFolder(folder)
    try:
        yield
    except KeyboardInterrupt:
        raise InterruptedRunError(folder) from None
    except ExecutorLostError as error:
        raise HarnessError(f"{error}; what is finished is kept: {resume_command(folder)}") from None
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
        LocalPool(count, imports="harness.risk.episodes")
        if make_executor is None
        else make_executor(count)
    )
    try:
        evaluation = Evaluation(question, folder / _BATCHES, executor, progress)
        rng = resampling(settings.scenario.experiment.seed, "risk")
        layout = question.space.layout
        findings = estimate_probability(
            evaluation, layout, rng, settings.target_cv, settings.most_episodes
        )
        compared = evaluation.compare(findings.z, findings.numbers)
    finally:
        executor.stop()
    write_findings(folder, settings, question, findings, evaluation, compared, rng)
    shutil.rmtree(folder / _BATCHES)
