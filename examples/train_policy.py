"""Train a policy in the Gymnasium environment by the cross-entropy method, in about a minute.

    python -m examples.train_policy policy.json

Draws weights from a normal distribution, drives some episodes with each, and moves the
distribution to the best of them (Rubinstein 1999).  Uses the plain engine: the same kinematics as
SUMO's, many times faster.  Afterwards `harness run` judges it in SUMO (see ``examples.policies``).
"""

import argparse
import json
from pathlib import Path

import gymnasium
import numpy as np

from examples.policies import NEAREST, features, linear

POPULATION, ELITE, GENERATIONS, EPISODES = 32, 6, 12, 20
SPREAD_FLOOR = 0.05

TRAINING_SEED = 1001
"""Not the scenarios' seed 1: ``harness run`` must judge by people whom training has not met."""


def total_reward(env, weights, pairs):
    """Mean over the pairs of the summed rewards."""
    total = 0.0
    for pair in pairs:
        vector, _ = env.reset(options={"pair": pair})
        over = False
        while not over:
            action = np.array([linear(weights, vector)], dtype=np.float32)
            vector, reward, terminated, truncated, _ = env.step(action)
            total += reward
            over = terminated or truncated
    return total / len(pairs)


def train(
    env, generations, seed=TRAINING_SEED, population=POPULATION, elite=ELITE, episodes=EPISODES
):
    """The mean of the last generation's distribution, shape of ``features``."""
    rng = np.random.default_rng(seed)
    vector, _ = env.reset(seed=seed)
    count = features(vector).size
    mean, spread = np.zeros(count), np.ones(count)
    for generation in range(generations):
        # The same pedestrians for all weights of a generation, others in the next.
        pairs = range(generation * episodes, (generation + 1) * episodes)
        drawn = mean + spread * rng.standard_normal((population, count))
        scores = np.array([total_reward(env, weights, pairs) for weights in drawn])
        best = drawn[np.argsort(-scores)[:elite]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + SPREAD_FLOOR
        print(
            f"generation {generation + 1:2d}: best {scores.max():8.2f}, mean {scores.mean():8.2f}"
        )
    return mean


def main():
    """Train and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="the weights are written here (JSON)")
    parser.add_argument("--generations", type=int, default=GENERATIONS)
    parser.add_argument("--episodes", type=int, default=EPISODES, help="for each weights drawn")
    options = parser.parse_args()
    env = gymnasium.make(
        "harness.rl:harness/Crosswalk-v0",
        scenario="cctc_flow",
        settings={"pedestrians.flow_per_hour": 1000},
        nearest=NEAREST,
        engine="plain",
        disable_env_checker=True,
    )
    weights = train(env, options.generations, episodes=options.episodes)
    options.out.write_text(json.dumps(weights.tolist()) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
