"""What a risk is asked, and whether it can be."""

from dataclasses import dataclass
from typing import Any

from harness.encounter import Arm
from harness.engine.installation import check_packages
from harness.episode.arms import check_arms
from harness.errors import InputError
from harness.interaction import load_model
from harness.risk.episodes import Question
from harness.risk.event import parse_event
from harness.risk.space import space_of
from harness.scenario import Scenario
from harness.strategies.registry import source_digests
from harness.versions import versions_of_runs


@dataclass(frozen=True)
class Settings:
    """What is asked; ``event`` as ``parse_event`` reads it, ``most_episodes`` of the last stage."""

    name: str
    scenario: Scenario
    arm: Arm = Arm.AV
    event: str = "crashed"
    target_cv: float = 0.1
    most_episodes: int = 200_000
    in_sumo: bool = False

    def document(self) -> dict[str, Any]:
        """What ``risk.json`` holds: all that the result depends on."""
        model = load_model(self.scenario.model.name, self.scenario.model.path)
        driver = self.scenario.arms.driver(self.arm)
        return {
            "name": self.name,
            "scenario": self.scenario.model_dump(),
            "arm": self.arm.value,
            "event": self.event,
            "target_cv": self.target_cv,
            "most_episodes": self.most_episodes,
            "in_sumo": self.in_sumo,
            "seed": self.scenario.experiment.seed,
            "versions": {**versions_of_runs(), **source_digests({driver})},
            "model": {"name": model.name, "sha256": model.sha256},
        }


def question_of(settings: Settings) -> Question:
    """The question, with everything that a user may have got wrong refused.

    Raises:
        InputError: naming what.
    """
    check_packages()
    scenario = settings.scenario
    if not 0 < settings.target_cv <= 1:
        raise InputError("--target-cv", f"{settings.target_cv:g}", "above 0, at most 1")
    if settings.most_episodes < 1:
        raise InputError("--most-episodes", f"{settings.most_episodes}", "at least 1")
    driver = scenario.arms.driver(settings.arm)
    if driver == "sumo_driver" and not settings.in_sumo:
        raise InputError(
            f"arms.{settings.arm.value}", "sumo_driver drives in SUMO alone", "--engine sumo"
        )
    model = load_model(scenario.model.name, scenario.model.path)
    check_arms(scenario, model)
    event, space = parse_event(settings.event), space_of(scenario, settings.arm)
    return Question(scenario, model, settings.arm, event, space, settings.in_sumo)
