"""The results of ``strategies`` and ``doctor`` as plain data."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TypedDict

from harness.core.encounter import Observation, StrategyFactory
from harness.core.errors import HarnessError, InputError, InterruptedRunError
from harness.engine.installation import check_packages
from harness.old.report.screens.tables import counted
from harness.old.studies.conformance import RuleResult
from harness.strategies.parameters import describe, knows_the_model, parameters_of
from harness.strategies.registry import available

_SHOWN = 5
"""Maximum number of pedestrians in the text of an observation."""

CHECKS = (
    "SUMO is installed in the version needed",
    "SUMO's library loads",
    "SUMO's netconvert builds a network",
    "one pair runs in SUMO",
)


class ParameterRow(TypedDict):
    """A parameter of a strategy; ``default`` is None if it is required.

    ``notes`` are lines on its measured values and their source: ``NOTES`` of the class.
    """

    name: str
    kind: str
    default: str | None
    required: bool
    notes: list[str]


class StrategyRow(TypedDict, total=False):
    """A strategy.  An unusable strategy has only its name and its problem."""

    name: str
    problem: str
    summary: str
    parameters: list[ParameterRow]
    knows: str | None


class RuleRow(TypedDict):
    """A rule of ``strategies --check``, its problem, and the observation that shows it."""

    check: str
    problem: str | None
    observation: list[str]


def strategy_documents() -> list[StrategyRow]:
    """Return every strategy with ``name``, ``summary``, ``parameters``, or with its ``problem``.

    ``knows`` is a sentence about strategies that receive the interaction model; None for others.
    """
    documents: list[StrategyRow] = []
    for name, factory in available().items():
        if isinstance(factory, InputError):
            documents.append({"name": name, "problem": str(factory)})
            continue
        parameters: list[ParameterRow] = [
            {
                "name": parameter.name,
                "kind": describe(parameter.annotation),
                "default": None if parameter.required else repr(parameter.default),
                "required": parameter.required,
                "notes": [*getattr(factory, "NOTES", {}).get(parameter.name, ())],
            }
            for parameter in parameters_of(factory)
        ]
        summary = (factory.__doc__ or "no description").strip().splitlines()[0]
        known = knowledge_of(factory)
        documents.append(
            {"name": name, "summary": summary, "parameters": parameters, "knows": known}
        )
    return documents


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


def installation_checks() -> Iterator[tuple[str, str | None]]:
    """Yield each check of the installation with its problem or None.  Stop at the first problem."""
    checks = (check_packages, _check_library, _check_network, _check_episode)
    for title, check in zip(CHECKS, checks, strict=True):
        try:
            check()
        except InterruptedRunError:
            raise KeyboardInterrupt from None  # the run's folder no longer exists
        except (HarnessError, ImportError, OSError) as error:
            yield title, str(error)
            return
        yield title, None


def _check_library() -> None:
    from harness.old.studies.workers.pool import LocalPool

    # A broken library may kill its process, so the check runs in another process.
    pool = LocalPool(1)
    try:
        pool.submit(abs, -1).result()
    finally:
        pool.stop()


def _check_network() -> None:
    from harness.engine.network import build_network
    from harness.scenario.sections import CrossingSection

    with tempfile.TemporaryDirectory() as folder:
        build_network(CrossingSection(length_m=10.0), Path(folder), "doctor")


def _check_episode() -> None:
    from harness.old.studies.batch.experiment import run_study
    from harness.scenario import Options, Setting, read_scenario_file, study_of

    study = study_of(read_scenario_file("cctc", [Setting("experiment.pairs", 1)]))
    with tempfile.TemporaryDirectory() as folder:
        failures = run_study(study, Options(), out=Path(folder) / "run").failures
    if failures:
        raise HarnessError(failures[0][-1])
