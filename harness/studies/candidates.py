"""Cells of one run or of several that differ only in the AV, in groups: who may be compared."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow.compute as pc

from harness.core.errors import InputError, Parameter
from harness.core.freezing import Frozen
from harness.core.vocabulary import ROUNDING, Arm
from harness.results.catalogue import ENTRY_OF, AnySample
from harness.results.cell_findings import CellFindings, sample_of
from harness.results.cell_tables import driver_of
from harness.results.columns import REFERENCE
from harness.results.finding import Plain
from harness.results.loaded_run import Run
from harness.results.place import name_of
from harness.results.tables import COUNTED, RunKind, Tables
from harness.scenario import Scenario
from harness.scenario.study import as_written
from harness.scenario.variation import flatten
from harness.strategies.parameters import defaults_of
from harness.strategies.registry import STRATEGIES

_SHARED = ("traffic", "simulation")
"""Sections with a share of AVs."""

_REFERENCE: Mapping[RunKind, tuple[Any, ...]] = {
    "encounters": ("crashed", "steps", "pedestrians", "pass_time_s", "pedestrian_delay_s"),
    "simulations": tuple(
        ENTRY_OF[key].estimate.column for key in ("passages", "people", "people_wait_s")
    ),
}
"""Columns that are equal if the reference met the same people and drove alike."""


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
        first = {n: rows.filter(pc.less(rows["pair"], pairs)) for n, rows in self._tables.items()}
        return sample_of(first, self.cell.scenario, 0.0)

    @cached_property
    def _tables(self) -> Tables:
        """All rows of the cell, which is compared with every other cell of its group."""
        return {name: self.run.rows(name, self.cell.number) for name in COUNTED[self.run.kind]}


def comparable(runs: Sequence[Run]) -> tuple[list[list[Candidate]], list[Candidate]]:
    """The groups of several cells, and the cells that cannot be compared with any other.

    Raises:
        InputError: there is no run; one is not finished, of another kind or named twice; a run has
            no such group, with another run if there are several; or the reference met other people
            in one of the runs.
    """
    _refuse_runs(runs)
    every = groups_of(runs)
    groups, least = [group for group in every if len(group) > 1], min(len(runs), 2)
    joint = [group for group in groups if len({each.origin for each in group}) >= least]
    met = {each.run.path for group in joint for each in group}
    for alone in (run for run in reversed(runs) if run.path not in met):
        raise _nothing_to_compare([*[run for run in runs if run is not alone][:1], alone])
    for group in groups:
        _refuse_other_people(group)
    return groups, [group[0] for group in every if len(group) == 1]


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


def _refuse_runs(runs: Sequence[Run]) -> None:
    """Refuse no run, and runs that are not finished, of different kinds or code, or the same."""
    if not runs:
        raise InputError(Parameter("runs"), "there is none", "one or more")
    for number, run in enumerate(runs):
        run.refuse_unfinished()
        if run.kind != runs[0].kind:
            allowed = f"runs of {runs[0].kind}, as {runs[0].path}"
            raise InputError(str(run.path), f"is a run of {run.kind}", allowed)
        made, first = (each.manifest["simulated_with"] for each in (run, runs[0]))
        if (made["code"], made["versions"]) != (first["code"], first["versions"]):
            problem = f"has rows of other code or versions than {runs[0].path}"
            allowed = "runs of the same code; `harness run` of a run's folder simulates it again"
            raise InputError(str(run.path), problem, allowed)
        if run.path.resolve() in [other.path.resolve() for other in runs[:number]]:
            raise InputError(str(run.path), "is named twice", "different runs")


def _refuse_other_people(group: Sequence[Candidate]) -> None:
    """Refuse cells of several runs whose references differ, which the AV cannot cause."""
    first, *others = group
    for other in (each for each in others if each.origin != first.origin):
        pairs = common_pairs(first, other)
        samples = first.sample(pairs), other.sample(pairs)
        a, b = ([of[name][REFERENCE] for name in _REFERENCE[first.run.kind]] for of in samples)
        same = np.isclose(a, b, rtol=ROUNDING, atol=ROUNDING, equal_nan=True).all(axis=0)
        same |= np.isnan(a).all(axis=0) | np.isnan(b).all(axis=0)  # a simulation failed
        if not same.all():
            raise InputError(
                str(other.run.path),
                f"its reference drove otherwise than {first.run.path} in pair {same.argmin()}",
                "runs of the same version and model, or one sweep over both strategies",
            )


def _nothing_to_compare(runs: Sequence[Run]) -> InputError:
    if len(runs) == 1:
        allowed = "a sweep over arms.av or its parameters, or a second run"
        return InputError(str(runs[0].path), "has no two cells that differ only in the AV", allowed)
    trees = [flatten(without_av(run.cells[0].scenario)) for run in runs[:2]]
    keys = [key for key in {**trees[0], **trees[1]} if trees[0].get(key) != trees[1].get(key)]
    problem = f"differs from {runs[0].path} in more than the AV: {', '.join(keys[:5])}"
    return InputError(str(runs[1].path), problem, "the same seed, people, ego and reference")


def common_pairs(a: Candidate, b: Candidate) -> int:
    """The number of pairs that both cells have: entry i of each is pair i."""
    return min(a.cell["pairs"].count, b.cell["pairs"].count)
