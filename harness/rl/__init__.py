"""Actions in; observations and rewards of a Gymnasium environment out.

``gymnasium.make("harness.rl:harness/Crosswalk-v0", scenario="cctc_flow")`` makes it.  The same seed
and pair give the same pedestrians as in the harness.  A trained policy drives in the harness as a
strategy that gets the same observation vector (``harness.strategies.vector``, docs/python.md).
"""

from gymnasium.envs.registration import register

from harness.rl.environment import ENVIRONMENT_ID, CrosswalkEnv
from harness.rl.reward import CRASH_PENALTY, Transition, time_speeding_and_crash

__all__ = ["CRASH_PENALTY", "CrosswalkEnv", "Transition", "time_speeding_and_crash"]

register(id=ENVIRONMENT_ID, entry_point="harness.rl:CrosswalkEnv")
