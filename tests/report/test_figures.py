"""Figures by their data: lines, counts, limits.  Not their pixels."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy import stats

import harness
from harness.core.encounter import Crossing
from harness.engine.network import place_of
from harness.old.report.drawing import (
    episode_figures,
    safety_figures,
    style,
    svg,
    sweep_figures,
    tau_figures,
)
from harness.old.report.drawing.style import Picture
from harness.old.report.pages.pictures import pictures_of
from harness.old.report.pages.sweep_pictures import sweep_pictures
from harness.old.studies.kinds.tasks import Task
from harness.old.studies.runs.opening import load_run
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import shown_pairs
from tests.batches import sweep
from tests.made_up import made_up


@pytest.fixture
def axes() -> Axes:
    return Figure().subplots()


def labels(axes: Axes) -> list[str]:
    return axes.get_legend_handles_labels()[1]


def right_title(axes: Axes) -> str:
    return axes.get_title(loc="right")


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    (found,) = (line for line in axes.lines if line.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def bars_of(axes: Axes) -> list[Rectangle]:
    return [bar for bars in axes.containers for bar in bars]


TAU = np.array([0.7, np.nan, 0.9, 0.65, 1.4, 0.72, 0.8])


def test_running_mean_is_the_mean_of_the_first_n() -> None:
    values = TAU[~np.isnan(TAU)]
    mean, half = tau_figures.running_mean(values)
    assert mean == pytest.approx([values[:n].mean() for n in range(1, 7)])
    assert np.isnan(half[0])
    for n in range(2, 7):
        low, high = stats.t.interval(
            0.95, n - 1, loc=values[:n].mean(), scale=stats.sem(values[:n])
        )
        assert (mean[n - 1] - half[n - 1], mean[n - 1] + half[n - 1]) == pytest.approx((low, high))


def test_distribution_counts_every_pair_once(axes: Axes) -> None:
    fallback = np.array([False, False, False, False, True, True, False])
    tau_figures.draw_tau_distribution(axes, TAU, fallback, (0.86, 0.7, 1.1))
    heights: dict[str, float] = {
        str(bars.get_label()): sum(bar.get_height() for bar in bars) for bars in axes.containers
    }
    assert heights == {"without fallback": 4, "the AV fell back": 2}
    assert set(line(axes, "μ = 0.8600")[0]) == {0.86}
    assert "its 95 % interval" in labels(axes)


def test_speed_profiles_are_the_traces(axes: Axes, single: str) -> None:
    run = harness.load_run(single)
    rows = run.traces_of(0, 4)
    human = rows[(rows["arm"] == "human") & (rows["object"] == "ego")]
    episode_figures.draw_speed_over_distance(axes, {"pair 4": rows}, 4.0)
    x, y = line(axes, "pair 4, reference")
    assert list(x) == list(-human["x_m"])
    assert list(y) == list(human["speed_mps"])
    assert axes.xaxis_inverted()
    other = Figure().subplots()
    episode_figures.draw_speed_over_time(other, {"pair 4": rows})
    x, y = line(other, "pair 4, AV")
    assert (x[0], y[0]) == (0, 5.0)
    assert right_title(other) == "n = 2 episodes of 1 pair"


CROSSING = Crossing(9.0, 4.0, 2.25, 4.5)


def made_up_trace() -> pd.DataFrame:
    """The ego at 20, 15 and 10 m at 5 m/s; one from near at 1 m/s, one from far at 2 m/s."""
    rows = [("ego", t, -20.0 + 5 * t, 2.25, 5.0) for t in (0.0, 1.0, 2.0)]
    rows += [("pedestrian-0", t, 0.0, 0.5 + t, 1.0) for t in (0.0, 1.0, 2.0)]
    rows += [("pedestrian-1", t, 0.0, 9.0 - 2 * (t - 1), 2.0) for t in (1.0, 2.0)]
    return pd.DataFrame(rows, columns=["object", "time_s", "x_m", "y_m", "speed_mps"])


def test_time_advantage_by_hand() -> None:
    """|R/v − L/v_p|, the smaller of both: |4 − 1.75|; |3 − 0.75| or |3 − 3.375|; |2 − 2.375|.

    At t = 2 the one from near is at 2.5 m, past the lane's centre at 2.25 m.
    """
    found = episode_figures.time_advantage(made_up_trace(), CROSSING)
    assert found.tolist() == pytest.approx([2.25, 0.375, 0.375])
    # One who starts on the road, from the far side: at 4.25 and 3.25 m, L = 2 and 1; |4 − 2|,
    # |3 − 1|.
    rows = made_up_trace()
    rows = rows[rows["object"] != "pedestrian-0"]
    rows.loc[rows["object"] == "pedestrian-1", ["time_s", "speed_mps"]] = [[0.0, 1.0], [1.0, 1.0]]
    rows.loc[rows["object"] == "pedestrian-1", "y_m"] = [4.25, 3.25]
    found = episode_figures.time_advantage(rows, CROSSING)
    assert found[:2].tolist() == pytest.approx([2.0, 2.0])
    # It is undefined past the line and for an ego that stands.
    rows = made_up_trace()
    rows.loc[(rows["object"] == "ego") & (rows["time_s"] == 1.0), "x_m"] = 1.0
    rows.loc[(rows["object"] == "ego") & (rows["time_s"] == 2.0), "speed_mps"] = 0.0
    found = episode_figures.time_advantage(rows, CROSSING)
    assert found[0] == pytest.approx(2.25)
    assert np.isnan(found[1:]).all()


def test_time_advantage_of_a_run_never_undercuts_its_record(single: str) -> None:
    """The record looks at the moment of stepping off too, the trace at whole steps alone."""
    run = harness.load_run(single)
    records = run.episodes.set_index(["pair", "arm"])["min_time_advantage_s"]
    equal = 0
    for (pair, arm), rows in run.traces.groupby(["pair", "arm"]):
        smallest = np.nanmin(episode_figures.time_advantage(rows, CROSSING))
        assert smallest >= records[(pair, arm)] - 1e-9
        equal += smallest == pytest.approx(records[(pair, arm)], abs=1e-9)
    assert equal >= 20


def test_shares_count_undefined_episodes_among_all(axes: Axes) -> None:
    values = {
        "AV": np.array([1.0, 2.0, np.nan, 4.0]),
        "human": np.array([np.nan, np.nan, 30.0, 3.0]),
    }
    safety_figures.draw_shares(axes, values, "TTC (s)", 10.0)
    x, y = line(axes, "AV, defined in 3 of 4")
    assert list(x) == [0, 1, 2, 4, 10]
    assert list(y) == [0, 0.25, 0.5, 0.75, 0.75]
    assert list(line(axes, "human, defined in 2 of 4")[1]) == [0, 0.25, 0.25]
    assert right_title(axes) == "n = 4 per arm"
    nothing = Figure().subplots()
    safety_figures.draw_shares(nothing, {"AV": np.array([np.nan])}, "TTC (s)", 10.0)
    assert list(line(nothing, "AV, defined in 0 of 1")[1]) == [0, 0]


SUMMARY = pd.DataFrame(
    [(1.0, 0.9, 1.2), (0.9, 0.8, 1.0), (1.2, 1.0, 1.5), (np.nan,) * 3],
    columns=["mu", "mu_ci_low", "mu_ci_high"],
)
NAMES = ["a", "a", "b", "b"]


def pictures(run: RunData) -> list[Picture]:
    place = place_of(run.scenario_of(0))
    with style.styled():
        return list(pictures_of(run, run.model_of(0), place, shown_pairs(run)))


@pytest.fixture(scope="module")
def of_single(single: str) -> list[Picture]:
    return pictures(harness.load_run(single))


@pytest.fixture(scope="module")
def of_sweep(swept: str) -> list[Picture]:
    return pictures(harness.load_run(swept))


def test_the_papers_figures_come_first_and_those_of_a_sweep_over_the_flow(
    of_single: list[Picture], of_sweep: list[Picture]
) -> None:
    assert [picture.name for picture in of_single] == [
        *("tau-mean", "tau-distribution", "arrivals", "speed-distance", "speed-time", "site"),
        *("safety", "walking-speeds", "model"),
    ]
    measures = ["time-ratio", "mu", "kappa", "delay", "pedestrian-delay"]
    assert [picture.name for picture in of_sweep][:5] == [f"sweep-{name}" for name in measures]
    (axes,) = of_sweep[0].figure.axes
    assert labels(axes)[1:] == ["soft_yield", "constant_speed"]


def test_a_swept_parameter_has_its_picture(tmp_path: Path) -> None:
    def fates(task: Task, _pair: int) -> float:
        return 8.0 + task.scenario.strategies["soft_yield"]["time_margin_s"]

    changes = {"experiment.pairs": 20}
    study = sweep("cctc", changes, "strategies.soft_yield.time_margin_s=0.0,1.0,2.0")
    run = load_run(made_up(tmp_path / "margin", study, fates))
    with style.styled():
        found = list(sweep_pictures(run))
    names = ["aggressiveness", "sweep-time-ratio", "sweep-delay", "sweep-pedestrian-delay"]
    assert [picture.name for picture in found] == names
    upper, lower = found[0].figure.axes
    for axes in (upper, lower):
        # Bolder to the right: −2, −1, 0 s of margin.
        assert list(line(axes, "soft_yield")[0]) == [-2, -1, 0]
    values = run.summary.set_index("strategies.soft_yield.time_margin_s")["mu"]
    assert list(line(upper, "soft_yield")[1]) == pytest.approx([values[2], values[1], values[0]])


def test_every_caption_counts_and_every_axis_has_a_unit(
    of_single: list[Picture], of_sweep: list[Picture]
) -> None:
    for picture in [*of_single, *of_sweep]:
        assert re.search(r"n = \d", picture.caption), picture.name
        for axes in picture.figure.axes:
            assert axes.get_xlabel(), picture.name
            assert axes.get_ylabel(), picture.name


def test_svg_uses_the_pages_colours_and_unique_identifiers(
    of_single: list[Picture], of_sweep: list[Picture]
) -> None:
    seen: set[str] = set()
    for number, picture in enumerate([*of_single, of_sweep[0]]):
        text = svg.inline_svg(picture.figure, f"f{number}", "<title>", "a & b")
        root = ET.fromstring(text)
        assert not re.findall(r"#[0-9a-f]{6}\b", text), picture.name
        assert "<title>" not in text.replace('<title id="', "")
        own = [element.attrib["id"] for element in root.iter() if "id" in element.attrib]
        assert len(own) == len(set(own))
        assert not seen & set(own)
        seen |= set(own)
        for reference in re.findall(r'(?:href="|url\()#([^")]+)', text):
            assert reference in own
        assert len(text) < 80_000, picture.name


def test_names_from_files_are_text_in_figures(axes: Axes) -> None:
    name = "$\\frac{1}$ <b>\x1b[31m\x00"
    line_ = sweep_figures.Line(name, *(np.array([1.0, 2.0]) for _ in range(4)))
    with style.styled():
        figure, (axes,) = style.new_figure()
        sweep_figures.draw_over(axes, [line_], name, "μ", "n = 1")
        text = svg.inline_svg(figure, "x", name.replace("\x00", "").replace("\x1b", ""), "d")
    words = "".join(ET.fromstring(text).itertext())
    assert "$\\frac{1}$ <b>\N{REPLACEMENT CHARACTER}[31m" in words
