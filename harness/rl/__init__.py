"""Actions in; observations and rewards of a Gymnasium environment out.

``gymnasium.make("harness.rl:harness/Crosswalk-v0", scenario="cctc_flow")`` makes it.  The same seed
and pair give the same pedestrians as in the harness.  A trained policy drives in the harness as a
strategy that gets the same observation vector (``harness.strategies.vector``, docs/python.md).
"""

from gymnasium.envs.registration import register

from harness.rl.environment import CrosswalkEnv, Transition, time_speeding_and_crash

__all__ = ["CrosswalkEnv", "Transition", "time_speeding_and_crash"]

register(id="harness/Crosswalk-v0", entry_point="harness.rl:CrosswalkEnv")
