"""The Gymnasium environment, in which a policy drives the AV of one pair after another."""

import weakref
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from harness.core.errors import EngineError, InputError, StrategyError, checked, whole_number
from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, EgoView, Ending, Observation, Trace
from harness.encounter.loop import Episode, Steps
from harness.encounter.pairing import PairRunner
from harness.engine.shared import close_engine, open_engine
from harness.measures import EpisodeRecord, has_contact, measure
from harness.scenario import EngineName, Scenario, load_scenario
from harness.strategies.manoeuvres import half_path_width_m
from harness.strategies.vector import acceleration_of, observation_vector
from harness.studies.running.run import checked_models

Vector = NDArray[np.float32]

_FASTEST_WALK_MPS = 20.0
"""Nobody walks as fast; it bounds the observations, and where a contact is looked for."""

_IN_SUMO: "weakref.WeakSet[Episode]" = weakref.WeakSet()
"""The running episode in this process's SUMO, which has one ego."""


class Transition(NamedTuple):
    """One step of an episode, from which a reward is computed.

    ``after`` is None if the ego has crossed or the episode has timed out.
    """

    before: Observation
    acceleration_mps2: float
    after: Observation | None
    crossed: bool
    crashed: bool


def time_speeding_and_crash(step: Transition, crash_penalty_s: float = 100.0) -> float:
    """The default reward: −(step in s + metres driven in excess of v0 + 100 for a crash).

    Its sum over an episode that crosses and never exceeds v0 is minus the pass time, rounded up to
    a step.  Without the second term the best policy with few pedestrians would exceed v0.

    Args:
        step: the step.
        crash_penalty_s: penalty of a crash; ``functools.partial`` sets another.
    """
    ego, vehicle = step.before.ego, step.before.vehicle
    excess_m = max(0.0, ego.speed_mps - vehicle.initial_speed_mps) * step.before.step_s
    return -step.before.step_s - excess_m - (crash_penalty_s if step.crashed else 0.0)


class CrosswalkEnv(gymnasium.Env[Vector, Vector]):
    """Drive the AV of one pair after another.

    - *Observation*: ``observation_vector`` of the state with the ``nearest`` pedestrians; once the
      ego has crossed or the time is up, it has the ego alone.
    - *Action*: shape (1,), or a number.  -1 is the hardest braking, 0 keeps the speed, and 1 is
      full acceleration; values outside are clipped (``acceleration_of``).
    - *Reward*: ``reward`` of the ``Transition``.
    - *End*: ``terminated`` when the ego has crossed or after a contact (detected within the step,
      as in the harness); ``truncated`` on a time-out.  The info of the last step holds the
      ``ending``; ``record`` has the measures of that episode.

    ``reset(seed=s)`` begins with pair 0 of seed s.  Each further ``reset`` takes the next pair, or
    the pair in ``options={"pair": 17}``.  Without ``seed`` the scenario's seed is used.

    Args:
        scenario: a scenario, a file, or the name of a shipped one.
        settings: changes to it by dotted key, e.g. ``{"pedestrians.flow_per_hour": 500}``.
        nearest: k ≥ 1, the number of pedestrians in the observation.
        reward: function that returns the reward of each step.
        engine: ``sumo`` (one open episode per process) or ``plain`` (the same kinematics without
            SUMO, many times faster, with any number of open episodes).
        render_mode: with ``rgb_array``, ``render`` draws the crosswalk from above; with None, it
            draws nothing.

    Raises:
        InputError: the scenario, a setting or an argument is refused.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's own attribute

    @checked
    def __init__(
        self,
        scenario: Scenario | str | Path = "cctc",
        *,
        settings: Mapping[str, Any] | None = None,
        nearest: int = 3,
        reward: Callable[[Transition], float] = time_speeding_and_crash,
        engine: EngineName = "sumo",
        render_mode: Literal["rgb_array"] | None = None,
    ) -> None:
        self._nearest, self._reward = whole_number("nearest", nearest, 1), reward
        self._kind, self.render_mode = engine, render_mode
        self._scenario = load_scenario(scenario, settings or {})
        (self._model,) = checked_models([self._scenario], engine)
        self._runner: PairRunner | None = None
        self._next_pair = 0
        self._episode: Episode | None = None
        self._steps: Steps | None = None
        self._finished: Trace | None = None
        self._seen: Observation | None = None
        self.metadata = {**self.metadata, "render_fps": round(1 / self._scenario.experiment.step_s)}
        low, high = _bounds(self._scenario, self._nearest)
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    @checked
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin the next episode; see the class.

        Raises:
            EngineError: SUMO does not start.
            InputError: an option is unknown, the seed or the pair is not an allowed whole number,
                the pair is beyond ``pedestrians.drawn``, or another environment drives in SUMO.
        """
        options = options or {}
        if unknown := sorted(map(str, options.keys() - {"pair"})):
            raise InputError("options", f"unknown key {unknown[0]!r}", "pair", "pair")
        if seed is not None:
            seed = whole_number("seed", seed, 0)
            self._scenario = load_scenario(self._scenario, {"experiment.seed": seed})
            self._runner, self._next_pair = None, 0
        pair = whole_number("options['pair']", options.get("pair", self._next_pair), 0)
        super().reset(seed=seed)
        self._end()
        get_engine = partial(open_engine, self._scenario, self._kind)
        self._runner = self._runner or PairRunner(self._scenario, self._model, get_engine)
        if self._kind == "sumo" and _IN_SUMO:
            problem = "another environment of this process has a running episode in SUMO"
            raise InputError("engine", problem, "'plain', or 'sumo' once the other is closed")
        self._episode, self._next_pair = self._runner.begin(pair), pair + 1
        if self._kind == "sumo":
            _IN_SUMO.add(self._episode)
        self._steps = _steps_of(self._episode)
        self._seen = next(self._steps)
        return observation_vector(self._seen, self._nearest), {"pair": pair}

    def step(self, action: Vector | float) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Drive one simulation step; see the class.

        Raises:
            EngineError: the engine failed.
            StrategyError: the action is NaN.
            InputError: no episode is running, or the action is neither a number nor an array of
                one.
        """
        if self._steps is None or self._episode is None or self._seen is None:
            raise InputError("step", "no episode is running", "after reset")
        before, episode = self._seen, self._episode
        try:
            wanted = acceleration_of(np.asarray(action, dtype=float).item(), before.vehicle)
        except (TypeError, ValueError):
            raise InputError("action", repr(action), "a number or an array of one") from None
        after, ending = None, None
        try:
            after = self._steps.send(wanted)
        except StopIteration as finished:
            ending = finished.value
        except (EngineError, StrategyError):
            self._end()
            raise
        if _touched(episode):
            ending = Ending.CRASHED
        speed = episode.speed_mps[-1]
        gain = (speed - before.ego.speed_mps) / before.step_s
        alone = before._replace(ego=EgoView(-episode.x_m[-1], speed, gain), pedestrians=())
        self._seen = after or alone
        info: dict[str, Any] = {} if ending is None else {"ending": ending.value}
        if ending is not None:
            self._finished = episode.trace(ending, self._end())
        crossed, crashed = ending is Ending.CROSSED, ending is Ending.CRASHED
        reward = float(self._reward(Transition(before, wanted, after, crossed, crashed)))
        vector = observation_vector(self._seen, self._nearest)
        return vector, reward, crossed or crashed, ending is Ending.TIMED_OUT, info

    def render(self) -> NDArray[np.uint8] | None:
        """The crosswalk from above with ``render_mode="rgb_array"``; otherwise None.

        Raises:
            InputError: no episode has begun.
        """
        if self.render_mode is None:
            return None
        if self._episode is None or self._seen is None:
            raise InputError("render", "there is nothing to draw yet", "after reset")
        from harness.report.top_view import top_view

        crossing, crowd = self._seen.crossing, self._episode.crowd
        people_y_m = [crossing.place_of(view.side, view.remaining_m) for view in crowd.views()]
        return top_view(self._seen.vehicle, crossing, self._episode.x_m[-1], people_y_m)

    def close(self) -> None:
        """End the running episode and SUMO in this process, unless another environment uses it."""
        self._end()
        if self._kind == "sumo" and not _IN_SUMO:
            close_engine()

    @property
    def record(self) -> EpisodeRecord:
        """The measures of the last finished episode.

        Raises:
            InputError: no episode has ended yet.
        """
        if self._finished is None:
            raise InputError("record", "no episode has ended yet", "after an episode")
        return measure([self._finished])[0]

    def _end(self) -> bool | None:
        """Clear the road if an episode is running; whether SUMO has detected a collision."""
        if self._steps is None or self._episode is None:
            return None
        self._steps = None
        _IN_SUMO.discard(self._episode)
        return None if self._episode.engine.closed else self._episode.engine.end()


def _steps_of(episode: Episode) -> Steps:
    """The steps of an episode; an engine that fails is closed, so the next episode gets another."""
    try:
        return (yield from episode.steps())
    except EngineError:
        episode.engine.close()
        raise


def _touched(episode: Episode) -> bool:
    """Whether the ego has touched somebody; it is measured only where that may be so now."""
    vehicle, crossing = episode.rules.vehicle, episode.rules.crossing
    # Pedestrians stay within the crosswalk's width.
    ahead_m = crossing.width_m / 2 + PEDESTRIAN_RADIUS_M
    here = episode.x_m[-1] >= -ahead_m and episode.x_m[-2] <= vehicle.length_m + ahead_m
    beside_m = half_path_width_m(vehicle) + _FASTEST_WALK_MPS * episode.rules.step_s
    near = here and any(abs(y - crossing.lane_centre_m) <= beside_m for _, y in episode.places)
    return near and has_contact(episode.trace(Ending.TIMED_OUT))


def _bounds(scenario: Scenario, nearest: int) -> tuple[Vector, Vector]:
    """Lowest and highest value of every entry of an observation."""
    vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
    road_m = vehicle.trigger_range_m + vehicle.length_m + crossing.width_m / 2
    step_s, hardest_mps2 = scenario.experiment.step_s, vehicle.max_acceleration_mps2
    squared = vehicle.initial_speed_mps**2 + 2 * hardest_mps2 * road_m
    fastest_mps = np.sqrt(squared) + hardest_mps2 * step_s
    beyond_m = vehicle.trigger_range_m - road_m - fastest_mps * step_s
    # Even a pedestrian beyond the kerb is at most twice the crossing's length away; errors of
    # 8 standard deviations occur once in 1e15 draws.
    far_m = 2 * crossing.length_m + 8 * scenario.perception.position_sd_m
    walking_mps = _FASTEST_WALK_MPS + 8 * scenario.perception.speed_sd_mps
    # The acceleration is a difference of speeds, so it may exceed its limit by rounding.
    low = [beyond_m, 0.0, -vehicle.max_deceleration_mps2 - 1e-3]
    high = [vehicle.trigger_range_m, fastest_mps, hardest_mps2 + 1e-3]
    low += [0.0, -far_m, 0.0, 0.0, 0.0] * nearest
    high += [1.0, far_m, far_m, walking_mps, 1.0] * nearest
    return np.array(low, dtype=np.float32), np.array(high, dtype=np.float32)
