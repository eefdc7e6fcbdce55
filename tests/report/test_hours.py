"""What is said and drawn of hours of traffic, from summaries made by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest
from matplotlib import pyplot as plt

from harness.comparison import Interval, proportion
from harness.encounter import Arm
from harness.report import style
from harness.report.hour_pictures import hour_pictures
from harness.report.hour_words import hour_lines, hour_tables
from harness.results.hour_summaries import HOUR_MEASURES, ArmOfHours, HoursSummary
from harness.scenario import parse_variation, read_scenario_file, study_of

CALM = ArmOfHours(0, 0, 0.0, False, proportion(0, 1000), None, None, None, "A", "A")

FLOW, AV = "pedestrians.flow_per_hour", "arms.av"


def summary(level: float, av: ArmOfHours = CALM, human: ArmOfHours = CALM) -> HoursSummary:
    """Every measure is ``level`` of the AV, half of it of the human; no limits with one hour."""
    measures = {
        of.name: (
            Interval(level, level - 1, level + 1),
            Interval(level / 2, None, None),
            Interval(level / 2, None, None),
        )
        for of in HOUR_MEASURES
    }
    arms = {Arm.AV: av, Arm.HUMAN: human}
    return HoursSummary(1, 0, 0.95, Interval(1.0, None, None), measures, arms)


def run_of(*variations: str, **of: HoursSummary) -> Any:
    """A run whose cells have these summaries, in order."""
    settings = {AV: "gap_yield", "arms.human": "human_yield", "traffic.flow_per_hour": 300}
    file = read_scenario_file("cctc_flow", settings)
    cells = study_of(file, [parse_variation(text) for text in variations]).cells
    summaries = [*of.values()]
    assert len(cells) == len(summaries)
    keys = [*cells[0].varied]
    return SimpleNamespace(
        varied_keys=keys,
        hour_results=[*zip(cells, summaries, strict=True)],
        confidence=0.95,
        summary=pd.DataFrame([{key: cell.varied[key] for key in keys} for cell in cells]),
    )


def drawn(run: Any) -> dict[str, Any]:
    """The figures' axes by name."""
    with style.styled():
        pictures = [*hour_pictures(run, None)]
    axes = {picture.name: picture.figure.axes[0] for picture in pictures}
    plt.close("all")
    return axes


@pytest.fixture
def flows() -> Any:
    crashing = replace(CALM, kappa=proportion(2, 1000))
    full = replace(CALM, saturated=True, growth=0.2, not_through=7, never_went=3)
    return run_of(
        f"{FLOW}=100,400",
        quiet=summary(10.0, av=crashing),
        busy=replace(summary(40.0, av=replace(crashing, kappa=proportion(5, 1000)), human=full)),
    )


def test_crashes_and_saturation_are_said_of_the_cell_they_are_in(flows: Any) -> None:
    first, *others = hour_lines(flows)
    assert first.startswith("Crashes (AV) in 2 of 2 cells, at most 5 per 1,000 passages")
    assert f"({FLOW} = 400)" in first
    assert all(line.startswith(f"{FLOW} = 400: ") for line in others)
    said = " ".join(others)
    # A fifth of the arrivals stayed on the road.
    assert "Saturated (human): the vehicles on the road grow by 20 % of what arrives" in said
    assert "7 vehicles (human) never got through" in said
    assert "3 pedestrians (human) never got to go." in said


def test_a_cell_that_failed_says_how_often() -> None:
    run = run_of(only=replace(summary(5.0), pairs=3, failed=1))
    assert hour_lines(run) == ["1 of 3 pairs failed and count nowhere."]


def test_the_table_over_cells_has_a_row_for_each(flows: Any) -> None:
    (table,) = hour_tables(flows)
    assert table.headings[:2] == ("flow_per_hour", "saturated")
    rows = [[cell.text for cell in row] for row in table.rows]
    assert [row[:2] for row in rows] == [["100", "no"], ["400", "human"]]
    delay = table.headings.index("vehicle delay, s, AV")
    assert [row[delay].split()[0] for row in rows] == ["10.00", "40.00"]


def test_a_line_goes_through_the_cells_of_a_strategy(flows: Any) -> None:
    axes = drawn(flows)
    assert [*axes] == [
        "over-vehicle-delay-s",
        "over-pedestrian-delay-s",
        "over-throughput-per-hour",
    ]
    lines = {of.get_label(): of.lines[0] for of in axes["over-vehicle-delay-s"].containers}
    assert {*lines} == {"AV: gap_yield", "reference: human_yield"}
    assert lines["AV: gap_yield"].get_xydata().tolist() == [[100, 10], [400, 40]]
    assert lines["reference: human_yield"].get_xydata().tolist() == [[100, 5], [400, 20]]


def test_strategies_have_lines_of_their_own_and_what_is_undefined_has_none() -> None:
    nothing = {of.name: (Interval(None, None, None),) * 3 for of in HOUR_MEASURES}
    run = run_of(
        f"{AV}=gap_yield,hard_yield",
        f"{FLOW}=400,100",
        one=summary(40.0),
        two=summary(10.0),
        three=summary(60.0),
        four=replace(summary(0.0), measures=nothing),
    )
    (axes, *_) = drawn(run).values()
    lines = {of.get_label(): of.lines[0].get_xydata().tolist() for of in axes.containers}
    assert lines["AV: gap_yield"] == [[100, 10], [400, 40]]
    assert lines["AV: hard_yield"] == [[400, 60]]
    empty = run_of(
        f"{FLOW}=1,2", **{name: replace(summary(0.0), measures=nothing) for name in "ab"}
    )
    assert drawn(empty) == {}
