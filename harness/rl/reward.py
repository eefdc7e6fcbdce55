"""What a policy is trained for: the reward of a step."""

import inspect
from collections.abc import Callable
from typing import NamedTuple

from harness.core.encounter import Observation
from harness.core.errors import InputError

CRASH_PENALTY = 100.0


class Transition(NamedTuple):
    """One step of an episode, what a reward is made from.

    ``after`` is None once the ego has crossed or the episode has timed out.
    """

    before: Observation
    acceleration_mps2: float
    after: Observation | None
    crossed: bool
    crashed: bool


Reward = Callable[[Transition], float]


def time_speeding_and_crash(step: Transition, crash_penalty: float = CRASH_PENALTY) -> float:
    """The default reward: − step in s, − metres driven beyond what v0 allows, − 100 for a crash.

    Summed over an episode that crosses and never exceeds v0 it is minus the pass time, rounded up
    to a step.  Without the second part the best policy against few pedestrians is to rush.

    Args:
        step: what happened.
        crash_penalty: the seconds that one crash is worth; ``functools.partial`` sets another.
    """
    ego, vehicle = step.before.ego, step.before.vehicle
    excess_m = max(0.0, ego.speed_mps - vehicle.initial_speed_mps) * step.before.step_s
    return -step.before.step_s - excess_m - (crash_penalty if step.crashed else 0.0)


def check_reward(reward: object) -> None:
    """Refuse what cannot be called with a ``Transition`` alone.

    Raises:
        InputError: it is no such function.
    """
    allowed = "a function of one harness.Transition"
    if not callable(reward):
        raise InputError("reward", f"{reward!r} is no function", allowed)
    try:
        inspect.signature(reward).bind(None)
    except TypeError as error:
        raise InputError("reward", f"{reward!r} cannot be called so ({error})", allowed) from None
    except ValueError:  # a built-in function that does not say what it takes
        return
