"""The pictures of a page: which figure for which run, with its caption.

To add a picture, add a function that draws into axes and returns a caption, and a line in
``PICTURES``.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from harness.core.documents import unit_of
from harness.core.errors import HarnessError
from harness.core.vocabulary import Arm
from harness.engine.configuration import digest_of, read_config
from harness.report import figures as draw
from harness.report.player import pair_name
from harness.report.style import HEIGHT_INCH, MUTED, SERIES, new_figure
from harness.report.words import counted_noun, level_text, plain_text
from harness.results.catalogue import ENTRY_OF
from harness.results.cell_findings import CellFindings
from harness.results.estimators import CONFIDENCE
from harness.results.finding import Finding, Form
from harness.results.loaded_run import Run
from harness.results.references import is_the_papers
from harness.results.result import Result, Shown
from harness.results.tables import ENCOUNTERS, SIMULATIONS, RunKind
from harness.strategies.registry import aggressiveness_of
from harness.studies.allowed import as_number
from harness.studies.page_content import PageContent, ShownPair

_FLOW = "pedestrians.flow_per_hour"
_MOST_CELLS = 40
"""Most rows of a figure with a row for each cell or crosswalk."""
_MOST = 3
"""Most pairs of one figure, and most parameters."""

_CELLS = ("time_ratio", "kappa", "conflict_pet")
_OVER = ("av_delay_s", "other_delay_s", "people_wait_s", "conflicts_pet")
_AT = ("av_delay_s", "conflicts_pet")
"""The numbers that are drawn by cell, over a key, and by crosswalk."""


DrawnPicture = tuple[str, str, str, Figure]
"""A picture's name, title, caption and figure."""


class Picture(NamedTuple):
    """A picture of ``PICTURES``.

    Attributes:
        name: its file's name.
        title: its title on the page.
        wanted: whether a run has it.
        draw: draws it into its axes, from top to bottom, and returns its caption.
        size: returns the number of its axes, and the height of each in inch.
        kinds: the kinds of run that may have it.
    """

    name: str
    title: str
    wanted: Callable[[PageContent], bool]
    draw: Callable[[Sequence[Axes], PageContent], str]
    size: Callable[[PageContent], tuple[int, float]] = lambda _scene: (1, HEIGHT_INCH)
    kinds: tuple[RunKind, ...] = ENCOUNTERS


def pictures_of(scene: PageContent) -> Iterator[tuple[Picture, str, Figure]]:
    """Yield the pictures of a run with captions; call this inside ``style.styled``."""
    for picture in PICTURES:
        if scene.run.kind in picture.kinds and picture.wanted(scene):
            panels, height_inch = picture.size(scene)
            figure, axes = new_figure(panels, panels * height_inch)
            yield (picture, picture.draw(axes, scene), figure)


def pictures_of_result(result: Result) -> Iterator[DrawnPicture]:
    """Yield the pictures of a result without a run; call this inside ``style.styled``.

    They are the columns of its screen whose intervals are on every screen.
    """
    names = [plain_text(row[0]) for row in result.screen.rows]
    for place, column in enumerate(result.screen.columns):
        cells = [row[place] for row in result.screen.rows]
        shown = [cell for cell in cells if isinstance(cell, Shown)]
        if not column.interval or len(shown) < len(cells):
            continue
        share = shown[0].style.form is Form.SHARE
        figure, axes = new_figure(height_inch=1.4 + 0.26 * len(names))
        found = [cell.finding for cell in shown]
        across = f"{column.heading}, %" if share else column.heading
        draw.draw_cells(axes[0], names, {Arm.AV: found}, across, 100.0 if share else 1.0)
        axes[0].legend_ = None  # it names the arms of runs
        caption = f"Each row with its {level_text(CONFIDENCE)} interval."
        title = column.heading.partition(",")[0].capitalize()
        yield column.key, title, caption, figure


def axis_label(key: str) -> str:
    """A key of a scenario as the label of an axis, with its unit.

    >>> axis_label("strategies.hard_yield.max_deceleration_mps2")
    'hard_yield: max deceleration (m/s²)'
    """
    if key == _FLOW:
        return "pedestrian flow λ (per hour)"
    section, _, name = key.rpartition(".")
    owner = section.removeprefix("strategies.") + ": " if section.startswith("strategies.") else ""
    ending, unit = unit_of(name) or ("", "")
    words = owner + name.removesuffix(ending).replace("_", " ")
    return f"{words} ({unit})" if unit else words


def _of_one_cell(scene: PageContent) -> bool:
    return len(scene.run.cells) == 1


def _with_crosswalks(scene: PageContent) -> bool:
    return _of_one_cell(scene) and bool(scene.run.cells[0].by_crosswalk)


def _with_traces(scene: PageContent) -> bool:
    return bool(scene.shown)


def _over_a_key(scene: PageContent) -> bool:
    return 0 < len(_lines(scene.run, "pairs")) <= len(SERIES)


def _across(run: Run) -> str | None:
    """The key of the x axis: the flow, or else the numeric key with the most values."""
    keys, cells = run.cells[0].varied, run.cells
    values = {key: {as_number(cell.varied[key]) for cell in cells} for key in keys}
    numeric = {k: len(each) for k, each in values.items() if len(each) > 1 and None not in each}
    if not numeric:
        return None
    return _FLOW if _FLOW in numeric else max(numeric, key=numeric.__getitem__)


def _lines(run: Run, name: str) -> dict[str, list[tuple[float, Finding]]]:
    """A finding over the x axis' key: a line for each combination of the other varied keys.

    If the cells differ in nothing else but the AV, they share the reference's line.
    """
    lines: dict[str, list[tuple[float, Finding]]] = {}
    if (key := _across(run)) is None:
        return lines
    others = [other for other in run.cells[0].varied if other != key]
    reference: dict[float, Finding] = {}
    for cell in run.cells:
        if (value := as_number(cell.varied[key])) is None:
            continue
        label = ", ".join(plain_text(cell.varied[other]) for other in others)
        lines.setdefault(label or cell.scenario.arms.av, []).append((value, cell[name]))
        if f"{name}_human" in cell.findings:
            reference.setdefault(value, cell[f"{name}_human"])
    if reference and others in ([], ["arms.av"]):
        lines[f"{run.cells[0].scenario.arms.human} (reference)"] = [*reference.items()]
    return {label: sorted(points, key=lambda point: point[0]) for label, points in lines.items()}


def _pairs(cells: Sequence[CellFindings]) -> str:
    counts = sorted({cell["pairs"].count for cell in cells})
    low, high = counts[0], counts[-1]
    return f"n = {counted_noun(low, 'pair')}" if low == high else f"n = {low:,} to {high:,} pairs"


def _title(name: str, run: Run) -> tuple[str, float]:
    """The label of a finding with its unit, and the scale of its axis."""
    entry = ENTRY_OF[name]
    title = entry.title(run.cells[0].scenario.conflicts.model_dump())
    share = entry.style.form in (Form.SHARE, Form.EVENTS)
    return (f"{title}, %", 100.0) if share else (title, 1.0)


def _tau_mean(axes: Sequence[Axes], scene: PageContent) -> str:
    run, scenario = scene.run, scene.run.cells[0].scenario
    paper = float(ENTRY_OF["mu"].paper) if is_the_papers(scenario) else None
    tau, driver = run.pairs["tau"], scenario.arms.human
    draw.draw_running_mean(axes[0], tau, paper, driver)
    return (
        f"τ = AV time / {driver} time of each pair, and the mean of the first n with its 95 % band "
        f"(Student's t); {tau.notna().sum():,} of {counted_noun(len(tau), 'pair')} have a τ."
    )


def _tau(axes: Sequence[Axes], scene: PageContent) -> str:
    run, cell = scene.run, scene.run.cells[0]
    fallback = run.episodes.loc[run.episodes["arm"] == Arm.AV, "fallback"]
    draw.draw_tau(axes[0], run.pairs["tau"], cell["mu"], cell.scenario.arms.human, fallback)
    return f"Histogram of τ with its mean μ and the {level_text(run.confidence)} interval of μ."


def _limits(axes: Sequence[Axes], scene: PageContent) -> str:
    """Draw the paper's figure of the influence of aggressiveness."""
    for place, swept in enumerate(scene.allowed[:_MOST]):
        table, _, name = swept.key.rpartition(".")
        bolder = aggressiveness_of(table.removeprefix("strategies.")).get(name, 0.0)
        across = f"{axis_label(swept.key)}{' → bolder' if bolder > 0 else ''}"
        across = f"bolder ← {across}" if bolder < 0 else across
        allowed = [row.verdict == "allowed" for row in swept.rows]
        for panel, up, limit, points in (
            (0, "μ", swept.mu0, [(row.value, row.mu) for row in swept.rows]),
            (1, "κ", swept.kappa0, [(row.value, row.kappa) for row in swept.rows]),
        ):
            draw.draw_limit(axes[2 * place + panel], points, across, up, limit, allowed)
    said = "; ".join(f"{each.title}: {each.values}" for each in scene.allowed)
    counts = "In μ a reference who crashed counts as driving on; in κ time-outs and failures count "
    return f"{said}. {counts}as crashes."


def _over(axes: Sequence[Axes], scene: PageContent, name: str) -> str:
    run, key = scene.run, _across(scene.run) or ""
    up, scale = _title(name, run)
    level = (1.0, "as fast as the reference") if name == "time_ratio" else None
    count = f"{_pairs(run.cells)} per point"
    draw.draw_over(axes[0], _lines(run, name), axis_label(key), up, count, level, scale)
    return f"Over {key}, with {level_text(run.confidence)} intervals; points are a little apart."


def _cells(axes: Sequence[Axes], scene: PageContent) -> str:
    """Draw the numbers of each cell with their intervals."""
    cells = scene.run.cells[:_MOST_CELLS]
    values = ([value for value in cell.varied.values() if value is not None] for cell in cells)
    names = [", ".join(map(plain_text, each)) for each in values]
    for panel, name in zip(axes, _CELLS, strict=True):
        across, scale = _title(name, scene.run)
        keys = zip(Arm, ENTRY_OF[name].keys, strict=False)
        arms = {arm: [cell[key] for cell in cells] for arm, key in keys}
        draw.draw_cells(panel, names, arms, across, scale)
    axes[0].axvline(1.0, color=MUTED, ls=":", lw=1.2)
    more = f"; the first {_MOST_CELLS} of {len(scene.run.cells):,}"
    return (
        f"Each cell with {level_text(scene.run.confidence)} intervals; {_pairs(cells)} per cell"
        f"{more if len(cells) < len(scene.run.cells) else ''}."
    )


def _curves(axes: Sequence[Axes], scene: PageContent) -> str:
    for panel, name in zip(axes, _OVER, strict=True):
        said = _over([panel], scene, name)
    return (
        f"{said} Intervals are over pairs (Student's t). In the reference's arm AVs are the "
        "vehicles that are AVs in the other one."
    )


def _by_crosswalk(axes: Sequence[Axes], scene: PageContent) -> str:
    found = scene.run.cells[0].by_crosswalk
    names = [*found][:_MOST_CELLS]
    for panel, key in zip(axes, _AT, strict=True):
        keys = zip(Arm, ENTRY_OF[key].keys, strict=False)
        arms = {arm: [found[name][own] for name in names] for arm, own in keys}
        draw.draw_cells(panel, names, arms, *_title(key, scene.run))
    more = f" The first {len(names)} of {len(found)} crosswalks." if len(found) > len(names) else ""
    level = level_text(scene.run.confidence)
    return f"Each crosswalk with {level} intervals; {_pairs(scene.run.cells)}.{more}"


def _places(run: Run) -> dict[str, tuple[float, float]]:
    """Where the crosswalks are, of those whose place is known."""
    rows = run.rows("crosswalks", run.cells[0].number).to_pylist()
    found = {row["crosswalk"]: (row["x_m"], row["y_m"]) for row in rows}
    return {name: at for name, at in found.items() if None not in at}


def _map(axes: Sequence[Axes], scene: PageContent) -> str:
    found, places = scene.run.cells[0].by_crosswalk, _places(scene.run)
    sizes = {name: found[name]["conflicts_pet"].value for name in places}
    slower = {name: found[name]["av_delay_s_difference"] for name in places}
    roads, problem = _roads(scene.run)
    draw.draw_map(axes[0], roads, places, sizes, slower)
    return (
        f"Area: {_title('conflicts_pet', scene.run)[0]} in the AV's arm. Colour and "
        "marker: the AVs' delay against that of the same vehicles in the reference's arm. Hollow: "
        f"the share is undefined.{problem}"
    )


def _roads(run: Run) -> "tuple[list[ArrayLike], str]":
    """The shapes of the user's roads, and why there are none or other ones than in the run."""
    simulation, made = run.cells[0].scenario.simulation, run.manifest["simulated_with"]["files"]
    if simulation is None:
        return [], " The roads, which the harness made, are not drawn."
    from harness.engine.ids import is_inside_junction  # no other picture needs them
    from harness.engine.town_reader import read_town

    try:
        net = read_config(Path(simulation.file), simulation.step_s).net
        lanes, now = read_town(net).lanes.values(), digest_of(net)
    except HarnessError as error:
        return [], f" The roads are not drawn, because the network cannot be read: {error}."
    roads: list[ArrayLike] = [each.shape for each in lanes if not is_inside_junction(each.id)]
    same = made.get(str(net)) == now
    return roads, "" if same else f" The roads are those of now: {net} has changed since the run."


def _traces(scene: PageContent) -> Mapping[str, ShownPair]:
    """A few shown pairs by name, those first that were chosen for their τ."""
    several = len(scene.run.study.cells) > 1
    named = {}
    for pair in sorted(scene.shown, key=lambda pair: not any("τ" in why for why in pair.reasons)):
        reason = next((why for why in pair.reasons if "τ" in why), pair.reasons[0])
        named[f"{pair_name(pair, several)}, {reason}"] = pair
    return dict([*named.items()][:_MOST])


def _motion(axes: Sequence[Axes], scene: PageContent, of: Callable[..., None], what: str) -> str:
    width_m = scene.run.scenario_of(scene.shown[0].cell).crossing.width_m
    of(axes[0], {name: pair.traces.to_pandas() for name, pair in _traces(scene).items()}, width_m)
    return f"The vehicle's {what}, in chosen pairs."


PICTURES = (
    Picture("tau-mean", "Running mean of τ", _of_one_cell, _tau_mean),
    Picture("tau-distribution", "Distribution of τ", _of_one_cell, _tau),
    Picture("aggressiveness", "μ and κ over a strategy's parameter",
            lambda scene: len(scene.allowed) > 0, _limits,
            lambda scene: (2 * len(scene.allowed[:_MOST]), 3.2)),
    Picture("time-ratio", "Ratio of times", _over_a_key, partial(_over, name="time_ratio")),
    Picture("kappa", "Crashes", _over_a_key, partial(_over, name="kappa")),
    Picture("delay", "Delay", _over_a_key, partial(_over, name="delay_s")),
    Picture("pet", "PET", _over_a_key, partial(_over, name="conflict_pet")),
    Picture("cells", "Time, crashes and PET of each cell",
            lambda scene: len(scene.run.cells) > 1 and not _over_a_key(scene), _cells,
            lambda scene: (len(_CELLS), 1.4 + 0.26 * len(scene.run.cells[:_MOST_CELLS]))),
    Picture("speed-place", "Speed over place", _with_traces,
            partial(_motion, of=draw.draw_speed_over_place, what="speed over its distance")),
    Picture("speed-time", "Speed over time", _with_traces,
            partial(_motion, of=lambda axes, traces, _: draw.draw_speed_over_time(axes, traces),
                    what="speed over time")),
    Picture("map", "Crosswalks",
            lambda scene: _with_crosswalks(scene) and bool(_places(scene.run)),
            _map, lambda _scene: (1, 5.0), SIMULATIONS),
    Picture("crosswalks", "Delay and PET by crosswalk", _with_crosswalks, _by_crosswalk,
            lambda scene: (
                len(_AT), 1.4 + 0.26 * len([*scene.run.cells[0].by_crosswalk][:_MOST_CELLS])),
            SIMULATIONS),
    Picture("curves", "Delays, waits and PET over a key", _over_a_key, _curves,
            lambda _scene: (len(_OVER), 3.0), SIMULATIONS),
    Picture("place-time", "Place over time", _with_traces,
            partial(_motion, of=draw.draw_place_over_time, what="place on the road over time")),
)  # fmt: skip
"""Every picture of a page, in its order."""
