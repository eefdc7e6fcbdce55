"""What is done with scenarios and folders: runs, comparisons, risks, models, exports, checks."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.results.result import Result


def result_of(path: Path, settings: Mapping[str, Any] | None = None) -> "Result":
    """What a run or a risk says; of a run also with other thresholds, see ``load_run``.

    The study of risks is imported for a risk alone.
    """
    from harness.results.folder import read_manifest
    from harness.results.loaded_run import load_run

    if settings or read_manifest(path)["kind"] != "risk":
        return load_run(path, settings).result()
    from harness.studies.risk.estimate import read_risk

    return read_risk(path)


def resumed(path: Path, **options: Any) -> "Result":
    """Continue an interrupted run or risk, with the ``options`` of ``run.resume``."""
    from harness.results.folder import read_manifest
    from harness.studies.running.run import resume

    if read_manifest(path)["kind"] != "risk":
        return resume(path, **options).result()
    from harness.studies.risk import estimate

    return estimate.resume_risk(path, **options)
