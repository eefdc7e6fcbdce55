"""The reward of a step, for which a policy is trained."""

import inspect
from collections.abc import Callable
from typing import NamedTuple

from harness.core.encounter import Observation
from harness.core.errors import InputError

CRASH_PENALTY = 100.0


class Transition(NamedTuple):
    """One step of an episode, from which a reward is computed.

    ``after`` is None if the ego has crossed or the episode has timed out.
    """

    before: Observation
    acceleration_mps2: float
    after: Observation | None
    crossed: bool
    crashed: bool


Reward = Callable[[Transition], float]


def time_speeding_and_crash(step: Transition, crash_penalty: float = CRASH_PENALTY) -> float:
    """The default reward: −(step in s + metres driven in excess of v0 + 100 for a crash).

    Its sum over an episode that crosses and never exceeds v0 is minus the pass time, rounded up to
    a step.  Without the second term the best policy with few pedestrians would exceed v0.

    Args:
        step: the step.
        crash_penalty: penalty of a crash in s; ``functools.partial`` sets another.
    """
    ego, vehicle = step.before.ego, step.before.vehicle
    excess_m = max(0.0, ego.speed_mps - vehicle.initial_speed_mps) * step.before.step_s
    return -step.before.step_s - excess_m - (crash_penalty if step.crashed else 0.0)


def check_reward(reward: object) -> None:
    """Refuse a reward that cannot be called with a ``Transition`` alone.

    Raises:
        InputError: the reward is not such a function.
    """
    allowed = "a function of one harness.Transition"
    if not callable(reward):
        raise InputError("reward", f"{reward!r} is not a function", allowed)
    try:
        inspect.signature(reward).bind(None)
    except TypeError as error:
        problem = f"{reward!r} cannot be called with one argument ({error})"
        raise InputError("reward", problem, allowed) from None
    except ValueError:  # a built-in function without a signature
        return
