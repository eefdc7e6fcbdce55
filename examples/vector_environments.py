"""Drive several crosswalks at once: vectorised environments of Gymnasium.

    python -m examples.vector_environments --environments 4 --episodes 10

Each environment has a seed of its own and goes on to its next pair by itself.  ``sync`` steps them
in this process, on the plain engine; ``async`` gives each a process, where SUMO runs too.
"""

import argparse

import gymnasium
import numpy as np

from examples.policies import NEAREST, yield_to_the_nearest

LATE_EYES = {"perception.latency_s": 0.3, "perception.detection_probability": 0.5}


def drive(environments, episodes, *, mode="sync", engine="plain", seed=1, settings=None):
    """The sums of rewards of each environment's first episodes: (environments, episodes).

    As many of each: whoever counts those that end first prefers the short ones.
    """
    envs = gymnasium.make_vec(
        "harness.rl:harness/Crosswalk-v0",
        num_envs=environments,
        vectorization_mode=mode,
        scenario="cctc_flow",
        settings=settings or {},
        nearest=NEAREST,
        engine=engine,
    )
    try:
        # Environment i gets seed + i: other people in each, the same in every run.
        vectors, _ = envs.reset(seed=seed)
        returns = [[] for _ in range(environments)]
        running = np.zeros(environments)
        while min(map(len, returns)) < episodes:
            actions = [[yield_to_the_nearest(vector)] for vector in vectors]
            # The step after an episode's last one is Gymnasium's reset, with a reward of 0.
            vectors, rewards, terminated, truncated, _ = envs.step(np.array(actions, np.float32))
            running += rewards
            for number in np.flatnonzero(terminated | truncated):
                returns[number].append(float(running[number]))
                running[number] = 0.0
        return np.array([own[:episodes] for own in returns])
    finally:
        envs.close()


def main():
    """Print the mean return with perfect eyes and with late ones."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environments", type=int, default=4)
    parser.add_argument("--episodes", type=int, default=10, help="of each environment")
    parser.add_argument("--mode", choices=["sync", "async"], default="sync")
    parser.add_argument("--engine", choices=["plain", "sumo"], default="plain")
    given = parser.parse_args()
    how = {"mode": given.mode, "engine": given.engine}
    for words, settings in (("perfect eyes", {}), ("late eyes", LATE_EYES)):
        returns = drive(given.environments, given.episodes, **how, settings=settings)
        print(f"{words}: mean return {returns.mean():.2f} over {returns.size} episodes")


if __name__ == "__main__":
    main()
