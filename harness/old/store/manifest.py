"""The manifest of a run, which records everything the run depends on."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from harness.core.documents import JsonObject
from harness.core.errors import InputError
from harness.core.versions import versions_of_runs
from harness.model.interaction import InteractionModel
from harness.old.store.schemas import SCHEMA
from harness.scenario import Options, Scenario, Study
from harness.strategies.parameters import knows_the_model
from harness.strategies.registry import find_strategy, source_digests


def origin_of(study: Study, models: Iterable[InteractionModel]) -> JsonObject:
    """The part of the manifest about the versions, strategies and models of a new run."""
    driven = study.driven
    return {
        "know_the_model": [name for name in driven if knows_the_model(find_strategy(name, "arms"))],
        "simulated_with": _simulated_now(driven, models),
        "scored_with": {"versions": versions_of_runs()},
    }


def _simulated_now(driven: Iterable[str], models: Iterable[InteractionModel]) -> JsonObject:
    used: dict[str, JsonObject] = {}
    for model in models:
        used[model.name] = model_entry(model)
    return {
        "versions": versions_of_runs(),
        "strategies": source_digests(driven),
        "models": [*used.values()],
    }


def model_entry(model: InteractionModel) -> JsonObject:
    """A model in the manifest."""
    return {"name": model.name, "sha256": model.sha256}


def manifest_of(
    study: Study,
    origin: Mapping[str, Any],
    options: Options,
    counts: dict[str, int] | None = None,
) -> JsonObject:
    """The manifest: everything a run depends on.

    Args:
        study: the study.
        origin: see ``origin_of``.
        options: the options of the run.
        counts: None until the tables are finished.
    """
    return {
        "schema": SCHEMA,
        "name": study.name,
        "scenario": study.base.model_dump(),
        "cells": [dict(cell.varied) for cell in study.cells],
        "traces": options.traces,
        "engine": options.engine,
        "seed": study.base.experiment.seed,
        **origin,
        "counts": counts,
    }


def options_of(document: Mapping[str, Any], workers: int | None = None) -> Options:
    """The options of a run from its manifest as returned by ``read_manifest``."""
    return Options(
        traces=document["traces"],
        workers=workers,
        engine=document["engine"],
    )


def refuse_other_versions(then: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Refuse to resume a run if versions, strategies or models have changed since it began.

    Args:
        then: the manifest's ``simulated_with``.
        now: the same part for this installation.
    """
    for change in _changes(then, now):
        raise InputError("resume", change, "the versions, strategies and model of its beginning")


def explained(
    differences: Iterable[str],
    document: Mapping[str, Any],
    scenario: Scenario,
    model: InteractionModel,
) -> tuple[str, ...]:
    """Changes since the run, then the differences of a repeated episode from its record.

    Args:
        differences: the differences in words; without any, nothing is returned.
        document: the run's manifest.
        scenario: the scenario of the episode's cell.
        model: the interaction model of the repetition.
    """
    if not (words := tuple(differences)):
        return ()
    now = _simulated_now(scenario.arms.model_dump().values(), [model])
    return *_changes(document["simulated_with"], now), *words


def _changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """The changes in ``simulated_with``, in words."""
    for name, digest in now["strategies"].items():
        if then["strategies"].get(name) != digest:
            yield f"the strategy {name} has been edited since the run"
    models = {model["name"]: model for model in then["models"]}
    for model in now["models"]:
        entry = models.get(model["name"], {})
        before = entry.get("sha256")
        if before != model["sha256"]:
            had = "" if before is None else f" (sha256 {model['sha256'][:8]}…, not {before[:8]}…)"
            yield f"the interaction model {model['name']} has changed since the run{had}"
    for name, version in now["versions"].items():
        before = then["versions"].get(name)
        if before != version:
            yield f"the run was simulated with {name} {before}, this is {version}"
