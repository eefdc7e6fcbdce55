"""Whether the interaction model had a say in a run: only then is it said to have."""

from harness.runs.run_data import RunData
from harness.scenario import Cell
from harness.strategies.parameters import knows_the_model
from harness.strategies.registry import STRATEGIES


def given_the_model(run: RunData) -> list[str]:
    """The strategies of a run that were given the model that its pedestrians are drawn from.

    The manifest says it, since looking at a run imports no module of a user's.  A manifest from
    before it did tells of the built-in strategies alone.
    """
    names: list[str] | None = run.manifest["know_the_model"]
    if names is not None:
        return names
    return [of for of in run.study.driven if of in STRATEGIES and knows_the_model(STRATEGIES[of])]


def model_cells(run: RunData) -> list[Cell]:
    """The cells in which somebody walks or drives by the model."""
    given = {*given_the_model(run)}
    return [
        cell
        for cell in run.study.cells
        if cell.scenario.walks_by_model or given & {*cell.scenario.arms.model_dump().values()}
    ]
