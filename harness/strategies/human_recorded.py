"""The second reference: a driver fitted to recorded encounters."""

from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, ROUNDING, Observation
from harness.strategies.manoeuvres import (
    InPath,
    full_braking_distance_m,
    stop_after,
    times_in_path,
    times_over_line_s,
    towards,
    towards_v0,
)

SPARE_M = 0.05
"""Clearance that it keeps from a pedestrian's disc, along the road and across it."""

_LINE_M = PEDESTRIAN_RADIUS_M + SPARE_M
"""Distance from a pedestrian's centre that it keeps along the road."""

HORIZON_S = 0.5
"""A pedestrian becomes relevant this long before they enter its path."""

EARLY_S = 0.5
"""It goes before pedestrians who enter its path later than this before its front is there."""

REACTION_TIME_S = 0.5
"""Reaction time of yielding."""

YIELDING_MPS2 = 0.5
"""Deceleration of yielding."""

AMONG_PEOPLE_MPS = 3.0
"""Greatest speed to which it accelerates among relevant pedestrians."""

PULLING_AWAY_MPS2 = 3.0
"""Acceleration of going first."""


class HumanRecorded:
    """Reacts to pedestrians who will soon be in its path, and avoids every avoidable crash.

    At their present speed each pedestrian is in the ego's path (half its width plus 0.3 m on either
    side of its centre) from t_in to t_out.  If the ego goes first, it accelerates with
    3 m/s² up to v0 and covers their line (x = 0, plus 0.3 m) from t_arrive to t_gone.

    *Relevant pedestrians* have a t_in of at most 0.5 s and are not past the ego's path.
    While there are any, the ego does not accelerate beyond 3 m/s; if it is faster it keeps its
    speed.  While there are none, it returns to v0 with a0.

    *Yielding.*  It goes before pedestrians who enter its path later than 0.5 s before its front
    reaches their line.  It goes behind pedestrians who leave its path before that front is there.
    For other relevant pedestrians it stops 0.3 m before their line: it brakes once they have been
    in the way for 0.5 s, and as late as 0.5 m/s² allows.  It drives on when none of them is left.

    *Avoiding* has no reaction time and applies to all pedestrians.  The ego also stops there for a
    pedestrian whom it would meet if it went first (t_in ≤ t_gone and t_out ≥ t_arrive).  It begins
    to brake at the last step at which full braking is enough.  If full braking is no longer enough,
    nobody was in the way before, and the ego goes first.

    *Limits.*  It was fitted to a few dozen vehicles at one place: docs/validation.md has its card.
    Recorded pedestrians give way to a car that rolls among them.  Pedestrians of the harness's
    flows keep their speeds, so it waits for them.
    """

    FITTED_ON = "dut"
    """The shipped model on whose data its rules and parameters were fitted."""

    def __init__(self) -> None:
        self._since_s: dict[int, float] = {}

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        ego, vehicle, step_s = observation.ego, observation.vehicle, observation.step_s
        limit_mps2, room_m = vehicle.max_deceleration_mps2, ego.range_m - _LINE_M
        pulling_mps2 = min(PULLING_AWAY_MPS2, vehicle.max_acceleration_mps2)
        people = times_in_path(observation, SPARE_M)
        if full_braking_distance_m(ego.speed_mps, limit_mps2, step_s) > room_m + ROUNDING:
            first = people and ego.range_m > -vehicle.length_m
            return towards(observation, vehicle.initial_speed_mps, pulling_mps2 if first else None)
        counting = [
            person for person in people if person.leaves_s > 0 and person.enters_s <= HORIZON_S
        ]
        arrives_s, leaves_s = times_over_line_s(observation, _LINE_M, pulling_mps2)
        yields = self._yields(observation, counting, arrives_s)
        go_mps2 = towards_v0(observation)
        if counting:
            top_mps = max(ego.speed_mps, min(AMONG_PEOPLE_MPS, vehicle.initial_speed_mps))
            go_mps2 = towards(observation, top_mps)
        if not yields and not any(
            person.leaves_s >= arrives_s and person.enters_s <= leaves_s for person in people
        ):
            return go_mps2
        braking_mps2 = min(limit_mps2, YIELDING_MPS2) if yields else limit_mps2
        after_mps = max(0.0, ego.speed_mps + go_mps2 * step_s)
        left_m = room_m - (ego.speed_mps + after_mps) / 2 * step_s
        if full_braking_distance_m(after_mps, braking_mps2, step_s) <= left_m:
            return go_mps2
        return min(go_mps2, max(-limit_mps2, stop_after(room_m, ego.speed_mps, step_s)))

    def _yields(self, observation: Observation, counting: list[InPath], arrives_s: float) -> bool:
        """Whether somebody has been in the way for the reaction time; notes since when all have."""
        since_s = {
            person.index: self._since_s.get(person.index, observation.time_s)
            for person in counting
            if person.enters_s <= max(0.0, arrives_s - EARLY_S) and person.leaves_s > arrives_s
        }
        self._since_s = since_s
        return any(observation.time_s - at >= REACTION_TIME_S - ROUNDING for at in since_s.values())
