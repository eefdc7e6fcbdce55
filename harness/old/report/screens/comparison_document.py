"""The JSON document and the CSV rows of ``harness compare``."""

from collections.abc import Mapping

from harness.old.statistics import CONFIDENCE, ENCOUNTERS, Summary, row_of
from harness.old.studies.runs.comparisons import (
    LEVEL,
    Comparison,
    GroupResult,
    RunComparison,
    SweepResult,
)
from harness.old.studies.runs.notes import av_label, encounter_notes
from harness.old.studies.runs.strategy_groups import StrategyCell

Document = Mapping[str, object]


def comparison_document(result: RunComparison) -> Document:
    """Return the document that ``--json`` prints."""
    return {
        "folders": [str(folder) for folder in result.folders],
        "confidence": CONFIDENCE,
        "groups": [
            {
                "shared": group.group.shared,
                "cells": [
                    _cell_document(*of, result)
                    for of in zip(group.group.cells, group.summaries, strict=True)
                ],
                "comparisons": [_row(item, group) for item in group.comparisons],
                "allowed": [_sweep_document(sweep, group) for sweep in group.sweeps],
            }
            for group in result.groups
        ],
    }


def comparison_rows(result: RunComparison) -> list[Document]:
    """Return the rows of ``--out``: every comparison, with its group's shared values."""
    return [
        {
            **group.group.shared,
            **_row(item, group),
            "indicative": " ".join(item.indicative),
            "confidence": CONFIDENCE,
        }
        for group in result.groups
        for item in group.comparisons
    ]


def _row(item: Comparison, group: GroupResult) -> Document:
    a, b = (group.group.cells[position] for position in (item.a, item.b))
    crashes = item.crashes
    return {
        "cell_a": a.number,
        "cell_b": b.number,
        "a": a.label,
        "b": b.label,
        "defined_in_both": item.defined_in_both,
        "counted_in_both": item.counted_in_both,
        "counted_in_one": item.counted_in_one,
        **item.time_ratio_difference.columns("time_ratio_difference"),
        "time_ratio_difference_p_holm": item.time_ratio_p_holm,
        **item.mu_difference.columns("mu_difference"),
        **item.mu_worst_difference.columns("mu_worst_difference"),
        "crossed_in_both": item.crossed_in_both,
        **item.delay_difference_s.columns("delay_difference_s"),
        **item.delay_worst_difference_s.columns("delay_worst_difference_s"),
        "ran_in_both": crashes.pairs,
        "crashed_in_a_alone": crashes.only_a,
        "crashed_in_b_alone": crashes.only_b,
        "kappa_difference": crashes.kappa_difference,
        "mcnemar_p": crashes.p,
        "mcnemar_p_holm": item.p_holm,
        "tried_in_both": item.misses.pairs,
        "missed_in_a_alone": item.misses.only_a,
        "missed_in_b_alone": item.misses.only_b,
        "missed_p": item.misses.p,
        "missed_p_holm": item.misses_p_holm,
        **_over_model(item),
        "indicative": item.indicative,
    }


def _over_model(item: Comparison) -> Document:
    """Return the intervals over pairs and refits; empty if pairs are not spread over refits."""
    return {
        column: value
        for name, found in item.over_model.items()
        for column, value in (
            *list(found.columns(name, "model_ci").items())[1:],
            (f"{name}_model_share", found.share),
        )
    }


def _cell_document(
    cell: StrategyCell,
    summary: Summary,
    result: RunComparison,
) -> Document:
    return {
        "cell": cell.number,
        "folder": str(result.folders[cell.run]),
        "cell_in_folder": cell.cell.number,
        "label": av_label(cell.label, summary.findings),
        "strategy": cell.strategy,
        "parameters": cell.parameters,
        "caveats": [
            note.text for note in encounter_notes(cell.cell.scenario, summary.findings, ENCOUNTERS)
        ],
        **row_of(ENCOUNTERS, summary.findings),
    }


def _sweep_document(result: SweepResult, group: GroupResult) -> Document:
    sweep, found = result.sweep, result.found
    bold = sweep.aggressiveness
    return {
        "parameter": sweep.key,
        "fixed": sweep.fixed,
        "mu0": result.limits.mu0,
        "kappa0": result.limits.kappa0,
        "verdict": found.verdict.value,
        "expected": found.expected.value,
        "pairs_needed": found.pairs_needed,
        "values": [
            {
                "value": sweep.values[position],
                "aggressiveness": bold[position] if bold else None,
                "cell": group.group.cells[sweep.cells[position]].number,
                "verdict": judgement.verdict.value,
                "pairs": judgement.swept.pairs,
                "pairs_needed": judgement.pairs_needed,
                **judgement.swept.mu.columns("mu_all", "bound"),
                **group.summaries[sweep.cells[position]].mu_worst.columns("mu_worst"),
                **judgement.swept.kappa.columns("kappa_all", "bound"),
                "failed_engine": group.summaries[sweep.cells[position]].failed_engine,
                "confidence": 1 - LEVEL / (2 * len(sweep.values)),
                "indicative": ["mu_bound"] if judgement.swept.unreliable else [],
            }
            for position, judgement in enumerate(found.judgements)
        ],
    }
