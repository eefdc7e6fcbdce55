"""Vehicles that obey late, in SUMO: encounters, hours of traffic, own simulations, and risks."""

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.core.actuation import Actuator
from harness.core.encounter import Arm, Ending, Strategy
from harness.encounter.cell_constants import constants_of
from harness.encounter.pairing import PairRunner
from harness.encounter.simulation.driving import Control, PassageLog
from harness.encounter.traffic.demand import Scheduled
from harness.encounter.traffic.hour import Hour
from harness.encounter.traffic.lanes import lanes_of
from harness.encounter.traffic.vehicles import LaneOnRoad
from harness.engine.plain import PlainEngine
from harness.engine.shared import engine_for, road_for
from harness.model.interaction import InteractionModel
from harness.old.studies.risk.asking import Settings
from harness.old.studies.risk.folder import estimate_risk
from harness.old.studies.risk.writing import RESULT
from harness.scenario import Scenario, load_scenario
from tests import towns
from tests.batches import Inline
from tests.scenes import Recorder, on_plain, scenario

pytestmark = pytest.mark.usefixtures("no_simulation")

LATE = {"dead_time_s": 0.25, "lag_s": 0.3, "max_jerk_mps3": 9.0}
STEP_S = 0.1


def chain(car: Actuator, speed: float, commands: list[float]) -> Iterator[float]:
    yield speed
    for command in commands:
        speed = car.speed_after(command, speed)
        yield speed


def test_both_engines_play_the_same_episodes(model: InteractionModel) -> None:
    scene = scenario(
        pedestrians={"flow_per_hour": 1000.0},
        arms={"av": "gap_yield", "human": "hard_yield"},
        actuation={**LATE, "human": True},
        crossing={"grade": -0.05, "friction": 0.4},
    )
    in_sumo = [*PairRunner(scene, model, lambda: engine_for(scene)).run(range(5))]
    plain = [*PairRunner(scene, model, lambda: PlainEngine(scene.vehicle(), STEP_S)).run(range(5))]
    for one, other in zip(in_sumo, plain, strict=True):
        assert one.trace.speed_mps == pytest.approx(other.trace.speed_mps, abs=1e-7)
        assert one.trace.x_m == pytest.approx(other.trace.x_m, abs=1e-6)
        assert one.record.ending is other.record.ending


def hour_scene(**sections: Any) -> Scenario:
    return scenario(
        pedestrians={"flow_per_hour": 0.0},
        arms={"av": "gap_yield", "human": "gap_yield"},
        traffic={"duration_s": 60.0, "warm_up_s": 0.0},
        **sections,
    )


def test_commands_of_an_hour_pass_the_actuator() -> None:
    scene = hour_scene(actuation=LATE, crossing={"grade": 0.06})
    rules, drivers = constants_of(scene), list[Recorder]()
    commands = [(-3.0, 1.0, 0.0)[n // 15] if n < 45 else 0.2 for n in range(200)]

    def make(_planned: Scheduled) -> tuple[bool, str, Strategy]:
        drivers.append(Recorder(lambda seen: commands[round(seen.time_s / STEP_S)]))
        return True, "recorder", drivers[-1]

    lanes = [
        LaneOnRoad(number, lane, iter([Scheduled(number, lane, 5, 0.0)]), rules)
        for number, lane in enumerate(lanes_of(scene))
    ]
    hour = Hour(road_for(scene), lanes, (), lambda *_: 1.0, make, rules, scene.known_traffic)
    cars = hour.run().vehicles
    for car, oncoming in zip(cars, (False, True), strict=True):
        (vehicle,) = scene.vehicles(Arm.AV, oncoming=oncoming)
        assert car.vehicle == vehicle
        expected = chain(Actuator(vehicle, STEP_S, car.speeds[0]), car.speeds[0], commands)
        assert car.speeds == pytest.approx([*expected][: len(car.speeds)], abs=1e-9)
        assert len(car.speeds) > 60


def test_a_vehicle_of_an_own_simulation_goes_on_from_where_sumo_cut_it() -> None:
    vehicle = scenario(actuation=LATE).vehicle(Arm.AV)
    sent: list[float] = []
    api = SimpleNamespace(
        vehicle=SimpleNamespace(
            getSpeedMode=lambda _: 31,
            getLaneChangeMode=lambda _: 0,
            getParameter=lambda *_: "",
            setSpeedMode=lambda *_: None,
            setLaneChangeMode=lambda *_: None,
            setParameter=lambda *_: None,
            getAcceleration=lambda _: -1.0,
        )
    )
    way = SimpleNamespace(way=SimpleNamespace(crossing=None), meets_vehicles=False)
    control = Control(api, lambda _, speed: sent.append(speed), STEP_S, 30.0, lambda *_: ())
    driver: Any = Recorder(lambda _: 2.0)
    log: Any = PassageLog("a", "car", way, vehicle, True, "x", None, 0.0, driver)  # type: ignore[arg-type]
    control.take(log)
    car, speed, expected = Actuator(vehicle, STEP_S, 5.0, -1.0), 5.0, []
    for n in range(12):
        log.note(n * STEP_S, -30.0 + n, speed)
        expected.append(car.speed_after(2.0, speed))
        control.command(n * STEP_S)
        speed = expected[-1] - (0.3 if n == 7 else 0.0)  # a leader is in the way
    assert sent == expected


def test_an_own_simulation_runs_with_late_vehicles(tmp_path: Path, model: InteractionModel) -> None:
    town = towns.main_road(tmp_path, 90)
    speeds = []
    for lag_s in (0.0, 0.4):
        settings = {"arms__av": "gap_yield", "actuation__lag_s": lag_s}
        scene = towns.scenario_of(town, [":b_c0"], **settings)
        outcome = towns.run_arm(scene, model, tmp_path / f"lag-{lag_s}")
        assert outcome.reason is None, outcome.traceback
        driven = [each for each in outcome.passages if each.log.commands]
        assert driven
        assert {each.trace.vehicle.lag_s for each in driven} == {lag_s}
        speeds.append(driven[0].trace.speed_mps.tolist())
    assert speeds[0] != speeds[1]


def test_a_risk_of_a_late_vehicle_holds_its_quadrature(
    tmp_path: Path, model: InteractionModel
) -> None:
    changes = {
        "arms.av": "emergency_brake",
        "strategies.emergency_brake.ttc_threshold_s": 0.8,
        **{f"actuation.{key}": value for key, value in LATE.items()},
    }
    scene = load_scenario("cctc", changes)
    # An episode is a function of the side and of u; the sum over the midpoints of u is the truth.
    parts = 100
    cases = [
        (0, {"side": (side,), "quantile": ((part + 0.5) / parts,)})
        for side in (0.25, 0.75)
        for part in range(parts)
    ]
    driven = on_plain(scene, model).run_arm_given(Arm.AV, cases, lambda _: None)
    truth = float(np.mean([each.record.ending is Ending.CRASHED for each in driven]))
    asked = Settings("cctc", scene, target_cv=0.3)
    folder = estimate_risk(asked, out=tmp_path / "risk", make_executor=Inline)
    result = json.loads((folder / RESULT).read_text())
    # On either side the crashes are an interval of u, with two ends.
    assert result["ci_low"] - 2 / parts <= truth <= result["ci_high"] + 2 / parts
    assert result["ci_low"] > 0.05  # 0.0225 by the same sum if the vehicle obeys at once
