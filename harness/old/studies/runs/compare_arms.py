"""Compares the AV's arms of cells with long pairs: hours of traffic, and users' own simulations.

Two cells that differ only in the AV's strategy are compared like the two arms of a run.  The second
cell's AV takes the place of the reference.
"""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.old.statistics import CONFIDENCE, CellFindings, Note, Rank, RunFindings
from harness.old.studies.runs.hour_notes import FEW_HOURS
from harness.old.studies.runs.notes import counted
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.same_pairs import TOLERANCE, check_same_scenario, names_of
from harness.old.studies.runs.site_words import site_words
from harness.old.studies.runs.strategy_groups import StrategyCell, groups_over


def compare_arms(runs: Sequence[RunData]) -> RunFindings:
    """Compare every two cells that differ only in the AV's strategy, pair by pair.

    Args:
        runs: finished runs of one kind with long pairs; several runs need the same reference arm.

    Returns:
        The findings of each comparison in the form of a cell's findings.  The first cell's AV is
        the AV, and the second cell's AV is the reference.  All intervals hold simultaneously with
        95 % (Bonferroni).

    Raises:
        InputError: no two cells can be compared, or their reference arms differ; see also
            ``check_same_scenario``.
    """
    names = names_of(runs) if len(runs) > 1 else [""]
    groups = groups_over([run.study for run in runs], names)
    if len(runs) > 1:
        check_same_scenario(runs, groups)
    couples = [couple for group in groups for couple in combinations(group.cells, 2)]
    if not couples:
        raise InputError(
            str(runs[0].path),
            "has no two cells that differ only in the AV's strategy",
            "a sweep over arms.av or over parameters of its strategy, or a second run",
        )
    confidence = 1 - (1 - CONFIDENCE) / len(couples)
    cells = tuple(
        _compared(runs, first, second, number, confidence, several=len(couples) > 1)
        for number, (first, second) in enumerate(couples)
    )
    together = f"Each interval holds with {100 * confidence:.4g} %: all {len(cells)} comparisons "
    together += f"hold together with {100 * CONFIDENCE:.3g} % (Bonferroni)."
    return RunFindings(
        catalogue=runs[0].kind.catalogue,
        name=runs[0].name,
        folder=str(runs[0].path),
        scope=f"seed {runs[0].manifest['seed']}",
        confidence=confidence,
        cells=cells,
        notes=(Note(Rank.REFERENCE, together),) if len(cells) > 1 else (),
        site=site_words([member.cell.scenario for couple in couples for member in couple]),
        between_avs=True,
    )


def _compared(
    runs: Sequence[RunData],
    first: StrategyCell,
    second: StrategyCell,
    number: int,
    confidence: float,
    *,
    several: bool,
) -> CellFindings:
    kind, cell = runs[0].kind, first.cell
    rows, others = (runs[each.run].rows_of_cell(each.cell.number) for each in (first, second))
    if first.run != second.run:
        _refuse_other_references(rows, others, runs[second.run].path)
    findings = kind.findings(_side_by_side(rows, others), cell, confidence)
    pairs, failed = findings["pairs"].count, findings["failed"].count
    notes = []
    if failed:
        text = f"{failed:,} of {counted(pairs, 'pair')} failed; no row counts them."
        notes.append(Note(Rank.FAILURES, text))
    if pairs - failed < FEW_HOURS:
        text = f"Few pairs: each interval rests on {counted(pairs - failed, 'pair')}."
        notes.append(Note(Rank.FEW_PAIRS, text))
    return CellFindings(
        cell=number,
        varied={"against": second.label} if several else {},
        av=first.label,
        reference=second.label,
        pairs=pairs,
        thresholds=cell.scenario.conflicts.model_dump(),
        findings=findings,
        notes=tuple(notes),
    )


def _side_by_side(first: pa.Table, second: pa.Table) -> pa.Table:
    """Return the AV's rows of two cells as the two arms of one cell, by pair."""
    arms = [rows.filter(pc.equal(rows["arm"], Arm.AV.value)) for rows in (first, second)]
    common = np.intersect1d(*(arm["pair"].to_numpy() for arm in arms))
    parts = []
    for arm, rows in zip(Arm, arms, strict=True):
        kept = rows.filter(pc.is_in(rows["pair"], value_set=pa.array(common)))
        names = pa.array([arm.value] * kept.num_rows, pa.string())
        parts.append(kept.set_column(kept.schema.get_field_index("arm"), "arm", names))
    return pa.concat_tables(parts).sort_by([("pair", "ascending"), ("arm", "ascending")])


def _refuse_other_references(first: pa.Table, second: pa.Table, path: Path) -> None:
    """Refuse runs whose reference arms differ, because their pairs are not the same."""
    arms = [
        rows.filter(pc.equal(rows["arm"], Arm.HUMAN.value)).sort_by("pair")
        for rows in (first, second)
    ]
    common = np.intersect1d(*(arm["pair"].to_numpy() for arm in arms))
    tables = [arm.filter(pc.is_in(arm["pair"], value_set=pa.array(common))) for arm in arms]
    for field in first.schema:
        if not pa.types.is_floating(field.type):
            continue
        a, b = (table[field.name].to_numpy(zero_copy_only=False) for table in tables)
        if not np.allclose(a, b, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True):
            problem = f"its reference arm has another {field.name}: the pairs are not the same"
            raise InputError(str(path), problem, "the same seed, people, vehicles and reference")
