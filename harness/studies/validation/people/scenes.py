"""The experiments as scenarios: one for each measured cell, built in memory."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from harness.core.encounter import Observation
from harness.core.errors import InputError
from harness.scenario import Scenario, Setting, load_scenario, validate
from harness.scenario.file import apply_setting
from harness.strategies.driving import stop_after
from harness.studies.validation.people.measured import FirstCell, GapCell, SitePeriod

STEP_S = 0.1
"""The simulation step of every experiment."""

BRAKES_FROM_M, STANDS_AT_M = 38.5, 2.5
"""Ranges at which the yielding car begins to brake and at which it stands."""

WATCHED_S = 20.0
"""Duration of an episode before a yielding car; nobody in the data set off later than this."""

FIRST_SPEED_MPS = 50 / 3.6
TO_ZONE_M = 1.95
"""Speed of the car at the zebra crossing; distance from the person to the path of the car."""

LOOKS_AFTER_S = 1.0
"""Time after the car appeared from which the person at the zebra crossing may set off."""

MOST_SHARED_PER_HOUR = 20.0
"""Where fewer people come, this many are simulated: they meet each other too rarely to matter."""

_WALKING_MPS = 1.34
"""Mean walking speed in the laboratory (Tarawneh 2001)."""

_LANE_M, _LINE_M = 3.5, 1.0
"""Width of a lane.  The laboratory's road has no marked crosswalk, only the line that people walk
along: the narrowest crosswalk that a scenario can have."""

ALLOWED = ("pedestrians.", "strategies.", "model.", "traffic.")
"""Tables whose keys may be changed; the others define the experiments."""


@dataclass(frozen=True, slots=True)
class Scene:
    """One cell: its scenario, and when the person who stands at the kerb may decide.

    ``brakes`` says whether the car is the one that brakes evenly.  Otherwise ``arms.human``
    drives.
    """

    scenario: Scenario
    looks_from_s: float
    brakes: bool = False


class EvenBraking:
    """The car that brakes evenly from 38.5 m on to stand 2.5 m before the crossing line."""

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²; braking may begin within a step."""
        ego, step_s = observation.ego, observation.step_s
        to_brake_m = ego.range_m - BRAKES_FROM_M
        if to_brake_m > 0:
            braked_s = max(0.0, step_s - to_brake_m / ego.speed_mps)
            return -even_deceleration_mps2(ego.speed_mps) * braked_s / step_s
        return stop_after(ego.range_m - STANDS_AT_M, ego.speed_mps, step_s)


def even_deceleration_mps2(speed_mps: float) -> float:
    """The deceleration v²/2d of the yielding car, in m/s², from its speed before it brakes."""
    return speed_mps**2 / (2 * (BRAKES_FROM_M - STANDS_AT_M))


def state_at(cell: GapCell, time_s: float) -> tuple[float, float]:
    """Range (m) and speed (m/s) of the second car, ``time_s`` after the first one has passed.

    A car that yields may have begun to brake before: this is so where v · gap is below 38.5 m.
    """
    speed_mps = cell.speed_mps
    range_m = speed_mps * (cell.time_gap_s - time_s)
    if not cell.yields or range_m >= BRAKES_FROM_M:
        return range_m, speed_mps
    braked_s = (BRAKES_FROM_M - range_m) / speed_mps
    lost_mps = even_deceleration_mps2(speed_mps) * braked_s
    return range_m + lost_mps * braked_s / 2, speed_mps - lost_mps


def gap_scene(cell: GapCell, behaviour: str, settings: Sequence[Setting], seed: int) -> Scene:
    """One car and one person, who stands at the near kerb and may decide once a car has passed.

    Before a yielding car the episode begins a step earlier, so that the person sees it brake.
    """
    lead_s = STEP_S if cell.yields else 0.0
    range_m, speed_mps = state_at(cell, -lead_s)
    tree = _alone(behaviour, seed) | {
        "crossing": {"length_m": _LANE_M, "oncoming_lanes": 0, "width_m": _LINE_M},
        "ego": {"initial_speed_mps": speed_mps, "trigger_range_m": range_m},
        "arms": {"av": "constant_speed", "human": "constant_speed"},
    }
    tree["experiment"] |= {"timeout_s": WATCHED_S}
    return Scene(_scenario(tree, settings), lead_s, cell.yields)


def first_scene(
    cell: FirstCell,
    behaviour: str,
    driver: str,
    settings: Sequence[Setting],
    seed: int,
    zebra: bool = True,
) -> Scene:
    """A car at 50 km/h and a person whom its driver sees from the start.

    Without a zebra crossing the driver need not give way: ``human_yield`` has the yield rate 0.
    """
    width_m = 1.8
    length_m = 2 * (TO_ZONE_M + width_m / 2)
    tree = _alone(behaviour, seed) | {
        "crossing": {
            "length_m": length_m,
            "oncoming_lanes": 0,
            "lane_width_m": _LANE_M,
            "pedestrian_priority": zebra,
        },
        "ego": {
            "initial_speed_mps": FIRST_SPEED_MPS,
            "trigger_range_m": FIRST_SPEED_MPS * cell.time_to_arrival_s,
            "width_m": width_m,
        },
        "arms": {"av": driver, "human": driver},
        "strategies": {} if zebra else {"human_yield": {"yield_rate": 0.0}},
    }
    return Scene(_scenario(tree, settings), LOOKS_AFTER_S)


def site_scenario(
    site: SitePeriod, behaviour: str, driver: str, settings: Sequence[Setting], seed: int
) -> Scenario:
    """``field_sites`` with the keys of a site-period: hours of traffic with its yield rate."""
    oncoming = site.lanes // 2 if site.two_way else 0
    share = oncoming / site.lanes
    values: Mapping[str, Any] = {
        "crossing.length_m": site.length_m,
        "crossing.lanes": site.lanes - oncoming,
        "crossing.oncoming_lanes": oncoming,
        "ego.initial_speed_mps": site.speed_mps,
        "traffic.flow_per_hour": site.vehicles_per_hour * (1 - share),
        "traffic.oncoming_per_hour": site.vehicles_per_hour * share,
        "pedestrians.flow_per_hour": max(site.pedestrians_per_hour, MOST_SHARED_PER_HOUR),
        "pedestrians.behaviour": behaviour,
        "pedestrians.walking_speed.mean_mps": site.length_m / site.crossing_time_s,
        "strategies.human_yield.yield_rate": site.yield_rate,
        "arms.av": driver,
        "arms.human": driver,
        "model.extrapolate": True,
        "experiment.seed": seed,
    }
    ours = [Setting(key, value, "") for key, value in values.items()]
    return load_scenario("field_sites", [*ours, *settings])


def check_settings(settings: Sequence[Setting]) -> None:
    """Refuse keys that define the experiments."""
    for setting in settings:
        if not setting.key.startswith(ALLOWED):
            where = f"{setting.source} {setting.key}"
            tables = ", ".join(name.rstrip(".") for name in ALLOWED)
            raise InputError(where, "is fixed by the experiments", f"a key of {tables}")


def _alone(behaviour: str, seed: int) -> dict[str, Any]:
    """The tables of an encounter with one person, who is at the near kerb from the start."""
    return {
        "pedestrians": {
            "behaviour": behaviour,
            "flow_per_hour": 0.0,
            "first_at_trigger": True,
            "near_side_share": 1.0,
            "walking_speed": {"mean_mps": _WALKING_MPS},
        },
        "model": {"extrapolate": True},
        "experiment": {"seed": seed, "step_s": STEP_S},
    }


def _scenario(tree: dict[str, Any], settings: Sequence[Setting]) -> Scenario:
    mine = [setting for setting in settings if not setting.key.startswith("traffic.")]
    for setting in mine:
        apply_setting(tree, setting)
    return validate(tree, "harness validate people", {setting.key: "--set" for setting in mine})
