"""What strategies at crosswalks cost in a user's simulation, beside `sumo` alone; and `[traffic]`.

    python -m benchmarks.simulation [--rounds 5] [--profile] [--traffic]

The simulation is a town or a grid of netgenerate with sidewalks and crossings, and the demand of
randomTrips: vehicles, and a quarter as many people.  `sumo` with an arm's own configuration, and
the arm with `gap_yield` in every car, run in turns; the medians of the turns' ratios of processor
time are shown, with SUMO's start, the tables of trips and all measures of the passages.  The
crosswalks are those nearest to the network's centre.

With `--traffic`: processor time for each simulated second of an hour of `[traffic]`, whole command,
here and in the folder that the environment variable BESIDE names, another version's checkout with
its `.venv`.
"""

import argparse
import cProfile
import os
import pstats
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import sumo

from harness.core.vocabulary import Arm
from harness.engine.arm_files import write_config
from harness.engine.shared import close_engine
from harness.engine.town_reader import read_town
from harness.model.interaction import load_model
from harness.scenario import validate
from harness.simulation.arm_tables import run_arm
from harness.simulation.opening import opened
from harness.simulation.setup import Setup

NETS = {
    "grid": "--grid --grid.number 5 --grid.length 150",
    "town": "--rand --rand.iterations 100 --seed 3",
}
VEHICLES_PER_S = 0.7
END_S = 600
LIMITS = {1: 1.2, 10: 1.6}
"""The greatest ratio wanted, by the number of crosswalks."""

HOUR = """[ego]
initial_speed_mps = 8.0
[pedestrians]
flow_per_hour = 500.0
[arms]
av = "gap_yield"
human = "human_yield"
[traffic]
flow_per_hour = 600
oncoming_per_hour = 600
duration_s = 3600
"""


def call(*command: object) -> None:
    """Run a program."""
    environment = {**os.environ, "SUMO_HOME": sumo.SUMO_HOME}
    subprocess.run([*map(str, command)], check=True, capture_output=True, env=environment)


def build(folder: Path, net: str) -> Path:
    """Write network, demand and configuration into a folder; returns the configuration."""
    walks = ["--sidewalks.guess", "--crossings.guess", "--no-turnarounds", "-j", "priority"]
    tools, file = Path(sumo.SUMO_HOME) / "tools", folder / "net.net.xml"
    call(Path(sumo.SUMO_HOME) / "bin/netgenerate", *NETS[net].split(), *walks, "-o", file)
    for name, per_s, more in (
        ("v", VEHICLES_PER_S, ["--min-distance", "150"]),
        ("p", VEHICLES_PER_S / 4, ["--pedestrians", "--max-distance", "400", "--prefix", "p"]),
    ):
        trips = ["-n", file, "-e", END_S, "-p", 1 / per_s, "--seed", 1, *more]
        out = ["-o", folder / f"{name}.xml", "-r", folder / f"{name}.rou.xml"]
        call(sys.executable, tools / "randomTrips.py", *trips, *out)
    options = {
        **{"net-file": "net.net.xml", "route-files": "v.rou.xml,p.rou.xml", "end": END_S},
        **{"step-length": 0.1, "collision.action": "warn", "time-to-teleport": -1},
    }
    lines = "".join(f'<{key} value="{value}"/>' for key, value in options.items())
    path = folder / "town.sumocfg"
    path.write_text(f"<configuration>{lines}</configuration>")
    return path


def central(config: Path, count: int) -> Setup:
    """The simulation with `gap_yield` at the crosswalks nearest to the network's centre."""
    town = read_town(config.parent / "net.net.xml")
    centres = {
        each.id: complex(*each.axis.centroid.coords[0])
        for each in town.crosswalks.values()
        if each.refused is None
    }
    middle = sum(centres.values()) / len(centres)
    names = sorted(centres, key=lambda name: abs(centres[name] - middle))[:count]
    tree = {
        "simulation": {"file": str(config), "crossings": names},
        "ego": {"trigger_range_m": 50.0},
        "arms": {"av": "gap_yield", "human": "sumo_driver"},
    }
    return opened(validate(tree, "benchmark"), load_model("dut"))


def used_s() -> float:
    """Processor time so far, of this process and of programs that have ended."""
    now = os.times()
    return now.user + now.system + now.children_user + now.children_system


def arm_s(setup: Setup) -> tuple[float, int]:
    """The processor time of an arm, and the number of its passages."""
    close_engine()
    with tempfile.TemporaryDirectory() as folder:
        begin_s = used_s()
        outcome = run_arm(setup, 0, Arm.AV, Path(folder))
        if outcome.reason is not None:
            raise RuntimeError(outcome.reason)
        return used_s() - begin_s, len(outcome.tables["passages"].get("vehicle", ()))


def alone_s(setup: Setup) -> float:
    """The processor time of `sumo` with an arm's configuration."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_config(setup.config, Path(folder), setup.seed(0))
        begin_s = used_s()
        call(Path(sumo.SUMO_HOME) / "bin/sumo", "-c", path)
        return used_s() - begin_s


def hour_s(checkout: Path, folder: Path) -> float:
    """The processor time of an hour of ``[traffic]`` with a checkout's command."""
    file = folder / "hour.toml"
    file.write_text(HOUR, encoding="utf-8")
    options = ["--pairs", 1, "--workers", 1, "--quiet", "--out", folder / checkout.name]
    begin_s = used_s()
    call(checkout / ".venv/bin/harness", "run", file, *options)
    return used_s() - begin_s


def main() -> None:
    """Measure both networks with one and with ten crosswalks, or ``[traffic]``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--traffic", action="store_true")
    options = parser.parse_args()
    if options.traffic:
        places = [Path.cwd(), *map(Path, filter(None, [os.environ.get("BESIDE")]))]
        for number in range(options.rounds):
            for place in places:
                with tempfile.TemporaryDirectory() as folder:
                    print(number, place.name, f"{hour_s(place, Path(folder)):.1f} s", flush=True)
        return
    for net in NETS:
        with tempfile.TemporaryDirectory() as folder:
            config = build(Path(folder), net)
            for count, limit in LIMITS.items():
                setup = central(config, count)
                if options.profile:
                    profiler = cProfile.Profile()
                    profiler.runcall(arm_s, setup)
                    pstats.Stats(profiler).sort_stats("tottime").print_stats(25)
                    continue
                ratios, passed = [], 0
                for _ in range(options.rounds):
                    alone = alone_s(setup)
                    taken_s, passed = arm_s(setup)
                    ratios.append(taken_s / alone)
                shown = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
                print(f"{net}, {count} crosswalks, {passed} passages: {shown}, wanted {limit}")


if __name__ == "__main__":
    main()
