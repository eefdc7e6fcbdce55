"""Takes the user's settings of a risk estimate and returns the input of its workers."""

from dataclasses import dataclass, fields

from pydantic import BaseModel, ConfigDict

from harness.core.documents import JsonObject
from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.core.versions import versions_of_runs
from harness.encounter.arms import check_arms
from harness.engine.installation import check_packages
from harness.model.interaction import InteractionModel, load_model
from harness.old.studies.risk.event import Event, parse_event
from harness.old.studies.risk.space import Space, space_of
from harness.scenario import Scenario, validate
from harness.strategies.registry import source_digests


class Document(BaseModel):
    """A part of the JSON files of a risk estimate."""

    model_config = ConfigDict(allow_inf_nan=False, frozen=True)


class SettingsDocument(Document):
    """``risk.json``: everything that determines the result.

    ``model`` contains the interaction model's name and sha256.
    """

    name: str
    scenario: JsonObject
    arm: Arm
    event: str
    target_cv: float
    most_episodes: int
    in_sumo: bool
    seed: int
    versions: dict[str, str]
    model: dict[str, str]

    def settings(self, where: str) -> "Settings":
        """Return the settings from which the document was made.

        Raises:
            InputError: the scenario is invalid; the error names ``where``.
        """
        values = {item.name: getattr(self, item.name) for item in fields(Settings)}
        return Settings(**values | {"scenario": validate(self.scenario, where)})


@dataclass(frozen=True)
class Question:
    """The input of a worker that runs episodes, in SUMO if ``in_sumo``."""

    scenario: Scenario
    model: InteractionModel
    arm: Arm
    event: Event
    space: Space
    in_sumo: bool


@dataclass(frozen=True)
class Settings:
    """The settings of a risk estimate.

    ``event`` has the format of ``parse_event``; ``most_episodes`` bounds the last stage.
    """

    name: str
    scenario: Scenario
    arm: Arm = Arm.AV
    event: str = "crashed"
    target_cv: float = 0.1
    most_episodes: int = 200_000
    in_sumo: bool = False

    @property
    def driver(self) -> str:
        """The strategy whose episodes are run."""
        return self.scenario.arms.driver(self.arm)

    def document(self) -> SettingsDocument:
        """Return the content of ``risk.json``."""
        scenario = self.scenario
        model = load_model(scenario.model.name, scenario.model.path)
        more = {
            "scenario": scenario.model_dump(mode="json"),
            "seed": scenario.experiment.seed,
            "versions": {**versions_of_runs(), **source_digests({self.driver})},
            "model": {"name": model.name, "sha256": model.sha256},
        }
        return SettingsDocument.model_validate(vars(self) | more)


def question_of(settings: Settings) -> Question:
    """Check the settings and return the scenario and the event as the workers need them.

    Raises:
        InputError: a setting, the scenario, the strategy or the event is invalid.
    """
    check_packages()
    scenario = settings.scenario
    if not 0 < settings.target_cv <= 1:
        raise InputError("--target-cv", f"{settings.target_cv:g}", "above 0, at most 1")
    if settings.most_episodes < 1:
        raise InputError("--most-episodes", f"{settings.most_episodes}", "at least 1")
    model = load_model(scenario.model.name, scenario.model.path)
    check_arms(scenario, model)
    event, space = parse_event(settings.event), space_of(scenario, settings.arm)
    return Question(scenario, model, settings.arm, event, space, settings.in_sumo)
