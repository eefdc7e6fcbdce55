"""The manifest of a run: everything it depends on, written down, recalled, and checked."""

from dataclasses import dataclass
from typing import Any

from harness.errors import InputError
from harness.interaction import InteractionModel, load_model
from harness.options import Options, Precision
from harness.pairing import check_arms
from harness.place import network_of
from harness.results import SCHEMA, versions
from harness.strategies.registry import source_digests
from harness.study import Study, study_from


@dataclass(frozen=True)
class Batch:
    """What a run carries out: every cell, its model by the cell's number, and how."""

    study: Study
    models: dict[int, InteractionModel]
    options: Options

    @property
    def planned(self) -> dict[int, int]:
        """Pairs of each cell, by number; with ``--until`` at most so many."""
        return {cell.number: cell.scenario.experiment.pairs for cell in self.study.cells}


def batch_of(study: Study, options: Options) -> Batch:
    """Load the models; all that a user may have got wrong is found here.

    Raises:
        InputError: a model, a strategy or a network is refused.
    """
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
    return Batch(study, models, options)


def manifest_of(batch: Batch, counts: dict[str, int] | None = None) -> dict[str, Any]:
    """Everything a run depends on; ``counts`` is null until its tables are finished."""
    study, options = batch.study, batch.options
    until = options.until
    used = {model.name: model.sha256 for model in batch.models.values()}
    driven = {name for cell in study.cells for name in cell.scenario.arms.model_dump().values()}
    return {
        "schema": SCHEMA,
        "name": study.name,
        "scenario": study.base.model_dump(),
        "cells": [cell.varied for cell in study.cells],
        "traces": options.traces,
        "sumo_outputs": options.sumo_outputs,
        "until": None if until is None else {until.measure: until.half_width},
        "seed": study.base.experiment.seed,
        "versions": {**versions(), **source_digests(driven)},
        "models": [{"name": name, "sha256": sha256} for name, sha256 in used.items()],
        "counts": counts,
    }


def recall_study(document: dict[str, Any]) -> Study:
    """The study of a manifest.

    Raises:
        InputError: the manifest is of another format, or damaged.
    """
    try:
        if document["schema"] != SCHEMA:
            raise InputError("manifest.json", f"format version {document['schema']!r}", str(SCHEMA))
        return study_from(document)
    except (KeyError, TypeError, AttributeError, ValueError):
        raise InputError("manifest.json", "is damaged", "a manifest as a run writes it") from None


def options_of(document: dict[str, Any], workers: int | None = None) -> Options:
    """The options of a manifest that decide what a run holds.

    Raises:
        InputError: the manifest is damaged.
    """
    try:
        until = document["until"]
        return Options(
            traces=bool(document["traces"]),
            until=None if until is None else Precision(*next(iter(until.items()))),
            workers=workers,
            sumo_outputs=document["sumo_outputs"],
        )
    except (KeyError, TypeError, AttributeError, StopIteration):
        raise InputError("manifest.json", "is damaged", "a manifest as a run writes it") from None


def recall_batch(document: dict[str, Any], workers: int | None = None) -> Batch:
    """What the run of a manifest carries out.

    Raises:
        InputError: see ``recall_study``, ``options_of`` and ``batch_of``.
    """
    study = recall_study(document)
    return batch_of(study, options_of(document, workers))


def refuse_other_versions(then: dict[str, Any], now: dict[str, Any]) -> None:
    """Half a run under one version and half under another would be neither."""
    versions_then = then.get("versions")
    for name, version in now["versions"].items():
        before = versions_then.get(name) if isinstance(versions_then, dict) else None
        if before != version:
            raise InputError(
                "--resume",
                f"the run was begun with {name} {before}, this is {version}",
                "the same versions",
            )
    if then.get("models") != now["models"]:
        raise InputError("--resume", "the interaction model has changed", "the same model")
