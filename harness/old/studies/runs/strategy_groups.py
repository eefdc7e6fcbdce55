"""Groups cells that differ only in the AV's strategy.

Two cells of one study or of several are comparable if they differ only in ``arms.av``, the
parameters of the AV's strategy and its perception.  If the strategy also drives the reference arm,
its parameters change that arm.  Perception that the human shares also changes it.  Cells that
differ in such a key are in different groups.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from harness.core.encounter import Parameters
from harness.scenario import Cell, Scenario, Study, as_written
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import STRATEGIES, table_key

_EQUIPMENT = ("perception.", "actuation.")
"""Sections that belong to the AV, unless they apply to the reference too (``human``)."""


@dataclass(frozen=True)
class StrategyCell:
    """A cell with its AV's strategy, all parameters, and a name that is unique in its group.

    If a cell of the group changes perception or actuation from its default, the section's keys
    count as parameters, by their dotted names.  ``run`` is the index of the cell's run among the
    compared runs.  ``number`` is the cell's index among the cells of all runs.
    """

    run: int
    number: int
    cell: Cell
    strategy: str
    parameters: Parameters
    label: str


@dataclass(frozen=True)
class StrategyGroup:
    """Cells that differ only in the AV's strategy; ``shared`` are the varied keys they share.

    ``repeats`` counts further cells that are equivalent to one of these.  They arise if a grid
    varies a parameter of a strategy that does not drive.
    """

    shared: Parameters
    cells: tuple[StrategyCell, ...]
    repeats: int


_Numbered = tuple[int, int, Cell]
"""Index of the run, index among the cells of all runs, and the cell."""


def groups_over(studies: Sequence[Study], names: Sequence[str] = ("",)) -> list[StrategyGroup]:
    """Return the groups of the cells of several studies, also those of one cell, in order of
    their first cells.

    Args:
        studies: the studies, in order of their numbers.
        names: the name of each study, which ends the labels of its cells.
    """
    members: dict[str, list[_Numbered]] = {}
    number = 0
    for run, study in enumerate(studies):
        for cell in study.cells:
            key = _frozen(all_but_the_strategy(cell.scenario))
            members.setdefault(key, []).append((run, number, cell))
            number += 1
    return [_group(cells, names) for cells in members.values()]


def _group(cells: list[_Numbered], names: Sequence[str]) -> StrategyGroup:
    distinct: dict[str, tuple[_Numbered, str, Parameters]] = {}
    default = {prefix: _equipment(Scenario(), prefix) for prefix in _EQUIPMENT}
    limited = [
        prefix
        for prefix in _EQUIPMENT
        if any(_equipment(cell.scenario, prefix) != default[prefix] for *_, cell in cells)
    ]
    for numbered in cells:
        run, _, cell = numbered
        strategy = cell.scenario.arms.av
        parameters = _parameters(cell.scenario, strategy)
        for prefix in limited:
            keys = _equipment(cell.scenario, prefix)
            parameters |= {f"{prefix}{key}": value for key, value in keys.items()}
        distinct.setdefault(_frozen([run, strategy, parameters]), (numbered, strategy, parameters))
    told_apart = {
        name: None
        for name in _varied(parameters for *_, parameters in distinct.values())
        if name.startswith(_EQUIPMENT)
    }
    members = []
    for (run, number, cell), strategy, parameters in distinct.values():
        alike = (other for _, name, other in distinct.values() if name == strategy)
        prefix = f"{table_key(strategy)}."
        swept = (key.removeprefix(prefix) for key in cell.varied if key.startswith(prefix))
        told = dict.fromkeys([*_varied(alike), *swept]) | told_apart
        words = [strategy]
        words += [f"{_short(n)}={as_written(parameters.get(n))}" for n in told]
        if names[run]:
            words.append(f"({names[run]})")
        members.append(StrategyCell(run, number, cell, strategy, parameters, " ".join(words)))
    _, _, first = cells[0]
    human = table_key(first.scenario.arms.human)
    of_av = [p for p in _EQUIPMENT if not _equipment(first.scenario, p)["human"]]
    av_keys = ("arms.av", "strategies.", *of_av)
    shared = {
        key: value
        for key, value in first.varied.items()
        if not key.startswith(av_keys) or key.startswith(f"{human}.")
    }
    return StrategyGroup(shared, tuple(members), len(cells) - len(members))


_SAYS_NO_MORE = (
    ("experiment", "pairs"),
    ("experiment", "decide_limit_s"),
    ("simulation", "outputs"),
)
"""Keys that do not affect a pair; ``conflicts`` does not either."""


def all_but_the_strategy(scenario: Scenario) -> Parameters:
    """Return the nested tables that two cells must share to be compared pair by pair."""
    tree = scenario.model_dump()
    human = tree["arms"]["human"]
    del tree["arms"]["av"], tree["conflicts"]
    for section, key in _SAYS_NO_MORE:
        if tree[section] is not None:
            del tree[section][key]
    for prefix in _EQUIPMENT:
        if not _equipment(scenario, prefix)["human"]:
            del tree[prefix.removesuffix(".")]
    tree["strategies"] = {human: _parameters(scenario, human)}
    return tree


def _equipment(scenario: Scenario, prefix: str) -> Parameters:
    """The keys of a section of ``_EQUIPMENT``."""
    keys: Parameters = getattr(scenario, prefix.removesuffix(".")).model_dump()
    return keys


def _short(parameter: str) -> str:
    """A parameter's name without the section of ``_EQUIPMENT``."""
    for prefix in _EQUIPMENT:
        parameter = parameter.removeprefix(prefix)
    return parameter


def _parameters(scenario: Scenario, strategy: str) -> Parameters:
    """Return a strategy's parameters with the defaults of shipped strategies, without user code."""
    given = scenario.strategies.get(strategy, {})
    if strategy not in STRATEGIES:
        return dict(given)
    return {p.name: p.default for p in parameters_of(STRATEGIES[strategy])} | given


def _varied(tables: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the parameters whose values differ between tables."""
    all_of = list(tables)
    names = dict.fromkeys(name for table in all_of for name in table)
    return [name for name in names if len({_frozen(table.get(name)) for table in all_of}) > 1]


def _frozen(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=str)
