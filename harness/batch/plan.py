"""What a run carries out: its study with the models loaded and everything checked."""

from dataclasses import dataclass
from typing import Any

from harness.episode.arms import check_arms
from harness.errors import InputError
from harness.interaction import InteractionModel, load_model
from harness.network import network_of
from harness.results.manifest import manifest_of, options_of, recall_study
from harness.scenario import Options, Study


@dataclass(frozen=True)
class Plan:
    """What a run carries out: every cell, its model by the cell's number, and how."""

    study: Study
    models: dict[int, InteractionModel]
    options: Options

    @property
    def planned(self) -> dict[int, int]:
        """Pairs of each cell, by number; with ``--until`` at most so many."""
        return {cell.number: cell.scenario.experiment.pairs for cell in self.study.cells}

    def manifest(self, counts: dict[str, int] | None = None) -> dict[str, Any]:
        """See ``manifest_of``."""
        return manifest_of(self.study, self.models.values(), self.options, counts)


def plan_of(study: Study, options: Options) -> Plan:
    """Load the models; all that a user may have got wrong is found here.

    Raises:
        InputError: a model, a strategy or a network is refused.
    """
    if study.in_traffic and options.until:
        raise InputError("--until", "of hours of traffic", "a scenario without [traffic]")
    loaded: dict[tuple[str, str | None], InteractionModel] = {}
    models = {}
    for cell in study.cells:
        section = cell.scenario.model
        key = (section.name, section.path)
        if key not in loaded:
            loaded[key] = load_model(*key)
        models[cell.number] = loaded[key]
        check_arms(cell.scenario, models[cell.number])
        network_of(cell.scenario)
    return Plan(study, models, options)


def recall_plan(document: dict[str, Any], workers: int | None = None) -> Plan:
    """What the run of a manifest carries out.

    Raises:
        InputError: see ``recall_study``, ``options_of`` and ``plan_of``.
    """
    study = recall_study(document)
    return plan_of(study, options_of(document, workers))
