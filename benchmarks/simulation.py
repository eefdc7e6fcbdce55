"""What strategies at crosswalks cost in a user's own simulation, beside `sumo` alone.

    python -m benchmarks.simulation [--vehicles 40,400,4000] [--rounds 5] [--profile]

Each scenario is a grid of netgenerate with sidewalks and crossings, without traffic lights, and the
demand of randomTrips: so many vehicles on the road at a time, and a quarter as many people. An arm
(`SimulationRunner`: `gap_yield` drives every passenger car, or nobody does) and `sumo` with the
arm's own configuration run in turns, and the medians of the turns' ratios are shown. Processor time
counts, with SUMO's start, the tables of trips and all measures of the passages.
"""

import argparse
import cProfile
import os
import pstats
import statistics
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import sumo

from harness.core.encounter import Arm
from harness.engine.simulation.outputs import Kept
from harness.engine.simulation.running import write_config
from harness.episode.simulation.pairing import SimulationRunner, setting_of
from harness.model.interaction import load_model
from harness.scenario import Scenario, validate
from harness.site import crosswalks_of, read_network

STEP_S = 0.1
LIMITS = {1: 1.3, 10: 2.0}
"""The greatest ratio wanted, by the number of crosswalks."""


@dataclass(frozen=True)
class Size:
    """A grid, the vehicles that enter it per second, and the duration."""

    junctions: int
    vehicles_per_s: float
    end_s: int


SIZES = {40: Size(5, 0.7, 900), 400: Size(10, 2.2, 600), 4000: Size(28, 16.0, 400)}
"""By the number of vehicles on the road that is aimed at."""


def build(folder: Path, size: Size) -> Path:
    """Write network, demand and configuration into a folder; returns the configuration."""
    binaries, tools = Path(sumo.SUMO_HOME) / "bin", Path(sumo.SUMO_HOME) / "tools"
    net, end = folder / "grid.net.xml", str(size.end_s)
    grid = ["--grid", "--grid.number", str(size.junctions), "--grid.length", "150", "--seed", "1"]
    walks = ["--sidewalks.guess", "--crossings.guess", "--default-junction-type", "priority"]
    call(binaries / "netgenerate", *grid, *walks, "-o", net)
    trips = [sys.executable, tools / "randomTrips.py", "-n", net, "-e", end, "--seed", "1"]
    people = ["--pedestrians", "--max-distance", "400", "--prefix", "p"]
    rates = size.vehicles_per_s, size.vehicles_per_s / 4
    for name, per_s, more in (("v", rates[0], []), ("p", rates[1], people)):
        out = ["-o", folder / f"{name}.xml", "-r", folder / f"{name}.rou.xml"]
        call(*trips, *more, "--insertion-rate", 3600 * per_s, *out)
    config = ET.Element("configuration")
    routes = f"{folder / 'v.rou.xml'},{folder / 'p.rou.xml'}"
    for name, value in {
        **{"net-file": str(net), "route-files": routes, "end": end},
        **{"step-length": f"{STEP_S}", "collision.action": "warn", "time-to-teleport": "-1"},
        "pedestrian.striping.jamtime": "60",
    }.items():
        ET.SubElement(config, name, value=value)
    path = folder / "grid.sumocfg"
    ET.ElementTree(config).write(path, encoding="utf-8")
    return path


def call(*command: object) -> None:
    """Run a program of SUMO's."""
    subprocess.run([*map(str, command)], check=True, capture_output=True)


def central(config: Path, count: int) -> list[str]:
    """The crosswalks nearest to the network's centre that vehicles pass straight on."""
    network = read_network(config.parent / "grid.net.xml")
    west, south, east, north = network.net.getBoundary()
    middle = (west + east) / 2, (south + north) / 2

    def away_m(crosswalk: str) -> float:
        x_m, y_m = network.net.getEdge(crosswalk).getToNode().getCoord()
        return float(abs(x_m - middle[0]) + abs(y_m - middle[1]))

    usable = [each.id for each in crosswalks_of(network) if each.problem is None]
    return sorted(usable, key=lambda name: (away_m(name), name))[:count]


def scenario_of(config: Path, crossings: list[str]) -> Scenario:
    """The scenario of a configuration at those crosswalks."""
    tree = {
        "simulation": {"config": str(config), "crossings": crossings, "step_s": STEP_S},
        "arms": {"av": "gap_yield", "human": "sumo_driver"},
    }
    return validate(tree, "benchmark")


@contextmanager
def scratch() -> Iterator[Path]:
    """A temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def alone_s(scenario: Scenario) -> float:
    """Processor time of `sumo` with the final configuration of an arm."""
    setting = setting_of(scenario)
    with scratch() as folder:
        path = write_config(
            setting.config, Kept(folder, frozenset()), setting.config.seed, STEP_S, None
        )
        before = os.times()
        call(Path(sumo.SUMO_HOME) / "bin" / "sumo", "-c", path)
        after = os.times()
    used = after.children_user + after.children_system
    return used - before.children_user - before.children_system


def arm_s(runner: SimulationRunner, arm: Arm) -> tuple[float, str]:
    """Processor time of an arm, and what it did."""
    begin = time.process_time()
    outcome = runner.run_arm(0, arm)
    used_s = time.process_time() - begin
    if outcome.reason is not None:
        raise RuntimeError(outcome.reason)
    passages = outcome.log.passages
    driven = sum(each.strategy_name == "gap_yield" for each in passages)
    running_s = sum(trip.duration_s for trip in outcome.trips if not trip.person)
    mean = running_s / outcome.log.end_s
    return used_s, f"{mean:.0f} vehicles on the road, {len(passages)} passages, {driven} driven"


def measure(config: Path, crosswalks: int, rounds: int) -> None:
    """Print the medians of the ratios of both arms to `sumo` alone."""
    scenario = scenario_of(config, central(config, crosswalks))
    setting = setting_of(scenario)
    model = load_model("dut", None)
    runner = SimulationRunner(scenario, model, lambda *_: scratch())
    ratios: dict[Arm, list[float]] = {arm: [] for arm in Arm}
    alone, words = [], ""
    for _ in range(rounds):
        alone.append(alone_s(scenario))
        for arm in Arm:
            used_s, what = arm_s(runner, arm)
            ratios[arm].append(used_s / alone[-1])
            words = what if arm is Arm.AV else words
    shown = ", ".join(
        f"{arm.value} {statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"
        for arm, values in ratios.items()
    )
    met = statistics.median(ratios[Arm.AV]) <= LIMITS[crosswalks]
    print(
        f"{crosswalks} chosen ({len(setting.crosswalks)} controlled): {shown}; "
        f"limit {LIMITS[crosswalks]}: {'met' if met else 'missed'}; "
        f"sumo alone {statistics.median(alone):.2f} s; {words}",
        flush=True,
    )


def profile(config: Path, crosswalks: int) -> None:
    """Print where an arm spends its time."""
    scenario = scenario_of(config, central(config, crosswalks))
    runner = SimulationRunner(scenario, load_model("dut", None), lambda *_: scratch())
    profiler = cProfile.Profile()
    profiler.runcall(runner.run_arm, 0, Arm.AV)
    pstats.Stats(profiler).sort_stats("tottime").print_stats(25)


def main() -> None:
    """Measure every size with one and with ten crosswalks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", default="40,400,4000")
    parser.add_argument("--crosswalks", default="1,10")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    for vehicles in map(int, options.vehicles.split(",")):
        with scratch() as folder:
            config = build(folder, SIZES[vehicles])
            for crosswalks in map(int, options.crosswalks.split(",")):
                print(f"about {vehicles} vehicles, ", end="")
                if options.profile:
                    profile(config, crosswalks)
                else:
                    measure(config, crosswalks, options.rounds)


if __name__ == "__main__":
    main()
