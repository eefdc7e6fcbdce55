"""Vehicles that obey late, in SUMO: encounters and risks."""

from pathlib import Path

import numpy as np
import pytest

from harness.core.encounter import Arm, Ending
from harness.encounter.pairing import PairRunner
from harness.engine.plain import PlainEngine
from harness.engine.shared import open_engine
from harness.model.interaction import InteractionModel
from harness.scenario import Cell, Study, load_scenario
from harness.studies.risk import risk
from tests.scenes import on_plain, scenario

pytestmark = pytest.mark.usefixtures("no_simulation")

LATE = {"dead_time_s": 0.25, "lag_s": 0.3, "max_jerk_mps3": 9.0}
STEP_S = 0.1


def test_both_engines_play_the_same_episodes(model: InteractionModel) -> None:
    scene = scenario(
        pedestrians={"flow_per_hour": 1000.0},
        arms={"av": "gap_yield", "human": "hard_yield"},
        actuation={**LATE, "human": True},
        crossing={"grade": -0.05, "friction": 0.4},
    )
    in_sumo = [*PairRunner(scene, model, lambda: open_engine(scene)).run(range(5))]
    plain = [*PairRunner(scene, model, lambda: PlainEngine(scene.vehicle(), STEP_S)).run(range(5))]
    for one, other in zip(in_sumo, plain, strict=True):
        assert one.trace.speed_mps == pytest.approx(other.trace.speed_mps, abs=1e-7)
        assert one.trace.x_m == pytest.approx(other.trace.x_m, abs=1e-6)
        assert one.record.ending is other.record.ending


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
    study = Study("late", scene, (Cell(0, {}, scene),))
    (record,) = risk(study, workers=0, target_cv=0.3, out=tmp_path / "risk").records
    found = record["probability"]
    # On either side the crashes are an interval of u, with two ends.
    assert found.low - 2 / parts <= truth <= found.high + 2 / parts
    assert found.low > 0.05  # 0.0225 by the same sum if the vehicle obeys at once
