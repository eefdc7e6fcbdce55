"""The people at one crosswalk as drivers and their sensors see them: SUMO's, the harness's."""

import math
from collections.abc import Callable

from harness.core.seeding import number_of
from harness.core.vocabulary import STANDING_MPS, PedestrianView, Side, Views, quick_tuple
from harness.engine.protocol import Running
from harness.simulation.cars import Passage
from harness.simulation.own_people import OWN_PREFIX, OwnPeople
from harness.simulation.walk import WAITING_M, SumoPerson, Walked
from harness.site.town import Crosswalk
from harness.site.zone import Zone
from harness.strategies.perception.sensor import Sensor
from harness.strategies.perception.updates import Updates, track_from


class PeopleAt:
    """Everybody at one crosswalk.

    Args:
        session: SUMO.
        crosswalk: the crosswalk.
        own: the harness's people, if they cross here.

    Attributes:
        crosswalk, own: the same.
        changed: whether somebody has come or gone; whoever has seen to it resets it.
        watched: the number of vehicles that are on their ways over it.
    """

    def __init__(self, session: Running, crosswalk: Crosswalk, own: OwnPeople | None) -> None:
        self._people, self._people_on = session.people, session.last.people_on
        self.crosswalk, self._areas = crosswalk, crosswalk.areas
        self.own, self.changed, self.watched = own, False, 0
        self._first = 0 if own is None else len(own.arrivals)
        self._here: dict[str, SumoPerson] = {}
        self._came: list[SumoPerson] = []
        self._noted_s = -math.inf
        self._now: list[PedestrianView] | None = None
        self._views: dict[Zone, tuple[PedestrianView, ...]] = {}

    def note(self, time_s: float) -> None:
        """Note where SUMO's people are at the end of a step."""
        if time_s == self._noted_s:
            return
        self._noted_s, self._now, here = time_s, None, self._here
        ids, next_edge = self._people_on, self._people.next_edge
        crossing = self.crosswalk.id
        there = dict.fromkeys(ids(crossing), True)
        for area in self._areas:
            for name in ids(area):
                # The first place beyond the crosswalk shows when they reached the kerb.
                if name not in there and (
                    (name in here and here[name].on) or next_edge(name) == crossing
                ):
                    there[name] = False
        if not there and not here:
            return
        if self.own is not None:
            there = {name: on for name, on in there.items() if not name.startswith(OWN_PREFIX)}
        if there.keys() != here.keys():
            self.changed = True
        self._here = {}
        for name, on in there.items():
            at = complex(*self._people.position(name))
            person = here.get(name)
            if person is None:
                ends = (begins for area, begins in self._areas.items() if name in ids(area))
                near = next(ends, self.crosswalk.line.foot(at)[0] < self.crosswalk.length_m / 2)
                person = SumoPerson(name, self._first + len(self._came), near)
                self._came.append(person)
            self._here[name] = person
            person.states.append((time_s, at, on))

    def names(self) -> list[str]:
        """Ids of everybody who is here."""
        own = () if self.own is None else map(self.own.name_of, self.own.moved)
        return [*self._here, *own]

    def id_of(self, index: int) -> str:
        """The id of somebody, by their index in ``views``."""
        if self.own is not None and index < self._first:
            return self.own.name_of(index)
        return self._came[index - self._first].id

    def views(self, passage: Passage) -> tuple[PedestrianView, ...]:
        """Everybody as the driver of a vehicle with that zone would see them."""
        if self._now is None:
            self._now = [*map(self._view, self._here.values())]
            if self.own is not None:
                self._now += self.own.crowd.views()
            self._views.clear()
        if not self._now:
            return ()
        zone = passage.at.zone
        if zone not in self._views:
            self._views[zone] = tuple(_turned(view, passage) for view in self._now)
        return self._views[zone]

    def seen_by(self, passage: Passage, sensor: Sensor, pair: int) -> Callable[[bool], Views]:
        """What a driver sees at each step by a sensor: late, in part, or with errors.

        The function is given whether the vehicle is within the detection range.  The random streams
        are keyed by the ids of vehicle, crosswalk and person.
        """
        key = number_of(passage.car.name), number_of(passage.at.crosswalk.id)
        updates = Updates(sensor, lambda i: track_from(sensor, pair, key, number_of(self.id_of(i))))
        return lambda near: updates.shown(lambda: ((view, near) for view in self.views(passage)))

    def _view(self, person: SumoPerson) -> PedestrianView:
        """One of SUMO's people in the axis's frame, as from a lane in the middle.

        Whoever has not come to the crossing's edge has not stepped off, and is shown at the kerb if
        SUMO draws them beyond it: its curves on walking areas cut corners by up to 1 m, and end in
        a jump back.  Within 1 m of the kerb, people slower than 0.1 m/s wait; others who come walk.
        """
        length_m, (_, at, on) = self.crosswalk.length_m, person.states[-1]
        speed_mps, ahead_m = self._people.speed_mps(person.id), self.crosswalk.line.foot(at)[0]
        if not person.near:
            ahead_m = length_m - ahead_m
        ahead_m = min(ahead_m, length_m if on else 0.0)
        if not on and ahead_m >= -WAITING_M and speed_mps < STANDING_MPS:
            speed_mps = 0.0
        side, steps_off = Side.NEAR if person.near else Side.FAR, on and 0.0 <= ahead_m < length_m
        middle_m, end_m, speed_mps = length_m / 2 - ahead_m, length_m - ahead_m, max(0.0, speed_mps)
        return PedestrianView(person.index, side, middle_m, end_m, speed_mps, steps_off)

    def walked(self) -> list[Walked]:
        """Everybody who stepped off or waited, the harness's first."""
        own = [] if self.own is None else [*self.own.walked()]
        found = (each.walked(self.crosswalk) for each in self._came)
        return own + [walk for walk in found if walk is not None]

    @property
    def left_out(self) -> int:
        """The number of SUMO's people who stepped off, but were seen too briefly for a way."""
        stepped_off = (each for each in self._came if any(on for *_, on in each.states))
        return sum(each.walked(self.crosswalk) is None for each in stepped_off)


def _turned(view: PedestrianView, passage: Passage) -> PedestrianView:
    """A view in the axis's frame, as the driver of a passage sees it."""
    side, crossing = view.side.other if passage.at.zone.reverse else view.side, passage.crossing
    to_lane_m = crossing.to_lane_m(side) - (crossing.length_m - view.remaining_m)
    return quick_tuple(PedestrianView, (view.index, side, to_lane_m, *view[3:]))
