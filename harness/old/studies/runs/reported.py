"""Collects the findings and notes of a run from its folder."""

from dataclasses import replace

from harness.old.statistics import (
    CONFIDENCE,
    ENCOUNTERS,
    CellFindings,
    Finding,
    Note,
    Rank,
    RunFindings,
)
from harness.old.store.over_model import refits_of
from harness.old.studies.runs.cell_result import CellResult
from harness.old.studies.runs.model_use import given_the_model
from harness.old.studies.runs.nearness import nearness
from harness.old.studies.runs.notes import av_label, model_notes
from harness.old.studies.runs.references import agreement, keeps_its_defaults, reference_lines
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.site_words import site_words
from harness.old.studies.runs.views import view_of
from harness.scenario import Scenario

PAPER_REMARK = (
    "The paper's column is a reference, not a target. The paper's 2,973 events and fitted "
    "parameters were never published, so the model here is fitted to other trajectories. "
    "Soft-Yield has no valid plan for walkers under 0.976 m/s at (30 m, 5 m/s); here Hard-Yield "
    "takes over in that case."
)

PAPER_MU = float(next(entry.paper for entry in ENCOUNTERS if entry.key == "mu"))


def reported(run: RunData) -> RunFindings:
    """Return the findings of a run."""
    return RunFindings(
        catalogue=run.kind.catalogue,
        name=run.name,
        folder=str(run.path),
        scope=", ".join([f"seed {run.manifest['seed']}", *_refits_scope(run), *_engine_scope(run)]),
        confidence=CONFIDENCE,
        paper=_has_paper_values(run),
        cells=tuple(_cell_findings(run, result) for result in run.results),
        notes=tuple(_run_notes(run)),
        site=site_words([cell.scenario for cell in run.study.cells]),
    )


def _cell_findings(run: RunData, result: CellResult) -> CellFindings:
    cell, findings = result.cell, result.findings
    scenario, over = cell.scenario, run.over_model[cell.number]
    notes = view_of(run).notes(scenario, findings, run.kind.catalogue)
    thresholds = scenario.conflicts.model_dump()
    doubt = model_notes(over, findings, run.kind.catalogue, thresholds)
    return CellFindings(
        cell=cell.number,
        varied=cell.varied,
        av=av_label(scenario.arms.av, findings),
        reference=scenario.arms.human,
        pairs=findings["pairs"].count,
        thresholds=thresholds,
        findings=findings,
        notes=tuple(sorted((*notes, *doubt), key=lambda note: note.rank)),
        over_model=over,
    )


def _has_paper_values(run: RunData) -> bool:
    """Return whether the paper reports this run's numbers: one cell with the paper's scenario."""
    reported_there = any(entry.paper is not None for entry in run.kind.catalogue)
    return reported_there and not run.varied_keys and is_the_papers(run.scenario)


def is_the_papers(scenario: Scenario) -> bool:
    """Return whether a scenario is the paper's (Table II, arms, pedestrian), for any N and seed."""
    ego, pedestrians = scenario.ego, scenario.pedestrians
    arms = (scenario.arms.av, scenario.arms.human)
    return (
        (ego.trigger_range_m, scenario.crossing.length_m, ego.initial_speed_mps) == (30, 9, 5)
        and scenario.crosswalk().lane_centre_m == scenario.crossing.length_m / 4
        and arms == ("soft_yield", "human_gmm")
        and all(keeps_its_defaults(scenario, name) for name in arms)
        and (pedestrians.behaviour, pedestrians.timed) == ("constant", ())
        and pedestrians.first_at_trigger
        and pedestrians.max_count == 1
    )


def _run_notes(run: RunData) -> list[Note]:
    """Return the notes about the run as a whole."""
    notes = []
    if tuple(run.varied_keys) == ("arms.human",):
        ratios = [
            (result.cell.scenario.arms.human, _time_ratio(run, result))
            for result in run.results
            if "time_ratio" in result.findings  # own simulations do not have it
        ]
        if ratios:
            notes.append(Note(Rank.REFERENCE, agreement(ratios)))
    lines = (nearness(result.cell.scenario) for result in run.results)
    notes += [Note(Rank.NEARNESS, line) for line in dict.fromkeys(lines)]
    return notes


def _time_ratio(run: RunData, result: CellResult) -> Finding:
    """Return the ratio of times with the interval that includes the model, if there is one."""
    usual, over = result.findings["time_ratio"], run.over_model[result.cell.number]
    found = over.get("time_ratio")
    return usual if found is None else replace(usual, low=found.low, high=found.high)


def _refits_scope(run: RunData) -> list[str]:
    """Return the number of refits over which the pairs are spread; empty if they are not."""
    return (
        [f"over {refits_of(run.manifest)['count']} refits"] if any(run.over_model.values()) else []
    )


def _engine_scope(run: RunData) -> list[str]:
    """Name the plain engine; empty for a run in SUMO."""
    return ["plain engine"] if run.engine == "plain" else []


def remarks(run: RunData) -> list[str]:
    """Return the remarks for ``--full`` and the page: on paper, references …"""
    scenarios = [cell.scenario for cell in run.study.cells]
    return [
        *([PAPER_REMARK] if _has_paper_values(run) else []),
        *reference_lines(scenarios),
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
