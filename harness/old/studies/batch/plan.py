"""The plan of a run: its checked study with the loaded models."""

from dataclasses import dataclass
from functools import cache

from harness.core.documents import JsonObject
from harness.core.errors import InputError
from harness.episode.arms import check_arms
from harness.model.interaction import InteractionModel, load_model
from harness.old.store.kinds import Kind, kind_of_study
from harness.old.store.manifest import manifest_of, options_of, origin_of
from harness.old.store.reading import MANIFEST
from harness.old.studies.kinds.table import simulation_of
from harness.scenario import Options, Scenario, Study, study_from
from harness.strategies.parameters import knows_the_model
from harness.strategies.program import is_program
from harness.strategies.registry import find_strategy


@dataclass(frozen=True)
class Plan:
    """The cells of a run, the interaction model of each cell by cell number, and the options.

    ``origin`` is the manifest's record of versions, models and strategies (``origin_of``).
    """

    study: Study
    models: dict[int, InteractionModel]
    options: Options
    origin: JsonObject

    @property
    def kind(self) -> Kind:
        """The kind of the run."""
        return kind_of_study(self.study)

    @property
    def shard_tables(self) -> list[str]:
        """The tables that the tasks return."""
        return self.kind.tables(traces=self.options.traces)

    @property
    def planned(self) -> dict[int, int]:
        """Number of pairs of each cell, by cell number."""
        return {cell.number: cell.scenario.experiment.pairs for cell in self.study.cells}

    def manifest(self, counts: dict[str, int] | None = None) -> JsonObject:
        """See ``manifest_of``."""
        return manifest_of(self.study, self.origin, self.options, counts)


def plan_of(study: Study, options: Options) -> Plan:
    """Load the models and check all user input.

    Raises:
        InputError: a model, a strategy, a network or a limit is refused.
    """
    kind = kind_of_study(study)
    if options.engine == "plain" and kind.section:
        raise InputError("--engine plain", f"{kind.section} needs SUMO", "--engine sumo")
    for cell in study.cells if study.long_pairs else ():
        for arm, name in cell.scenario.arms.model_dump().items():
            if is_program(name):
                problem = f"{name} drives one vehicle at a time"
                raise InputError(f"arms.{arm}", problem, f"a scenario without {kind.section}")
    load, models = cache(load_model), {}
    for cell in study.cells:
        models[cell.number] = load(*cell.scenario.model.file_and_refits)
        check_arms(cell.scenario, models[cell.number])
        _check_refits(cell.scenario, models[cell.number])
        simulation_of(cell.scenario).check(cell.scenario)
    if len({model.refits.sha256 for model in models.values() if model.refits is not None}) > 1:
        raise InputError("--over-model", "the cells use several models", "one model")
    return Plan(study, models, options, origin_of(study, models.values()))


def _check_refits(scenario: Scenario, model: InteractionModel) -> None:
    """Refuse refits if nothing depends on the model, or if a refit would get no pair."""
    if model.refits is None:
        return
    walk = scenario.walks_by_model and scenario.simulation is None
    names = scenario.arms.model_dump().values()
    if not walk and not any(knows_the_model(find_strategy(name, "arms")) for name in names):
        problem = "nothing here depends on the interaction model"
        allowed = "pedestrians or a driver by the model, for example human_gmm"
        raise InputError("--over-model", problem, allowed)
    pairs, refits = scenario.experiment.pairs, len(model.refits.models)
    if pairs < refits:
        raise InputError(
            "--over-model",
            f"{pairs} pairs for {refits} refits",
            f"at least {refits} pairs, one for each refit",
        )


def recall_plan(document: JsonObject, workers: int | None = None) -> Plan:
    """Return the plan of the run that a manifest describes.

    Raises:
        InputError: see ``study_from`` and ``plan_of``.
    """
    return plan_of(study_from(document, MANIFEST), options_of(document, workers))
