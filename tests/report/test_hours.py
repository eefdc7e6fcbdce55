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
from harness.results.hour_catalogue import HOURS
from harness.results.hour_summaries import ArmOfHours, HoursSummary
from harness.scenario import parse_variation, read_scenario_file, study_of
from harness.traffic.handbook import Handbook
from harness.traffic.saturation import Growth

CALM = ArmOfHours(
    not_through=0,
    never_went=0,
    unreached=0,
    conflicts_unreached=0,
    growth=Growth(0.0, 0.1),
    saturated=False,
    rising_s=Interval(0.0, -1.0, 1.0),
    kappa=proportion(0, 1000),
    fallback=proportion(0, 1000),
    handbook=Handbook(),
    los_vehicles="A",
    los_pedestrians="A",
)

MEASURES = [entry.key for entry in HOURS if entry.of_arm and entry.paired]

FLOW, AV = "pedestrians.flow_per_hour", "arms.av"


def summary(level: float, av: ArmOfHours = CALM, human: ArmOfHours = CALM) -> HoursSummary:
    """Every measure is ``level`` of the AV, half of it of the human; no limits with one hour."""
    measures = {
        name: (
            Interval(level, level - 1, level + 1),
            Interval(level / 2, None, None),
            Interval(level / 2, None, None),
        )
        for name in MEASURES
    }
    arms = {Arm.AV: av, Arm.HUMAN: human}
    return HoursSummary(1, 0, 0.95, Interval(1.0, None, None), measures, arms)


def run_of(*variations: str, settings: dict[str, Any] | None = None, **of: HoursSummary) -> Any:
    """A run whose cells have these summaries, in order."""
    common = {AV: "gap_yield", "arms.human": "human_yield", "traffic.flow_per_hour": 300}
    varied = [parse_variation(text) for text in variations]
    settings = {key: common[key] for key in common if key not in dict(varied)} | (settings or {})
    cells = study_of(read_scenario_file("cctc_flow", settings), varied).cells
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
    full = replace(CALM, saturated=True, growth=Growth(0.2, 0.08), not_through=7, never_went=3)
    return run_of(
        f"{FLOW}=100,400",
        quiet=summary(10.0, av=crashing),
        busy=replace(summary(40.0, av=replace(crashing, kappa=proportion(5, 1000)), human=full)),
    )


def test_crashes_and_saturation_are_said_of_the_cell_they_are_in(flows: Any) -> None:
    who, first, *others = hour_lines(flows)
    assert who == (
        "In the AV's arm 100 % of the vehicles are driven by gap_yield, all others and all of the "
        "reference by human_yield; 300 + 600 vehicles and a varied number of pedestrians per hour."
    )
    assert first.startswith("Crashes (AV's arm) in 2 of 2 cells, at most 5 per 1,000 vehicles")
    assert f"({FLOW} = 400)" in first
    assert all(line.startswith(f"{FLOW} = 400: ") for line in others)
    said = " ".join(others)
    # A fifth of the arrivals stayed on the road.
    assert "Saturated (reference): late vehicles grow by 20 % of what arrives" in said
    assert "(limit 5 %, by chance up to 8 %)" in said
    assert "7 vehicles (reference) never got through" in said
    assert "3 pedestrians (reference) never got to go." in said


def test_a_strategy_that_fell_back_is_named() -> None:
    """208 of 414 passages that were not the AV's own; fewer than half are no line."""
    arm = replace(CALM, fallback=proportion(208, 414))
    run = run_of(only=summary(5.0, av=arm))
    (line,) = hour_lines(run)[1:]
    assert line.startswith("AV's arm: ")
    assert "drove 50 % of the passages that met someone, for which gap_yield has no" in line
    (table,) = hour_tables(run)
    assert "passages driven by the strategy's fallback" in [row[0].text for row in table.rows]
    few = run_of(only=summary(5.0, av=replace(CALM, fallback=proportion(100, 414))))
    assert len(hour_lines(few)) == 1


def test_a_mixed_hour_has_the_delays_of_avs_apart() -> None:
    """And who came is said first; why there is no handbook's delay where it would stand."""
    av = replace(CALM, handbook=Handbook(reason="gap_yield declares no yield rate"))
    run = run_of(only=summary(5.0, av=av), settings={"traffic.av_share": 0.3})
    assert hour_lines(run)[0].startswith("In the AV's arm 30 % of the vehicles are driven by gap_")
    (table,) = hour_tables(run)
    assert table.headings[1:] == ("AV's arm", "reference", "difference")
    rows = {row[0].text: [cell.text for cell in row[1:]] for row in table.rows}
    assert {name.split(" (")[0].split(",")[0] for name in rows} >= {
        "vehicle delay",
        "vehicle delay of AVs",
        "vehicle delay of the others",
    }
    assert rows["pedestrian delay by the HCM, s"][0] == "none: gap_yield declares no yield rate"
    (all_avs,) = hour_tables(run_of(only=summary(5.0)))
    assert len(all_avs.rows) == len(table.rows) - 2


def test_a_delay_that_still_grows_is_said() -> None:
    arm = replace(CALM, rising_s=Interval(40.0, 20.0, 60.0))
    (line,) = hour_lines(run_of(only=summary(5.0, human=arm)))[1:]
    assert line.startswith("The delay still grows (reference): ")
    assert "40.0 (20.0 … 60.0) s more" in line


def test_a_cell_that_failed_says_how_often() -> None:
    run = run_of(only=replace(summary(5.0), pairs=3, failed=1))
    assert hour_lines(run)[1:] == ["1 of 3 pairs failed and count nowhere."]


def test_the_table_over_cells_has_a_row_for_each(flows: Any) -> None:
    (table,) = hour_tables(flows)
    assert table.headings[:2] == ("flow_per_hour", "saturated")
    rows = [[cell.text for cell in row] for row in table.rows]
    assert [row[:2] for row in rows] == [["100", "no"], ["400", "reference"]]
    delay = table.headings.index("vehicle delay, s, AV's arm")
    assert [row[delay].split()[0] for row in rows] == ["10.00", "40.00"]


def test_a_line_goes_through_the_cells_of_a_strategy(flows: Any) -> None:
    axes = drawn(flows)
    assert [*axes] == [
        "over-vehicle-delay-s",
        "over-pedestrian-delay-s",
        "over-throughput-per-hour",
    ]
    lines = {of.get_label(): of.lines[0] for of in axes["over-vehicle-delay-s"].containers}
    assert {*lines} == {"AV's arm: gap_yield", "reference: human_yield"}
    assert lines["AV's arm: gap_yield"].get_xydata().tolist() == [[100, 10], [400, 40]]
    assert lines["reference: human_yield"].get_xydata().tolist() == [[100, 5], [400, 20]]


def test_strategies_have_lines_of_their_own_and_what_is_undefined_has_none() -> None:
    nothing = {name: (Interval(None, None, None),) * 3 for name in MEASURES}
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
    assert lines["AV's arm: gap_yield"] == [[100, 10], [400, 40]]
    assert lines["AV's arm: hard_yield"] == [[400, 60]]
    empty = run_of(
        f"{FLOW}=1,2", **{name: replace(summary(0.0), measures=nothing) for name in "ab"}
    )
    assert drawn(empty) == {}
