"""A strategy of your own: copy this file, change `decide`, and run

    harness strategies --check my_strategy:MyStrategy
    harness run cctc --set arms.av=my_strategy:MyStrategy

in the folder it lies in.  docs/strategies.md explains what an observation holds.
"""

from harness import InputError, Observation


class MyStrategy:
    """Brakes at a constant rate while somebody on the crossing is still before or in its lane.

    A new object is made for each episode, so what one episode leaves in `self` is gone in the
    next.  Parameters are keyword arguments with defaults; a scenario sets them in
    `[strategies."my_strategy:MyStrategy"]`, and their annotations are checked.

    Args:
        deceleration_mps2: how hard it brakes, > 0.
        look_ahead_m: it brakes only within this distance of the crosswalk, > 0.
    """

    def __init__(self, *, deceleration_mps2: float = 1.5, look_ahead_m: float = 15.0) -> None:
        for name, value in (
            ("deceleration_mps2", deceleration_mps2),
            ("look_ahead_m", look_ahead_m),
        ):
            if value <= 0:
                raise InputError(name, f"{value!r} is not accepted", "above 0")
        self._deceleration = deceleration_mps2
        self._look_ahead = look_ahead_m

    def decide(self, observation: Observation, /) -> float:
        """The wanted acceleration in m/s², asked for at every step."""
        ego, vehicle = observation.ego, observation.vehicle
        half_lane = observation.crossing.lane_width_m / 2
        in_the_way = any(
            pedestrian.on_crossing and pedestrian.lateral_m > -half_lane
            for pedestrian in observation.pedestrians
        )
        to_edge = ego.range_m - observation.crossing.width_m / 2
        if in_the_way and 0 < to_edge < self._look_ahead:
            return -self._deceleration
        # Back to v0 within this step; a vehicle that obeys late gets more time, or it overshoots.
        time_s = observation.step_s + 3 * (vehicle.dead_time_s + vehicle.lag_s)
        to_initial = (vehicle.initial_speed_mps - ego.speed_mps) / time_s
        return max(0.0, min(vehicle.resume_acceleration_mps2, to_initial))
