"""Whether the interaction model had a say in a run: only then is it said to have."""

from harness.scenario import Cell
from harness.studies.runs.run_data import RunData


def given_the_model(run: RunData) -> list[str]:
    """The strategies of a run that were given the model that its pedestrians are drawn from.

    The manifest names them, since looking at a run imports no module of a user's.
    """
    names: list[str] = run.manifest["know_the_model"]
    return names


def model_cells(run: RunData) -> list[Cell]:
    """The cells in which somebody walks or drives by the model."""
    given = {*given_the_model(run)}
    return [
        cell
        for cell in run.study.cells
        if cell.scenario.walks_by_model or given & {*cell.scenario.arms.model_dump().values()}
    ]
