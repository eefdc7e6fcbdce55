"""The uniforms behind an episode that are sampled, and what they are in the episode's streams.

An episode is a function of uniforms: when each pedestrian comes, from which side, at which quantile
of the walking speed, with which critical gap, when they are first detected and found again after
the first loss, with which errors at first, and what the strategy draws first.  Those who are there
for certain (timed, or first at the trigger) have fixed uniforms, and so has the strategy.  The flow
is a Poisson process: within ``window_s`` of the trigger, each of its people is a point whose first
uniform is the arrival over the window.  Everything else (those who come later, later draws of
strategy and perception) is drawn from the streams of the episode's number, with weight 1.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from harness.core.encounter import Arm, FloatArray
from harness.core.errors import InputError
from harness.core.seeding import GIVEN_DRAWS, Given, Purpose, stream
from harness.episode.arms import draws, draws_from
from harness.episode.arrivals import SECONDS_PER_HOUR
from harness.scenario import Scenario
from harness.studies.risk.layout import Layout

_WINDOW_PASSES = 4.0
"""The flow's people are sampled within so many times the time of an unhindered pass."""

_OPEN = 2.0**-53
"""Uniforms keep this far from 0 and 1, whose quantiles are infinite."""


@dataclass(frozen=True, slots=True)
class Space:
    """What the numbers of a state are.

    Attributes:
        fixed: the purpose of each fixed uniform: the first is its stream's first, and so on.
        marks: purposes of the uniforms of each of the flow, the arrival first; () without a flow.
        layout: sizes of a state.
        first: the number of the flow's first pedestrian.
        seed: of the streams.
        by_chance: what perception draws and no uniform of a state stands for, in words.
    """

    fixed: tuple[Purpose, ...]
    marks: tuple[Purpose, ...]
    layout: Layout
    first: int
    seed: int
    by_chance: tuple[str, ...]

    def given(self, z: FloatArray, number: int) -> Given:
        """The uniforms Φ(z) by purpose, in place of the first draws of each stream.

        The streams know the flow by the gaps between its arrivals, which are exponential.  The gap
        to the first one after the window begins anew at its end, as the process has no memory.

        Args:
            z: one state, shape (width,).
            number: of the episode.
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
        # The first arrival is nobody's where the first pedestrian is there at the trigger.
        values["arrival"] = [0.5] * self.first + gaps.tolist()
        return values


def space_of(scenario: Scenario, arm: Arm) -> Space:
    """The sampled uniforms of a scenario, of the episodes of one arm.

    Raises:
        InputError: hours of traffic; SUMO's own pedestrians, who are no function of uniforms; or
            nothing in an episode is random.
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
    if pedestrians.behaviour == "gap_acceptance":
        per_walker.append("critical_gap")
    if misses:
        per_walker.append("detection")
    timed = len(scenario.timed_walks())
    most = pedestrians.max_count
    first = int(pedestrians.first_at_trigger and most != 0)
    fixed: list[Purpose] = ["timed_detection"] * timed if misses else []
    fixed += per_walker * first + seen * (timed + first)
    if draws(scenario, arm):
        fixed += [draws_from(scenario, arm)] * GIVEN_DRAWS
    flows = pedestrians.flow_per_hour > 0 and (most is None or most > first)
    if not (fixed or flows or drops):
        raise InputError(
            "pedestrians.flow_per_hour",
            "is 0: nothing in an episode is random",
            "a flow above 0, or pedestrians who may be missed; otherwise use harness run",
        )
    marks: tuple[Purpose, ...] = ("arrival", *per_walker, *seen) if flows else ()
    free_pass_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    window_s = min(_WINDOW_PASSES * free_pass_s, scenario.experiment.timeout_s)
    rate = pedestrians.flow_per_hour / SECONDS_PER_HOUR
    by_chance = (
        *(["whether perception loses a pedestrian at a look"] if drops else []),
        *(["how perception errors change after the first look at a pedestrian"] if errs else []),
    )
    # The errors of those who walk at the trigger come from streams numbered after all who come.
    entangled = (errs or drops) and pedestrians.warm_up_s > 0
    layout = Layout(len(fixed), len(marks), rate, window_s, entangled)
    return Space(tuple(fixed), marks, layout, first, scenario.experiment.seed, by_chance)


def _refuse_unsampled(scenario: Scenario) -> None:
    pedestrians = scenario.pedestrians
    if scenario.traffic is not None:
        raise InputError(
            "traffic", "describes hours of many vehicles, not episodes of one", "no [traffic]"
        )
    if pedestrians.behaviour == "sumo":
        raise InputError(
            "pedestrians.behaviour",
            '"sumo" cannot be sampled: SUMO moves these pedestrians by itself',
            '"constant", "gap_acceptance" or "reactive"',
        )
    if pedestrians.drawn:
        raise InputError("pedestrians.drawn", "leaves nothing random", "a scenario without it")
