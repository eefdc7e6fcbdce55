"""The people at one crosswalk as drivers see them: SUMO's, and the harness's."""

import math
from collections.abc import Sequence

from harness.core.encounter import PedestrianView, Side, quick_tuple
from harness.engine.session import Session
from harness.simulation.cars import Passage
from harness.simulation.own_people import OWN_CROSSES, OwnPeople
from harness.simulation.walked import STANDING_MPS, WAITING_M, Axis, Seen, Walked, walked_of
from harness.site.town import Crosswalk


class PeopleAt:
    """Everybody at one crosswalk.

    Args:
        session: SUMO.
        crosswalk: the crosswalk.
        areas: ids of the walking areas at its ends.
        own: the harness's people, if they cross here.

    Attributes:
        crosswalk, own: the same.
        changed: whether somebody has come or gone; whoever has seen to it resets it.
    """

    def __init__(
        self, session: Session, crosswalk: Crosswalk, areas: Sequence[str], own: OwnPeople | None
    ) -> None:
        self._session, self._people = session, session.people
        self.crosswalk, self.axis = crosswalk, Axis(crosswalk)
        self._crossing, self._areas = crosswalk.id, areas
        self.own, self.changed = own, False
        self._first = 0 if own is None else len(own.arrivals)
        self._here: dict[str, Seen] = {}
        self._came: list[Seen] = []
        self._noted_s = -math.inf
        self._now: list[PedestrianView] | None = None
        self._views: dict[int, tuple[PedestrianView, ...]] = {}

    def note(self, time_s: float) -> None:
        """Note where SUMO's people are at the end of a step."""
        self._now = None
        if time_s == self._noted_s:
            return
        self._noted_s, here = time_s, self._here
        ids, next_edge = self._session.people_on, self._people.next_edge
        crossing, beside = ids(self._crossing), [name for area in self._areas for name in ids(area)]
        if not crossing and not beside and not here:
            return
        there = {name: True for name in crossing if not name.startswith(OWN_CROSSES)}
        for name in beside:
            if name in there or name.startswith(OWN_CROSSES):
                continue
            # The first place beyond the crosswalk shows when they reached the kerb.
            if (name in here and here[name].on[-1]) or next_edge(name) == self._crossing:
                there[name] = False
        if there.keys() != here.keys():
            self.changed = True
        self._here = {}
        for name, on in there.items():
            x, y = self._people.position(name)
            person = here.get(name)
            if person is None:
                number = self._first + len(self._came)
                person = Seen(name, number, self.axis.along_m(x, y))
                self._came.append(person)
            self._here[name] = person
            person.time_s.append(time_s)
            person.x.append(x)
            person.y.append(y)
            person.on.append(on)

    def names(self) -> list[str]:
        """Ids of everybody who is here."""
        own = () if self.own is None else map(self.own.name_of, self.own.moved)
        return [*self._here, *own]

    def id_of(self, index: int) -> str:
        """The id of somebody, by the index that drivers see."""
        if index >= self._first:
            return self._came[index - self._first].id
        assert self.own is not None
        return self.own.name_of(index)

    def views(self, passage: Passage) -> tuple[PedestrianView, ...]:
        """Everybody as the driver of a vehicle with that zone would see them."""
        if self._now is None:
            self._now = [*map(self._view, self._here.values())]
            if self.own is not None:
                self._now += [walker.view() for walker in self.own.crowd.walkers]
            self._views.clear()
        if not self._now:
            return ()
        key = id(passage.zone)
        if key not in self._views:
            self._views[key] = tuple(_turned(view, passage) for view in self._now)
        return self._views[key]

    def places(self) -> list[tuple[float, float]]:
        """x and y of everybody, in the order of ``views``."""
        own = () if self.own is None else [each.view() for each in self.own.crowd.walkers]
        ahead_m = ((view.side, self.axis.length_m - view.remaining_m) for view in own)
        return [
            *((person.x[-1], person.y[-1]) for person in self._here.values()),
            *(
                self.axis.point(at_m if side is Side.NEAR else self.axis.length_m - at_m)
                for side, at_m in ahead_m
            ),
        ]

    def _view(self, person: Seen) -> PedestrianView:
        """One of SUMO's people in the axis's frame, without the lane.

        Whoever has not come to the crossing's edge has not stepped off, and is shown at the kerb if
        SUMO draws them beyond it: its curves on walking areas cut corners by up to 1 m, and end in
        a jump back.  Within 1 m of the kerb, people slower than 0.1 m/s wait; others who come walk.
        """
        length_m, on = self.axis.length_m, person.on[-1]
        speed_mps = self._people.speed_mps(person.id)
        side, ahead_m = Side.NEAR, self.axis.along_m(person.x[-1], person.y[-1])
        if 2 * person.first_m >= length_m:
            side, ahead_m = Side.FAR, length_m - ahead_m
        ahead_m = min(ahead_m, length_m if on else 0.0)
        if not on and ahead_m >= -WAITING_M and speed_mps < STANDING_MPS:
            speed_mps = 0.0
        steps_off = on and 0.0 <= ahead_m < length_m
        return PedestrianView(
            person.index, side, math.nan, length_m - ahead_m, max(0.0, speed_mps), steps_off
        )

    def walked(self, begin_s: float) -> list[Walked]:
        """Everybody who stepped off or waited, the harness's first; see ``OwnPeople.walked``."""
        own = [] if self.own is None else [*self.own.walked(begin_s)]
        return own + [each for each in (walked_of(one, self.axis) for one in self._came) if each]


def _turned(view: PedestrianView, passage: Passage) -> PedestrianView:
    """A view in the axis's frame, as the driver of a passage sees it."""
    side, crossing = view.side.other if passage.zone.reverse else view.side, passage.crossing
    to_lane_m = crossing.to_lane_m(side) - (crossing.length_m - view.remaining_m)
    return quick_tuple(PedestrianView, (view.index, side, to_lane_m, *view[3:]))
