"""The folder into which a run is written: claimed, locked, logged; what its results depend on."""

import json
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, cast

import filelock

from harness.core.errors import InputError, Parameter, advised
from harness.core.files import cannot_write
from harness.core.versions import versions_of_runs
from harness.model.interaction import InteractionModel
from harness.results import folder as folders
from harness.results.estimators import CONFIDENCE
from harness.scenario import EngineName, Study
from harness.strategies.parameters import knows_the_model
from harness.strategies.registry import find_strategy, source_digests


class RunFolder:
    """The folder of a run, locked by this process until ``close``.

    Args:
        path: an existing folder.

    Raises:
        InputError: another process works on this run, or nobody may write in the folder.
        HarnessError: the file system refuses (full).
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = filelock.FileLock(path / ".lock", timeout=0)
        try:
            # The operating system releases the lock when the process ends, even if it is killed.
            self._lock.acquire()
        except filelock.Timeout:
            raise InputError(str(path), "another process is working on this run") from None
        except OSError as error:
            raise cannot_write(path, error) from None

    def close(self) -> None:
        """Release the folder; the lock's file stays, because another process may have opened it."""
        self._lock.release()

    def note(self, event: str, **details: Any) -> None:
        """Append a line to the log, the only file of a run with time stamps."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        try:
            with (self.path / folders.LOG).open("a", encoding="utf-8") as file:
                file.write(json.dumps({"time": now, "event": event, **details}) + "\n")
        except OSError as error:
            raise cannot_write(self.path / folders.LOG, error) from None


def claim_folder(out: Path | str | None, name: str) -> Path:
    """Make the folder of a new run.

    Args:
        out: a new or empty folder, or None for ``runs/<name>-<next free number>``.
        name: the scenario's name.

    Raises:
        InputError: the folder holds a run or anything else, is a file, or cannot be made there.
        HarnessError: the file system refuses (full).
    """
    number = 1
    while out is None and (Path("runs") / f"{name}-{number}").exists():
        number += 1
    folder = Path("runs") / f"{name}-{number}" if out is None else Path(out)
    where, empty = Parameter("out", folder), "a new or empty folder"
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(where, "is a file", empty)
        folder.mkdir(parents=True, exist_ok=out is not None)
        # A run that ended before its manifest was written leaves hidden files.
        names = {file.name for file in folder.glob("[!.]*")}
    except OSError as error:
        if out is None and isinstance(error, FileExistsError) and folder.exists():
            return claim_folder(out, name)  # another run took the number
        raise cannot_write(where, error) from None
    if folders.MANIFEST in names:
        raise InputError(where, "already holds a run", f"{empty}, or {advised('resume', folder)}")
    if names:
        raise InputError(where, "is not empty", empty)
    return folder


def manifest_of(
    study: Study,
    models: Iterable[InteractionModel],
    *,
    traces: bool,
    engine: EngineName,
    pairs_per_part: int,
    files: Mapping[str, str] = MappingProxyType({}),
    risk: folders.RiskAsked | None = None,
) -> folders.Manifest:
    """The manifest: everything on which a run depends.

    Args:
        study: the study.
        models: the interaction model of each cell.
        files: hashes of the user's files that are simulated, by their paths.
        traces: whether traces are kept.
        engine: the engine.
        pairs_per_part: number of pairs of a part.
        risk: what a risk is of.
    """
    know = [name for name in study.driven if knows_the_model(find_strategy(name, "arms"))]
    document: folders.Manifest = {
        "schema": folders.schema_digest(),
        "kind": study.base.kind if risk is None else "risk",
        "name": study.name,
        "scenario": study.base.model_dump(),
        "cells": [dict(cell.varied) for cell in study.cells],
        "traces": traces,
        "engine": engine,
        "confidence": CONFIDENCE,
        "pairs_per_part": pairs_per_part,
        "seed": study.base.experiment.seed,
        "know_the_model": know,
        "simulated_with": simulated_with(study.driven, models, files),
        "digest": "",
    }
    if risk is not None:
        document["risk"] = risk
    return cast(folders.Manifest, folders.sealed(document))


def simulated_with(
    drivers: Iterable[str],
    models: Iterable[InteractionModel],
    files: Mapping[str, str] = MappingProxyType({}),
) -> folders.SimulatedWith:
    """The versions, code, the user's strategies and files, and the models of results."""
    return {
        "versions": versions_of_runs(),
        "code": folders.code_of_rows(),
        "strategies": source_digests(drivers),
        "models": {model.name: model.sha256 for model in models},
        "files": dict(files),
    }


_CHANGES: Mapping[Literal["code", "strategies", "files", "models", "versions"], str] = {
    "code": "the harness's code of {} has changed since the run",
    "strategies": "the strategy {} has been edited since the run",
    "files": "{} has changed since the run",
    "models": "the interaction model {} has changed since the run",
    "versions": "the run was simulated with {} {}, this is {}",
}


def changes(then: folders.SimulatedWith, now: folders.SimulatedWith) -> Iterator[str]:
    """What has changed since a run, in words, from two results of ``simulated_with``."""
    for kind, words in _CHANGES.items():
        for name, value in now[kind].items():
            if (before := then[kind].get(name)) != value:
                yield words.format(name, before, value)


def refuse_changes(folder: Path, then: folders.SimulatedWith, now: folders.SimulatedWith) -> None:
    """Refuse to resume a run if versions, code, strategies or models have changed since it began.

    Raises:
        InputError: names the first change.
    """
    for change in changes(then, now):
        raise InputError(str(folder), change, "what the run began with, or a new run")
