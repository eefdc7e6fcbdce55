"""What is said and drawn of hours of traffic, from summaries made by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest
from matplotlib import pyplot as plt

from harness.core.encounter import Arm
from harness.encounter.traffic.saturation import Growth
from harness.old.report.drawing import style
from harness.old.report.pages.hour_pictures import hour_pictures
from harness.old.statistics import Interval, Proportion
from harness.old.store.hour_catalogue import HOURS
from harness.old.store.hour_summaries import ArmOfHours, HoursSummary
from harness.scenario import parse_variation, read_scenario_file, study_of


def proportion(events: int, trials: int) -> Proportion:
    """A share without an interval."""
    return Proportion(events / trials, None, None, events, trials)


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
    los_vehicles="A",
    los_pedestrians="A",
)

MEASURES = [entry.key for entry in HOURS if entry.of_arm and entry.paired]

FLOW, AV = "pedestrians.flow_per_hour", "arms.av"


def summary(level: float, av: ArmOfHours = CALM, human: ArmOfHours = CALM) -> HoursSummary:
    """Every measure is ``level`` of the AV, half of it of the human; no limits with one hour."""
    half = Interval(level / 2, None, None)
    measures = {name: (Interval(level, level - 1, level + 1), half, half) for name in MEASURES}
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


def test_a_line_goes_through_the_cells_of_a_strategy(flows: Any) -> None:
    axes = drawn(flows)
    measures = ("vehicle-delay-s", "pedestrian-delay-s", "throughput-per-hour")
    assert [*axes] == [f"over-{name}" for name in measures]
    lines = {of.get_label(): of.lines[0] for of in axes["over-vehicle-delay-s"].containers}
    assert {*lines} == {"AV's arm: gap_yield", "reference: human_yield"}
    assert lines["AV's arm: gap_yield"].get_xydata().tolist() == [[100, 10], [400, 40]]
    assert lines["reference: human_yield"].get_xydata().tolist() == [[100, 5], [400, 20]]


def test_strategies_have_lines_of_their_own_and_what_is_undefined_has_none() -> None:
    nothing = {name: (Interval(None, None, None),) * 3 for name in MEASURES}
    undefined = replace(summary(0.0), measures=nothing)
    defined = {str(level): summary(level) for level in (40.0, 10.0, 60.0)}
    run = run_of(f"{AV}=gap_yield,hard_yield", f"{FLOW}=400,100", **defined, last=undefined)
    (axes, *_) = drawn(run).values()
    lines = {of.get_label(): of.lines[0].get_xydata().tolist() for of in axes.containers}
    assert lines["AV's arm: gap_yield"] == [[100, 10], [400, 40]]
    assert lines["AV's arm: hard_yield"] == [[400, 60]]
    assert drawn(run_of(f"{FLOW}=1,2", a=undefined, b=undefined)) == {}
