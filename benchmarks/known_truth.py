"""A small experiment of which the truth is known: the paper's (``cctc``) on the plain engine.

Its one pedestrian steps off at the trigger, so an episode is a function of his side and of his
quantile u, which is uniform.  Expectations are integrals over u: here sums over the midpoints of
equal parts of (0, 1), for either side, each driven through the program's own episode.  There is no
sampling in them, and nothing of ``harness.results.estimators``.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial

import numpy as np
import pyarrow as pa

from benchmarks.coverage import chosen_pairs as chosen_pairs, plain_engine
from harness.core.vocabulary import Arm, Arrival, FloatArray, Side
from harness.encounter.arms import make_strategy
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.cell_constants import constants_of
from harness.encounter.loop import Episode, drive
from harness.encounter.pairing import PairRunner
from harness.measures import Outcome, measure
from harness.model.interaction import InteractionModel, load_model
from harness.results.rows import episode_rows
from harness.scenario import Scenario, Setting, load_scenario

SCENARIO = "cctc"

CELLS: dict[str, dict[str, object]] = {
    "soft": {},
    "hard": {"arms.av": "hard_yield"},
    "constant": {"arms.av": "constant_speed"},
    "brake": {"arms.av": "emergency_brake", "strategies.emergency_brake.ttc_threshold_s": 0.6},
    "bold": {"strategies.soft_yield.time_margin_s": -1.046},
}
"""AVs by a short name.  ``brake`` and ``bold`` crash equally often, but not in the same pairs."""

COMPARED = (("soft", "hard"), ("soft", "constant"), ("brake", "bold"))

FREE_S = (30.0 + 2.0 + 5.0) / 5.0
"""Pass time of a car that never brakes: range, half the crosswalk and length at 5 m/s."""

CHUNK = 500

Columns = Mapping[str, np.ndarray]


def scenario_of(settings: Mapping[str, object], seed: int = 1) -> Scenario:
    """The experiment with another AV and root seed."""
    changes = {**settings, "experiment.seed": seed}
    return load_scenario(SCENARIO, [Setting(key, value) for key, value in changes.items()])


def model_of(scenario: Scenario) -> InteractionModel:
    """The interaction model of a scenario."""
    return load_model(scenario.model.name, scenario.model.path)


def nodes(cells: Mapping[str, Mapping[str, object]], per_side: int) -> dict[str, pa.Table]:
    """``episodes`` of every cell, one pair for each node; all nodes weigh the same."""
    middles = (np.arange(per_side) + 0.5) / per_side
    quantiles, sides = np.tile(middles, 2), [Side.NEAR] * per_side + [Side.FAR] * per_side
    any_cell = scenario_of({})
    human = _arm(any_cell, Arm.HUMAN, quantiles, sides)
    return {
        name: both_arms(_arm(scenario_of(settings), Arm.AV, quantiles, sides), human)
        for name, settings in cells.items()
    }


def both_arms(av: pa.Table, human: pa.Table) -> pa.Table:
    """Rows pair by pair, AV first, of one arm's rows each."""
    order = np.arange(2 * av.num_rows).reshape(2, -1).T.ravel()
    return pa.concat_tables([av, human]).take(order)


def node_of(arrival: Arrival, per_side: int) -> int:
    """The node nearest to a pedestrian's quantile, on his side."""
    assert arrival.quantile is not None
    return int(arrival.quantile * per_side) + (arrival.side is Side.FAR) * per_side


def planned_nodes(pairs: int, seed: int, per_side: int) -> np.ndarray:
    """The nodes nearest to the pedestrians whom the program plans for these pairs."""
    scenario = scenario_of({}, seed)
    planned = (planned_arrivals(scenario, pair) for pair in range(pairs))
    return np.array([node_of(arrivals[0], per_side) for arrivals in planned])


def simulated(
    cells: Mapping[str, Mapping[str, object]], pairs: int, seed: int, model: InteractionModel
) -> dict[str, pa.Table]:
    """The same cells as the program runs them: planned and drawn from the root seed.

    The human's arm is the same in every cell, so it is simulated in the first alone.
    """
    found: dict[str, pa.Table] = {}
    human = None
    for name, settings in cells.items():
        reference: dict[str, object] = {} if human is None else {"arms.human": "constant_speed"}
        scenario = scenario_of({**settings, **reference}, seed)
        outcomes = PairRunner(scenario, model, partial(plain_engine, scenario)).run(range(pairs))
        table = episode_rows(0, [*outcomes])
        if human is None:
            human = table.take(np.arange(1, 2 * pairs, 2))
        found[name] = both_arms(table.take(np.arange(0, 2 * pairs, 2)), human)
    return found


def _arm(scenario: Scenario, arm: Arm, quantiles: FloatArray, sides: list[Side]) -> pa.Table:
    """One arm of every node."""
    model, engine = model_of(scenario), plain_engine(scenario)
    vehicle, rules = scenario.vehicle(), constants_of(scenario)
    count = len(quantiles)
    seen = vehicle.trigger_range_m, vehicle.initial_speed_mps
    speeds = [model.walking_speed(quantile, *seen) for quantile in quantiles.tolist()]
    name = scenario.arms.driver(arm)

    def outcomes() -> Iterator[Outcome]:
        for begin in range(0, count, CHUNK):
            chunk = range(begin, min(begin + CHUNK, count))
            traces = [
                drive(
                    Episode(
                        engine,
                        (Arrival(0, 0.0, sides[node], float(quantiles[node])),),
                        _always(speeds[node]),
                        rules,
                    ),
                    make_strategy(scenario, arm, node, model),
                )
                for node in chunk
            ]
            for node, trace, record in zip(chunk, traces, measure(traces), strict=True):
                yield Outcome(node, arm, name, record, trace)

    return episode_rows(0, [*outcomes()])


def _always(speed_mps: float) -> Callable[..., float]:
    return lambda *_seen: speed_mps


def columns_of(episodes: pa.Table) -> tuple[Columns, Columns]:
    """Of the AV's and the human's rows: pass times, ending, and what conflicts go by."""
    names = ["pass_time_s", "pass_time_ignoring_contact_s", "pedestrian_delay_s"]
    names += ("min_ttc_s", "min_time_advantage_s", "pet_s", "max_drac_mps2")
    found = []
    for first in (0, 1):
        rows = episodes.take(np.arange(first, episodes.num_rows, 2))
        numbers = {name: np.array(rows[name].to_pylist(), dtype=float) for name in names}
        crashed = np.array(rows["ending"].to_pylist()) == "crashed"
        avoidable, attentive = (
            np.array([bool(value) for value in rows[name].to_pylist()])
            for name in ("avoidable", "avoidable_attentive")
        )
        front = np.array(rows["contact"].to_pylist()) == "front"
        marks = {"avoidable": avoidable, "attentive": attentive, "front": front}
        crashes = {name: crashed & mark for name, mark in marks.items()}
        found.append({**numbers, "crashed": crashed, **crashes})
    return found[0], found[1]


def truth_of_cell(episodes: pa.Table) -> dict[str, float]:
    """What the intervals of a cell should hold, from the definitions in docs/method.md."""
    truth = {}
    av, human = columns_of(episodes)
    tau = tau_of(episodes)
    mean, square = np.nanmean(tau), np.nanmean(tau**2)
    truth["mu"], truth["cv"] = float(mean), float(np.sqrt(square - mean**2) / mean)
    truth |= _left_out(av, human)
    for arm, end in ((av, ""), (human, "_human")):
        crashed = arm["crashed"]
        truth[f"kappa{end}"] = float(crashed.mean())
        truth[f"kappa_avoidable{end}"] = float(arm["avoidable"].mean())
        truth[f"kappa_avoidable_attentive{end}"] = float(arm["attentive"].mean())
        truth[f"delay_s{end}"] = float(np.nanmean(arm["pass_time_s"])) - FREE_S
        truth[f"pedestrian_wait_s{end}"] = float(arm["pedestrian_delay_s"].mean())
        # The one pedestrian steps off in every pair.
        truth[f"kappa_met_someone{end}"] = truth[f"kappa{end}"]
        truth[f"delay_met_someone_s{end}"] = truth[f"delay_s{end}"]
        for name, conflict in (
            ("ttc", arm["min_ttc_s"] < 1.5),
            ("time_advantage", arm["min_time_advantage_s"] < 1.5),
            ("pet", arm["pet_s"] < 1.5),
            ("drac", arm["max_drac_mps2"] > 3.35),
        ):
            share = float((conflict | crashed).mean())
            truth[f"conflict_{name}{end}"] = share
    return truth


def _left_out(av: Columns, human: Columns) -> dict[str, float]:
    """What stands beside μ and κ: what they leave out, counted or at its worst."""
    timeout_s = scenario_of({}).experiment.timeout_s
    av_s, human_s = av["pass_time_s"], human["pass_time_ignoring_contact_s"]
    missing = np.isnan(av_s)
    worst = np.where(missing, timeout_s, av_s) / np.where(np.isnan(human_s), FREE_S, human_s)
    return {
        "mu_all": float(np.nanmean(av_s / human_s)),
        "mu_met_someone": float(np.nanmean(av_s / human["pass_time_s"])),
        "delay_difference_s": float(np.nanmean(av_s - human_s)),
        "mu_worst": float(worst.mean()),
        **_ratios(av, human, timeout_s),
        "kappa_worst": float(missing.mean()),
        "kappa_all": float(missing.mean()),
        "delay_worst_s": float(np.where(missing, timeout_s, av_s).mean()) - FREE_S,
        "delay_worst_s_human": float(np.nan_to_num(human_s, nan=FREE_S).mean()) - FREE_S,
    }


def _ratios(av: Columns, human: Columns, timeout_s: float) -> dict[str, float]:
    """Ratios of times: a crash of the human as if untouched, whoever never passed at the end."""
    times = [
        np.where(
            np.isnan(arm["pass_time_ignoring_contact_s"]),
            timeout_s,
            arm["pass_time_ignoring_contact_s"],
        )
        for arm in (av, human)
    ]
    alive = ~av["crashed"]
    never = np.isnan(human["pass_time_ignoring_contact_s"])
    av_worst = np.where(alive, times[0], timeout_s)
    return {
        "time_ratio": float(times[0][alive].sum() / times[1][alive].sum()),
        "time_s": float(times[0][alive].mean()),
        "time_s_human": float(times[1][alive].mean()),
        "time_ratio_worst": float(av_worst.sum() / np.where(never, FREE_S, times[1]).sum()),
    }


def truth_of_differences(first: pa.Table, second: pa.Table) -> dict[str, float]:
    """Of the AV's arm, over the nodes at which both cells are defined."""
    times = [columns_of(cell)[0]["pass_time_s"] for cell in (first, second)]
    return {
        "mu_difference": float(np.nanmean(tau_of(first) - tau_of(second))),
        "delay_difference_s": float(np.nanmean(times[0] - times[1])),
    }


def tau_of(episodes: pa.Table) -> FloatArray:
    """τ of every pair, NaN where either arm did not cross."""
    av, human = columns_of(episodes)
    tau: FloatArray = av["pass_time_s"] / human["pass_time_s"]
    return tau


def every_truth(
    cells: Mapping[str, pa.Table], compared: Iterable[tuple[str, str]]
) -> dict[str, float]:
    """Truths by cell, or by the two compared, and the name of the number."""
    found = {
        f"{cell}: {name}": value
        for cell, episodes in cells.items()
        for name, value in truth_of_cell(episodes).items()
    }
    for a, b in compared:
        for name, value in truth_of_differences(cells[a], cells[b]).items():
            found[f"{a} − {b}: {name}"] = value
    return found
