"""Takes a scenario and returns the sampled uniforms of its episodes by random stream.

An episode is a function of uniforms.  They determine each pedestrian's arrival, side, quantile and
class of the walking speed, critical gap or threshold and latency, first detection, detection after
the first loss, and first errors, and the strategy's first draws.  Timed pedestrians, the first
pedestrian at the trigger, and the strategy have fixed uniforms.  The flow is a Poisson process.
Each of its pedestrians who arrives within ``window_s`` of the trigger is a point whose first
uniform is arrival/window.  Other randomness (later pedestrians, later draws of the strategy and of
perception) comes from streams keyed by the episode's number and is not weighted.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from harness.core.encounter import Arm, FloatArray
from harness.core.errors import InputError
from harness.core.seeding import GIVEN_DRAWS, Given, Purpose, stream
from harness.encounter.arms import draws, draws_from
from harness.encounter.arrivals import SECONDS_PER_HOUR
from harness.old.studies.risk.layout import Layout
from harness.scenario import Scenario

_WINDOW_PASSES = 4.0
"""Length of the flow's sampled window as a multiple of the unhindered passing time."""

_OPEN = 2.0**-53
"""Smallest distance of a uniform from 0 and from 1, where quantiles are infinite."""


@dataclass(frozen=True, slots=True)
class Space:
    """The meaning of the numbers of a state.

    Attributes:
        fixed: the purpose of each fixed uniform, in the order of its stream's draws.
        marks: the purpose of each uniform of a pedestrian in the flow, the arrival first; ()
            without a flow.
        layout: sizes of a state.
        first: whether the first pedestrian is at the crosswalk at the trigger, 0 or 1.
        before: index of the flow's first pedestrian.
        seed: seed of the streams.
        by_chance: names of perception's random processes that no uniform of a state represents.
    """

    fixed: tuple[Purpose, ...]
    marks: tuple[Purpose, ...]
    layout: Layout
    first: int
    before: int
    seed: int
    by_chance: tuple[str, ...]

    def given(self, z: FloatArray, number: int) -> Given:
        """Return the uniforms Φ(z) by purpose.  They replace the first draws of each stream.

        The stream of arrivals contains the exponential gaps between the flow's pedestrians.  A
        Poisson process has no memory, so the gap to the first pedestrian after the window counts
        from the window's end.

        Args:
            z: a state, shape (width,).
            number: the episode's number.
        """
        layout = self.layout
        uniforms = np.clip(ndtr(z[: layout.fixed]), _OPEN, 1 - _OPEN).tolist()
        values: dict[Purpose, list[float]] = {}
        for purpose, uniform in zip(self.fixed, uniforms, strict=True):
            values.setdefault(purpose, []).append(uniform)
        if not self.marks:
            return values
        people = layout.people(z[None])[0]
        people = people[~np.isnan(people[:, 0])]
        people = np.clip(ndtr(people[np.argsort(people[:, 0], kind="stable")]), _OPEN, 1 - _OPEN)
        for purpose in dict.fromkeys(self.marks[1:]):
            columns = [k for k, mark in enumerate(self.marks) if mark == purpose]
            values.setdefault(purpose, []).extend(people[:, columns].ravel().tolist())
        later = stream(self.seed, "arrival", number).random(self.first + len(people) + 1)[-1]
        window = layout.mean_count
        times = [0.0, *(window * people[:, 0]), window - math.log1p(-later)]
        gaps = np.clip(-np.expm1(-np.diff(times)), _OPEN, 1 - _OPEN)
        # If the first pedestrian is at the crosswalk at the trigger, the first gap is not used.
        values["arrival"] = [0.5] * self.first + gaps.tolist()
        return values

    def place_of(self, z: FloatArray, index: int | None) -> int:
        """Return the place in a state of the pedestrian with an index; −1 if there is none.

        Args:
            z: a state, shape (width,).
            index: index among all arrivals of the episode.
        """
        arrival = self.layout.people(z[None])[0, :, 0]
        (present,) = np.nonzero(~np.isnan(arrival))
        order = present[np.argsort(arrival[present], kind="stable")]
        rank = -1 if index is None else index - self.before
        return int(order[rank]) if 0 <= rank < len(order) else -1


def space_of(scenario: Scenario, arm: Arm) -> Space:
    """Return the sampled uniforms of one arm's episodes.

    Raises:
        InputError: the scenario has ``[traffic]``, SUMO moves the pedestrians, or nothing in an
            episode is random.
    """
    pedestrians, perception = scenario.pedestrians, scenario.perception
    _refuse_unsampled(scenario)
    misses, drops = perception.detection_probability < 1, perception.dropout_probability > 0
    errs = perception.position_sd_m > 0 or perception.speed_sd_mps > 0
    hides = perception.occlusion and bool(scenario.obstacles())
    seen: list[Purpose] = ["redetection"] if misses and (drops or hides) else []
    if errs:
        seen += ["perception_error", "perception_error"]
    per_walker: list[Purpose] = ["side", "quantile"]
    if pedestrians.walking_classes:
        per_walker.append("walking_class")
    if pedestrians.behaviour == "gap_acceptance":
        per_walker.append("critical_gap")
    if pedestrians.behaviour == "threshold":
        per_walker += ["threshold", "latency"]
    if misses:
        per_walker.append("detection")
    timed = len(scenario.timed_walks())
    most = pedestrians.max_count
    first = int(pedestrians.first_at_trigger and most != 0)
    fixed: list[Purpose] = ["timed_detection"] * timed if misses else []
    fixed += per_walker * first + seen * (timed + first)
    if draws(scenario, arm):
        fixed += [draws_from(scenario, arm)] * GIVEN_DRAWS
    flow_per_hour = pedestrians.flows_per_hour[0]
    flows = flow_per_hour > 0 and (most is None or most > first)
    if not (fixed or flows or drops):
        raise InputError(
            "pedestrians.flow_per_hour",
            "is 0: nothing in an episode is random",
            "a flow above 0, or a detection probability below 1; otherwise use harness run",
        )
    marks: tuple[Purpose, ...] = ("arrival", *per_walker, *seen) if flows else ()
    free_pass_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    window_s = min(_WINDOW_PASSES * free_pass_s, scenario.experiment.timeout_s)
    rate = flow_per_hour / SECONDS_PER_HOUR
    by_chance = (
        *(["the updates at which perception loses a pedestrian"] if drops else []),
        *(["the change of perception errors after a pedestrian's first update"] if errs else []),
    )
    layout = Layout(len(fixed), len(marks), rate, window_s)
    seed = scenario.experiment.seed
    return Space(tuple(fixed), marks, layout, first, timed + first, seed, by_chance)


def _refuse_unsampled(scenario: Scenario) -> None:
    pedestrians = scenario.pedestrians
    if scenario.kind != "encounters":
        section = "simulation" if scenario.traffic is None else "traffic"
        problem = "is not supported by a risk estimate"
        raise InputError(section, problem, f"a scenario without [{section}]")
    if isinstance(pedestrians.flow_per_hour, tuple):
        problem = "a list is not supported by a risk estimate"
        raise InputError("pedestrians.flow_per_hour", problem, "one flow")
    if len(pedestrians.group_size) > 1:
        problem = "is not supported by a risk estimate"
        raise InputError("pedestrians.group_size", problem, "a scenario without it")
    if pedestrians.drawn:
        raise InputError(
            "pedestrians.drawn", "leaves nothing random to sample", "a scenario without it"
        )
