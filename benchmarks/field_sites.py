"""Pedestrian delays predicted at measured crossings, beside the HCM's revised form.

    python -m benchmarks.field_sites [--hours 4] [--workers 2] [--set KEY=VALUE …]

Each site-period of ``benchmarks/data/field_sites.csv`` (NCHRP Project 17-87, working paper on
uncontrolled crossings, tables B-1 to B-4) is ``field_sites`` with the site's own keys.
"""

import argparse
import csv
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.encounter import Arm
from harness.engine.shared import road_for
from harness.episode.traffic.closed_forms import (
    critical_headway_s,
    group_headway_s,
    revised_hcm_delay_s,
)
from harness.episode.traffic.pairing import HourRunner
from harness.model.interaction import load_model
from harness.scenario import Setting, load_scenario, parse_setting
from harness.store.hour_tables import hour_rows

SITES = Path(__file__).parent / "data" / "field_sites.csv"
FOOT_M, MPH_MPS = 0.3048, 0.44704


def settings_of(site: dict[str, str]) -> list[Setting]:
    """A site-period's own keys over ``field_sites``."""
    length_m = float(site["crossing_length_ft"]) * FOOT_M
    lanes, flow = int(site["through_lanes"]), float(site["vehicles_per_hour"])
    oncoming = lanes // 2 if site["two_way"] == "yes" else 0
    share = oncoming / lanes
    values: dict[str, Any] = {
        "crossing.length_m": length_m,
        "crossing.lanes": lanes - oncoming,
        "crossing.oncoming_lanes": oncoming,
        "ego.initial_speed_mps": float(site["speed_limit_mph"]) * MPH_MPS,
        "traffic.flow_per_hour": flow * (1 - share),
        "traffic.oncoming_per_hour": flow * share,
        "pedestrians.flow_per_hour": float(site["pedestrians_per_hour"]),
        "pedestrians.walking_speed.mean_mps": length_m / float(site["crossing_time_s"]),
        "strategies.human_yield.yield_rate": float(site["yield_rate"]),
    }
    return [Setting(key, value) for key, value in values.items()]


def predicted(job: tuple[dict[str, str], int, list[Setting]]) -> tuple[float, float, int]:
    """Mean wait in the human's arm, its standard error, and the number of pedestrians."""
    site, hours, more = job
    scenario = load_scenario("field_sites", [*settings_of(site), *more])
    runner = HourRunner(scenario, load_model("dut", None), lambda: road_for(scenario))
    waits: list[float] = []
    for pair in range(hours):
        rows = hour_rows(0, [runner.run_arm(pair, Arm.HUMAN)])
        waits += [wait for wait in rows["pedestrians"]["delay_s"].to_pylist() if wait is not None]
    error = float(np.std(waits, ddof=1) / np.sqrt(len(waits))) if len(waits) > 1 else float("nan")
    return float(np.mean(waits)), error, len(waits)


def hcm(site: dict[str, str]) -> float:
    """The revised form with t_s = 0."""
    flow, people = (
        float(site[key]) / 3600 for key in ("vehicles_per_hour", "pedestrians_per_hour")
    )
    length_m = float(site["crossing_length_ft"]) * FOOT_M
    headway_s = critical_headway_s(length_m, length_m / float(site["crossing_time_s"]), 0.0)
    group_s = group_headway_s(flow, people, headway_s, 4.0)
    return revised_hcm_delay_s(flow, group_s, int(site["through_lanes"]), float(site["yield_rate"]))


def scores(values: np.ndarray, measured: np.ndarray) -> str:
    """Bias, mean absolute error, R² and correlation in one line."""
    error = values - measured
    r2 = 1 - (error**2).sum() / ((measured - measured.mean()) ** 2).sum()
    return (
        f"bias {error.mean():+.2f} s, mean absolute error {np.abs(error).mean():.2f} s, "
        f"R² {r2:.2f}, correlation {np.corrcoef(values, measured)[0, 1]:.2f}"
    )


def main() -> None:
    """Print every site-period and the scores."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[])
    options = parser.parse_args()
    more = [parse_setting(text) for text in options.set]
    with SITES.open(encoding="utf-8") as file:
        sites = list(csv.DictReader(file))
    jobs = [(site, options.hours, more) for site in sites]
    with ProcessPoolExecutor(options.workers) as pool:
        found = list(pool.map(predicted, jobs))
    measured = np.array([float(site["pedestrian_delay_s"]) for site in sites])
    forms = np.array([hcm(site) for site in sites])
    print("site  day      measured  simulated (s.e.)  revised HCM")
    for site, (mean, error, count), form in zip(sites, found, forms, strict=True):
        print(
            f"{site['site']:>4}  {site['day']:<8} {site['pedestrian_delay_s']:>8}"
            f"  {mean:9.2f} ({error:.2f}) {form:12.2f}   {count} pedestrians"
        )
    print("simulated:", scores(np.array([mean for mean, _, _ in found]), measured))
    print("revised HCM:", scores(forms, measured))


if __name__ == "__main__":
    main()
