"""The plan of a run: its checked study with the loaded models."""

from dataclasses import dataclass
from functools import cache

from harness.core.documents import JsonObject
from harness.core.errors import InputError
from harness.encounter.arms import check_arms
from harness.model.interaction import InteractionModel, load_model
from harness.old.store.kinds import Kind, kind_of_study
from harness.old.store.manifest import manifest_of, options_of, origin_of
from harness.old.store.reading import MANIFEST
from harness.old.studies.kinds.table import simulation_of
from harness.scenario import Options, Study, study_from
from harness.strategies.program import is_program


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
    if options.engine == "plain":
        raise InputError("--engine plain", f"{kind.section} needs SUMO", "--engine sumo")
    for cell in study.cells:
        for arm, name in cell.scenario.arms.model_dump().items():
            if is_program(name):
                problem = f"{name} drives one vehicle at a time"
                raise InputError(f"arms.{arm}", problem, f"a scenario without {kind.section}")
    load, models = cache(load_model), {}
    for cell in study.cells:
        models[cell.number] = load(*cell.scenario.model.file_and_refits)
        check_arms(cell.scenario, models[cell.number])
        cell.scenario.refuse_refits(f"a run of {kind.name}")
        simulation_of(cell.scenario).check(cell.scenario)
    return Plan(study, models, options, origin_of(study, models.values()))


def recall_plan(document: JsonObject, workers: int | None = None) -> Plan:
    """Return the plan of the run that a manifest describes.

    Raises:
        InputError: see ``study_from`` and ``plan_of``.
    """
    return plan_of(study_from(document, MANIFEST), options_of(document, workers))
