"""The Gymnasium environment, in which a policy drives the AV of one pair after another."""

import math
import sys
import weakref
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from harness.core.encounter import PEDESTRIAN_RADIUS_M, EgoView, Ending, Observation, Trace
from harness.core.errors import EngineError, InputError, unknown_name
from harness.encounter.loop import Episode, Steps
from harness.encounter.pairing import PairRunner
from harness.engine.protocol import Engine
from harness.engine.shared import close_engine, open_engine
from harness.measures import EpisodeRecord, has_contact, measure
from harness.model.interaction import load_model
from harness.rl.reward import Reward, Transition, check_reward, time_speeding_and_crash
from harness.scenario import EngineName, Scenario
from harness.scenario.arguments import engine_named, number_in, whole_number
from harness.scenario.file import scenario_of_encounters
from harness.strategies.vector import acceleration_of, observation_vector

ENVIRONMENT_ID = "harness/Crosswalk-v0"

Vector = NDArray[np.float32]

_FASTEST_WALK_MPS = 20.0

_LARGEST = sys.float_info.max


class CrosswalkEnv(gymnasium.Env[Vector, Vector]):
    """Drive the AV of one pair after another.

    - *Observation*: ``observation_vector`` of the state with the ``nearest`` pedestrians; after the
      last step it has the ego alone.
    - *Action*: shape (1,).  -1 is the hardest braking, 0 keeps the speed, and 1 is full
      acceleration (``acceleration_of``).
    - *Reward*: ``reward`` of the ``Transition``.
    - *End*: ``terminated`` when the ego has crossed or after a contact (detected within the step,
      as in the harness); ``truncated`` on a time-out.  The info of the last step holds the
      ``ending``; ``record`` has the measures of that episode.

    ``reset(seed=s)`` begins with pair 0 of seed s.  Each further ``reset`` takes the next pair, or
    the pair in ``options={"pair": 17}``.  Without ``seed`` the scenario's seed is used.  The
    environment can be pickled between two episodes; the copy continues with the next pair.

    Args:
        scenario: a scenario, a file, or the name of a shipped one.
        settings: changes to it by dotted key, e.g. ``{"pedestrians.flow_per_hour": 500}``.
        nearest: k ≥ 1, the number of pedestrians in the observation.
        reward: function that returns the reward of each step, a finite number.
        engine: ``sumo`` (one open episode per process) or ``plain`` (the same kinematics without
            SUMO, many times faster, with any number of open episodes).
        render_mode: with ``rgb_array``, ``render`` draws the crosswalk from above; with None, it
            draws nothing.

    Raises:
        InputError: the scenario, a setting or an argument is refused.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's own attribute

    def __init__(
        self,
        scenario: Scenario | str | Path = "cctc",
        *,
        settings: Mapping[str, Any] | None = None,
        nearest: int = 3,
        reward: Reward = time_speeding_and_crash,
        engine: EngineName = "sumo",
        render_mode: str | None = None,
    ) -> None:
        nearest = whole_number("nearest", nearest, 1)
        check_reward(reward)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError("render_mode", f"{render_mode!r}", "rgb_array, or None")
        self.render_mode = render_mode
        arguments: dict[str, Any] = {"scenario": scenario, "settings": settings, "nearest": nearest}
        arguments |= {"reward": reward, "engine": engine}
        self.spec = EnvSpec(ENVIRONMENT_ID, "harness.rl:CrosswalkEnv", kwargs=arguments)
        scenario = scenario_of_encounters(scenario, settings)
        self._scenario = scenario
        self._model = load_model(scenario.model.name, scenario.model.path)
        self._nearest, self._reward, self._kind = nearest, reward, engine_named(engine)
        self._runner: PairRunner | None = None
        self._next_pair = 0
        self._episode: Episode | None = None
        self._shown: Episode | None = None
        self._steps: Steps | None = None
        self._vehicle, self._crossing = vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
        self.metadata = {**self.metadata, "render_fps": round(1 / scenario.experiment.step_s)}
        # The area in which a contact is possible: pedestrians stay within the crosswalk's width.
        touch = PEDESTRIAN_RADIUS_M
        ahead = crossing.width_m / 2 + touch
        self._reach_m = (-ahead, vehicle.length_m + ahead)
        half = vehicle.width_m / 2 + touch
        self._swept_m = (crossing.lane_centre_m - half, crossing.lane_centre_m + half)
        self._places: list[tuple[int, float]] = []
        self._finished: Trace | None = None
        self.observation_space = gymnasium.spaces.Box(*_bounds(scenario, nearest), dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin the next episode; see the class.

        Raises:
            InputError: an option is unknown, or the seed or the pair is not a whole number.
        """
        requested = dict(options or {})
        for name in requested.keys() - {"pair"}:
            raise unknown_name("options", "key", str(name), ["pair"])
        seed = None if seed is None else whole_number("seed", seed, 0)
        pair = whole_number("options['pair']", requested["pair"], 0) if requested else None
        super().reset(seed=seed)
        self._break_off()
        if seed is not None:
            experiment = self._scenario.experiment.model_copy(update={"seed": seed})
            self._scenario = self._scenario.model_copy(update={"experiment": experiment})
            self._runner, self._next_pair = None, 0
        if self._runner is None:
            self._runner = PairRunner(self._scenario, self._model, self._engine)
        pair = self._next_pair if pair is None else pair
        self._next_pair = pair + 1
        self._claim()
        self._episode = self._shown = self._runner.begin(pair)
        self._steps = self._episode.steps()
        self._seen, self._places = next(self._steps), []
        return observation_vector(self._seen, self._nearest), {"pair": pair}

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Drive one simulation step; see the class."""
        if self._steps is None or self._episode is None:
            raise EngineError("no episode is running: call reset first")
        before, wanted = self._seen, acceleration_of(float(action[0]), self._vehicle)
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
        given = self._reward(Transition(before, wanted, after, crossed, crashed))
        reward = number_in("reward", given, -_LARGEST, _LARGEST)
        return vector, reward, crossed or crashed, final and not (crossed or crashed), info

    def render(self) -> NDArray[np.uint8] | None:
        """The crosswalk from above with ``render_mode="rgb_array"``; otherwise None.

        Raises:
            EngineError: no episode has begun.
        """
        if self.render_mode is None:
            return None
        if self._shown is None:
            raise EngineError("there is nothing to draw yet: call reset first")
        from harness.report.top_view import top_view

        crossing = self._crossing
        views = [(walker.x_m, walker.view()) for walker in self._shown.crowd.walkers]
        people = [(x, crossing.place_of(view.side, view.remaining_m)) for x, view in views]
        return top_view(self._vehicle, crossing, self._shown.x_m[-1], people)

    def __getstate__(self) -> dict[str, Any]:
        """The state without the simulation; the next ``reset`` begins a new one.

        Raises:
            EngineError: an episode is running, whose state in SUMO cannot be saved.
        """
        if self._episode is not None:
            raise EngineError(
                "an episode is running: pickle or copy the environment before reset, after an "
                "episode's last step, or after close"
            )
        return {**self.__dict__, "_runner": None, "_steps": None, "_shown": None}

    def close(self) -> None:
        """End the running episode and, if it was started, SUMO in this process."""
        self._break_off()
        if self._kind == "sumo" and self._runner is not None:
            close_engine()
        self._runner = None

    def _engine(self) -> Engine:
        return open_engine(self._scenario, self._kind)

    def _claim(self) -> None:
        """Reserve SUMO for this environment; a process has one simulation with one ego."""
        global _driving
        if self._kind != "sumo":
            return
        other = None if _driving is None else _driving()
        if other is not None and other is not self and other._steps is not None:
            raise EngineError(
                "another environment of this process has a running episode in SUMO: "
                "close it, or use engine='plain'"
            )
        _driving = weakref.ref(self)

    def _contact(self) -> bool:
        """Whether the last step had a contact; measured only where a contact is possible."""
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
        """The measures of the last finished episode.

        Raises:
            EngineError: no episode has ended yet.
        """
        if self._finished is None:
            raise EngineError("no episode has ended yet")
        return measure([self._finished])[0]

    def _conclude(self, ending: Ending) -> None:
        """Clear the road and keep the trace."""
        episode = self._episode
        assert episode is not None
        self._finished = replace(episode.trace(ending), sumo_collision=episode.engine.end())
        self._episode = self._steps = None

    def _break_off(self) -> None:
        if self._episode is not None:
            self._episode.engine.end()
        self._episode = self._steps = None

    def _last_state(self, before: Observation) -> Observation:
        """The ego's state after its last step, without pedestrians."""
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
    # Even a pedestrian beyond the kerb is at most twice the crossing's length away; errors of
    # 8 standard deviations occur once in 1e15 draws.
    far = 2 * crossing.length_m + 8 * scenario.perception.position_sd_m
    walking = _FASTEST_WALK_MPS + 8 * scenario.perception.speed_sd_mps
    low = [beyond, 0.0, -vehicle.max_deceleration_mps2 - 1e-3]
    high = [vehicle.trigger_range_m, fastest, hardest + 1e-3]
    low += [0.0, -far, 0.0, 0.0, 0.0] * nearest
    high += [1.0, far, far, walking, 1.0] * nearest
    return np.array(low, dtype=np.float32), np.array(high, dtype=np.float32)


_driving: "weakref.ref[CrosswalkEnv] | None" = None
