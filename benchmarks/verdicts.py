"""SUMO's verdict against the geometric one: ``python -m benchmarks.verdicts RUN``.

Every episode of a finished run in which either saw a hit is simulated once more and held against
the rule of docs/sumo.md, which says when SUMO must see a hit, when it may, and so why the two
differ.  What the rule does not explain is listed, and ends the command with exit code 1.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import pairwise
from math import hypot
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from rich.console import Console
from rich.table import Table

from harness.core.encounter import Arm, Crossing, Ending, Side, Trace, Vehicle, Walk
from harness.engine.shared import close_engine, engine_for
from harness.episode.pairing import PairRunner
from harness.measures import Outcome
from harness.measures.motion.walking import states_at
from harness.model.interaction import load_model
from harness.scenario import Cell, study_from
from harness.store.episode_tables import episode_rows
from harness.store.reading import MANIFEST, read_finished_manifest, read_table
from harness.studies.runs.stored import differences_of

# The rule, by SUMO's sources (MSVehicle::getBoundingPoly, MSTransportable::getBoundingBox,
# MSLane::detectCollisions): a car is an octagon, its nose and tail tapered to 0.6 of the width
# over a tenth of the length; a person is a box of 0.215 m behind his position and 0.239 m to
# either side; only a car whose front is on the junction's inner lane is looked at, and only once
# or twice a step.
OUTLINE = [(0.0, 0.3), (0.1, 0.5), (0.9, 0.5), (1.0, 0.3)]
"""(share of the length from the front, share of the width) of the car's corners on its left."""

BEHIND_M, ASIDE_M = 0.215, 0.239
"""How far a person's box reaches behind his position and to either side."""

BEYOND_BAND_M = 1.5
"""The junction's inner lane goes on so far beyond either edge of the crosswalk."""

OWN_WALK_MPS = 1.39
"""At which SUMO lets a person walk by himself before he is put where he is told to be."""

MARGIN_M = 1e-6
"""Overlaps as small as this are left open: a last bit decides."""

MOMENTS = 50
"""In each step, where the outlines are looked at between its ends."""

AGREE = "both, or neither"
GRAZING = "geometry alone: SUMO's outlines do not overlap"
FLANK = "geometry alone: they do only with the front off the junction"
BRIEF = "geometry alone: they do only between the ends of two steps"
STEP_LATE = "SUMO alone: where he was a step ago"
UNEXPLAINED = "NOT EXPLAINED"
REASONS = (AGREE, GRAZING, FLANK, BRIEF, STEP_LATE, UNEXPLAINED)

Polygon = list[tuple[float, float]]


class Moment(NamedTuple):
    """Where the ego's front is at a time."""

    time_s: float
    front_m: float


def overlap(one: Polygon, other: Polygon, margin_m: float) -> bool:
    """Whether two convex polygons overlap by more than the margin (separating axes)."""
    for polygon in (one, other):
        for (x0, y0), (x1, y1) in pairwise([*polygon, polygon[0]]):
            side = hypot(x1 - x0, y1 - y0)
            reach = [[((y1 - y0) * x - (x1 - x0) * y) / side for x, y in p] for p in (one, other)]
            if min(max(reach[0]) - min(reach[1]), max(reach[1]) - min(reach[0])) < margin_m:
                return False
    return True


class Passage:
    """One episode as SUMO's check of collisions meets it.

    Args:
        trace: of pedestrians who walk straight across and are held where they are told to be.
    """

    def __init__(self, trace: Trace) -> None:
        self._vehicle, self._crossing, self._step_s = trace.vehicle, trace.crossing, trace.step_s
        self._walks = [walk for walk in trace.walks if walk.start_s is not None]
        self._inner_m = trace.crossing.width_m / 2 + BEYOND_BAND_M
        self._own_walk_m = 2 * OWN_WALK_MPS * trace.step_s
        self._x_m, self._speed_mps = trace.x_m.tolist(), trace.speed_mps.tolist()
        times = [step * trace.step_s for step in range(len(self._x_m))]
        self._ends = [Moment(*both) for both in zip(times, self._x_m, strict=True)]

    def must_be_seen(self) -> bool:
        """The outlines overlap at a step's end, the front clearly on the inner lane."""
        return any(
            abs(end.front_m) < self._inner_m - MARGIN_M and self._overlap(end, 0.0, MARGIN_M)
            for end in self._ends
        )

    def may_be_seen(self) -> bool:
        """Or after the car has moved and before the person is put where he is told to be.

        Then he stands up to two steps of SUMO's own walk ahead of where he was a step ago, and the
        car counts as on the inner lane if it began its step there.
        """
        return self.must_be_seen() or any(
            abs(before.front_m) <= self._inner_m + MARGIN_M
            and self._overlap(Moment(before.time_s, end.front_m), self._own_walk_m, -MARGIN_M)
            for before, end in pairwise(self._ends)
        )

    def is_left_open(self) -> bool:
        """Whether the rule does not decide."""
        return self.may_be_seen() and not self.must_be_seen()

    def overlaps(self) -> Iterator[Moment]:
        """Moments at which the outlines overlap, within steps too."""
        for number, (before, end) in enumerate(pairwise(self._ends)):
            speed, after = self._speed_mps[number : number + 2]
            gain = (after - speed) / self._step_s
            for part in range(MOMENTS):
                elapsed = part / MOMENTS * self._step_s
                front = before.front_m + speed * elapsed + gain * elapsed**2 / 2
                moment = Moment(before.time_s + elapsed, front)
                if end.front_m > -1 and self._overlap(moment, 0.0, MARGIN_M):
                    yield moment

    def on_inner_lane(self, moment: Moment) -> bool:
        """Whether SUMO looks at the car at all."""
        return abs(moment.front_m) < self._inner_m

    def _overlap(self, moment: Moment, ahead_m: float, margin_m: float) -> bool:
        """SUMO's outlines at one moment; a person's box reaches ``ahead_m`` in front of him."""
        if not -1 < moment.front_m < self._vehicle.length_m + 1:
            return False
        boxes = (self._box(walk, moment.time_s, ahead_m) for walk in self._walks)
        car = outline(self._vehicle, self._crossing, moment.front_m)
        return any(box is not None and overlap(car, box, margin_m) for box in boxes)

    def _box(self, walk: Walk, time_s: float, ahead_m: float) -> Polygon | None:
        """The person's box, None before he stepped off and once he is across."""
        assert walk.start_s is not None
        if time_s < walk.start_s:
            return None
        place = states_at(walk, self._crossing, np.array([time_s]))
        x, y = float(place[0][0]), float(place[1][0])
        if not 0 <= y <= self._crossing.length_m:
            return None
        direction = 1 if walk.arrival.side is Side.NEAR else -1
        back, front = y - direction * BEHIND_M, y + direction * ahead_m
        left, right = x - ASIDE_M, x + ASIDE_M
        return [(left, back), (right, back), (right, front), (left, front)]


def outline(vehicle: Vehicle, crossing: Crossing, front_m: float) -> Polygon:
    """The car's octagon."""
    left = [(front_m - vehicle.length_m * along, vehicle.width_m * b) for along, b in OUTLINE]
    centre = crossing.lane_centre_m
    return [(x, centre + y) for x, y in left] + [(x, centre - y) for x, y in reversed(left)]


def explained(trace: Trace, crashed: bool) -> str:
    """Which of ``REASONS`` says why geometry and SUMO agree or differ about an episode."""
    passage, seen = Passage(trace), bool(trace.sumo_collision)
    must, may = passage.must_be_seen(), passage.may_be_seen()
    if (must and not seen) or (seen and not may):
        return UNEXPLAINED
    if crashed == seen:
        return AGREE
    if seen:
        return STEP_LATE
    moments = list(passage.overlaps())
    if not moments:
        return GRAZING
    return BRIEF if any(map(passage.on_inner_lane, moments)) else FLANK


class Verdicts(NamedTuple):
    """What came of one arm of a cell: episodes by reason; pairs that the rule does not explain.

    ``left_open`` counts the episodes with a hit in which SUMO may see one, but need not.
    """

    episodes: int
    crashed: int
    seen: int
    reasons: Counter[str]
    left_open: int
    unexplained: list[int]


def verdicts_of(run: Path) -> dict[tuple[int, str], Verdicts]:
    """Hold every episode of a run with a hit against the rule, by cell and arm.

    Raises:
        SystemExit: people are shown to SUMO elsewhere than they walk, or an episode simulated once
            more is not the stored one.
    """
    found = {}
    for cell in study_from(read_finished_manifest(run), MANIFEST).cells:
        arms, behaviour = cell.scenario.arms, cell.scenario.pedestrians.behaviour
        if "sumo_driver" in (arms.av, arms.human) or behaviour == "sumo":
            sys.exit(f"{run}: the rule is for people whom SUMO holds where they walk")
        episodes = read_table(run, "episodes", cell.number)
        crashed = pc.equal(episodes["ending"], Ending.CRASHED.value)
        hit = pc.or_(crashed, pc.fill_null(episodes["sumo_collision"], False))
        pairs = sorted(set(episodes.filter(hit)["pair"].to_pylist()))
        again = list(_again(cell, pairs, episodes))
        for arm in Arm:
            own = episodes.filter(pc.equal(episodes["arm"], arm.value))
            outcomes = [outcome for outcome in again if outcome.arm is arm]
            found[cell.number, arm.value] = _judged(own, outcomes)
    return found


def _again(cell: Cell, pairs: Iterable[int], episodes: pa.Table) -> Iterator[Outcome]:
    """Simulate pairs once more; ends the command where one is not what is stored."""
    section = cell.scenario.model
    model = load_model(section.name, section.path)
    runner = PairRunner(cell.scenario, model, lambda: engine_for(cell.scenario))
    chosen = episodes.filter(pc.is_in(episodes["pair"], pa.array(pairs, episodes["pair"].type)))
    stored: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for row in chosen.to_pylist():
        stored[row["pair"], row["arm"]] = [row]
    try:
        for outcome in runner.run(pairs):
            rows = episode_rows(cell.number, [outcome]).to_pylist()
            key = outcome.pair, outcome.arm.value
            for difference in differences_of("episodes", rows, stored[key]):
                sys.exit(f"pair {key[0]}, {key[1]}: {difference}")
            yield outcome
    finally:
        close_engine()


def _judged(episodes: pa.Table, outcomes: Iterable[Outcome]) -> Verdicts:
    reasons: Counter[str] = Counter()
    unexplained, left_open = [], 0
    for outcome in outcomes:
        crashed = outcome.record.ending is Ending.CRASHED
        if crashed or outcome.record.sumo_collision:
            reason = explained(outcome.trace, crashed)
            reasons[reason] += 1
            left_open += Passage(outcome.trace).is_left_open()
            if reason == UNEXPLAINED:
                unexplained.append(outcome.pair)
    crashes = episodes["ending"].to_pylist().count(Ending.CRASHED.value)
    reasons[AGREE] += episodes.num_rows - reasons.total()
    seen = episodes["sumo_collision"].to_pylist().count(True)
    return Verdicts(episodes.num_rows, crashes, seen, reasons, left_open, unexplained)


def counts_of(run: Path, found: dict[tuple[int, str], Verdicts]) -> Table:
    """Counts by reason, a column for each cell and arm."""
    table = Table(title=str(run))
    table.add_column("episodes")
    for cell, arm in found:
        table.add_column(f"{cell} {arm}", justify="right")
    verdicts = found.values()
    table.add_row("all", *(f"{each.episodes}" for each in verdicts))
    table.add_row("crashed by geometry", *(f"{each.crashed}" for each in verdicts))
    table.add_row("hit by SUMO", *(f"{each.seen}" for each in verdicts))
    table.add_row("left open by the rule", *(f"{each.left_open}" for each in verdicts))
    for reason in REASONS:
        table.add_row(reason, *(f"{each.reasons[reason]}" for each in verdicts))
    return table


def main() -> None:
    """Check runs and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    console = Console(width=120)
    failed = False
    for run in parser.parse_args().runs:
        found = verdicts_of(run)
        console.print(counts_of(run, found))
        for (cell, arm), verdicts in found.items():
            if verdicts.unexplained:
                failed = True
                console.print(f"not explained: cell {cell}, {arm}, pairs {verdicts.unexplained}")
    sys.exit(failed)


if __name__ == "__main__":
    main()
