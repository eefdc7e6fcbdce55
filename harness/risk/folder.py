"""A risk from question to folder: begun, interrupted, gone on with, finished.

The folder holds ``risk.json`` (what was asked), ``result.json``, ``failures.parquet`` (the draws
that ended in the event, with their weights) and ``critical.toml``: a scenario whose pairs are the
likeliest of them, on which any strategy can be run.
"""

import json
import math
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import tomlkit

from harness.comparison.intervals import CONFIDENCE
from harness.encounter import Arm
from harness.engine.installation import check_packages
from harness.episode.arms import check_arms
from harness.errors import HarnessError, InputError, InterruptedRunError, resume_command
from harness.files import write_file
from harness.interaction import load_model
from harness.results.run_folder import RunFolder, claim_folder
from harness.results.tables import write_parquet
from harness.risk.episodes import Question
from harness.risk.estimation import Findings, estimate_probability
from harness.risk.event import parse_event
from harness.risk.running import Evaluation, Progress
from harness.risk.space import space_of
from harness.risk.ways import drawn_of, people_of, ways_of
from harness.scenario import Scenario, validate
from harness.seeding import resampling
from harness.strategies.registry import source_digests
from harness.versions import versions_of_runs
from harness.workers.pool import LocalPool, default_workers
from harness.workers.tasks import Executor, ExecutorLostError

ASKED = "risk.json"
RESULT = "result.json"

_BATCHES = "batches"
_CRITICAL_OF_EACH_WAY = 20
_DIFFERENCES_KEPT = 10

MakeExecutor = Callable[[int], Executor]


@dataclass(frozen=True)
class Settings:
    """What is asked; ``event`` as ``parse_event`` reads it, ``most_episodes`` of the last stage."""

    name: str
    scenario: Scenario
    arm: Arm = Arm.AV
    event: str = "crashed"
    target_cv: float = 0.1
    most_episodes: int = 200_000
    in_sumo: bool = False

    def document(self) -> dict[str, Any]:
        """What ``risk.json`` holds: all that the result depends on."""
        model = load_model(self.scenario.model.name, self.scenario.model.path)
        driver = self.scenario.arms.model_dump()[self.arm.value]
        return {
            "name": self.name,
            "scenario": self.scenario.model_dump(),
            "arm": self.arm.value,
            "event": self.event,
            "target_cv": self.target_cv,
            "most_episodes": self.most_episodes,
            "in_sumo": self.in_sumo,
            "seed": self.scenario.experiment.seed,
            "versions": {**versions_of_runs(), **source_digests({driver})},
            "model": {"name": model.name, "sha256": model.sha256},
        }


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
        write_file(folder / ASKED, _json(settings.document()))
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
        try:
            settings = Settings(
                document["name"],
                validate(document["scenario"], ASKED),
                Arm(document["arm"]),
                document["event"],
                document["target_cv"],
                document["most_episodes"],
                document["in_sumo"],
            )
        except (KeyError, ValueError):
            raise InputError(
                str(folder / ASKED), "is damaged", "as harness risk writes it"
            ) from None
        if document != json.loads(_json(settings.document())):
            raise InputError(
                str(folder), "was begun with other versions or another model", "the same ones"
            )
        if not (folder / RESULT).is_file():
            question = question_of(settings)
            _carry_out(folder, settings, question, workers, progress, make_executor)


def read_risk(folder: Path, name: str = RESULT) -> dict[str, Any]:
    """What ``risk.json`` or ``result.json`` of a folder holds.

    Raises:
        InputError: there is none, or it is damaged.
    """
    try:
        document = json.loads((folder / name).read_text(encoding="utf-8"))
    except OSError:
        raise InputError(str(folder), f"has no {name}", "a folder of harness risk") from None
    except ValueError:
        raise InputError(str(folder / name), "is damaged", "as harness risk writes it") from None
    if not isinstance(document, dict):
        raise InputError(str(folder / name), "is damaged", "as harness risk writes it")
    return document


def question_of(settings: Settings) -> Question:
    """The question, with everything that a user may have got wrong refused.

    Raises:
        InputError: naming what.
    """
    check_packages()
    scenario = settings.scenario
    if not 0 < settings.target_cv <= 1:
        raise InputError("--target-cv", f"{settings.target_cv:g}", "above 0, at most 1")
    if settings.most_episodes < 1:
        raise InputError("--most-episodes", f"{settings.most_episodes}", "at least 1")
    driver = scenario.arms.model_dump()[settings.arm.value]
    if driver == "sumo_driver" and not settings.in_sumo:
        raise InputError(
            f"arms.{settings.arm.value}", "sumo_driver drives in SUMO alone", "--engine sumo"
        )
    model = load_model(scenario.model.name, scenario.model.path)
    check_arms(scenario, model)
    event, space = parse_event(settings.event), space_of(scenario)
    return Question(scenario, model, settings.arm, event, space, settings.in_sumo)


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
    numbers = findings.numbers.tolist()
    ways = _ways(question, findings, numbers, rng)
    _write_failures(folder, question, findings, numbers)
    if ways:
        _write_critical(folder, question, findings, numbers, ways)
    write_file(folder / RESULT, _json(_result(settings, findings, evaluation, compared, ways)))
    shutil.rmtree(folder / _BATCHES)


def _result(
    settings: Settings,
    findings: Findings,
    evaluation: Evaluation,
    compared: tuple[int, list[str]],
    ways: list[dict[str, Any]],
) -> dict[str, Any]:
    estimate, p = findings.estimate, findings.estimate.probability
    cv = estimate.coefficient_of_variation
    failed = len(evaluation.reasons)
    warnings = list(findings.warnings)
    if failed:
        warnings.append(
            f"{failed:,} of {evaluation.episodes:,} episodes failed and count as no event, "
            f"e.g. {evaluation.reasons[0]}"
        )
    if compared[1]:
        warnings.append(
            f"plain engine and SUMO disagree in {len(compared[1])} of {compared[0]} episodes"
        )
    return {
        "scenario": settings.name,
        "arm": settings.arm.value,
        "strategy": settings.scenario.arms.model_dump()[settings.arm.value],
        "event": settings.event,
        "probability": p,
        "ci_low": estimate.ci_low,
        "ci_high": estimate.ci_high,
        "confidence": CONFIDENCE,
        "probability_worst": None if p is None else min(1.0, p + findings.failed_weight),
        "coefficient_of_variation": cv,
        "effective_sample_size": estimate.effective_sample_size,
        "episodes": evaluation.episodes,
        "brute_force_episodes": None if p is None or not cv else math.ceil((1 - p) / p / cv**2),
        "draws": estimate.draws,
        "events": estimate.events,
        "failed": failed,
        "timed_out": evaluation.timed_out,
        "compared_with_other_engine": compared[0],
        "differences": compared[1][:_DIFFERENCES_KEPT],
        "levels": [list(exploration.levels) for exploration in findings.explorations],
        "ways": ways,
        "warnings": warnings,
    }


def _ways(
    question: Question, findings: Findings, numbers: list[int], rng: Any
) -> list[dict[str, Any]]:
    if not numbers:
        return []
    return [
        {
            "share": way.share,
            "events": len(way.members),
            "episode": numbers[way.members[0]],
            "pedestrians": people_of(
                question.scenario,
                question.space,
                numbers[way.members[0]],
                findings.z[way.members[0]],
            ),
            "critical": list(way.members[:_CRITICAL_OF_EACH_WAY]),
        }
        for way in ways_of(findings.keys, findings.weights, rng)
    ]


def _write_failures(
    folder: Path, question: Question, findings: Findings, numbers: list[int]
) -> None:
    given = [question.space.given(z, number) for z, number in zip(findings.z, numbers, strict=True)]
    columns: dict[str, Any] = {"episode": numbers, "weight": findings.weights}
    for purpose in sorted({purpose for uniforms in given for purpose in uniforms}):
        lists = [list(uniforms.get(purpose, ())) for uniforms in given]
        columns[purpose] = pa.array(lists, pa.list_(pa.float64()))
    table = pa.table(columns)
    write_parquet(folder / "failures.parquet", table.schema, iter([table]))


def _write_critical(
    folder: Path,
    question: Question,
    findings: Findings,
    numbers: list[int],
    ways: list[dict[str, Any]],
) -> None:
    """The scenario of the likeliest ways; each way's pairs are named in the result."""
    drawn, first = [], 0
    for way in ways:
        members = way.pop("critical")
        drawn += [drawn_of(question.space, numbers[k], findings.z[k]) for k in members]
        way["critical_pairs"] = [first, first + len(members) - 1]
        first += len(members)
    tree = question.scenario.model_dump(exclude_none=True)
    tree["pedestrians"]["drawn"] = drawn
    tree["experiment"]["pairs"] = len(drawn)
    write_file(folder / "critical.toml", tomlkit.dumps(_plain(tree)).encode())


def _plain(tree: Any) -> Any:
    """A tree with lists in the place of tuples, as TOML writers want it."""
    if isinstance(tree, Mapping):
        return {key: _plain(value) for key, value in tree.items()}
    return [_plain(value) for value in tree] if isinstance(tree, (list, tuple)) else tree


def _json(document: Mapping[str, Any]) -> bytes:
    return (json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()
