"""Finds the cells of a run in which the interaction model was used."""

from harness.old.studies.runs.run_data import RunData
from harness.scenario import Cell


def given_the_model(run: RunData) -> list[str]:
    """Return the strategies that received the model from which the pedestrians are drawn.

    The names come from the manifest, so that opening a run imports no user module.
    """
    names: list[str] = run.manifest["know_the_model"]
    return names


def model_cells(run: RunData) -> list[Cell]:
    """Return the cells in which pedestrians or a driver use the model."""
    informed = {*given_the_model(run)}
    return [
        cell
        for cell in run.study.cells
        if cell.scenario.walks_by_model or informed & {*cell.scenario.arms.model_dump().values()}
    ]
