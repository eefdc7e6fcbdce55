"""What a finished risk leaves: its result, its events, and a scenario of the likeliest of them."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import tomlkit

from harness.comparison.intervals import CONFIDENCE
from harness.files import write_file
from harness.results.tables import write_parquet
from harness.risk.asking import Settings
from harness.risk.episodes import Question
from harness.risk.estimation import Findings
from harness.risk.running import Compared, Evaluation
from harness.risk.ways import drawn_of, people_of, ways_of
from harness.seeding import GIVEN_DRAWS

RESULT = "result.json"

_CRITICAL_OF_EACH_WAY = 20
_DIFFERENCES_KEPT = 10


def write_findings(
    folder: Path,
    settings: Settings,
    question: Question,
    findings: Findings,
    evaluation: Evaluation,
    compared: Compared,
    rng: np.random.Generator,
) -> None:
    """Write ``failures.parquet``, ``critical.toml`` where there was an event, ``result.json`` last.

    Args:
        folder: of the risk.
        settings: what was asked.
        question: the same for the workers.
        findings: what the sampling came to.
        evaluation: counted the episodes.
        compared: what came of those run in both engines.
        rng: starts the search for ways.
    """
    numbers = findings.numbers.tolist()
    ways = _ways(question, findings, numbers, rng)
    _write_failures(folder, question, findings, numbers)
    if ways:
        _write_critical(folder, question, findings, numbers, ways)
    result = _result(settings, question, findings, evaluation, compared, ways)
    write_file(folder / RESULT, as_json(result))


def as_json(document: Mapping[str, Any]) -> bytes:
    """A document as the risk's files hold it."""
    return (json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()


def figures(findings: Findings) -> dict[str, Any]:
    """The estimate as the result holds it, with the bound on what the exploration did not find."""
    estimate, p = findings.estimate, findings.estimate.probability
    cv = estimate.coefficient_of_variation
    return {
        "by_brute_force": not findings.proposal.components,
        "probability": p,
        "ci_low": estimate.ci_low,
        "ci_high": estimate.ci_high,
        "nominal_high": estimate.nominal.high,
        "nominal_draws": estimate.nominal.draws,
        "nominal_events": estimate.nominal.events,
        "confidence": CONFIDENCE,
        "coefficient_of_variation": cv,
        "effective_sample_size": estimate.effective_sample_size,
        "episodes": findings.episodes,
        "brute_force_episodes": None if p is None or not cv else math.ceil((1 - p) / p / cv**2),
        "draws": estimate.draws,
        "events": estimate.events,
        "events_in_all": findings.events_in_all,
        "first_look_draws": findings.first_look.draws,
        "first_look_events": findings.first_look.events,
    }


def _result(
    settings: Settings,
    question: Question,
    findings: Findings,
    evaluation: Evaluation,
    compared: Compared,
    ways: list[dict[str, Any]],
) -> dict[str, Any]:
    p, failed = findings.estimate.probability, len(evaluation.reasons)
    nothing_known = failed == evaluation.episodes
    worst = findings.failed_weight + (p or 0.0)
    warnings = list(findings.warnings)
    if failed:
        warnings.append(
            f"{failed:,} of {evaluation.episodes:,} episodes failed and count as no event, "
            f"e.g. {evaluation.reasons[0]}"
        )
    by_chance = list(question.space.by_chance)
    if evaluation.drew_more:
        by_chance.append(
            f"what the strategy draws after its first {GIVEN_DRAWS} random numbers (it does in "
            f"{evaluation.drew_more:,} of {evaluation.episodes:,} episodes)"
        )
    if by_chance:
        warnings.append(
            f"left to chance, not sampled: {'; '.join(by_chance)}. Ways to the event that need "
            "rare values of it are found by chance alone"
        )
    if compared.differs:
        warnings.append(
            f"plain engine and SUMO disagree in {len(compared.differs)} of {compared.episodes} "
            "episodes"
        )
    return {
        "scenario": settings.name,
        "arm": settings.arm.value,
        "strategy": settings.scenario.arms.driver(settings.arm),
        "event": settings.event,
        **figures(findings),
        **({"ci_high": 1.0, "nominal_high": 1.0} if nothing_known else {}),
        "probability_worst": min(1.0, worst) if failed or p else None,
        "failed": failed,
        "timed_out": evaluation.timed_out,
        "compared_with_other_engine": compared.episodes,
        "differing": len(compared.differs),
        "differences": compared.differs[:_DIFFERENCES_KEPT],
        "differing_by_a_tie": len(compared.ties),
        "ties": compared.ties[:_DIFFERENCES_KEPT],
        "levels": [list(exploration.levels) for exploration in findings.explorations],
        "ways": ways,
        "warnings": warnings,
    }


def _ways(
    question: Question, findings: Findings, numbers: list[int], rng: np.random.Generator
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
