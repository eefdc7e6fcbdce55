"""What an hour of traffic costs beside a bare loop of the same SUMO calls, side by side.

    python -m benchmarks.traffic [--duration-s 900] [--rounds 3] [--hours 24]

The hour is simulated once with every call to SUMO written down. Then hour and calls alone are timed
in turns, each in a fresh SUMO; the best processor time of some rounds counts. The mix is the
prototype's: 600 vehicles and 500 pedestrians per hour at 8 m/s. The calls alone hold no strategy,
no pedestrian's decision, no record: their time is the floor.

Then hours of 600 vehicles in each direction and 500 pedestrians, one after another in one process:
the time of each, and the memory after the fourth and the last.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import psutil

from harness.core.encounter import Arm
from harness.encounter.traffic.pairing import HourRunner
from harness.engine.shared import close_engine, road_for
from harness.model.interaction import load_model
from harness.old.store.hour_tables import hour_rows
from harness.scenario import Scenario, validate

Call = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]


class _Noted:
    """A module of SUMO's, or a part of one, that writes down every call of a function."""

    def __init__(self, part: Any, calls: list[Call]) -> None:
        self._part, self._calls = part, calls

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._part, name)
        if isinstance(found, type) and issubclass(found, Exception):
            return found
        if isinstance(found, type) or not callable(found):  # a part of the interface
            return _Noted(found, self._calls)

        def noted(*args: Any, **named: Any) -> Any:
            self._calls.append((found, args, named))
            return found(*args, **named)

        return noted


def mix(flow_per_hour: float, duration_s: float) -> Scenario:
    """So many vehicles per direction, and 500 pedestrians per hour, at 8 m/s."""
    return validate(
        {
            "ego": {"initial_speed_mps": 8.0},
            "arms": {"av": "gap_yield", "human": "human_yield"},
            "pedestrians": {"flow_per_hour": 500.0},
            "traffic": {
                "flow_per_hour": flow_per_hour,
                "oncoming_per_hour": flow_per_hour,
                "duration_s": duration_s,
                "warm_up_s": 0.0,
            },
        },
        "benchmark",
    )


def side_by_side(duration_s: float, rounds: int) -> None:
    """Print the times of an hour and of its calls alone, and their ratio."""
    from harness.engine import sumo

    scenario = mix(300.0, duration_s)
    model, real = load_model("dut", None), sumo.libsumo
    runner = HourRunner(scenario, model, lambda: road_for(scenario))
    calls: list[Call] = []
    sumo.libsumo = _Noted(real, calls)
    road_for(scenario)
    calls.clear()
    runner.run_arm(0, Arm.AV)
    noted = list(calls)
    close_engine()
    sumo.libsumo = real
    best = {"whole": float("inf"), "bare": float("inf")}
    for _ in range(rounds):
        road_for(scenario)
        begin = time.process_time()
        outcome = runner.run_arm(0, Arm.AV)
        best["whole"] = min(best["whole"], time.process_time() - begin)
        close_engine()
        road_for(scenario)
        begin = time.process_time()
        for function, args, named in noted:
            function(*args, **named)
        best["bare"] = min(best["bare"], time.process_time() - begin)
        close_engine()
    whole_s, bare_s = best["whole"], best["bare"]
    steps = sum(
        (passage.vehicle.gone_step or 0) - (passage.vehicle.inserted_step or 0)
        for passage in outcome.passages
    )
    print(f"{len(noted):,} calls of SUMO, {steps:,} vehicle-steps, {duration_s:g} s of traffic")
    print(f"whole {whole_s:.2f} s, bare {bare_s:.2f} s, ratio {whole_s / bare_s:.2f}")
    print(f"{steps / whole_s:,.0f} vehicle-steps per second")


def one_after_another(hours: int) -> None:
    """Print the times of hours of 600 + 600 vehicles, rows and all, and the memory they take."""
    scenario = mix(600.0, 3600.0)
    runner = HourRunner(scenario, load_model("dut", None), lambda: road_for(scenario))
    process, times, memory = psutil.Process(), [], []
    for pair in range(hours):
        begin = time.process_time()
        hour_rows(0, [runner.run_arm(pair, Arm.AV)])
        times.append(time.process_time() - begin)
        memory.append(process.memory_info().rss / 2**20)
    close_engine()
    print(f"{hours} hours: {min(times):.1f} to {max(times):.1f} s each")
    early = memory[min(3, hours - 1)]
    print(f"memory after hour 4: {early:.0f} MB, after the last {memory[-1]:.0f} MB")


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration-s", type=float, default=900.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--hours", type=int, default=24)
    options = parser.parse_args()
    side_by_side(options.duration_s, options.rounds)
    one_after_another(options.hours)


if __name__ == "__main__":
    main()
