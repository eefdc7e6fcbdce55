"""The figures of a run with their captions, drawn by the ``*_figures`` modules."""

from collections.abc import Iterator, Sequence
from typing import cast

import numpy as np
import pandas as pd

from harness.core.encounter import Arm, Ending, FloatArray
from harness.episode.arrivals import planned_arrivals
from harness.model.interaction import InteractionModel
from harness.old.report import figures as draw
from harness.old.report.drawing import style
from harness.old.report.drawing.style import Picture
from harness.old.report.pages.sweep_pictures import sweep_pictures
from harness.old.report.screens.tables import counted, level
from harness.old.report.screens.words import pair_name
from harness.old.statistics import CONFIDENCE
from harness.old.studies.runs.model_use import model_cells
from harness.old.studies.runs.reported import PAPER_MU, is_the_papers
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import ShownPair
from harness.scenario import Scenario
from harness.site import Place, read_network, read_site

ARRIVALS_S = 60.0
_MOST_CONDITIONS = 300
"""Maximum number of pedestrians whose conditional densities are averaged."""
_GRID = 160
_SAFETY = (
    ("min_ttc_s", "smallest TTC (s)"),
    ("pet_s", "post-encroachment time (s)"),
    ("min_time_advantage_s", "smallest time advantage (s)"),
)


def pictures_of(
    run: RunData, model: InteractionModel | None, place: Place | None, shown: Sequence[ShownPair]
) -> Iterator[Picture]:
    """Return the figures of a run, the paper's figures first.  Call this inside ``style.styled``.

    Args:
        run: a run with at least one finished pair.
        model: the interaction model of the first of ``model_cells``; None means no figures of the
            model.
        place: the site of the run's first cell; None means no figure of the site.
        shown: the pairs with traces; without pairs there are no speed profiles.
    """
    if run.varied_keys:
        yield from sweep_pictures(run)
    else:
        yield from _tau_pictures(run)
    if _comes_at_random(run.scenario_of(0)):
        yield _arrivals(run)
    if shown:
        yield from _profiles(run, shown)
    if place is not None:
        yield _site(run, place)
    if not run.varied_keys:
        yield _safety(run)
    if model is not None:
        walking = None if run.varied_keys else _walking(run, model)
        if walking is not None:
            yield walking
        yield _model(model, model_cells(run)[0].scenario)


def _tau_pictures(run: RunData) -> Iterator[Picture]:
    tau = run.pairs["tau"].to_numpy(dtype=float)
    scenario = run.scenario_of(0)
    driver = scenario.arms.human
    count = f"n = {np.count_nonzero(~np.isnan(tau)):,} of {counted(len(tau), 'pair')}"
    figure, (axes,) = style.new_figure()
    reference = PAPER_MU if is_the_papers(scenario) else None
    draw.draw_running_mean(axes, tau, reference, driver)
    yield Picture(
        "tau-mean",
        "Running mean of τ",
        f"Mean of the first n values of τ = AV time / {driver} time, with its 95 % band "
        f"(Student's t): {count}.",
        figure,
    )
    figure, (axes,) = style.new_figure()
    row = run.summary.iloc[0]
    interval = float(row["mu"]), float(row["mu_ci_low"]), float(row["mu_ci_high"])
    mu = interval if np.isfinite(interval).all() else None
    fallback = _of_arm(run.episodes, Arm.AV)["fallback"].to_numpy(dtype=bool)
    draw.draw_tau_distribution(axes, tau, fallback, mu, driver)
    yield Picture(
        "tau-distribution",
        "Distribution of τ",
        f"Histogram of τ with μ and its {level(CONFIDENCE)} interval; {count}, "
        f"{int(fallback.sum()):,} with a fallback of the AV.",
        figure,
    )


def _arrivals(run: RunData) -> Picture:
    """Draw arrivals of the first pair with at least the expected number within a minute."""
    scenario = run.scenario_of(0)
    flow, most = scenario.pedestrians.flows_per_hour[0], scenario.pedestrians.max_count
    wanted = max(1, round(flow * ARRIVALS_S / 3600))
    # These are all pedestrians who arrive within the figure's minute, simulated or not.
    experiment = scenario.experiment.model_copy(update={"timeout_s": ARRIVALS_S})
    people = scenario.pedestrians.model_copy(update={"max_count": None})
    minute = scenario.model_copy(update={"experiment": experiment, "pedestrians": people})
    planned = [planned_arrivals(minute, pair) for pair in range(min(20, experiment.pairs))]
    pair = next((pair for pair, arrivals in enumerate(planned) if len(arrivals) >= wanted), 0)
    figure, (axes,) = style.new_figure()
    draw.draw_arrivals(axes, planned[pair], flow, most, ARRIVALS_S)
    first = ", the first at the trigger" if scenario.pedestrians.first_at_trigger else ""
    if len(scenario.pedestrians.group_size) > 1:
        first += ", in groups"
    limit = ""
    if most is not None:
        limit = f"; at most {most} per pair {'is' if most == 1 else 'are'} simulated (filled marks)"
    return Picture(
        "arrivals",
        "Arrival times of one pair",
        f"Pedestrians who arrive within {ARRIVALS_S:g} s of the trigger in "
        f"{pair_name(run, 0, pair)}: a Poisson process, λ = {flow:g} per hour{first}{limit}; "
        f"n = {len(planned[pair])}.",
        figure,
    )


def _comes_at_random(scenario: Scenario) -> bool:
    """Return whether all pedestrians arrive at random, neither timed nor drawn by a risk."""
    people = scenario.pedestrians
    return not people.drawn and (max(people.flows_per_hour) > 0 or people.first_at_trigger)


def _profiles(run: RunData, shown: Sequence[ShownPair]) -> Iterator[Picture]:
    """Draw speeds of the pairs with the lowest, the median and the highest τ."""
    chosen: dict[str, ShownPair] = {}
    for reason in ("lowest τ", "median τ", "highest τ"):
        pair = next((pair for pair in shown if reason in pair.reasons), None)
        if pair is not None and not any(other is pair for other in chosen.values()):
            chosen[f"{pair_name(run, pair.cell, pair.pair)}, {reason}"] = pair
    if not chosen:
        chosen[f"pair {shown[0].pair} of cell {shown[0].cell}"] = shown[0]
    traces = {label: pair.traces for label, pair in chosen.items()}
    caption = (
        "The ego's speed over its {} in chosen pairs. Each pair has a colour; the AV's line is "
        f"solid, the reference's is dashed; n = {counted(len(traces), 'pair')}."
    )
    figure, (axes,) = style.new_figure(height=4.4)
    width_m = run.scenario_of(shown[0].cell).crossing.width_m
    draw.draw_speed_over_distance(axes, traces, width_m)
    words = caption.format("distance to the crosswalk")
    yield Picture("speed-distance", "Speed over distance", words, figure)
    figure, (axes,) = style.new_figure(height=4.4)
    draw.draw_speed_over_time(axes, traces)
    yield Picture("speed-time", "Speed over time", caption.format("time"), figure)


def _site(run: RunData, place: Place) -> Picture:
    scenario = run.scenario_of(0)
    network = read_network(place.net)
    figure, (axes,) = style.new_figure(height=5.2)
    site = read_site(place)
    draw.draw_site(axes, network, site, scenario.vehicle(), scenario.crosswalk())
    crossing = scenario.crossing
    where = "at unknown coordinates"
    if crossing.latitude_deg is not None:
        where = f"at {crossing.latitude_deg:.6f}°, {crossing.longitude_deg:.6f}°"
    return Picture(
        "site",
        "The site",
        f"Drawn from the SUMO network, north up: crosswalk {crossing.length_m:g} m kerb to kerb "
        f"and {crossing.width_m:g} m wide {where}, the ego's bearing {crossing.bearing_deg:g}°; "
        "n = 1 site.",
        figure,
    )


def _safety(run: RunData) -> Picture:
    ran = run.episodes[run.episodes["ending"] != Ending.ENGINE_FAILED]
    driver = run.scenario.arms.human
    arms = {"AV": _of_arm(ran, Arm.AV), driver: _of_arm(ran, Arm.HUMAN)}
    figure, axes = style.new_figure(3, 1, height=9.0)
    for panel, (column, label) in zip(axes, _SAFETY, strict=True):
        values = {name: rows[column].to_numpy(dtype=float) for name, rows in arms.items()}
        draw.draw_shares(panel, values, label, 10.0)
    return Picture(
        "safety",
        "TTC, PET and time advantage",
        "Share of episodes whose smallest TTC, post-encroachment time and smallest time advantage "
        "are at most x. A curve ends below 1 if the measure is undefined in some episodes. "
        f"n = {len(arms['AV']):,} AV and {len(arms[driver]):,} {driver} episodes.",
        figure,
    )


def _walking(run: RunData, model: InteractionModel) -> Picture | None:
    """Draw walking speeds in the AV's arm and the model's mean density."""
    scenario = run.scenario_of(0)
    # Timed pedestrians have no quantile, because their speeds are not drawn from the model.
    walkers = _of_arm(run.pedestrians, Arm.AV).dropna(subset=["speed_mps", "quantile"])
    if walkers.empty or not scenario.walks_by_model:
        return None
    lower, upper = (bound[2] for bound in (model.mixture.lower, model.mixture.upper))
    grid = np.linspace(lower, upper, _GRID)
    density = _mean_density(model, scenario, walkers, grid)
    figure, (axes,) = style.new_figure()
    draw.draw_walking_speeds(axes, walkers["speed_mps"].to_numpy(), grid, density)
    return Picture(
        "walking-speeds",
        "Walking speeds and the model's density",
        "Walking speeds of everyone who stepped off in the AV's arm, compared with the mean of the "
        f"model's densities given what each of them saw; n = {len(walkers):,}.",
        figure,
    )


def _mean_density(
    model: InteractionModel, scenario: Scenario, walkers: pd.DataFrame, grid: FloatArray
) -> FloatArray:
    """Return the mean of f(v_p | state seen by the walker), over a sample if there are many."""
    rows = np.linspace(0, len(walkers) - 1, min(len(walkers), _MOST_CONDITIONS)).astype(int)
    sample = walkers.iloc[rows]
    if scenario.model.pedestrian_reading == "unconditional":
        return model.walking_speed_density_unconditional(grid)
    total = np.zeros_like(grid)
    seen = sample.groupby(["range_m", "vehicle_speed_mps"], sort=False).size()
    for condition, count in seen.items():
        range_m, speed = cast("tuple[float, float]", condition)
        if range_m <= 0:
            total += count * model.walking_speed_density_unconditional(grid)
            continue
        state = (np.full_like(grid, range_m), np.full_like(grid, speed))
        total += count * model.walking_speed_density(grid, *state)
    return total / len(sample)


def _model(model: InteractionModel, scenario: Scenario) -> Picture:
    """Draw f(v_p | 1/R, v) near the trigger's state, and f(v | 1/R, v_p, 1/T_adv)."""
    drives = "human_gmm" in scenario.arms.model_dump().values()
    figure, axes = style.new_figure(1 + drives, 1, height=3.5 + 3.1 * drives)
    range_m, speed = scenario.ego.trigger_range_m, scenario.ego.initial_speed_mps
    states = [{"range_m": range_m, "vehicle_speed_mps": share * speed} for share in (0.4, 0.7, 1.0)]
    draw.draw_walking_speed(axes[0], model, states, "v_p")
    shown, dots = "walking speeds given the vehicle", "modes"
    if drives:
        common = {"pedestrian_speed_mps": 1.2, "inverse_time_advantage_per_s": 0.1}
        states = [{"range_m": share * range_m, **common} for share in (1.0, 0.5, 0.25)]
        draw.draw_driving_speed(axes[1], model, states, "v")
        shown += ", driving speeds given the pedestrian"
        if scenario.strategies.get("human_gmm", {}).get("speed", "mode") == "mode":
            dots += ", the speeds that the human driver aims for"
    rows = model.provenance.get("rows")
    fitted = f", fitted on n = {rows:,} rows" if isinstance(rows, int) else ""
    return Picture(
        "model",
        "Conditional densities of the model",
        f"Model {model.name}, K = {model.mixture.weights.size} components{fitted}: {shown}. Dots: "
        f"{dots}.",
        figure,
    )


def _of_arm(rows: pd.DataFrame, arm: Arm) -> pd.DataFrame:
    return rows[rows["arm"] == arm.value]
