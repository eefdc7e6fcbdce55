"""The results of ``strategies`` and ``doctor`` as plain data."""

from typing import TypedDict

from harness.core.encounter import Observation, StrategyFactory
from harness.old.report.screens.tables import counted
from harness.old.studies.conformance import RuleResult
from harness.strategies.parameters import knows_the_model

_SHOWN = 5
"""Maximum number of pedestrians in the text of an observation."""


class RuleRow(TypedDict):
    """A rule of ``strategies --check``, its problem, and the observation that shows it."""

    check: str
    problem: str | None
    observation: list[str]


def knowledge_of(strategy: StrategyFactory) -> str | None:
    """Return the knowledge that a strategy receives and real drivers or AVs lack; None if none."""
    if not knows_the_model(strategy):
        return None
    return "knows the pedestrians' distribution: it is given the model that they are drawn from"


def observation_lines(observation: Observation | None) -> list[str]:
    """Return an observation in words: the ego, then everybody at the crosswalk."""
    if observation is None:
        return []
    ego = observation.ego
    lines = [
        f"shown at t = {observation.time_s:.3f} s: R = {ego.range_m:.3f} m, "
        f"v = {ego.speed_mps:.3f} m/s, a = {ego.acceleration_mps2:.3f} m/s², "
        f"{counted(len(observation.pedestrians), 'pedestrian')}"
    ]
    lines += [
        f"{person.index} from the {person.side.value} side: L = {person.lateral_m:.3f} m, "
        f"{person.remaining_m:.3f} m to the other kerb, {person.speed_mps:.3f} m/s, "
        f"{'on the crossing' if person.on_crossing else 'not on the crossing'}"
        for person in observation.pedestrians[:_SHOWN]
    ]
    more = len(observation.pedestrians) - _SHOWN
    return [*lines, *([f"and {more} more"] if more > 0 else [])]


def verdict_document(verdict: RuleResult) -> RuleRow:
    """Return the entry of ``strategies --check --json`` for one rule."""
    return {
        "check": verdict.check,
        "problem": verdict.problem,
        "observation": observation_lines(verdict.observation),
    }
