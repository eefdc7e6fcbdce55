"""The strategies and models of a run, as its page names them."""

from harness.core.encounter import Arm
from harness.old.studies.runs.model_use import model_cells
from harness.old.studies.runs.run_data import RunData


def strategies_of(run: RunData, arm: Arm) -> str:
    """Return the strategies of an arm in all cells."""
    names = (getattr(cell.scenario.arms, arm.value) for cell in run.study.cells)
    return ", ".join(dict.fromkeys(names))


def models_of(run: RunData) -> list[dict[str, str]]:
    """Return the manifest's interaction models; empty if no pedestrian or driver used one."""
    return list(run.manifest["simulated_with"]["models"]) if model_cells(run) else []
