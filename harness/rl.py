"""The AV's arm as a Gymnasium environment (extra ``rl``).

``gymnasium.make("harness.rl:harness/Crosswalk-v0", scenario="cctc_flow")``.  The same seed and pair
give the same pedestrians as in the harness, and a policy goes back into the harness as a strategy
through the same vector (``harness.strategies.vector``, docs/rl.md).
"""

import math
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.envs.registration import register
from numpy.typing import NDArray

from harness.encounter import PEDESTRIAN_RADIUS_M, EgoView, Ending, Observation, Trace
from harness.engine.protocol import Engine
from harness.engine.shared import close_engine, open_engine
from harness.episode.loop import Episode, Steps
from harness.episode.pairing import PairRunner
from harness.errors import EngineError, InputError
from harness.interaction import load_model
from harness.measures import EpisodeRecord, has_contact, measure
from harness.scenario import EngineName, Scenario, engine_named, load_scenario
from harness.strategies.vector import observation_vector

Vector = NDArray[np.float32]

CRASH_PENALTY = 100.0

_FASTEST_WALK_MPS = 20.0


class Transition(NamedTuple):
    """One step of an episode, what a reward is made from.

    ``after`` is None once the ego has crossed or the episode has timed out.
    """

    before: Observation
    acceleration_mps2: float
    after: Observation | None
    crossed: bool
    crashed: bool


def time_speeding_and_crash(step: Transition) -> float:
    """The default reward: − step in s, − metres driven beyond what v0 allows, − 100 for a crash.

    Summed over an episode that crosses and never exceeds v0 it is minus the pass time, rounded up
    to a step.  Without the second part the best policy against few pedestrians is to rush.
    """
    ego, vehicle = step.before.ego, step.before.vehicle
    excess_m = max(0.0, ego.speed_mps - vehicle.initial_speed_mps) * step.before.step_s
    return -step.before.step_s - excess_m - (CRASH_PENALTY if step.crashed else 0.0)


class CrosswalkEnv(gymnasium.Env[Vector, Vector]):
    """Drive the AV of one pair after another.

    *Observation*: ``observation_vector`` of the state, with the ``nearest`` pedestrians; after the
    last step that of the ego alone.  *Action*: the wanted acceleration in m/s², shape (1,), within
    the vehicle's limits.  *Reward*: ``reward`` of the ``Transition``.  ``terminated`` on crossing
    or contact (found inside the step, as in the harness), ``truncated`` on time-out.  The last
    step's info holds the ``ending``; ``record`` has the measures of that episode.

    ``reset(seed=s)`` begins at pair 0 of seed s; each further ``reset`` takes the next pair, or
    the one named in ``options={"pair": 17}``.  Without a seed it is the scenario's.

    Args:
        scenario: a scenario, a file, or the name of a shipped one.
        settings: changes to it by dotted key, e.g. ``{"pedestrians.flow_per_hour": 500}``.
        nearest: k ≥ 1, pedestrians in the observation.
        reward: of each step.
        engine: ``sumo`` (one open episode per process), or ``plain``: the same kinematics without
            SUMO, many times faster, any number side by side.

    Raises:
        InputError: the scenario, a setting or an argument is refused.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  # Gymnasium's own attribute

    def __init__(
        self,
        scenario: Scenario | str | Path = "cctc",
        *,
        settings: Mapping[str, Any] | None = None,
        nearest: int = 3,
        reward: Callable[[Transition], float] = time_speeding_and_crash,
        engine: EngineName = "sumo",
    ) -> None:
        if nearest < 1:
            raise InputError("nearest", f"{nearest!r}", "1 or more")
        if not isinstance(scenario, Scenario):
            scenario = load_scenario(scenario, settings or {})
        elif settings:
            raise InputError(
                "settings", "stand beside a Scenario", "a name or file, or no settings"
            )
        if scenario.traffic is not None:
            raise InputError("scenario", "is of hours of traffic", "a scenario without [traffic]")
        self._scenario = scenario
        self._model = load_model(scenario.model.name, scenario.model.path)
        self._nearest, self._reward, self._kind = nearest, reward, engine_named(engine)
        self._runner: PairRunner | None = None
        self._next_pair = 0
        self._episode: Episode | None = None
        self._steps: Steps | None = None
        vehicle = scenario.vehicle()
        # Where a contact is possible at all: pedestrians stay within the crosswalk's width.
        crossing, touch = scenario.crosswalk(), PEDESTRIAN_RADIUS_M
        ahead = crossing.width_m / 2 + touch
        self._reach_m = (-ahead, vehicle.length_m + ahead)
        half = vehicle.width_m / 2 + touch
        self._swept_m = (crossing.lane_centre_m - half, crossing.lane_centre_m + half)
        self._places: list[tuple[int, float]] = []
        self._finished: Trace | None = None
        self.observation_space = gymnasium.spaces.Box(*_bounds(scenario, nearest), dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(
            -vehicle.max_deceleration_mps2, vehicle.max_acceleration_mps2, (1,), np.float32
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin the next episode; see the class."""
        super().reset(seed=seed)
        self._break_off()
        if seed is not None:
            experiment = self._scenario.experiment.model_copy(update={"seed": seed})
            self._scenario = self._scenario.model_copy(update={"experiment": experiment})
            self._runner, self._next_pair = None, 0
        if self._runner is None:
            self._runner = PairRunner(self._scenario, self._model, self._engine)
        pair = (options or {}).get("pair", self._next_pair)
        if not isinstance(pair, int) or pair < 0:
            raise InputError("options['pair']", f"{pair!r}", "0 or more")
        self._next_pair = pair + 1
        self._claim()
        self._episode = self._runner.begin(pair)
        self._steps = self._episode.steps()
        self._seen, self._places = next(self._steps), []
        return observation_vector(self._seen, self._nearest), {"pair": pair}

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Drive one simulation step; see the class."""
        if self._steps is None or self._episode is None:
            raise EngineError("no episode is under way: call reset first")
        before, wanted = self._seen, float(action[0])
        after, ending = None, None
        try:
            after = self._steps.send(wanted)
        except StopIteration as finished:
            ending = finished.value
        crashed = self._contact()
        crossed = ending is Ending.CROSSED and not crashed
        final = crashed or ending is not None
        if after is None:
            vector = observation_vector(self._last_state(before), self._nearest)
        else:
            vector, self._seen = observation_vector(after, self._nearest), after
        info: dict[str, Any] = {}
        if final:
            self._conclude(ending or Ending.TIMED_OUT)
            info["ending"] = (Ending.CRASHED if crashed else ending or Ending.TIMED_OUT).value
        reward = self._reward(Transition(before, wanted, after, crossed, crashed))
        return vector, float(reward), crossed or crashed, final and not (crossed or crashed), info

    def close(self) -> None:
        """End the episode under way and, if it was started, this process's SUMO."""
        self._break_off()
        if self._kind == "sumo" and self._runner is not None:
            close_engine()
        self._runner = None

    def _engine(self) -> Engine:
        return open_engine(self._scenario, self._kind)

    def _claim(self) -> None:
        """libsumo runs one simulation per process, and that one holds one ego."""
        global _driving
        if self._kind != "sumo":
            return
        other = None if _driving is None else _driving()
        if other is not None and other is not self and other._steps is not None:
            raise EngineError(
                "another environment of this process is in the middle of an episode in SUMO: "
                "close it, use engine='plain', or a process for each (AsyncVectorEnv)"
            )
        _driving = weakref.ref(self)

    def _contact(self) -> bool:
        """Whether the last step had a contact; measured only where one is possible."""
        episode = self._episode
        assert episode is not None
        before, self._places = self._places, episode.places
        if episode.x_m[-1] < self._reach_m[0] or episode.x_m[-2] > self._reach_m[1]:
            return False
        low, high = self._swept_m
        length, came_from = episode.rules.crossing.length_m, dict(before)
        for index, y in self._places:
            start = came_from.get(index, 0.0 if y < length / 2 else length)
            if min(start, y) <= high and max(start, y) >= low:
                return has_contact(episode.trace(Ending.TIMED_OUT))
        return False

    @property
    def record(self) -> EpisodeRecord:
        """The measures of the episode that ended last, worked out when asked for.

        Raises:
            EngineError: none has ended yet.
        """
        if self._finished is None:
            raise EngineError("no episode has ended yet")
        return measure([self._finished])[0]

    def _conclude(self, ending: Ending) -> None:
        """Clear the road and keep the trace."""
        episode = self._episode
        assert episode is not None
        self._finished = episode.trace(ending, sumo_collision=episode.engine.end())
        self._episode = self._steps = None

    def _break_off(self) -> None:
        if self._episode is not None:
            self._episode.engine.end()
        self._episode = self._steps = None

    def _last_state(self, before: Observation) -> Observation:
        """The ego after its last step, alone."""
        assert self._episode is not None
        x_m, speed = self._episode.x_m[-1], self._episode.speed_mps[-1]
        acceleration = (speed - before.ego.speed_mps) / before.step_s
        ego = EgoView(-x_m, speed, acceleration)
        return before._replace(time_s=before.time_s + before.step_s, ego=ego, pedestrians=())


def _bounds(scenario: Scenario, nearest: int) -> tuple[Vector, Vector]:
    """Lowest and highest value of every entry of an observation."""
    vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
    road = vehicle.trigger_range_m + vehicle.length_m + crossing.width_m / 2
    step_s, hardest = scenario.experiment.step_s, vehicle.max_acceleration_mps2
    fastest = math.sqrt(vehicle.initial_speed_mps**2 + 2 * hardest * road) + hardest * step_s
    beyond = vehicle.trigger_range_m - road - fastest * step_s
    # Not even someone placed beyond the kerb is farther away than twice the crossing; errors of
    # 8 standard deviations come once in 1e15 draws.
    far = 2 * crossing.length_m + 8 * scenario.perception.position_sd_m
    walking = _FASTEST_WALK_MPS + 8 * scenario.perception.speed_sd_mps
    low = [beyond, 0.0, -vehicle.max_deceleration_mps2 - 1e-3]
    high = [vehicle.trigger_range_m, fastest, hardest + 1e-3]
    low += [0.0, -far, 0.0, 0.0, 0.0] * nearest
    high += [1.0, far, far, walking, 1.0] * nearest
    return np.array(low, dtype=np.float32), np.array(high, dtype=np.float32)


_driving: "weakref.ref[CrosswalkEnv] | None" = None

register(id="harness/Crosswalk-v0", entry_point="harness.rl:CrosswalkEnv")
