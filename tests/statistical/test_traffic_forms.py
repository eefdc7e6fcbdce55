"""`[traffic]` against closed forms of delay and capacity at an unsignalized crosswalk."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.results.loaded_run import Run
from harness.scenario import Scenario, validate
from harness.studies.running.run import run
from tests.closed_forms import gap_wait_s, priority_capacity_per_s

STEP_S = 0.1
pytestmark = pytest.mark.slow


def hours(folder: Path, traffic: dict[str, Any], **sections: Any) -> Run:
    """One pair of a scenario with these tables."""
    tree: dict[str, Any] = {
        "ego": {"initial_speed_mps": 8.0},
        "arms": {"av": "constant_speed", "human": "constant_speed"},
        "traffic": {"warm_up_s": 60.0, **traffic},
        "experiment": {"pairs": 1},
    }
    for section, values in sections.items():
        tree[section] = {**tree.get(section, {}), **values}
    scenario: Scenario = validate(tree, "test")
    return run(scenario, out=folder / "run", workers=0)


def waits_of(found: Run) -> tuple[Any, Any]:
    """Arrivals since the begin of the counted time, and waits, in the AV's arm."""
    people = found.table("people").query("arm == 'av'")
    return people["arrival_s"].to_numpy() - 60.0, people["wait_s"].to_numpy()


def test_waits_are_the_integral_over_the_blocked_times(tmp_path: Path) -> None:
    """Drivers who ignore waiting people: mean wait = Σ blocked²/2 / time, at any flow.

    A vehicle blocks from the kerb wait before its front arrives until its rear has left; who waits
    goes at the next step's beginning.
    """
    total_s, wait_s = 1800.0, 2.0
    found = hours(
        tmp_path,
        {"flow_per_hour": 500.0, "oncoming_per_hour": 400.0, "duration_s": total_s},
        pedestrians={"flow_per_hour": 2000.0, "kerb_wait_s": wait_s},
    )
    passages = found.table("passages").query("arm == 'av'")
    spans = zip(passages["front_s"] - 60.0 - wait_s, passages["rear_s"] - 60.0, strict=True)
    merged: list[list[float]] = []
    for begin, end in sorted((a, math.ceil(b / STEP_S - 1e-6) * STEP_S) for a, b in spans):
        if merged and begin <= merged[-1][1]:
            merged[-1][1] = max(merged[-1][1], end)
        else:
            merged.append([begin, end])
    blocked = np.clip(merged, 0.0, total_s)
    expected = float((np.diff(blocked, axis=1) ** 2).sum()) / 2 / total_s
    _, waits = waits_of(found)
    error = float(np.std(waits)) / math.sqrt(len(waits))
    assert len(waits) > 900
    assert abs(float(np.mean(waits)) - expected) < 3 * error


def test_delay_of_a_lone_vehicle_under_absolute_priority(tmp_path: Path) -> None:
    """(e^{λτ} − λτ − 1)/λ where slowing down and speeding up take no time: at 20 m/s².

    A vehicle that waits stands 1 m before the crosswalk, so it needs 1 m/v from its start until its
    bumper is over the edge, and a person who comes within that time stops it again.  The gap
    between people that lets it pass is therefore a walk over the crosswalk and 1 m/v, and its delay
    ends 1 m/v after its start, as that of a free vehicle ends 1 m/v after the same place.  It looks
    at the beginning of steps, on average half a step late.
    """
    walking, rate = 0.6, 1000.0
    limits = ("max_deceleration_mps2", "resume_acceleration_mps2")
    found = hours(
        tmp_path,
        {"flow_per_hour": 20.0, "oncoming_per_hour": 0.0, "duration_s": 40_000.0},
        crossing={"oncoming_lanes": 0, "length_m": 4.5},
        ego={"initial_speed_mps": 3.0, "detection_range_m": 3.6} | dict.fromkeys(limits, 20.0),
        pedestrians={
            **{"flow_per_hour": rate, "kerb_wait_s": 0.0},
            "walking_speed": {"mean_mps": walking, "std_mps": 1e-6},
        },
        arms={"av": "hard_yield"},
    )
    delays = found.table("passages").query("arm == 'av'")["delay_s"].dropna().to_numpy()
    expected = gap_wait_s(rate / 3600, 4.5 / walking + 1.0 / 3.0 + STEP_S / 2)
    error = float(delays.std()) / math.sqrt(len(delays))
    assert abs(float(delays.mean()) - expected) < 0.03 * expected + 3 * error


def test_capacity_under_absolute_priority(tmp_path: Path) -> None:
    """λ e^{−λ(τ + t0)}/(1 − e^{−λ h}) of a saturated lane with Hard-Yield, within 15 %.

    h is the headway of the queue without people, in the same run of cells.  The k-th vehicle has
    committed itself, d_k after the crosswalk became free, once its bumper is over the edge: Hard-
    Yield stops for people until then.  The first one stands a metre before it, so with a0 = 1 m/s²
    d_0 = √(2 · 1 m/a0), and each of the others follows a headway later.  That the first ones are
    slower than the queue at speed is left out.
    """
    scenario = validate(
        {
            "crossing": {"oncoming_lanes": 0, "length_m": 4.5},
            "ego": {"initial_speed_mps": 8.0},
            "pedestrians": {
                "kerb_wait_s": 0.0,
                "walking_speed": {"mean_mps": 1.2, "std_mps": 1e-6},
            },
            "arms": {"av": "hard_yield", "human": "constant_speed"},
            "traffic": {"duration_s": 2400.0, "warm_up_s": 300.0, "saturated": True},
            "experiment": {"pairs": 1},
        },
        "test",
    )
    flows = [0.0, 200.0, 400.0, 800.0]
    found = run(
        scenario, vary={"pedestrians.flow_per_hour": flows}, out=tmp_path / "run", workers=0
    )
    passed = found.table("passages").query("arm == 'av'").groupby("cell")["rear_s"].count() * 1.5
    headway_s = 3600 / passed[0]
    for cell, flow in list(enumerate(flows))[1:]:
        rate = flow / 3600
        times = (math.sqrt(2.0) + headway_s * np.arange(1000)).tolist()
        expected = 3600 * priority_capacity_per_s(rate, 4.5 / 1.2, times)
        assert passed[cell] == pytest.approx(expected, rel=0.15)
