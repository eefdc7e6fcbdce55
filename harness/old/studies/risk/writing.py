"""Writes a finished risk estimate: its findings, its events and the likeliest events."""

import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import tomlkit

from harness.core.documents import JsonObject
from harness.core.files import write_file
from harness.core.seeding import GIVEN_DRAWS
from harness.old.statistics.findings import Note, Rank
from harness.old.statistics.intervals import CONFIDENCE
from harness.old.store.tables import Row, write_parquet
from harness.old.studies.risk.asking import Question, Settings
from harness.old.studies.risk.estimation import Estimation
from harness.old.studies.risk.findings import SCHEMA, RiskFindings, Way
from harness.old.studies.risk.running import Evaluation
from harness.old.studies.risk.ways import Cluster, drawn_of, people_of, ways_of

RESULT = "result.json"

CRITICAL = "critical.toml"
"""The scenario of the likeliest events, in the folder of a finished risk estimate."""

_CRITICAL_OF_EACH_WAY = 20


def write_findings(
    folder: Path,
    settings: Settings,
    estimation: Estimation,
    evaluation: Evaluation,
    rng: np.random.Generator,
) -> None:
    """Write ``failures.parquet``, ``result.json`` and, if there were events, ``critical.toml``.

    Args:
        folder: folder of the risk estimate.
        settings: the user's settings.
        estimation: the result of the sampling.
        evaluation: counts of episodes, and what is known of the events.
        rng: seeds the clusters of events.
    """
    question = evaluation.question
    clusters = ways_of(estimation.keys, estimation.weights, rng) if estimation.weights.size else []
    _write_failures(folder, question, estimation)
    if clusters:
        _write_critical(folder, question, estimation, clusters)
    findings = findings_of(
        settings, estimation, evaluation, _ways(evaluation, estimation, clusters)
    )
    write_file(folder / RESULT, as_json(risk_document(findings)))


def risk_document(findings: RiskFindings) -> JsonObject:
    """Return the content of ``result.json`` and the output of ``--json``."""
    return {"schema": SCHEMA, **findings.model_dump(mode="json")}


def as_json(tree: Mapping[str, object]) -> bytes:
    """Return a document in the file format of a risk estimate."""
    return (json.dumps(tree, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()


def findings_of(
    settings: Settings, estimation: Estimation, evaluation: Evaluation, ways: tuple[Way, ...]
) -> RiskFindings:
    """Return the findings.  See ``write_findings`` for the arguments."""
    estimate, failed = estimation.estimate, len(evaluation.reasons)
    p, cv = estimate.probability, estimate.coefficient_of_variation
    nothing_known = failed == evaluation.episodes
    worst = min(1.0, estimation.failed_weight + (p or 0.0))
    return RiskFindings(
        scenario=settings.name,
        arm=settings.arm,
        strategy=settings.driver,
        event=settings.event,
        by_brute_force=not estimation.weighted,
        probability=p,
        ci_low=estimate.ci_low,
        ci_high=1.0 if nothing_known else estimate.ci_high,
        nominal_high=1.0 if nothing_known else estimate.nominal.high,
        nominal_draws=estimate.nominal.draws,
        nominal_events=estimate.nominal.events,
        confidence=CONFIDENCE,
        coefficient_of_variation=cv,
        effective_sample_size=estimate.effective_sample_size,
        episodes=estimation.episodes,
        brute_force_episodes=None if p is None or not cv else math.ceil((1 - p) / p / cv**2),
        draws=estimate.draws,
        episodes_to_estimate=estimation.episodes_to_estimate,
        events=estimate.events,
        events_in_all=estimation.events_in_all,
        first_look_draws=estimation.first_look.draws,
        first_look_events=estimation.first_look.events,
        probability_worst=worst if failed or p else None,
        failed=failed,
        timed_out=evaluation.timed_out,
        levels=tuple(exploration.levels for exploration in estimation.explorations),
        ways=ways,
        notes=tuple(sorted(_notes(estimation, evaluation, worst))),
    )


def _notes(estimation: Estimation, evaluation: Evaluation, worst: float) -> list[Note]:
    notes = list(estimation.notes)
    failures, episodes = evaluation.reasons, f"{evaluation.episodes:,} episodes"

    def note(rank: Rank, text: str) -> None:
        notes.append(Note(rank, text))

    if len(failures) == evaluation.episodes:
        note(Rank.NOTHING_TESTED, "Every episode failed: there is no result.")
    elif not estimation.events_in_all:
        note(Rank.NOTHING_TESTED, f"No way to the event was found in {episodes}.")
    if failures:
        note(
            Rank.FAILURES,
            f"{len(failures):,} of {episodes} failed and do not count as events. If all of them "
            f"were events, the probability would be {worst:.3g}. The first failure: {failures[0]}",
        )
    if evaluation.timed_out:
        words = f"{evaluation.timed_out:,} of {episodes} timed out and do not count as events."
        note(Rank.TIME_OUTS, words)
    by_chance = list(evaluation.question.space.by_chance)
    if evaluation.drew_more:
        by_chance.append(
            f"what the strategy draws after its first {GIVEN_DRAWS} random numbers (in "
            f"{evaluation.drew_more:,} of {episodes})"
        )
    if by_chance:
        note(
            Rank.LEFT_OUT,
            f"Random, but not sampled: {'; '.join(by_chance)}. A way to the event that needs rare "
            "values of these draws is found only by chance.",
        )
    return notes


def _ways(
    evaluation: Evaluation, estimation: Estimation, clusters: list[Cluster]
) -> tuple[Way, ...]:
    ways, first, question = [], 0, evaluation.question
    events = evaluation.events
    for cluster in clusters:
        likeliest = cluster.members[0]
        number = int(estimation.numbers[likeliest])
        last = first + len(cluster.members[:_CRITICAL_OF_EACH_WAY]) - 1
        ways.append(
            Way(
                share=cluster.share,
                events=len(cluster.members),
                episode=number,
                pedestrians=people_of(
                    question.scenario,
                    question.space,
                    number,
                    estimation.z[likeliest],
                    events["speeds_mps"][likeliest].as_py(),
                    events["culprit_index"][likeliest].as_py(),
                ),
                critical_pairs=(first, last),
            )
        )
        first = last + 1
    return tuple(ways)


def _write_failures(folder: Path, question: Question, estimation: Estimation) -> None:
    numbers = estimation.numbers.tolist()
    states = [question.space.given(z, key) for z, key in zip(estimation.z, numbers, strict=True)]
    purposes = sorted({purpose for uniforms in states for purpose in uniforms})
    columns = {"episode": pa.int64(), "weight": pa.float64()}
    schema = pa.schema(columns | dict.fromkeys(purposes, pa.list_(pa.float64())))
    rows: list[Row] = [
        {"episode": number, "weight": weight}
        | {purpose: uniforms.get(purpose, ()) for purpose in purposes}
        for uniforms, number, weight in zip(
            states, numbers, estimation.weights.tolist(), strict=True
        )
    ]
    table = pa.Table.from_pylist(rows, schema)
    write_parquet(folder / "failures.parquet", schema, iter([table]))


def _write_critical(
    folder: Path, question: Question, estimation: Estimation, clusters: list[Cluster]
) -> None:
    """Write the scenario of the likeliest episodes.  Each way in the findings names its pairs."""
    drawn = [
        drawn_of(question.space, int(estimation.numbers[k]), estimation.z[k])
        for cluster in clusters
        for k in cluster.members[:_CRITICAL_OF_EACH_WAY]
    ]
    tree = question.scenario.model_dump(mode="json", exclude_none=True)
    tree["pedestrians"]["drawn"] = drawn
    tree["experiment"]["pairs"] = len(drawn)
    write_file(folder / CRITICAL, tomlkit.dumps(tree).encode())
