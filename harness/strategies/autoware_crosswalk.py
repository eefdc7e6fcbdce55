"""The crosswalk rule of an open Level-4 stack: Autoware's behaviour planner."""

import math
from typing import ClassVar

from harness.core.documents import Positive
from harness.core.vocabulary import ROUNDING, Observation, PedestrianView
from harness.strategies.emergency_brake import EmergencyBrake
from harness.strategies.manoeuvres import AT_KERB_M, half_path_width_m, stop_after, towards_v0

_STILL_MPS, _STILL_S = 0.25, 1.0
"""Who is slower stands; the ego goes on once it has stood this long for somebody who stands."""
_LEAST_EGO_MPS, _LEAST_PERSON_MPS = 2.0, 5 / 3.6
"""The least speeds with which times to the meeting point are computed."""
_CHATTER_S = 0.5
"""A decision changes only if the margin is missed by this much."""
_LINE_M, _LATEST_M = 3.5, 3.0
"""Distances before the crosswalk: of the preferred stop, and of the last possible one."""
_GENTLE_MPS2, _GENTLE_MPS3 = 1.0, 1.0
"""Deceleration and jerk of the preferred stop."""
_HARD_MPS2, _HARD_MPS3 = 1.5, 1.5
"""Deceleration and jerk of the hardest stop."""


class AutowareCrosswalk:
    """Autoware's rule: it stops gently for all who may come, and drives on where it cannot.

    TTC is the ego's time to the pedestrian's line (x = 0) at its speed, at least 2 m/s; TTV is the
    pedestrian's time to the ego's lane centre at their speed, at least 5 km/h.  The ego passes
    first if TTC + 4 s < TTV, and the pedestrian is long gone if TTV + 13 s < TTC.  Otherwise it
    stops 3.5 m before the crosswalk, with at most 1 m/s²; if that does not do, as far on as 3 m
    before the crosswalk.  A stop that needs more than 1.5 m/s² (reached with 1.5 m/s³) is
    cancelled: the ego drives through.  A decision changes only if its margin is missed by 0.5 s.
    A pedestrian who stands at the kerb or on the crosswalk counts no longer once they and the ego
    have stood for 1 s; one who stands farther away does not count.

    Source: behavior_velocity_crosswalk_module of Autoware Universe, documentation and default
    parameters of 2025.  Left out: occluded crosswalks, since an observation does not say what
    cannot be seen; the velocity smoother, so that commands act at once.

    Args:
        pass_first_margin_s: by how much TTV must exceed TTC for the ego to pass first, s.
        pass_later_margin_s: by how much TTC must exceed TTV for a pedestrian to be gone, s.
        emergency_brake: whether ``emergency_brake``, with its default threshold, is behind it.
    """

    AGGRESSIVENESS: ClassVar = {"pass_first_margin_s": -1.0}  # a smaller margin is bolder

    def __init__(
        self,
        *,
        pass_first_margin_s: Positive = 4.0,
        pass_later_margin_s: Positive = 13.0,
        emergency_brake: bool = False,
    ) -> None:
        self._first_s, self._later_s = pass_first_margin_s, pass_later_margin_s
        self._brake = EmergencyBrake() if emergency_brake else None
        self._yields_to: dict[int, bool] = {}
        self._stand_since_s: dict[int | None, float] = {}

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        wanted_mps2 = towards_v0(observation)
        stands_s = self._note_standing(None, observation.ego.speed_mps, observation.time_s)
        stood = stands_s is not None and stands_s >= _STILL_S - ROUNDING
        # Every step moves the memory of everybody, also of those after the first to stop for.
        stops = [self._note_decision(observation, each, stood) for each in observation.pedestrians]
        if any(stops):
            wanted_mps2 = min(wanted_mps2, _stop(observation, wanted_mps2))
        if self._brake is not None:
            wanted_mps2 = min(wanted_mps2, self._brake.decide(observation))
        return wanted_mps2

    def _note_decision(self, observation: Observation, person: PedestrianView, stood: bool) -> bool:
        """Whether the rule stops for somebody, given whether the ego has stood for 1 s."""
        ego, half_m = observation.ego, half_path_width_m(observation.vehicle)
        behind_kerb_m = max(0.0, person.remaining_m - observation.crossing.length_m)
        stands_s = self._note_standing(person.index, person.speed_mps, observation.time_s)
        if ego.range_m <= 0 or person.lateral_m < -half_m:
            return False
        if stands_s is not None:
            if behind_kerb_m > AT_KERB_M:
                return False
            if stood and stands_s >= _STILL_S - ROUNDING:
                return False
        ttc_s = ego.range_m / max(ego.speed_mps, _LEAST_EGO_MPS)
        ttv_s = max(0.0, person.lateral_m) / max(person.speed_mps, _LEAST_PERSON_MPS)
        before = self._yields_to.get(person.index)
        more_s = 0.0 if before is None else _CHATTER_S if before else -_CHATTER_S
        first = ttc_s + self._first_s + more_s < ttv_s
        later = ttv_s + self._later_s + more_s < ttc_s
        self._yields_to[person.index] = not (first or later)
        return self._yields_to[person.index]

    def _note_standing(self, who: int | None, speed_mps: float, now_s: float) -> float | None:
        """How long somebody has stood, or the ego (None), in s; None if they move."""
        if speed_mps >= (_STILL_MPS if who is not None else ROUNDING):
            self._stand_since_s.pop(who, None)
            return None
        return now_s - self._stand_since_s.setdefault(who, now_s)


def _stop(observation: Observation, else_mps2: float) -> float:
    """The acceleration of the stop that is possible; without one ``else_mps2``: it is cancelled."""
    ego, edge_m = observation.ego, observation.crossing.width_m / 2
    line_m, latest_m = ego.range_m - edge_m - _LINE_M, ego.range_m - edge_m - _LATEST_M
    if latest_m < -ROUNDING or _way_m(observation, _HARD_MPS2, _HARD_MPS3) > latest_m + ROUNDING:
        return else_mps2
    if ego.speed_mps <= ROUNDING:
        return 0.0
    gentle_m = _way_m(observation, _GENTLE_MPS2, _GENTLE_MPS3)
    begins = gentle_m + ego.speed_mps * observation.step_s >= line_m
    if not (begins or ego.acceleration_mps2 < -ROUNDING):
        return else_mps2
    distance_m = max(line_m, min(gentle_m, latest_m))
    if distance_m <= ROUNDING:
        return -ego.speed_mps / observation.step_s
    return stop_after(distance_m, ego.speed_mps, observation.step_s)


def _way_m(observation: Observation, deceleration_mps2: float, jerk_mps3: float) -> float:
    """The way on which the ego stops if its deceleration grows with a jerk up to a limit, in m."""
    speed, gain = observation.ego.speed_mps, observation.ego.acceleration_mps2
    ramp_s = max(0.0, gain + deceleration_mps2) / jerk_mps3
    stands_s = (gain + math.sqrt(gain**2 + 2 * jerk_mps3 * speed)) / jerk_mps3
    ramp_s = min(ramp_s, stands_s)
    after = speed + gain * ramp_s - jerk_mps3 * ramp_s**2 / 2
    ramp_m = speed * ramp_s + gain * ramp_s**2 / 2 - jerk_mps3 * ramp_s**3 / 6
    return ramp_m + after**2 / (2 * deceleration_mps2)
