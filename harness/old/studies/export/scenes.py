"""Takes the tables of a pair; returns what is exported of it, for each kind of run."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm, Ending, FloatArray
from harness.core.errors import InputError
from harness.encounter.traffic.lanes import Lane, lanes_of
from harness.engine.network import network_of, place_of
from harness.old.store.simulations.simulation_traces import scene_parts
from harness.old.store.tables import Row
from harness.old.store.walk_rows import stored_walk
from harness.old.studies.export.scene import Box, Mover, Scene, walkers
from harness.old.studies.runs.simulation_choice import most_striking
from harness.scenario import Scenario
from harness.scenario.own_simulation import setting_of
from harness.site import read_site

_ROUNDING_S = 1e-9

States = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Time, x, y and speed of an object."""


@dataclass(frozen=True)
class Wanted:
    """Which arm and which passage are exported, and whether the ego drives freely.

    ``vehicle`` and ``crosswalk`` are ids in hours and in users' own simulations.
    """

    arm: Arm
    vehicle: str | None = None
    crosswalk: str | None = None
    free: bool = False


@dataclass(frozen=True)
class Stored:
    """One arm of a pair: its scenario, a title, and its rows by table."""

    scenario: Scenario
    title: str
    tables: Mapping[str, pa.Table]

    def rows(self, name: str) -> list[Row]:
        """Return the rows of a table."""
        rows: list[Row] = self.tables[name].to_pylist()
        return rows

    def states(self) -> Iterator[tuple[str, States]]:
        """Yield name and time, x, y and speed of each object, in the order of the table."""
        frame = self.tables["traces"].to_pandas()
        for name, rows in frame.groupby("object", sort=False):
            t, x, y, v = (
                rows[key].to_numpy(dtype=float) for key in ("time_s", "x_m", "y_m", "speed_mps")
            )
            yield str(name), (t, x, y, v)


def scene_of(stored: Stored, wanted: Wanted) -> Scene:
    """Return what is exported of an arm.

    Raises:
        InputError: there is no such passage, the arm failed, or an option is not supported.
    """
    name = stored.scenario.kind
    if name == "encounters":
        for option, value in (("--vehicle", wanted.vehicle), ("--crosswalk", wanted.crosswalk)):
            if value is not None:
                raise InputError(f"{option} {value}", "is not supported", "nothing: an encounter")
    elif wanted.free:
        raise InputError("--ego free", f"is not supported for {name}", "a run of encounters")
    return SCENES[name](stored, wanted)


def _encounter(stored: Stored, wanted: Wanted) -> Scene:
    scenario = stored.scenario
    row, states = stored.rows("episodes")[0], dict(stored.states())
    if row["ending"] == Ending.ENGINE_FAILED or "ego" not in states:
        raise _failed(wanted, row["reason"])
    crossing, step_s = scenario.crosswalk(), scenario.experiment.step_s
    ego = _driven("ego", scenario, states["ego"])
    end_s = float(ego.time_s[-1])
    walks = [stored_walk(each) for each in stored.rows("pedestrians")]
    people = [*walkers(walks, crossing, step_s, end_s, to_the_kerb=wanted.free)]
    if wanted.free and not any(len(person.time_s) > 1 for person in people):
        raise InputError("--ego free", "nobody walks in this arm of the pair", "another pair")
    boxes = [Box(each.x_m, each.y_m, each.length_m, each.width_m) for each in scenario.obstacles()]
    return Scene(
        title=stored.title,
        net=network_of(scenario),
        frame=read_site(place_of(scenario)).frame,
        movers=(ego, *people),
        crossing=crossing,
        end_s=end_s,
        timeout_s=scenario.experiment.timeout_s,
        boxes=tuple(boxes),
    )


def _hour(stored: Stored, wanted: Wanted) -> Scene:
    """The passages within the time of the named one."""
    scenario = stored.scenario
    if (reason := stored.rows("hours")[0]["reason"]) is not None:
        raise _failed(wanted, reason)
    if wanted.crosswalk is not None:
        raise InputError(f"--crosswalk {wanted.crosswalk}", "is not supported", "--vehicle")
    passages = {str(row["vehicle"]): row for row in stored.rows("passages")}
    chosen = _named(passages, wanted)
    begin_s, passed_s = chosen["trigger_s"], chosen["passed_s"]
    states = dict(stored.states())
    own = states[f"vehicle-{wanted.vehicle}"][0]
    last_s = inf if passed_s is None else passed_s + scenario.experiment.step_s
    own = own[(own > begin_s - _ROUNDING_S) & (own < last_s - _ROUNDING_S)]
    begin_s, end_s = float(own[0]), float(own[-1])
    lanes = {(lane.direction.value, lane.index): lane for lane in lanes_of(scenario)}
    vehicles = []
    for number, row in passages.items():
        if (columns := states.get(f"vehicle-{number}")) is None:
            continue
        lane: Lane = lanes[row["direction"], row["lane"]]
        sign = lane.direction.sign
        t, x, y, v = _within(columns, begin_s, end_s)
        if len(t):
            name = "ego" if number == wanted.vehicle else f"vehicle-{number}"
            mover = _driven(name, scenario, (t - begin_s, x, y, v), row["type"], sign)
            leaves_s = float(mover.time_s[-1]) if t[-1] < end_s else None
            vehicles.append(replace(mover, leaves_s=leaves_s))
    crossing = lanes[chosen["direction"], chosen["lane"]].crossing
    walks = _shifted(stored.rows("walks"), begin_s)
    step_s, length_s = scenario.experiment.step_s, end_s - begin_s
    people = walkers(
        map(stored_walk, walks), scenario.crosswalk(), step_s, length_s, to_the_kerb=False
    )
    return Scene(
        title=f"{stored.title}, vehicle {wanted.vehicle} from {begin_s:g} s",
        net=network_of(scenario),
        frame=read_site(place_of(scenario)).frame,
        movers=(*sorted(vehicles, key=lambda each: each.name != "ego"), *people),
        crossing=crossing,
        end_s=length_s,
        timeout_s=length_s,
    )


def _simulation(stored: Stored, wanted: Wanted) -> Scene:
    """One passage and the people whom it meets."""
    scenario = stored.scenario
    if (reason := stored.rows("simulations")[0]["reason"]) is not None:
        raise _failed(wanted, reason)
    rows = stored.tables["passages_over"].to_pandas()
    chosen = most_striking(
        rows.assign(number=np.arange(len(rows))), wanted.vehicle, wanted.crosswalk
    )
    if chosen is None:
        named = " ".join(filter(None, (wanted.vehicle, wanted.crosswalk)))
        problem = f"no such passage in the arm {wanted.arm.value}: {named or 'nobody passed'}"
        raise InputError("--vehicle, --crosswalk", problem, "a passage that `harness worst` lists")
    number = int(chosen["number"])
    scene = next(row for row in stored.rows("scenes_over") if row["passage"] == number)
    crossing, vehicle = scene_parts(scene)
    setting = setting_of(scenario)
    crosswalk = next(each for each in setting.crosswalks if each.id == scene["crosswalk"])
    way = next(each for each in crosswalk.straight_ways if each.approach == scene["approach"])
    t, x, y, v = dict(stored.states())[f"passage-{number}"]
    ego = Mover("ego", vehicle, 0.0, None, t - scene["begin_s"], x, y, v, (1.0, 0.0))
    end_s = float(ego.time_s[-1])
    walks = map(stored_walk, scene["walks"])
    people = walkers(walks, crossing, scene["step_s"], end_s, to_the_kerb=False)
    where = f"vehicle {scene['vehicle']} over {scene['crosswalk']} from {scene['begin_s']:g} s"
    return Scene(
        title=f"{stored.title}, {where}",
        net=setting.config.net,
        frame=way.frame,
        movers=(ego, *people),
        crossing=crossing,
        end_s=end_s,
        timeout_s=end_s,
    )


SCENES: Mapping[str, Callable[[Stored, Wanted], Scene]] = {
    "encounters": _encounter,
    "hours of traffic": _hour,
    "own simulations": _simulation,
}
"""What is exported of each kind of run, by the kind's name."""


def _driven(
    name: str,
    scenario: Scenario,
    states: States,
    kind: str | None = None,
    sign: float = 1.0,
) -> Mover:
    """A vehicle of a scenario; ``sign`` is −1 if it drives against the road frame's x."""
    vehicle = scenario.vehicle_of_type(kind)
    return Mover(name, vehicle, float(states[0][0]), None, *states, (sign, 0.0))


def _within(columns: States, begin_s: float, end_s: float) -> States:
    """The states between two times and at both, between two stored states on a straight line.

    A vehicle farther away than R0 is stored once per second.
    """
    times = columns[0]
    inside = times[(times > begin_s) & (times < end_s)]
    ends = [time for time in (begin_s, end_s) if times[0] <= time <= times[-1]]
    wanted = np.union1d(inside, ends)
    x, y, v = (np.interp(wanted, times, column) for column in columns[1:])
    return wanted, x, y, v


def _named(passages: Mapping[str, Row], wanted: Wanted) -> Row:
    """The row of the named passage."""
    came = [name for name, row in passages.items() if row["trigger_s"] is not None]
    if wanted.vehicle is None:
        raise InputError("--vehicle", "is missing", f"a vehicle of this hour, e.g. {came[0]}")
    if wanted.vehicle not in came:
        problem = f"did not reach the trigger in the arm {wanted.arm.value}"
        raise InputError(f"--vehicle {wanted.vehicle}", problem, f"e.g. {came[0]}")
    return passages[wanted.vehicle]


def _shifted(walks: Sequence[Row], begin_s: float) -> list[Row]:
    """Rows of walks whose times count from another moment."""
    shifted = []
    for row in walks:
        times = {name: _earlier(row[name], begin_s) for name in ("arrival_s", "start_s")}
        legs = row["legs"] and [leg | {"time_s": leg["time_s"] - begin_s} for leg in row["legs"]]
        shifted.append(row | times | {"legs": legs})
    return shifted


def _earlier(time_s: float | None, by_s: float) -> float | None:
    return None if time_s is None else time_s - by_s


def _failed(wanted: Wanted, reason: str | None) -> InputError:
    problem = f"the arm {wanted.arm.value} failed ({reason})"
    return InputError("--pair", problem, "a pair whose arm ran")
