"""What a run was made from, as its page names it."""

from harness.core.encounter import Arm
from harness.studies.runs.model_use import model_cells
from harness.studies.runs.run_data import RunData


def strategies_of(run: RunData, arm: Arm) -> str:
    """The strategies of an arm in all cells."""
    names = (getattr(cell.scenario.arms, arm.value) for cell in run.study.cells)
    return ", ".join(dict.fromkeys(names))


def models_of(run: RunData) -> list[dict[str, str]]:
    """The interaction models of the manifest; none if nobody walked or drove by them."""
    return list(run.manifest["simulated_with"]["models"]) if model_cells(run) else []
