"""Small scenes that many tests play: given walkers, given strategy, given engine."""

from collections.abc import Sequence

from harness.encounter import Arrival, Side, Strategy, Trace
from harness.engine.plain import PlainEngine
from harness.engine.protocol import Engine
from harness.episode import Rules, run_episode
from harness.scenario import Scenario, validate


def scenario(**sections: dict[str, object]) -> Scenario:
    """The paper's scenario (its kerb rule and step) with changes by section."""
    tree: dict[str, dict[str, object]] = {"pedestrians": {"kerb_wait_s": 0.0}}
    for name, values in sections.items():
        tree.setdefault(name, {}).update(values)
    return validate(tree, "test")


def rules_of(scene: Scenario) -> Rules:
    """The episode's constants of a scenario."""
    return Rules(
        vehicle=scene.vehicle(),
        crossing=scene.crosswalk(),
        kerb_wait_s=scene.pedestrians.kerb_wait_s,
        step_s=scene.experiment.step_s,
        timeout_s=scene.experiment.timeout_s,
    )


def play(
    strategy: Strategy,
    walkers: Sequence[tuple[float, Side, float]],
    scene: Scenario | None = None,
    engine: Engine | None = None,
) -> Trace:
    """One episode with walkers given as (arrival_s, side, walking speed in m/s)."""
    scene = scene or scenario()
    engine = engine or PlainEngine(scene.vehicle(), scene.experiment.step_s)
    speeds = [speed for _, _, speed in walkers]
    arrivals = [Arrival(i, at, side, 0.5) for i, (at, side, _) in enumerate(walkers)]
    return run_episode(
        engine, strategy, arrivals, lambda who, _r, _v: speeds[who.index], rules_of(scene)
    )
