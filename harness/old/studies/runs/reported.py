"""Collects the findings and notes of a run from its folder."""

from harness.old.statistics import (
    CONFIDENCE,
    CellFindings,
    Findings,
    Note,
    Rank,
    RunFindings,
)
from harness.old.studies.runs.model_use import given_the_model
from harness.old.studies.runs.nearness import nearness
from harness.old.studies.runs.notes import av_label
from harness.old.studies.runs.references import agreement
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.site_words import site_words
from harness.old.studies.runs.views import view_of
from harness.scenario import Cell, Scenario
from harness.strategies.references import validation


def reported(run: RunData) -> RunFindings:
    """Return the findings of a run."""
    return RunFindings(
        catalogue=run.kind.catalogue,
        name=run.name,
        folder=str(run.path),
        scope=f"seed {run.manifest['seed']}",
        confidence=CONFIDENCE,
        cells=tuple(_cell_findings(run, *result) for result in run.results),
        notes=tuple(_run_notes(run)),
        site=site_words([cell.scenario for cell in run.study.cells]),
    )


def _cell_findings(run: RunData, cell: Cell, findings: Findings) -> CellFindings:
    scenario = cell.scenario
    return CellFindings(
        cell=cell.number,
        varied=cell.varied,
        av=av_label(scenario.arms.av, findings),
        reference=scenario.arms.human,
        pairs=findings["pairs"].count,
        thresholds=scenario.conflicts.model_dump(),
        findings=findings,
        notes=view_of(run).notes(scenario, findings, run.kind.catalogue),
    )


def _run_notes(run: RunData) -> list[Note]:
    """Return the notes about the run as a whole."""
    notes = []
    if tuple(run.varied_keys) == ("arms.human",):
        ratios = [
            (cell.scenario.arms.human, findings["time_ratio"])
            for cell, findings in run.results
            if "time_ratio" in findings  # own simulations do not have it
        ]
        if ratios:
            notes.append(Note(Rank.REFERENCE, agreement(ratios)))
    lines = (nearness(cell.scenario) for cell, _ in run.results)
    notes += [Note(Rank.NEARNESS, line) for line in dict.fromkeys(lines)]
    return notes


def remarks(run: RunData) -> list[str]:
    """Return the remarks for ``--full`` and the page: on references, knowledge, walkers."""
    scenarios = [cell.scenario for cell in run.study.cells]
    return [
        *dict.fromkeys(map(validation, scenarios)),
        *knowledge_lines(run),
        *walker_lines(scenarios),
    ]


def knowledge_lines(run: RunData) -> list[str]:
    """Name the strategies that received the model from which the pedestrians are drawn."""
    if not any(cell.scenario.walks_by_model for cell in run.study.cells):
        return []
    return [
        f"{name} knows the pedestrians' distribution: it uses the same interaction model from "
        "which they are drawn."
        for name in given_the_model(run)
    ]


def walker_lines(scenarios: list[Scenario]) -> list[str]:
    """Return a warning if a run draws walking speeds from the model ``dut``."""
    drawn = any(
        (scenario.model.name, scenario.model.path) == ("dut", None)
        and scenario.model.pedestrian_reading != "unconditional"
        and scenario.walks_by_model
        for scenario in scenarios
    )
    line = (
        "The model dut draws walking speeds conditional on the car, but in its data they hardly "
        "depend on the car: on held-out vehicles one normal distribution fits as well "
        '(docs/model.md). pedestrian_reading = "unconditional" draws them independently of the car.'
    )
    return [line] if drawn else []
