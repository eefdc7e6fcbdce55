"""A cell's findings over pairs and refits of the interaction model together."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from harness.core.documents import JsonObject
from harness.core.errors import InputError
from harness.old.statistics import CONFIDENCE, Findings, OverModel, Plain, over_model
from harness.old.store.kinds import Kind
from harness.old.store.reading import MANIFEST
from harness.scenario import Cell


def findings_over_model(
    kind: Kind,
    rows: pa.Table,
    cell: Cell,
    findings: Findings,
    manifest: Mapping[str, Any],
) -> dict[str, OverModel]:
    """The interval of each number that has one, over pairs and refits together, by its name.

    Args:
        kind: the kind of the run.
        rows: the rows of a cell by pair.
        cell: the cell; without ``model.over_refits`` the result is empty.
        findings: its findings over all pairs.
        manifest: the run's manifest, which has the number of refits.
    """
    if not cell.scenario.model.over_refits:
        return {}
    refits = refits_of(manifest)
    refit = rows["pair"].to_numpy() % refits["count"]
    by_refit = [
        kind.findings(rows.filter(pa.array(refit == number)), cell, 0.0)
        for number in np.unique(refit)
    ]
    confidence = findings["confidence"].number or CONFIDENCE
    vehicles = refits["effective_vehicles"]
    return {
        name: over_model(usual, [of[name].number for of in by_refit], vehicles, confidence)
        for name, usual in findings.items()
        if usual.low is not None
    }


def over_model_rows(intervals: Mapping[str, OverModel]) -> Iterator[dict[str, Plain]]:
    """The rows of a cell in ``over_model.csv``."""
    for name, found in intervals.items():
        yield {
            "number": name,
            "value": found.value,
            "ci_low": found.low,
            "ci_high": found.high,
            "model_share": found.share,
            "model_share_ci_low": found.share_low,
            "model_share_ci_high": found.share_high,
            "refits": found.refits,
        }


def refits_of(manifest: Mapping[str, Any]) -> JsonObject:
    """The record of the refits in a manifest.

    Raises:
        InputError: there is none.
    """
    for model in manifest["simulated_with"]["models"]:
        if "refits" in model:
            refits: JsonObject = model["refits"]
            return refits
    raise InputError(f"{MANIFEST}: simulated_with.models", "have no refits", "those of the run")
