"""Cells of one run or of several that differ only in the AV, in groups."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow.compute as pc

from harness.core.freezing import Frozen
from harness.core.vocabulary import Arm
from harness.results.catalogue import AnySample
from harness.results.cell_findings import CellFindings, sample_of
from harness.results.cell_tables import driver_of
from harness.results.finding import Plain
from harness.results.loaded_run import Run
from harness.results.place import name_of
from harness.results.tables import COUNTED
from harness.scenario import Scenario
from harness.scenario.study import as_written
from harness.scenario.variation import flatten
from harness.strategies.parameters import defaults_of
from harness.strategies.registry import STRATEGIES

_SHARED = ("traffic", "simulation")
"""Sections with a share of AVs."""


@dataclass(frozen=True)
class Candidate(Frozen):
    """A cell as one of several strategies that met the same people.

    ``label`` tells it from the others of its group; ``shared`` are the swept keys of the group, and
    ``own`` those of its AV but for the strategy.  ``origin`` names its run if there are several.
    """

    run: Run
    cell: CellFindings
    label: str
    shared: Mapping[str, Plain]
    own: tuple[str, ...]
    origin: str

    @property
    def driven(self) -> str:
        """The label, with the fallback if it drove most passages that met someone."""
        return self.label.replace(self.cell.scenario.arms.av, driver_of(self.cell, Arm.AV), 1)

    @property
    def name(self) -> str:
        """Its name among the cells of all groups and runs."""
        return ", ".join(filter(None, [name_of(self.shared), self.label]))

    @property
    def av_share(self) -> float:
        """The share of AVs; of encounters 1."""
        section = self.cell.scenario.traffic or self.cell.scenario.simulation
        return 1.0 if section is None else section.av_share

    def sample(self, pairs: int) -> AnySample:
        """The columns of its first pairs, without intervals of its own."""
        number, scenario = self.cell.number, self.cell.scenario
        tables = {name: self.run.rows(name, number) for name in COUNTED[self.run.kind]}
        first = {name: rows.filter(pc.less(rows["pair"], pairs)) for name, rows in tables.items()}
        return sample_of(first, scenario, 0.0)


def groups_of(runs: Sequence[Run]) -> list[list[Candidate]]:
    """The cells that differ only in the AV, in groups, in the order of their first cells."""
    names = Counter(run.path.name for run in runs)
    members: dict[str, list[tuple[Run, CellFindings, str]]] = {}
    for run in runs:
        name = run.path.name if names[run.path.name] == 1 else str(run.path)
        for cell in run.cells:
            key = _as_text(without_av(cell.scenario))
            members.setdefault(key, []).append((run, cell, name if len(runs) > 1 else ""))
    return [_group(cells) for cells in members.values()]


def without_av(scenario: Scenario) -> dict[str, Any]:
    """What two cells must share to be compared pair by pair.

    The AV's strategy, its parameters, and perception and actuation that the reference does not have
    are left out, and so are the share of AVs and the thresholds of conflicts.
    """
    human = scenario.arms.human
    tree = scenario.model_dump(exclude={"conflicts": True, "arms": {"av"}})
    del tree["experiment"]["pairs"], tree["experiment"]["decide_limit_s"]
    for equipment in ("perception", "actuation"):
        if not tree[equipment]["human"]:
            del tree[equipment]
    for place in _SHARED:
        (tree[place] or {}).pop("av_share", None)
    tree["strategies"] = {human: _parameters(scenario, human)}
    return tree


def _parameters(scenario: Scenario, strategy: str) -> dict[str, Any]:
    """A strategy's parameters; of a shipped one with its defaults, so that no user code runs."""
    given = dict(scenario.strategies.get(strategy, {}))
    if strategy not in STRATEGIES:
        return given
    return defaults_of(STRATEGIES[strategy]) | given


def _of_av(scenario: Scenario) -> dict[str, Any]:
    """The AV's strategy, parameters and equipment by dotted key."""
    av = scenario.arms.av
    tree = scenario.model_dump(include={"perception", "actuation", *_SHARED})
    shares = {f"{name}.av_share": (tree.pop(name) or {}).get("av_share") for name in _SHARED}
    own = flatten({"strategies": {av: _parameters(scenario, av)}, **tree})
    return {"arms.av": av, **own, **{key: one for key, one in shares.items() if one is not None}}


def _group(cells: Sequence[tuple[Run, CellFindings, str]]) -> list[Candidate]:
    """The cells of a group, each AV of a run once."""
    owns = [_of_av(cell.scenario) for _, cell, _ in cells]
    of_any = {key for own in owns for key in own}
    found: dict[str, Candidate] = {}
    for (run, cell, origin), own in zip(cells, owns, strict=True):
        alike = [other for other in owns if other["arms.av"] == own["arms.av"]]
        varied = [key for key in own if len({_as_text(other.get(key)) for other in alike}) > 1]
        swept = [key for key in cell.varied if key in own and key != "arms.av"]
        told = dict.fromkeys([*varied, *swept])
        words = [f"{key.rpartition('.')[2]}={as_written(own[key])}" for key in told]
        label = " ".join([own["arms.av"], *words, *([f"({origin})"] if origin else [])])
        shared = {key: value for key, value in cell.varied.items() if key not in of_any}
        candidate = Candidate(run, cell, label, shared, tuple(swept), origin)
        found.setdefault(_as_text([origin, own]), candidate)
    return [*found.values()]


def _as_text(value: object) -> str:
    return json.dumps(value, sort_keys=True, default=str)
