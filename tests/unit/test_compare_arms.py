"""The AV's arms of hours compared with each other, from rows made by hand."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow.compute as pc
import pytest

from harness.core.errors import InputError
from harness.old.store.kinds import HourKind
from harness.old.store.schemas import HOURS
from harness.old.store.tables import table_of
from harness.old.studies.runs.compare_arms import compare_arms
from harness.scenario import read_scenario_file, study_of
from harness.scenario.variation import parse_variation

TWO_VALUES = 12.706204736432095 / 2**0.5
"""Half-width over the standard deviation of a 95 % interval of two values (Student's t)."""
BONFERRONI_3 = 38.188459297025304 / 2**0.5
"""The same of a 98.33 % interval: three comparisons hold together with 95 %."""


def run_of(
    strategies: str, delays: list[list[float]], reference: float = 9.0, **settings: Any
) -> Any:
    """A run of hours: by cell and pair the delay of the AVs; the reference's is always the same."""
    file = read_scenario_file("cctc_flow", {"traffic.duration_s": 3600.0} | settings)
    study = study_of(file, [parse_variation(f"arms.av={strategies}")])
    rows = []
    for cell, values in enumerate(delays):
        for pair, delay_s in enumerate(values):
            for arm, own in (("av", delay_s), ("human", reference)):
                row = dict.fromkeys(HOURS.names[4:], 0) | {"walking_mps": 1.3}
                row |= {"cell": cell, "pair": pair, "arm": arm, "automated_delay_s": own}
                rows.append(row | {"reason": None})
    table = table_of("hours", rows)
    return SimpleNamespace(
        kind=HourKind(),
        study=study,
        confidence=0.95,
        path=Path(strategies),
        name="made",
        manifest={"seed": 1},
        rows_of_cell=lambda cell: table.filter(pc.equal(table["cell"], cell)),
    )


def test_a_difference_is_that_of_the_same_pairs() -> None:
    findings = compare_arms([run_of("gap_yield,hard_yield", [[11.0, 13.0], [10.0, 10.0]])])
    (cell,) = findings.cells
    assert (cell.av, cell.reference) == ("gap_yield", "hard_yield")
    difference = cell.findings["automated_delay_s_difference"]
    assert difference.number == pytest.approx(2.0)
    assert difference.high == pytest.approx(2.0 + 2**0.5 * TWO_VALUES)
    assert cell.findings["automated_delay_s_human"].number == 10.0  # not the reference's 9
    assert [note.text for note in cell.notes] == ["Few pairs: each interval rests on 2 pairs."]


def test_several_comparisons_hold_together() -> None:
    delays = [[11.0, 13.0], [10.0, 10.0], [12.0, 12.0]]
    findings = compare_arms([run_of("gap_yield,hard_yield,constant_speed", delays)])
    assert findings.confidence == pytest.approx(1 - 0.05 / 3)
    first = findings.cells[0].findings["automated_delay_s_difference"]
    assert first.high == pytest.approx(2.0 + 2**0.5 * BONFERRONI_3)
    assert [(cell.av, cell.reference) for cell in findings.cells] == [
        ("gap_yield", "hard_yield"),
        ("gap_yield", "constant_speed"),
        ("hard_yield", "constant_speed"),
    ]
    assert "hold together with 95 % (Bonferroni)" in findings.notes[0].text


def test_runs_need_the_same_reference_arm() -> None:
    one, same = run_of("gap_yield", [[11.0, 13.0]]), run_of("hard_yield", [[10.0, 10.0]])
    assert compare_arms([one, same]).cells[0].findings["pairs"].count == 2
    with pytest.raises(InputError, match="its reference arm has another automated_delay_s"):
        compare_arms([one, run_of("hard_yield", [[10.0, 10.0]], reference=8.0)])


def test_one_cell_has_nothing_to_be_compared_with() -> None:
    with pytest.raises(InputError, match="no two cells that differ only in the AV's strategy"):
        compare_arms([run_of("gap_yield", [[11.0, 13.0]])])


def test_a_refusal_of_runs_names_the_keys_that_differ() -> None:
    one = run_of("gap_yield", [[11.0, 13.0]])
    other = run_of("hard_yield", [[10.0, 10.0]], **{"traffic.duration_s": 1800.0})
    with pytest.raises(InputError) as refused:
        compare_arms([one, other])
    assert str(refused.value) == (
        "hard_yield: differs from gap_yield in more than the AV's strategy: "
        "traffic.duration_s 1800 instead of 3600; "
        "allowed: the same seed, pedestrians, ego and reference"
    )
    with pytest.raises(InputError, match="gap_yield: is named twice; allowed: different runs"):
        compare_arms([one, run_of("gap_yield", [[11.0, 13.0]])])
