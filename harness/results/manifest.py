"""The manifest of a run: everything it depends on, written down, recalled, and checked."""

from collections.abc import Iterable, Mapping
from typing import Any

from harness.errors import InputError
from harness.interaction import InteractionModel
from harness.results.tables import SCHEMA
from harness.scenario import Options, Precision, Study
from harness.scenario.options import AUDIT_SHARE
from harness.strategies.parameters import knows_the_model
from harness.strategies.registry import find_strategy, source_digests
from harness.versions import versions_of_runs


def manifest_of(
    study: Study,
    models: Iterable[InteractionModel],
    options: Options,
    counts: dict[str, int] | None = None,
) -> dict[str, Any]:
    """Everything a run depends on; ``counts`` is null until its tables are finished."""
    until = options.until
    used = {model.name: model.sha256 for model in models}
    arms = [name for cell in study.cells for name in cell.scenario.arms.model_dump().values()]
    driven = dict.fromkeys(arms)
    return {
        "schema": SCHEMA,
        "name": study.name,
        "scenario": study.base.model_dump(),
        "cells": [dict(cell.varied) for cell in study.cells],
        "traces": options.traces,
        "sumo_outputs": options.sumo_outputs,
        "engine": options.engine,
        "audit": options.audit if options.engine == "plain" else None,
        "until": None if until is None else {until.measure: until.half_width},
        "seed": study.base.experiment.seed,
        "know_the_model": [of for of in driven if knows_the_model(find_strategy(of, "arms"))],
        "versions": {**versions_of_runs(), **source_digests(driven)},
        "models": [{"name": name, "sha256": sha256} for name, sha256 in used.items()],
        "counts": counts,
    }


def options_of(document: Mapping[str, Any], workers: int | None = None) -> Options:
    """The options of a manifest, as ``read_manifest`` gives it, that decide what a run holds."""
    until = document["until"]
    return Options(
        traces=document["traces"],
        until=None if until is None else Precision(*next(iter(until.items()))),
        workers=workers,
        sumo_outputs=document["sumo_outputs"],
        engine=document["engine"],
        audit=AUDIT_SHARE if document["audit"] is None else document["audit"],
    )


def refuse_other_versions(then: dict[str, Any], now: dict[str, Any]) -> None:
    """Half a run under one version and half under another would be neither."""
    for name, version in now["versions"].items():
        before = then["versions"].get(name)
        if before != version:
            raise InputError(
                "resume",
                f"the run was begun with {name} {before}, this is {version}",
                "the same versions",
            )
    if then["models"] != now["models"]:
        raise InputError("resume", "the interaction model has changed", "the same model")
