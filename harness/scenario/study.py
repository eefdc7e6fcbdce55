"""A scenario file in; the cells of its study out: one cell, or a grid of varied keys."""

from collections.abc import Mapping, Sequence
from dataclasses import InitVar, dataclass
from pathlib import Path
from typing import Any

from harness.core.documents import as_plain
from harness.core.errors import InputError, Parameter, Place, checked, inside, nearest_name
from harness.core.freezing import Frozen
from harness.scenario.consistency import check_effects
from harness.scenario.file import ScenarioFile, Setting, parts_of, validate
from harness.scenario.scenario import Scenario
from harness.scenario.variation import Variation, planned_cells


@dataclass(frozen=True)
class Cell(Frozen):
    """One cell of a study.

    ``number`` is its position in the tables; seeds do not depend on it.  ``varied`` holds the
    varied keys with this cell's values.  The scenario is checked, unless the caller knows that it
    is ``valid``.
    """

    number: int
    varied: Mapping[str, Any]
    scenario: Scenario
    valid: InitVar[bool] = False

    def __post_init__(self, valid: bool) -> None:
        """Check the scenario, and copy ``varied`` into a read-only mapping."""
        if not valid:
            object.__setattr__(self, "scenario", validate(self.scenario.model_dump(), "scenario"))
        super().__post_init__()


@dataclass(frozen=True)
class Study:
    """All cells of a run, in order: the last varied key changes fastest.

    ``base`` is the scenario without the variation.  Each key has an effect in one of the cells in
    which it is set.
    """

    name: str
    base: Scenario
    cells: tuple[Cell, ...]

    def __post_init__(self) -> None:
        """Refuse keys without effect."""
        check_effects(cell.scenario for cell in self.cells)

    @property
    def driven(self) -> list[str]:
        """The names of the strategies that drive in any cell, without repetition."""
        arms = (cell.scenario.arms.model_dump().values() for cell in self.cells)
        return list(dict.fromkeys(name for names in arms for name in names))

    def cell(self, number: int) -> Cell:
        """The cell with a number.

        Raises:
            InputError: there is none.
        """
        if number not in (known := range(len(self.cells))):
            raise InputError(Parameter("cell", number), "there is none", f"0 to {known[-1]}")
        return self.cells[known.index(number)]

    @property
    def long_pairs(self) -> bool:
        """Whether a pair takes long: a simulation.

        A long pair is a task of its own, with the pairs of cells that share its AV's arm.
        """
        return self.cells[0].scenario.kind != "encounters"

    @property
    def varied_keys(self) -> list[str]:
        """The varied keys in the given order; empty for a run of one cell."""
        return list(self.cells[0].varied)


@checked
def study_of(file: ScenarioFile, variations: Sequence[Variation] = ()) -> Study:
    """The cells of a run, from ``variations``, or else the file's ``[sweep]``; otherwise one cell.

    A key to which a setting gives a value is left out of the file's grid.

    Args:
        file: the scenario with its settings.
        variations: keys with their values; every combination is a cell.

    Raises:
        InputError: a key or value is not accepted, a key varies twice or is also set, two cells are
            equal, or parameters are given to a strategy that drives in no cell.
    """
    in_file = file.sweep is not None and not variations
    source: Place = f"{file.source}: sweep" if in_file else Parameter("vary")
    points = planned_cells(file, variations, source)
    keys = list(dict.fromkeys(key for point in points for key in point))
    if "experiment.pairs" in keys:
        where = inside(source, "experiment.pairs")
        raise InputError(where, "cannot vary", "one number of pairs for all cells")
    cells: list[Cell] = []
    seen: dict[str, int] = {}
    for number, point in enumerate(points):
        scenario = file.cell([Setting(key, value, source) for key, value in point.items()])
        dumped = scenario.model_dump()
        # A speed with a unit is a number from here on, and a class is a name.
        varied = {
            key: point[key]
            if key in point and not isinstance(point[key], str | type)
            else _value_at(dumped, key)
            for key in keys
        }
        if (first := seen.setdefault(repr(dumped), number)) != number:
            what = ", ".join(f"{key}={value}" for key, value in varied.items())
            problem = f"cells {first} and {number} are the same ({what})"
            raise InputError(source, problem, "each value once")
        cells.append(Cell(number, varied, scenario, valid=True))
    base, more = file.cell(), [Setting(key, None, source) for key in keys]
    every = [base, *(cell.scenario for cell in cells)]
    if len({(each.traffic is None, each.simulation is None) for each in every}) > 1:
        allowed = "[traffic] or [simulation] in the file and every cell, or in none"
        raise InputError(source, "cells are of different kinds", allowed)
    with file.located(more):
        study = Study(file.name, base, tuple(cells))
    _check_driven(study, [*file.settings, *more])
    return study


def _check_driven(study: Study, settings: Sequence[Setting]) -> None:
    """Refuse settings of a strategy's parameters if the strategy drives in no cell."""
    for setting in settings:
        section, *names = parts_of(setting)
        if section == "strategies" and names and names[0] not in study.driven:
            where = inside(setting.source, setting.key)
            allowed = f"a parameter of {' or '.join(study.driven)}"
            near = nearest_name(names[0], study.driven)
            raise InputError(where, f"{names[0]} drives in no cell", allowed, near)


def study_from(document: Mapping[str, Any], where: str) -> Study:
    """The study of a manifest: its scenario and the varied keys of each cell.

    Args:
        document: the manifest, with ``name``, ``scenario`` and ``cells``.
        where: name of the file in messages.

    Raises:
        InputError: the scenario or a varied value is not accepted.
    """
    file = ScenarioFile(document["name"], where, document["scenario"], None, (), Path())
    cells = []
    for number, varied in enumerate(document["cells"]):
        own = [Setting(key, value, where) for key, value in varied.items() if value is not None]
        cells.append(Cell(number, varied, file.cell(own), valid=True))
    return Study(file.name, file.cell(), tuple(cells))


def as_written(value: Any) -> str:
    """A value of a scenario as a user would write it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:g}" if isinstance(value, float) else str(as_plain(value))


def _value_at(tree: Mapping[str, Any], key: str) -> Any:
    """The value of a varied key in a cell that does not set it; None if there is no such key."""
    node: Any = tree
    for name in parts_of(Setting(key, None)):
        node = node.get(name) if isinstance(node, Mapping) else None
    return node
