"""Runs of hours with perception errors: bytes, streams, and who is hidden, from tables alone."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from harness.core.encounter import Arm
from harness.core.errors import InterruptedRunError
from harness.core.seeding import stream
from harness.old.store.schemas import HOUR_TABLES
from harness.old.studies.batch.experiment import resume, run_study
from harness.old.studies.runs.opening import load_run
from harness.old.studies.workers.pool import LocalPool
from harness.scenario import Options, Study, read_scenario_file, study_of, validate
from harness.strategies.perception.sensor import Sensor, sensor_of
from harness.strategies.perception.track import track_from, updates_until_found
from tests.batches import Inline

SCENARIO = """
arms = {av = "hard_yield", human = "human_yield"}
crossing = {length_m = 14.0, lanes = 2, oncoming_lanes = 2}
ego = {initial_speed_mps = 10.0, trigger_range_m = 40.0}
pedestrians = {flow_per_hour = 500, kerb_wait_s = 1.0, walking_speed = {mean_mps = 1.4}}
experiment = {pairs = 2}
traffic = {flow_per_hour = 700, oncoming_per_hour = 700, duration_s = {SECONDS}, warm_up_s = 10}
"""
HIDES = "[perception]\nvehicles_hide = true\n"
FAULTS = """[perception]
vehicles_hide = true
latency_s = 0.3
detection_probability = 0.4
dropout_probability = 0.1
position_sd_m = 0.3
"""
WIDTH_M, LENGTH_M, LANE_M, ROAD_M, RADIUS_M, EYE_M = 1.8, 5.0, 3.5, 14.0, 0.25, 2.4


def study_in(folder: Path, perception: str, seconds: int) -> Study:
    text = SCENARIO.replace("{SECONDS}", str(seconds)) + perception
    (folder / "road.toml").write_text(text, encoding="utf-8")
    return study_of(read_scenario_file(folder / "road.toml"), [])


def test_bytes_do_not_depend_on_workers_nor_on_interruptions(tmp_path: Path) -> None:
    study = study_in(tmp_path, FAULTS, 15)
    for workers, make_executor in ((1, Inline), (2, LocalPool)):
        options = Options(traces=True, workers=workers)
        run_study(study, options, out=tmp_path / f"run-{workers}", make_executor=make_executor)

    def stop(done: int, _planned: int, _what: str) -> None:
        if done == 1:
            raise KeyboardInterrupt

    cut: dict[str, Any] = {"progress": stop, "make_executor": Inline}
    with pytest.raises(InterruptedRunError):
        run_study(study, Options(traces=True), out=tmp_path / "cut", **cut)
    resume(tmp_path / "cut", make_executor=Inline)
    for table in (*HOUR_TABLES, "traces"):
        first, *others = (
            (tmp_path / run / f"{table}.parquet").read_bytes() for run in ("run-1", "run-2", "cut")
        )
        assert others == [first, first]


def far_sighted(**perception: object) -> Sensor:
    sensor = sensor_of(validate({"perception": perception}, "test"), Arm.AV)
    assert sensor is not None
    return sensor


def test_every_vehicle_has_streams_of_its_own_by_its_number() -> None:
    """The first detection is the first draw of (seed, "detection", pair, vehicle, person)."""
    sensor = far_sighted(detection_probability=0.3)
    for key in ((0, 4, 1), (0, 5, 1), (0, 4, 2), (1, 4, 1)):
        pair, vehicle, person = key
        track = track_from(sensor, pair, (vehicle,), person)
        looks = [track.update(in_sight=True) for _ in range(60)]
        uniform = stream(sensor.seed, "detection", *key).random()
        assert looks.index(True) + 1 == updates_until_found(uniform, 0.3)
    # Over vehicles it is geometric: mean 1/p and variance (1 − p)/p².
    waits = [
        next(n for n in range(1, 99) if track.update(in_sight=True))
        for track in (track_from(sensor, 0, (vehicle,), 0) for vehicle in range(2_000))
    ]
    assert np.mean(waits) == pytest.approx(1 / 0.3, abs=4 * math.sqrt(0.7) / 0.3 / 2_000**0.5)
    errors = far_sighted(position_sd_m=1.0)
    firsts = [
        [track_from(errors, 0, (vehicle,), person).next_errors()[0] for person in (0, 1)]
        for vehicle in range(1_000)
    ]
    # Errors of two people, and of neighbouring vehicles, are uncorrelated: |r| < 4/√n.
    one, other = np.array(firsts).T
    assert abs(np.corrcoef(one, other)[0, 1]) < 4 / 1_000**0.5
    assert abs(np.corrcoef(one[1:], one[:-1])[0, 1]) < 4 / 1_000**0.5
    assert np.std(one) == pytest.approx(1.0, abs=4 / 2_000**0.5)


def a_ray_passes(
    eye: tuple[float, float], person: tuple[float, float], boxes: list[tuple[float, float]]
) -> list[bool]:
    """Whether each of 101 rays through a person's disc meets no box before the disc.

    A box is (x, y) of its centre.  The rays are sampled, so this knows no shadows.
    """
    dx, dy = person[0] - eye[0], person[1] - eye[1]
    distance = math.hypot(dx, dy)
    half = math.asin(RADIUS_M / distance)
    passes = []
    for angle in math.atan2(dy, dx) + np.linspace(-half, half, 101):
        off = angle - math.atan2(dy, dx)
        to_disc = distance * math.cos(off)
        to_disc -= math.sqrt(max(0.0, RADIUS_M**2 - (distance * math.sin(off)) ** 2))
        points = np.linspace(0.0, to_disc, 1_500)[1:-1]
        x, y = eye[0] + points * math.cos(angle), eye[1] + points * math.sin(angle)
        passes.append(
            not any(
                np.any((abs(x - bx) < LENGTH_M / 2) & (abs(y - by) < WIDTH_M / 2))
                for bx, by in boxes
            )
        )
    return passes


def wrongly_shown(traces: pd.DataFrame, range_m: float = 40.0) -> tuple[int, int, list[object]]:
    """Recompute from the rows of one arm, once per second, who is shown to each driven vehicle.

    Returns:
        The number of (vehicle, pedestrian, second) that are hidden, and that are not, and the ones
        for which the table says something else.  Cases with one or two rays are left out.
    """
    kinds = traces["object"].str.split("-")
    rows = traces.assign(shown=kinds.str.len() == 4, walks=kinds.str[0] == "pedestrian")
    times = rows["time_s"].round(6)
    hidden, visible, wrong = 0, 0, []
    for time, now in rows[(times % 1 == 0)].groupby(times):
        cars = now[~now["shown"] & ~now["walks"]].set_index("object")
        seen = {*now[now["shown"]]["object"]}
        forward = cars["y_m"] < ROAD_M / 2
        centres = [*zip(cars["x_m"] - np.where(forward, 2.5, -2.5), cars["y_m"], strict=True)]
        for number, name in enumerate(cars.index):
            x_m, y_m = cars["x_m"].iloc[number], cars["y_m"].iloc[number]
            sign = 1.0 if forward.iloc[number] else -1.0
            # From R0 until the rear has left, except the last row, after which nobody decides.
            if not -range_m <= sign * x_m < LENGTH_M + 2.0 - 0.01:
                continue
            others = [centre for n, centre in enumerate(centres) if n != number]
            for who in now[now["walks"]].itertuples():
                rays = sum(a_ray_passes((x_m - sign * EYE_M, y_m), (who.x_m, who.y_m), others))
                if 0 < rays < 3:
                    continue
                hidden, visible = hidden + (rays == 0), visible + (rays > 0)
                index = str(who.object).split("-")[1]
                if (f"{name}-shown-{index}" in seen) is not (rays > 0):
                    wrong.append((time, name, index, rays))
    return hidden, visible, wrong


def test_whom_vehicles_hide_is_recomputed_from_the_traces(tmp_path: Path) -> None:
    study = study_in(tmp_path, HIDES, 50)
    options = Options(traces=True, workers=1)
    run = run_study(study, options, out=tmp_path / "run", make_executor=Inline)
    traces = load_run(run.path).traces.query("cell == 0 and pair == 0")
    for arm in ("av", "human"):
        hidden, visible, wrong = wrongly_shown(traces[traces["arm"] == arm])
        assert wrong == []
        assert hidden > 5
        assert visible > 50
