"""The parts of the page of hours of traffic."""

from collections.abc import Iterator, Sequence

from harness.core.encounter import Arm
from harness.encounter.traffic.demand import scheduled_vehicle
from harness.encounter.traffic.lanes import Direction, lanes_of
from harness.old.report.drawing.style import Picture
from harness.old.report.pages.hour_pictures import hour_pictures
from harness.old.report.pages.inputs import strategies_of
from harness.old.report.pages.parts import PageParts, pair_by_pair
from harness.old.report.pages.traces import Encoded, pair_title, scene_of, short, shown_arm
from harness.old.report.screens.tables import ARM_NAMES
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import ShownPair

_VIEW_M = (-140.0, 60.0)
"""The stretch of road that the player shows for an hour."""


def _opening(run: RunData) -> str:
    av, human = (strategies_of(run, arm) for arm in Arm)
    return (
        f"Each hour of traffic is simulated twice: once {av} drives the AVs' share of the "
        f"vehicles, once {human} drives all of them. Both arms have the same pedestrians and "
        f"the same vehicles; seed {run.manifest['seed']}."
    )


def _pictures(run: RunData, shown: Sequence[ShownPair]) -> tuple[Iterator[Picture], list[str]]:
    return hour_pictures(run, shown[0] if shown else None), []


def _player_words(_run: RunData, shown: Sequence[ShownPair], _episodes: int) -> str:
    return (
        f"All vehicles from {shown[0].begin_s:g} s to {shown[0].end_s:g} s after the warm-up, "
        "around the longest queue of the AV's arm; a whole hour is too large for a page. AVs "
        "are filled, vehicles of other drivers are outlined."
    )


def _scene(run: RunData, cell: int) -> Encoded:
    scenario = run.scenario_of(cell)
    borders = scenario.crossing.lane_borders_m()
    scene = scene_of(scenario.crosswalk(), scenario.vehicle(), borders, scenario.obstacles())
    return {**scene, "stop": None, "left": _VIEW_M[0], "right": _VIEW_M[1]}


def _episode(run: RunData, pair: ShownPair) -> Encoded:
    scenario = run.scenario_of(pair.cell)
    passages = run.rows_of("passages", pair.cell, pair.pair).to_pylist()
    lanes = [lane for lane in lanes_of(scenario) if lane.direction is Direction.ONCOMING]
    # Vehicles of the warm-up have no row, so their driver is inferred.
    unknown = scenario.arms.av if scenario.known_traffic.share_of_avs == 1 else scenario.arms.human
    types = scenario.vehicles() if scenario.known_traffic.types else ()
    arms = []
    for arm in Arm:
        drivers = {
            f"vehicle-{row['vehicle']}": row["strategy"] for row in passages if row["arm"] == arm
        }
        rows, walks = (frame[frame["arm"] == arm.value] for frame in (pair.traces, pair.people))
        there = (walks["arrival_s"] < pair.end_s) & ~(walks["cleared_s"] < pair.begin_s)
        title = f"{ARM_NAMES[arm]}: {scenario.arms.driver(arm)}"
        document = shown_arm(arm, title, rows, walks[there])
        for vehicle in document["vehicles"]:
            if types:
                number = int(vehicle["name"].removeprefix("vehicle-"))
                kind = types[scheduled_vehicle(scenario, pair.pair, number).kind]
                vehicle["size"] = [kind.length_m, kind.width_m]
            driver = drivers.get(vehicle["name"], unknown)
            vehicle["filled"] = arm is Arm.HUMAN or driver == scenario.arms.av
            vehicle["oncoming"] = vehicle["y"] in [short(lane.centre_m) for lane in lanes]
            vehicle["name"] = f"{vehicle['name'].replace('-', ' ')}, {driver}"
        arms.append(document)
    return {
        "scene": str(pair.cell),
        "name": pair_title(run, pair.cell, pair.pair),
        "result": "",
        "note": " ".join([pair.note, *pair.differences[:1]]).strip(),
        "from": pair.begin_s,
        "until": pair.end_s,
        "step": 1,
        "speed": 4,
        "arms": arms,
    }


HOUR_PARTS = PageParts(
    opening=_opening,
    tables=lambda _run: [],
    pictures=_pictures,
    player_words=_player_words,
    episodes=pair_by_pair(_scene, _episode),
)
