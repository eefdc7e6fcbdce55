"""What a risk is about: its event, and every random number of an episode.

Timed pedestrians, the first one at the trigger, and the strategy's first draws have *fixed*
uniforms.  The flow is a Poisson process: each person who comes within ``window_s`` of the trigger
is a point with an arrival and further uniforms.  All are sampled as normal numbers z = Φ⁻¹(u).
Other randomness (later people, later draws of strategy and perception) comes from streams keyed by
the episode's number and is not weighted.
"""

import math
import re
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from harness.core.errors import InputError, Parameter
from harness.core.seeding import GIVEN_DRAWS, Given, Purpose, stream
from harness.core.vocabulary import SECONDS_PER_HOUR, Arm, Ending, FloatArray
from harness.encounter.arms import draws_from, draws_numbers
from harness.measures import EpisodeRecord
from harness.scenario import Scenario
from harness.strategies.perception.sensor import sensor_of
from harness.strategies.perception.track_errors import streams_of

GRADINGS = 4
"""Number of scores by which the distance of an episode from an event is graded."""

NEVER = (math.inf,) * GRADINGS
"""The scores of somebody who does not meet the ego, and of an episode that failed."""

_FAR, _NEVER_NEAR = 1_000.0, 100.0
"""Added to the score if the event's measure is undefined; and to the smallest gap in m, which is
the score without a conflict."""

LIMITED = ("pet_s<", "min_ttc_s<", "min_gap_m<", "contact_speed_mps>")
"""The events with a limit."""

_FORM = re.compile(r"\s*(\w+)\s*([<>])\s*(\d*\.?\d+)\s*")

_WINDOW_PASSES = 4.0
"""Length of the flow's sampled window as a multiple of the unhindered passing time."""

_OPEN = 2.0**-53
"""Smallest distance of a uniform from 0 and from 1, where quantiles are infinite."""


class Event(NamedTuple):
    """A crash (``measure`` None), or a measure beyond a limit.

    The measures are 0 in a crash but for the speed of the contact; the post-encroachment time is
    undefined then, and counts as 0.
    """

    text: str = "crashed"
    measure: str | None = None
    limit: float = 0.0

    @property
    def below(self) -> bool:
        """Whether small values of the measure are in the event."""
        return self.measure != "contact_speed_mps"

    def holds(self, record: EpisodeRecord) -> bool:
        """Whether an episode ended in the event."""
        value = None if self.measure is None else getattr(record, self.measure)
        if value is None or record.ending is Ending.FAILED:
            return record.ending is Ending.CRASHED and self.below
        return bool(value < self.limit if self.below else value > self.limit)

    def scores(self, record: EpisodeRecord) -> tuple[float, ...]:
        """The distance of an episode from the event, graded in ``GRADINGS`` ways.

        Each is at most 0 in the event, positive outside, and +∞ if the episode failed.  For a crash
        they are 10/DRAC, PET, TTC and the smallest gap in m, so that one leads to each kind of
        contact; where one is undefined it is 100 plus the gap, or +∞ if nobody stepped off.  For
        another event it is the distance from the limit in the measure's unit.
        """
        if record.ending is Ending.FAILED:
            return NEVER
        gap_m, drac = record.min_gap_m, record.max_drac_mps2
        far = math.inf if gap_m is None else _NEVER_NEAR + gap_m
        times = (far if each is None else each for each in (record.pet_s, record.min_ttc_s, gap_m))
        distances = (10 / drac if drac else far, *times)
        if self.measure is not None:
            value = getattr(record, self.measure)
            distances = tuple(_FAR + distance for distance in distances)
            if value is not None:
                distances = (value - self.limit if self.below else self.limit - value,) * GRADINGS
        if self.holds(record):
            return tuple(min(distance, 0.0) for distance in distances)
        return tuple(max(distance, math.ulp(0.0)) for distance in distances)


def parse_event(text: str) -> Event:
    """The event of a text: ``crashed``, ``min_ttc_s<0.5`` or ``contact_speed_mps>5``.

    Raises:
        InputError: the text is not an event.

    >>> parse_event("contact_speed_mps > 5.0000001")
    Event(text='contact_speed_mps>5.0000001', measure='contact_speed_mps', limit=5.0000001)
    """
    if text.strip() == "crashed":
        return Event()
    match = _FORM.fullmatch(text)
    allowed = f"crashed, or a number after one of {' '.join(LIMITED)}, after < above 0"
    if not match or match[1] + match[2] not in LIMITED or (match[2] == "<" and not float(match[3])):
        raise InputError(Parameter("event", text), "is not an event", allowed)
    return Event("".join(match.groups()), match[1], float(match[3]))


class Space(NamedTuple):
    """The random inputs of an episode: fixed normal numbers, and the people of a flow.

    People are an array of shape (n, 1 + m), by arrival: the arrival in s, then normal numbers.

    Attributes:
        fixed: the purpose of each fixed uniform, in the order of its stream's draws.
        marks: the purpose of each of the m uniforms of a person in the flow, besides the arrival.
        rate_per_s: the flow's rate; 0 without a flow.
        window_s: the flow is sampled between 0 and this time.
        first: whether the first pedestrian is at the crosswalk at the trigger, 0 or 1.
        before: index of the flow's first person among all arrivals.
        seed: seed of the streams.
        by_chance: what is random and neither sampled nor weighted, in words.
    """

    fixed: tuple[Purpose, ...]
    marks: tuple[Purpose, ...] = ()
    rate_per_s: float = 0.0
    window_s: float = 0.0
    first: int = 0
    before: int = 0
    seed: int = 0
    by_chance: tuple[str, ...] = ()

    def crowd(self, rng: np.random.Generator) -> FloatArray:
        """The people of a nominal flow."""
        count = int(rng.poisson(self.rate_per_s * self.window_s))
        arrivals_s = np.sort(rng.random(count)) * self.window_s
        return np.column_stack([arrivals_s, rng.standard_normal((count, len(self.marks)))])

    def given(self, fixed: FloatArray, people: FloatArray, number: int) -> Given:
        """The uniforms by purpose; they replace the first draws of each stream.

        The stream of arrivals has the exponential gaps between the people of the flow.  A Poisson
        process has no memory, so the gap to the first one after the window counts from its end.

        Args:
            fixed: the fixed normal numbers.
            people: the people of the flow.
            number: the episode's number.
        """
        values: dict[Purpose, list[float]] = {}
        for purpose, uniform in zip(self.fixed, _uniforms(fixed).tolist(), strict=True):
            values.setdefault(purpose, []).append(uniform)
        if not self.rate_per_s:
            return values
        own = _uniforms(people[:, 1:])
        for purpose in dict.fromkeys(self.marks):
            columns = [k for k, mark in enumerate(self.marks) if mark == purpose]
            values.setdefault(purpose, []).extend(own[:, columns].ravel().tolist())
        later = stream(self.seed, "arrival", number).random(self.first + len(people) + 1)[-1]
        window = self.rate_per_s * self.window_s
        times = [0.0, *(self.rate_per_s * people[:, 0]), window - math.log1p(-later)]
        gaps = np.clip(-np.expm1(-np.diff(times)), _OPEN, 1 - _OPEN)
        # If the first pedestrian is at the crosswalk at the trigger, the first gap is not used.
        values["arrival"] = [0.5] * self.first + gaps.tolist()
        return values


def _uniforms(z: FloatArray) -> FloatArray:
    return np.asarray(np.clip(ndtr(z), _OPEN, 1 - _OPEN))


def space_of(scenario: Scenario, arm: Arm) -> Space:
    """The random inputs of one arm's episodes.

    Raises:
        InputError: the scenario has groups or drawn pedestrians, or nothing in an episode is
            random.
    """
    people, sensor = scenario.pedestrians, sensor_of(scenario, arm)
    for key, odd in (("group_size", len(people.group_size) > 1), ("drawn", people.drawn)):
        if odd:
            problem, allowed = "is not supported by a risk estimate", "a scenario without it"
            raise InputError(f"pedestrians.{key}", problem, allowed)
    drawn = {} if sensor is None else streams_of(sensor)
    seen: list[Purpose] = [purpose for purpose, of in drawn.items() for _ in range(of.given)]
    misses = sensor is not None and sensor.section.detection_probability < 1
    each: list[Purpose] = [*people.marks, "detection"] if misses else [*people.marks]
    timed, most = len(scenario.timed_walks()), people.max_count
    first = int(people.first_at_trigger and most != 0)
    fixed: list[Purpose] = ["timed_detection"] * timed if misses else []
    fixed += each * first + seen * (timed + first)
    by_chance = [of.later for of in drawn.values() if of.later]
    if draws_numbers(scenario, arm):
        fixed += [draws_from(scenario, arm)] * GIVEN_DRAWS
        by_chance.append(f"what the strategy draws after its first {GIVEN_DRAWS} random numbers")
    rate = people.flow_per_hour / SECONDS_PER_HOUR
    by_chance += ["who already walks at the trigger"] * (rate > 0 and people.warm_up_s > 0)
    flows = rate > 0 and (most is None or most > first)
    if not (fixed or flows or (timed + first and by_chance)):
        allowed = "a flow above 0, or misses of this driver's perception; otherwise use harness run"
        raise InputError("pedestrians.flow_per_hour", "is 0: nothing here is random", allowed)
    pass_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    return Space(
        tuple(fixed),
        (*each, *seen) if flows else (),
        rate if flows else 0.0,
        min(_WINDOW_PASSES * pass_s, scenario.experiment.timeout_s) if flows else 0.0,
        first,
        timed + first,
        scenario.experiment.seed,
        tuple(by_chance),
    )
