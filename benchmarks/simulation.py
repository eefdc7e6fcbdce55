"""What strategies at crosswalks cost in a user's own simulation, beside `sumo` alone.

    python -m benchmarks.simulation [--vehicles 40,400,4000] [--rounds 5] [--profile]

Each scenario is a grid of netgenerate with sidewalks and crossings, without traffic lights, and the
demand of randomTrips: so many vehicles on the road at a time, and a quarter as many people. An arm
(`SimulationRunner`: `gap_yield` drives every passenger car, or nobody does) and `sumo` with the
arm's own configuration run in turns, with a bare loop of libsumo's steps, and the medians of the
turns' ratios are shown: of processor time and of wall time, with SUMO's start, the tables of trips
and all measures of the passages.
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
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import sumo

from harness.core.encounter import Arm
from harness.encounter.simulation.pairing import SimulationRunner
from harness.engine.simulation.outputs import Kept
from harness.engine.simulation.running import OwnSimulation, write_config
from harness.model.interaction import load_model
from harness.scenario import Scenario, validate
from harness.scenario.own_simulation import setting_of
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


Times = tuple[float, float]
"""Processor time and wall time in s."""


@contextmanager
def timed(times: list[Times]) -> Iterator[None]:
    """Add the time of what happens meanwhile, in this process and in programs that have ended."""

    def used_s() -> float:
        now = os.times()
        return now.user + now.system + now.children_user + now.children_system

    cpu_s, wall_s = used_s(), time.perf_counter()
    yield
    times.append((used_s() - cpu_s, time.perf_counter() - wall_s))


def run_alone(scenario: Scenario, times: dict[str, list[Times]]) -> None:
    """Run `sumo`, and a bare loop in libsumo, with the final configuration of an arm."""
    setting = setting_of(scenario)
    with scratch() as folder:
        kept = Kept(folder, frozenset())
        path = write_config(setting.config, kept, setting.config.seed, STEP_S)
        with timed(times["sumo"]):
            call(Path(sumo.SUMO_HOME) / "bin" / "sumo", "-c", path)
        with timed(times["bare libsumo"]):
            simulation = OwnSimulation(path, setting.config.end_s)
            while simulation.goes_on:
                simulation.step()
            simulation.close()


def run_arm(runner: SimulationRunner, arm: Arm, times: list[Times]) -> str:
    """Run an arm; returns what it did."""
    with timed(times):
        outcome = runner.run_arm(0, arm)
    if outcome.reason is not None:
        raise RuntimeError(outcome.reason)
    passages = outcome.log.passages
    driven = sum(each.strategy_name == "gap_yield" for each in passages)
    running_s = sum(trip.duration_s for trip in outcome.trips if not trip.person)
    mean = running_s / outcome.log.end_s
    return f"{mean:.0f} vehicles on the road, {len(passages)} passages, {driven} driven"


def measure(config: Path, crosswalks: int, rounds: int) -> None:
    """Print the medians of the ratios of a bare loop and of both arms to `sumo` alone."""
    scenario = scenario_of(config, central(config, crosswalks))
    runner = SimulationRunner(scenario, load_model("dut", None), lambda *_: scratch())
    times: dict[str, list[Times]] = defaultdict(list)
    for _ in range(rounds):
        run_alone(scenario, times)
        run_arm(runner, Arm.HUMAN, times["reference arm"])
        words = run_arm(runner, Arm.AV, times["AV arm"])
    chosen = f"{crosswalks} chosen ({len(setting_of(scenario).crosswalks)} controlled)"
    alone = times.pop("sumo")
    least = statistics.median(cpu_s for cpu_s, _ in alone)
    print(f"{chosen}: {words}; sumo alone {least:.2f} s; limit {LIMITS.get(crosswalks)}")
    for name, each in times.items():
        for number, kind in enumerate(("processor", "wall")):
            ratios = [one[number] / base[number] for one, base in zip(each, alone, strict=True)]
            shown = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
            print(f"  {name:14} {kind:10} {shown}", flush=True)


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
