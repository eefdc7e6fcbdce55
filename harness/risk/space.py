"""The uniforms behind an episode that are sampled, and what they are in the episode's streams.

An episode is a function of uniforms: when each pedestrian comes, from which side, at which quantile
of the walking speed, with which critical gap, and when they are first detected.  Those who are
there for certain (timed, or first at the trigger) have fixed uniforms.  The flow is a Poisson
process: within ``window_s`` of the trigger, each of its people is a point whose first uniform is
the arrival over the window.  Everything else (those who come later, the strategy's own draws) is
drawn from the streams of the episode's number, with weight 1.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from harness.encounter import FloatArray
from harness.episode.arrivals import SECONDS_PER_HOUR, Given
from harness.errors import InputError
from harness.risk.layout import Layout
from harness.scenario import Scenario
from harness.seeding import Purpose, stream

_WINDOW_PASSES = 4.0
"""The flow's people are sampled within so many times the time of an unhindered pass."""

_OPEN = 2.0**-53
"""Uniforms keep this far from 0 and 1, whose quantiles are infinite."""


@dataclass(frozen=True, slots=True)
class Space:
    """What the numbers of a state are.

    Attributes:
        fixed: (purpose, number of the pedestrian) of each fixed uniform.
        marks: purposes of the uniforms of each of the flow, the arrival first; () without a flow.
        window_s: within which the flow is sampled, from the trigger on.
        rate_per_s: of the flow.
        first: the number of the flow's first pedestrian.
        seed: of the streams.
        entangled: see ``Layout``: the errors of those who walk at the trigger come from streams
            numbered after all who come.
    """

    fixed: tuple[tuple[Purpose, int], ...]
    marks: tuple[Purpose, ...]
    window_s: float
    rate_per_s: float
    first: int
    seed: int
    entangled: bool

    @property
    def layout(self) -> Layout:
        """Sizes of a state."""
        return Layout(
            len(self.fixed), len(self.marks), self.rate_per_s, self.window_s, self.entangled
        )

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
        for (purpose, pedestrian), uniform in zip(self.fixed, uniforms, strict=True):
            of_purpose = values.setdefault(purpose, [0.5] * pedestrian)
            of_purpose.append(uniform)
        if not self.marks:
            return values
        people = layout.people(z[None])[0]
        people = people[~np.isnan(people[:, 0])]
        people = np.clip(ndtr(people[np.argsort(people[:, 0], kind="stable")]), _OPEN, 1 - _OPEN)
        for purpose, of_all in zip(self.marks[1:], people[:, 1:].T.tolist(), strict=True):
            values.setdefault(purpose, []).extend(of_all)
        later = stream(self.seed, "arrival", number).random(self.first + len(people) + 1)[-1]
        window = self.rate_per_s * self.window_s
        times = [0.0, *(window * people[:, 0]), window - math.log1p(-later)]
        gaps = np.clip(-np.expm1(-np.diff(times)), _OPEN, 1 - _OPEN)
        # The first arrival is nobody's where the first pedestrian is there at the trigger.
        values["arrival"] = [0.5] * self.first + gaps.tolist()
        return values


def space_of(scenario: Scenario) -> Space:
    """The sampled uniforms of a scenario.

    Raises:
        InputError: hours of traffic; SUMO's own pedestrians, who are no function of uniforms; or
            nothing in an episode is random.
    """
    pedestrians, perception = scenario.pedestrians, scenario.perception
    if scenario.traffic is not None:
        raise InputError(
            "traffic", "is hours of many vehicles, not episodes of one", "no [traffic]"
        )
    if pedestrians.behaviour == "sumo":
        raise InputError(
            "pedestrians.behaviour",
            '"sumo" cannot be sampled: SUMO moves these pedestrians by itself',
            '"constant", "gap_acceptance" or "reactive"',
        )
    if pedestrians.drawn:
        raise InputError("pedestrians.drawn", "leaves nothing to chance", "a scenario without it")
    misses = perception.detection_probability < 1
    purposes: list[Purpose] = ["side", "quantile"]
    if pedestrians.behaviour == "gap_acceptance":
        purposes.append("critical_gap")
    if misses:
        purposes.append("detection")
    fixed: list[tuple[Purpose, int]] = []
    if misses:
        fixed += [("timed_detection", number) for number in range(len(scenario.timed_walks()))]
    most = pedestrians.max_count
    at_trigger = pedestrians.first_at_trigger and most != 0
    if at_trigger:
        fixed += [(purpose, 0) for purpose in purposes]
    first = int(at_trigger)
    flows = pedestrians.flow_per_hour > 0 and (most is None or most > first)
    errs = perception.dropout_probability > 0
    errs = errs or perception.position_sd_m > 0 or perception.speed_sd_mps > 0
    if not (fixed or flows or errs):
        raise InputError(
            "pedestrians.flow_per_hour",
            "is 0: nothing in an episode is left to chance",
            "a flow above 0, or people who may be missed; else: harness run",
        )
    marks: tuple[Purpose, ...] = ("arrival", *purposes) if flows else ()
    free_pass_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    window_s = min(_WINDOW_PASSES * free_pass_s, scenario.experiment.timeout_s)
    rate = pedestrians.flow_per_hour / SECONDS_PER_HOUR
    entangled = errs and pedestrians.warm_up_s > 0
    return Space(tuple(fixed), marks, window_s, rate, first, scenario.experiment.seed, entangled)
