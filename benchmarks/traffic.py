"""What an hour of traffic costs beside a bare loop of the same SUMO calls, side by side.

    python -m benchmarks.traffic [--duration-s 900] [--rounds 3]

The hour is simulated once with every call to SUMO written down. Then hour and calls alone are timed
in turns, each in a fresh SUMO; the best of some rounds counts. The mix is the prototype's: 600
vehicles and 500 pedestrians per hour at 8 m/s. The calls alone hold no strategy, no pedestrian's
decision, no record: their time is the floor.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

from harness.encounter import Arm
from harness.engine.shared import close_engine, road_for
from harness.interaction import load_model
from harness.scenario import validate
from harness.traffic.pairing import HourRunner

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


def main() -> None:
    """Print both times, their ratio and the vehicle-steps per second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration-s", type=float, default=900.0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    duration_s, rounds = options.duration_s, options.rounds
    scenario = validate(
        {
            "ego": {"initial_speed_mps": 8.0},
            "arms": {"av": "gap_yield", "human": "human_yield"},
            "pedestrians": {"flow_per_hour": 500.0},
            "traffic": {
                "flow_per_hour": 300.0,
                "oncoming_per_hour": 300.0,
                "duration_s": duration_s,
                "warm_up_s": 0.0,
            },
        },
        "benchmark",
    )
    from harness.engine import sumo

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
        begin = time.perf_counter()
        outcome = runner.run_arm(0, Arm.AV)
        best["whole"] = min(best["whole"], time.perf_counter() - begin)
        close_engine()
        road_for(scenario)
        begin = time.perf_counter()
        for function, args, named in noted:
            function(*args, **named)
        best["bare"] = min(best["bare"], time.perf_counter() - begin)
        close_engine()
    whole_s, bare_s = best["whole"], best["bare"]
    steps = sum(
        (passage.moving.gone_step or 0) - (passage.moving.inserted_step or 0)
        for passage in outcome.passages
    )
    print(f"{len(noted):,} calls of SUMO, {steps:,} vehicle-steps, {duration_s:g} s of traffic")
    print(f"whole {whole_s:.2f} s, bare {bare_s:.2f} s, ratio {whole_s / bare_s:.2f}")
    print(f"{steps / whole_s:,.0f} vehicle-steps per second")


if __name__ == "__main__":
    main()
