"""How a vehicle obeys: by closed forms, by solving the differential equation, and in episodes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from harness.core.actuation import Actuator
from harness.core.vocabulary import Arm, Side, Trace, Vehicle
from harness.encounter import loop
from harness.encounter.cell_constants import constants_of
from harness.engine.plain import PlainEngine
from harness.measures import measure
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario
from tests.scenes import Recorder, drive, on_plain, scenario

STEP_S = 0.1


def late(dead_time_s: float = 0.0, lag_s: float = 0.0, jerk: float | None = None) -> Vehicle:
    actuation = {"dead_time_s": dead_time_s, "lag_s": lag_s, "max_jerk_mps3": jerk}
    return replace(Scenario().vehicle(), max_deceleration_mps2=9.0, **actuation)


def speeds_of(vehicle: Vehicle, commands: Sequence[float], speed: float = 5.0) -> list[float]:
    car, speeds = Actuator(vehicle, STEP_S, speed), [speed]
    for command in commands:
        speeds.append(car.speed_after(command, speeds[-1]))
    return speeds[1:]


def test_a_dead_time_of_two_and_a_half_steps() -> None:
    # −2 acts from 0.25 s to 0.35 s, then 1 until 0.45 s, then 0.
    found = speeds_of(late(dead_time_s=0.25), [-2.0, 1.0, 0.0, 0.0, 0.0])
    assert found == pytest.approx([5.0, 5.0, 4.9, 4.85, 4.9], abs=1e-12)


def test_the_lag_goes_on_from_the_acceleration_that_sumo_left() -> None:
    vehicle = late(lag_s=0.4)
    car = Actuator(vehicle, STEP_S, 5.0)
    car.speed_after(3.0, 5.0)
    # SUMO let it have 4.9 m/s: its acceleration was −1 m/s².
    expected = 4.9 + 3 * STEP_S + (-1 - 3) * 0.4 * (1 - math.exp(-STEP_S / 0.4))
    assert car.speed_after(3.0, 4.9) == pytest.approx(expected, abs=1e-12)


def solved(
    vehicle: Vehicle, commands: Sequence[float], speed: float
) -> list[tuple[float, float, float, float]]:
    """(distance, speed, least and greatest acceleration) of every step, by SciPy."""
    step, dead = STEP_S, vehicle.dead_time_s
    ends = [n * step for n in range(len(commands) + 1)]
    acts = [n * step + dead for n in range(len(commands))]
    steps, state = [], [0.0, speed, 0.0]
    for begin, end in pairwise(ends):
        cuts = [begin, *(t for t in acts if begin + 1e-9 < t < end - 1e-9), end]
        state, seen = [0.0, *state[1:]], [state[2]]
        for since, until in pairwise(cuts):
            given_before = [c for c, t in zip(commands, acts, strict=True) if t <= since + 1e-9]
            state = [
                *_solve(vehicle, given_before[-1] if given_before else 0.0, state, until - since)
            ]
            seen.append(state[2])
        steps.append((state[0], state[1], min(seen), max(seen)))
    return steps


def _solve(vehicle: Vehicle, command: float, state: Any, duration: float):
    jerk = math.inf if vehicle.max_jerk_mps3 is None else vehicle.max_jerk_mps3

    def gain(_t: float, y: np.ndarray) -> list[float]:
        return [y[1], y[2], max(-jerk, min(jerk, (command - y[2]) / vehicle.lag_s))]

    def stands(_t: float, y: np.ndarray) -> float:
        return y[1]

    stands.terminal, stands.direction = True, -1  # type: ignore[attr-defined]
    time = 0.0
    while time < duration:
        if state[1] <= 0 and state[2] <= 0 and command <= 0:
            return [state[0], 0.0, 0.0]
        # Short steps: the jerk's limit makes a kink that a long step would smooth.
        close: Any = {"rtol": 1e-11, "atol": 1e-12, "max_step": 2e-3}
        found = solve_ivp(gain, (time, duration), state, "DOP853", events=stands, **close)
        state, time = found.y[:, -1], found.t[-1]
        if found.status == 1:
            state = [state[0], 0.0, 0.0]
    return state


@settings(max_examples=25)
@given(
    st.lists(st.floats(-9.0, 3.0), min_size=6, max_size=12),
    st.floats(0.0, 0.35),
    st.floats(0.05, 1.0),
    st.none() | st.floats(2.0, 40.0),
    st.floats(0.5, 6.0),
)
def test_speeds_are_those_of_the_differential_equation(
    commands: list[float], dead_time_s: float, lag_s: float, jerk: float | None, speed: float
) -> None:
    vehicle = late(dead_time_s, lag_s, jerk)
    steps = solved(vehicle, commands, speed)
    found = speeds_of(vehicle, commands, speed)
    assert found == pytest.approx([after for _, after, _, _ in steps], abs=1e-8)
    # A step's distance is that of a constant acceleration, up to |Δa| step²/8.
    for (before, after), (distance, _, least, most) in zip(
        pairwise([speed, *found]), steps, strict=True
    ):
        # Its braking ends where it stands, which it may do within the step below 0.9 m/s.
        spread = 9.0 if before <= 9.0 * STEP_S else most - least
        assert abs((before + after) / 2 * STEP_S - distance) <= spread * STEP_S**2 / 8 + 1e-9


def test_an_episode_has_the_responses_speeds_and_shows_them() -> None:
    scene = scenario(actuation={"dead_time_s": 0.25, "lag_s": 0.4, "max_jerk_mps3": 8.0})
    commands = [-4.0 if n < 12 else 2.0 for n in range(200)]
    driver = Recorder(lambda seen: commands[round(seen.time_s / STEP_S)])
    rules = constants_of(scene, Arm.AV)
    episode = loop.Episode(PlainEngine(scene.vehicle(), STEP_S), (), lambda *_: 1.0, rules)
    trace = loop.drive(episode, driver)
    speeds = [5.0, *speeds_of(rules.vehicle, commands[: len(trace.x_m) - 1])]
    assert trace.speed_mps.tolist() == speeds
    assert [seen.ego.speed_mps for seen in driver.seen] == speeds[:-1]
    gains = np.diff(speeds) / STEP_S
    assert [seen.ego.acceleration_mps2 for seen in driver.seen[1:]] == gains[:-1].tolist()
    assert driver.seen[0].vehicle == scene.vehicle(Arm.AV) == trace.vehicle
    assert (trace.vehicle.dead_time_s, trace.vehicle.max_jerk_mps3) == (0.25, 8.0)


def test_actuation_is_the_avs_unless_the_reference_has_it_too(model: InteractionModel) -> None:
    # Gap-Yield slows down for an empty crosswalk too.
    arms, actuation = {"av": "gap_yield", "human": "gap_yield"}, {"dead_time_s": 0.4}
    at_once = [*on_plain(scenario(arms=arms), model).run([0, 1])]
    for human, slow in ((False, {Arm.AV}), (True, {*Arm})):
        scene = scenario(arms=arms, actuation={**actuation, "human": human})
        outcomes = [*on_plain(scene, model).run([0, 1])]
        for outcome, other in zip(outcomes, at_once, strict=True):
            same = outcome.trace.speed_mps.tolist() == other.trace.speed_mps.tolist()
            assert same is (outcome.arm not in slow), (human, outcome.arm)


def test_grade_and_friction_limit_every_vehicle_of_the_road() -> None:
    g, angle = 9.80665, math.atan(0.08)
    scene = scenario(
        crossing={"grade": -0.08, "friction": 0.35}, ego={"max_deceleration_mps2": 6.0}
    )
    grip, slope = 0.35 * g * math.cos(angle), g * math.sin(angle)
    for driver in (None, *Arm):
        car = scene.vehicle(driver)
        assert car.max_deceleration_mps2 == pytest.approx(grip - slope)  # downhill
        assert car.max_acceleration_mps2 == pytest.approx(3.0 + slope)
    other = scene.vehicle(oncoming=True)
    assert other.max_deceleration_mps2 == pytest.approx(grip + slope)
    assert other.max_acceleration_mps2 == pytest.approx(3.0 - slope)


def stopping_m(vehicle: Vehicle, speed: float) -> float:
    """v t_d plus the integral of the lagging response to full braking."""
    braking, lag = vehicle.max_deceleration_mps2, vehicle.lag_s

    def slower(time_s: float) -> float:
        decayed_s = lag * (1 - math.exp(-time_s / lag))
        return speed - braking * time_s + braking * decayed_s

    end_s = brentq(slower, 0.0, 20.0)
    return speed * vehicle.dead_time_s + quad(slower, 0.0, end_s)[0]


def test_avoidable_is_of_the_car_that_obeys_late() -> None:
    scene = scenario(actuation={"dead_time_s": 0.35, "lag_s": 0.3})
    vehicle = scene.vehicle(Arm.AV)
    stops_m = stopping_m(vehicle, 5.0)

    def hit(spare_m: float, car: Vehicle) -> Trace:
        """The walker steps off when full braking would stop that far before them."""
        start_s = (30.0 - 0.25 - stops_m - spare_m) / 5.0
        trace = drive([0.0] * 80, [(start_s, Side.NEAR, 1.2)], scene=scene)
        return replace(trace, vehicle=car)

    traces = [hit(0.002, vehicle), hit(-0.002, vehicle), hit(-0.002, scene.vehicle())]
    assert [record.avoidable for record in measure(traces)] == [True, False, True]
