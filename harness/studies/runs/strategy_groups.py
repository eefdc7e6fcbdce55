"""Cells that differ in the AV's strategy alone, and sweeps of one parameter among them.

What makes two cells comparable, of one study or of several: everything but ``arms.av``, the
parameters of the AV's strategy and its perception is the same.  A parameter of a strategy that also
drives the reference arm changes that arm, and so does perception that the human shares: cells that
differ in it stand apart.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from harness.core.encounter import Parameters
from harness.scenario import Cell, PerceptionSection, Scenario, Study, as_written
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import STRATEGIES, aggressiveness_of, table_key

_PERCEPTION = "perception."


@dataclass(frozen=True)
class StrategyCell:
    """A cell with its AV's strategy, all its parameters, and a name that tells it in its group.

    Where the group's perception is not all default its keys count as parameters, by their dotted
    names.  ``run`` is the place of its run among those compared, ``number`` its own among the
    cells of all of them.
    """

    run: int
    number: int
    cell: Cell
    strategy: str
    parameters: Parameters
    label: str


@dataclass(frozen=True)
class StrategyGroup:
    """Cells that differ in the AV's strategy alone; ``shared`` are the varied keys they share.

    ``repeats`` counts further cells that are the same as one of these in all that matters, as when
    a grid varies a parameter of a strategy that does not drive.
    """

    shared: Parameters
    cells: tuple[StrategyCell, ...]
    repeats: int


@dataclass(frozen=True)
class ParameterSweep:
    """Cells of a group that differ in one numeric parameter of one strategy.

    ``cells`` are positions in the group, ``values`` the parameter's there, rising; ``fixed`` holds
    the strategy's other parameters where the group varies them too.
    """

    strategy: str
    parameter: str
    fixed: Parameters
    cells: tuple[int, ...]
    values: tuple[float, ...]

    @property
    def key(self) -> str:
        """The parameter as a scenario writes it."""
        if self.of_perception:
            return self.parameter
        return f"{table_key(self.strategy)}.{self.parameter}"

    @property
    def of_perception(self) -> bool:
        """Whether it is a key of ``[perception]``, not of the strategy."""
        return self.parameter.startswith(_PERCEPTION)

    @property
    def aggressiveness(self) -> tuple[float, ...] | None:
        """The aggressiveness at every value, where the parameter is known to stand for it."""
        sign = aggressiveness_of(self.strategy).get(self.parameter)
        # No negative zero: a margin of 0 is an aggressiveness of 0.
        return None if sign is None else tuple(sign * value + 0.0 for value in self.values)


_Numbered = tuple[int, int, Cell]
"""Place of the run, number among the cells of all runs, the cell."""


def strategy_groups(study: Study) -> list[StrategyGroup]:
    """The groups of a study, in order of their first cells; also those of one cell."""
    return groups_over([study])


def groups_over(studies: Sequence[Study], names: Sequence[str] = ("",)) -> list[StrategyGroup]:
    """The groups of the cells of several studies; see ``strategy_groups``.

    Args:
        studies: in order of their numbers.
        names: of each, to end its cells' labels with.
    """
    members: dict[str, list[_Numbered]] = {}
    number = 0
    for run, study in enumerate(studies):
        for cell in study.cells:
            key = _frozen(all_but_the_strategy(cell.scenario))
            members.setdefault(key, []).append((run, number, cell))
            number += 1
    return [_group(cells, names) for cells in members.values()]


def parameter_sweeps(group: StrategyGroup) -> list[ParameterSweep]:
    """Every set of at least two cells that differ in one numeric parameter alone."""
    sweeps = []
    for strategy in dict.fromkeys(member.strategy for member in group.cells):
        sets = {i: m.parameters for i, m in enumerate(group.cells) if m.strategy == strategy}
        varied = _varied(sets.values())
        for parameter in varied:
            lines: dict[str, list[int]] = {}
            for position, parameters in sets.items():
                if _is_number(parameters.get(parameter)):
                    others = {name: parameters.get(name) for name in varied if name != parameter}
                    key = _frozen([group.cells[position].run, others])
                    lines.setdefault(key, []).append(position)
            for positions in lines.values():
                if len(positions) > 1:
                    sweeps.append(_sweep(strategy, parameter, varied, positions, sets))
    return sweeps


def _sweep(
    strategy: str,
    parameter: str,
    varied: list[str],
    positions: list[int],
    parameters: Mapping[int, Parameters],
) -> ParameterSweep:
    ordered = sorted(positions, key=lambda position: parameters[position][parameter])
    first = parameters[ordered[0]]
    return ParameterSweep(
        strategy,
        parameter,
        {name: first.get(name) for name in varied if name != parameter},
        tuple(ordered),
        tuple(float(parameters[position][parameter]) for position in ordered),
    )


def _group(cells: list[_Numbered], names: Sequence[str]) -> StrategyGroup:
    distinct: dict[str, tuple[_Numbered, str, Parameters]] = {}
    limited = any(cell.scenario.perception != PerceptionSection() for _, _, cell in cells)
    for numbered in cells:
        run, _, cell = numbered
        strategy = cell.scenario.arms.av
        parameters = _parameters(cell.scenario, strategy)
        if limited:
            seen = cell.scenario.perception.model_dump()
            parameters |= {f"{_PERCEPTION}{key}": value for key, value in seen.items()}
        distinct.setdefault(_frozen([run, strategy, parameters]), (numbered, strategy, parameters))
    seen_apart = {
        name: None
        for name in _varied(parameters for *_, parameters in distinct.values())
        if name.startswith(_PERCEPTION)
    }
    members = []
    for (run, number, cell), strategy, parameters in distinct.values():
        alike = (other for _, name, other in distinct.values() if name == strategy)
        prefix = f"{table_key(strategy)}."
        swept = (key.removeprefix(prefix) for key in cell.varied if key.startswith(prefix))
        told = dict.fromkeys([*_varied(alike), *swept]) | seen_apart
        words = [strategy]
        words += [f"{n.removeprefix(_PERCEPTION)}={as_written(parameters.get(n))}" for n in told]
        if names[run]:
            words.append(f"({names[run]})")
        members.append(StrategyCell(run, number, cell, strategy, parameters, " ".join(words)))
    _, _, first = cells[0]
    human = table_key(first.scenario.arms.human)
    sees = first.scenario.perception.human
    av_keys = ("arms.av", "strategies.", *(() if sees else (_PERCEPTION,)))
    shared = {
        key: value
        for key, value in first.varied.items()
        if not key.startswith(av_keys) or key.startswith(f"{human}.")
    }
    return StrategyGroup(shared, tuple(members), len(cells) - len(members))


_SAYS_NO_MORE = (("experiment", "pairs"), ("experiment", "decide_limit_s"))
"""Keys that change nothing of a pair; nor do ``conflicts`` and ``limits``."""


def all_but_the_strategy(scenario: Scenario) -> Parameters:
    """Nested tables of what two cells must share to be compared pair by pair."""
    tree = scenario.model_dump()
    human = tree["arms"]["human"]
    del tree["arms"]["av"], tree["conflicts"], tree["limits"]
    for section, key in _SAYS_NO_MORE:
        del tree[section][key]
    if not scenario.perception.human:
        del tree["perception"]
    tree["strategies"] = {human: _parameters(scenario, human)}
    return tree


def _parameters(scenario: Scenario, strategy: str) -> Parameters:
    """With the defaults of the shipped strategies filled in; a user's code is not needed here."""
    given = scenario.strategies.get(strategy, {})
    if strategy not in STRATEGIES:
        return dict(given)
    return {p.name: p.default for p in parameters_of(STRATEGIES[strategy])} | given


def _varied(tables: Iterable[Mapping[str, Any]]) -> list[str]:
    """Parameters that are not the same in all tables."""
    all_of = list(tables)
    names = dict.fromkeys(name for table in all_of for name in table)
    return [name for name in names if len({_frozen(table.get(name)) for table in all_of}) > 1]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _frozen(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=str)
