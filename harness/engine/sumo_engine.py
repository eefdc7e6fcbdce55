"""An encounter in SUMO: the ego's speed and the pedestrians' positions in, the ego's state out.

docs/simulations.md explains the choices and has the measurements behind them.
"""

from collections.abc import Sequence

from harness.core.errors import EngineError
from harness.core.vocabulary import Arrival
from harness.engine.ids import lane_of
from harness.engine.people import HeldPeople
from harness.engine.session import Session
from harness.engine.sources import APPROACH_M
from harness.scenario import Scenario
from harness.site.road_frame import RoadFrame

_ROUTE, _EDGES = "drive", ("approach", "exit")
"""The ego's route, and its edges in the network that the harness builds."""

COLLISION_REACH_M = 5.0
"""SUMO's collisions are read only when the ego's front is this near to the crosswalk.

SUMO reports a hit only while the front is on the junction, which begins a few metres upstream.
"""

_AHEAD_STEPS = 2
"""People are inserted this many steps before they arrive: they exist only after a step."""

_SHORT_M = 1e-6
"""The ego departs this far before its place, so that a front on the junction's far border is on the
junction: its state is that of its odometer."""


class SumoEngine:
    """Simulates episodes in SUMO, one after another in the same simulation.

    ``setSpeed`` sets the ego's speed under ballistic steps, so SUMO's state follows constant
    accelerations in closed form.  ``moveToXY`` sets the positions of all pedestrians at every step,
    because SUMO's own pedestrians would stop for the vehicle and hide crashes.

    Args:
        session: a new simulation of the scenario's network.
        scenario: the scenario.

    Attributes:
        automated: whether SUMO's files and window name the ego an AV; set between episodes.
    """

    def __init__(self, session: Session, scenario: Scenario) -> None:
        crossing = scenario.crossing
        self._frame = RoadFrame.of(crossing.bearing_deg, crossing.length_m)
        self._session, self._lost = session, session.lost
        self.closed = self.automated = False
        self._advance, self._collisions = session.advance, session.last.collisions
        self._get_speed, self._set_speed = session.vehicles.speed_mps, session.vehicles.set_speed
        self._get_distance = session.vehicles.odometer_m
        vehicle, self._step_s = scenario.vehicle(), scenario.experiment.step_s
        self._lane = scenario.ego.lane
        if crossing.kerb_strip_m > 0:
            self._lane += 1  # in SUMO a strip at the kerb is a lane
        # The least R0 is the lane's end, but for the rounding of its length.
        length_m = session.lane_length_m(lane_of(_EDGES[0]))
        self._from_m = min(APPROACH_M - vehicle.trigger_range_m, length_m) - _SHORT_M
        self._v0_mps, self._steps, self._collided = vehicle.initial_speed_mps, 0, False
        self._start_x_m = -vehicle.trigger_range_m
        self._collisions_from_m = -crossing.width_m / 2 - COLLISION_REACH_M
        self._episode = 0
        self._ego = ""
        self._set_mps: float | None = None
        """The speed that was last set; it is not read back before the end."""
        self.people = HeldPeople(session, self._frame, crossing.length_m)
        session.add_route(_ROUTE, _EDGES)
        session.limit_speed(_EDGES, scenario.speed_limit_mps)

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:
        """See ``Engine.begin``."""
        self._steps, self._collided, self._set_mps = 0, False, None
        self._ego = f"ego-{self._episode}"
        people = self.people
        people.begin(arrivals, self._episode)
        with self._session.watched("could not set up the episode"):
            people.announce(_AHEAD_STEPS * self._step_s)
            self._advance()
            people.after_step()
            kind = "av" if self.automated else "ego"
            self._session.add_commanded(
                self._ego, _ROUTE, kind, self._lane, self._from_m, self._v0_mps
            )
            people.place(())
            self._advance()
            return self._start_x_m + self._get_distance(self._ego), self._get_speed(self._ego)

    def step(self, speed_mps: float, pedestrians: Sequence[tuple[int, float]]) -> float:
        """See ``Engine.step``."""
        people, ego = self.people, self._ego
        try:
            if speed_mps != self._set_mps:  # SUMO keeps the speed that was last set
                self._set_speed(ego, speed_mps)
                self._set_mps = speed_mps
            people.place(pedestrians)
            self._steps += 1
            until_s = (self._steps + _AHEAD_STEPS) * self._step_s
            if people.next_s <= until_s:
                people.announce(until_s)
                self._advance()
                people.after_step()
            else:
                self._advance()
            x = self._start_x_m + self._get_distance(ego)
            if x > self._collisions_from_m and people.ids:
                # SUMO also lists two persons who pass each other.
                for collision in self._collisions():
                    self._collided |= collision.collider == ego
            return x
        except self._lost as error:
            raise EngineError(f"SUMO failed during the episode: {error}") from None

    def remove(self, index: int) -> None:
        """See ``Engine.remove``."""
        with self._session.watched(f"could not find pedestrian {index}"):
            self.people.remove(index)

    def end(self) -> bool | None:
        """See ``Engine.end``."""
        self._episode += 1
        with self._session.watched("could not clear the road"):
            self.people.clear()
            if self._ego in self._session.vehicles.ids():
                kept = self._set_mps in (None, self._get_speed(self._ego))
                self._session.vehicles.remove(self._ego)
                if not kept:
                    raise EngineError("SUMO did not keep the speed that was set")
        return self._collided

    def close(self) -> None:
        """End the simulation, which also completes SUMO's output files."""
        self.closed = True
        self._session.close()
