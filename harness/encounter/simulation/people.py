"""The people at a chosen crosswalk, whom SUMO moves: their records and the strategies' views."""

import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from harness.core.encounter import PedestrianView, Side
from harness.encounter.simulation.passages import STANDING_MPS, WAITING_M, PersonTrack
from harness.site import Crosswalk, WayOver


@dataclass(slots=True, eq=False)
class PersonAt:
    """A person who is about to cross, crosses, or has just crossed.

    The lists have one value for each step: time in s, network coordinates in m, and whether the
    person is on the crossing's edge.
    """

    id: str
    index: int
    time_s: "array[float]" = field(default_factory=lambda: array("d"))
    x_m: "array[float]" = field(default_factory=lambda: array("d"))
    y_m: "array[float]" = field(default_factory=lambda: array("d"))
    on_crossing: list[bool] = field(default_factory=list)

    def note(self, time_s: float, place: Sequence[float], *, on_crossing: bool) -> None:
        """Note where the person is."""
        self.time_s.append(time_s)
        self.x_m.append(place[0])
        self.y_m.append(place[1])
        self.on_crossing.append(on_crossing)

    @property
    def stands(self) -> bool:
        """Whether the person moved slower than 0.1 m/s in the last step."""
        if len(self.time_s) < 2:
            return False
        moved_m = math.hypot(self.x_m[-1] - self.x_m[-2], self.y_m[-1] - self.y_m[-2])
        return moved_m < STANDING_MPS * (self.time_s[-1] - self.time_s[-2])

    def track(self) -> PersonTrack:
        """The records as arrays."""
        return PersonTrack(
            self.id,
            np.array(self.time_s),
            np.array(self.x_m),
            np.array(self.y_m),
            np.array(self.on_crossing, dtype=bool),
        )


class PeopleAtCrosswalk:
    """Everybody who is about to cross at one crosswalk, or is on it.

    Args:
        function: SUMO's function of a part and a name (``OwnSimulation.function``).
        crosswalk: the crosswalk.
        on_new: called with the id of everybody who comes.
    """

    def __init__(
        self,
        function: Callable[[str, str], Callable[..., Any]],
        crosswalk: Crosswalk,
        on_new: Callable[[str], None],
    ) -> None:
        self.crosswalk = crosswalk
        self.present: dict[str, PersonAt] = {}
        self.id_of: list[str] = []
        """The id of everybody who came, by index."""
        self.gone: list[PersonAt] = []
        self._on_new = on_new
        self._areas = sorted(crosswalk.areas)
        self.edges = {crosswalk.id, *self._areas}
        self._seen: dict[int, tuple[PedestrianView, ...]] = {}
        self._next_edge: Callable[[str], str] = function("person", "getNextEdge")
        self._place: Callable[[str], Sequence[float]] = function("person", "getPosition")
        self._speed: Callable[[str], float] = function("person", "getSpeed")

    def note(self, time_s: float, there: Mapping[str, Sequence[str]]) -> None:
        """Note where everybody is at the end of a step.

        Args:
            time_s: the end of the step.
            there: by edge, everybody on the crossing and its walking areas; edges may be missing.
        """
        crossing, present = self.crosswalk.id, self.present
        self._seen.clear()
        here = there.get(crossing, ())
        beside = [there[area] for area in self._areas if area in there]
        known = set(here)
        for name in here:
            self._known(name).note(time_s, self._place(name), on_crossing=True)
        for names in beside:
            for name in names:
                if name in known:
                    continue
                if self._next_edge(name) == crossing:
                    self._known(name).note(time_s, self._place(name), on_crossing=False)
                    known.add(name)
                elif name in present and present[name].on_crossing[-1]:
                    # The first position beyond the crossing shows when the kerb was reached.
                    present[name].note(time_s, self._place(name), on_crossing=False)
        if len(known) < len(present):
            for name in [name for name in present if name not in known]:
                person = present.pop(name)
                if True in person.on_crossing:
                    self.gone.append(person)

    def _known(self, name: str) -> PersonAt:
        person = self.present.get(name)
        if person is None:
            person = self.present[name] = PersonAt(name, len(self.id_of))
            self.id_of.append(name)
            self._on_new(name)
        return person

    @property
    def anybody_stands(self) -> bool:
        """Whether somebody who wants to cross stands, before the crosswalk or on it."""
        return any(person.stands for person in self.present.values())

    def tracks(self) -> list[PersonTrack]:
        """The records of everybody who was on the crossing, in the order in which they came.

        Those who are still before it at the end come last.
        """
        return [person.track() for person in self._in_order()]

    def numbers(self) -> dict[int, int]:
        """The place in ``tracks`` of everybody, by index; those without a track come last."""
        order = [person.index for person in self._in_order()]
        without = sorted({*range(len(self.id_of))} - {*order})
        return {index: number for number, index in enumerate((*order, *without))}

    def _in_order(self) -> list[PersonAt]:
        everyone = [*self.gone, *(p for p in self.present.values() if True in p.on_crossing)]
        everyone.sort(key=lambda person: (person.time_s[0], person.index))
        before = [p for p in self.present.values() if True not in p.on_crossing]
        return [*everyone, *before]

    def views(self, way: WayOver) -> tuple[PedestrianView, ...]:
        """Everybody as a vehicle on one way sees them; all vehicles on a way see the same."""
        if not self.present:
            return ()
        seen = self._seen.get(id(way))
        if seen is None:
            everybody = self.present.values()
            seen = tuple(view_of(each, self._speed(each.id), way) for each in everybody)
            self._seen[id(way)] = seen
        return seen


def view_of(person: PersonAt, speed_mps: float, way: WayOver) -> PedestrianView:
    """A person as a vehicle on a way sees them at the last record.

    Whoever has not come to the crossing's edge has not stepped off, and is shown at the kerb if
    SUMO draws them beyond it: its curves on walking areas cut corners by up to 1 m, and end in a
    jump back.  For the same reason the speed is SUMO's, not that of the places.  Within 1 m of the
    kerb, people slower than 0.1 m/s wait; others who come walk.
    """
    crossing = way.crossing
    _, y_m = way.frame.to_road(person.x_m[-1], person.y_m[-1])
    _, first_m = way.frame.to_road(person.x_m[0], person.y_m[0])
    side = Side.NEAR if first_m < crossing.length_m / 2 else Side.FAR
    progress_m = y_m if side is Side.NEAR else crossing.length_m - y_m
    stepped_off = person.on_crossing[-1]
    progress_m = min(progress_m, crossing.length_m if stepped_off else 0.0)
    if not stepped_off and progress_m >= -WAITING_M and speed_mps < STANDING_MPS:
        speed_mps = 0.0
    return PedestrianView(
        person.index,
        side,
        crossing.to_lane_m(side) - progress_m,
        crossing.length_m - progress_m,
        max(0.0, speed_mps),
        stepped_off and 0.0 <= progress_m < crossing.length_m,
    )


def waited_s(track: PersonTrack, step_s: float, way: WayOver) -> float:
    """The time in s for which a person stood within 1 m of the kerb before stepping off."""
    # Whoever never stepped off waited until the last record.
    crossed = bool(track.on_crossing.any())
    first = int(np.argmax(track.on_crossing)) if crossed else len(track.time_s) - 1
    x_m, y_m = way.frame.to_road(track.x_m[: first + 1], track.y_m[: first + 1])
    if len(y_m) < 2:
        return 0.0
    near = y_m[0] < way.crossing.length_m / 2
    to_kerb_m = -y_m if near else y_m - way.crossing.length_m
    moved_mps = np.hypot(np.diff(x_m), np.diff(y_m)) / step_s
    waits = (to_kerb_m[1:] <= WAITING_M) & (to_kerb_m[1:] >= 0) & (moved_mps < STANDING_MPS)
    return math.fsum([step_s] * int(waits.sum()))
