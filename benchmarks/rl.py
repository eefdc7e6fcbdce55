"""SUMO steps per second of the Gymnasium environment beside sumo-rl's, both in libsumo.

Run as ``python -m benchmarks.rl``.  Each side has a process of its own (libsumo runs one
simulation per process), taken in turns; the ratio of each round's two rates is what counts on a
shared machine.  sumo-rl runs its single-intersection network for an hour at a time under the
network's own signal plan (random phases jam it and are slower), five SUMO steps per action; ours
drives the flow scenario with random accelerations, one step per action.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROUNDS, STEPS = 5, 20_000


def ours(steps: int) -> float:
    """SUMO steps per second of ``harness/Crosswalk-v0``."""
    import gymnasium

    env = gymnasium.make(
        "harness.rl:harness/Crosswalk-v0", scenario="cctc_flow", disable_env_checker=True
    )
    rng = np.random.default_rng(1)
    actions = rng.uniform(-0.2, 0.5, (1000, 1)).astype(np.float32)
    env.reset(seed=1)
    began = time.perf_counter()
    for number in range(steps):
        _, _, terminated, truncated, _ = env.step(actions[number % 1000])
        if terminated or truncated:
            env.reset()
    rate = steps / (time.perf_counter() - began)
    env.close()
    return rate


def theirs(steps: int) -> float:
    """SUMO steps per second of sumo-rl's single intersection."""
    import sumo_rl

    nets = Path(sumo_rl.__file__).parent / "nets" / "single-intersection"
    env = sumo_rl.SumoEnvironment(
        net_file=str(nets / "single-intersection.net.xml"),
        route_file=str(nets / "single-intersection.rou.xml"),
        single_agent=True,
        num_seconds=3600,
        fixed_ts=True,
        sumo_seed=1,
        sumo_warnings=False,
        additional_sumo_cmd="--no-step-log",
    )
    env.reset()
    began = time.perf_counter()
    for _ in range(steps // 5):
        *_, truncated, _ = env.step(0)
        if truncated:
            env.reset()
    rate = steps / (time.perf_counter() - began)
    env.close()
    return rate


def in_a_process(side: str, steps: int) -> float:
    """The rate of one side, measured in a fresh process."""
    import sumo

    # sumo-rl takes libsumo only when this says so, and looks for SUMO by SUMO_HOME.
    environment = {**os.environ, "LIBSUMO_AS_TRACI": "1", "SUMO_HOME": sumo.SUMO_HOME}
    command = [sys.executable, "-m", "benchmarks.rl", "--side", side, "--steps", str(steps)]
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return float(run.stdout.split()[-1])


def main() -> None:
    """Print each round's rates and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--side", choices=("ours", "theirs"))
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--steps", type=int, default=STEPS)
    options = parser.parse_args()
    if options.side:
        print({"ours": ours, "theirs": theirs}[options.side](options.steps))
        return
    ratios = []
    for number in range(options.rounds):
        mine, other = (in_a_process(side, options.steps) for side in ("ours", "theirs"))
        ratios.append(mine / other)
        print(
            f"round {number + 1}: {mine:.0f} / {other:.0f} SUMO steps/s = {ratios[-1]:.1f}",
            flush=True,
        )
    print(f"median ratio {np.median(ratios):.1f} (goal: 5 or more)")


if __name__ == "__main__":
    main()
