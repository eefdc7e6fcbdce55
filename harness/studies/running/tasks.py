"""Tasks: some pairs of cells with the same people, all known before the first one starts."""

from collections.abc import Callable, Mapping, Sequence, Sized
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from harness.core.freezing import Frozen
from harness.core.vocabulary import Arm, FailedIn

if TYPE_CHECKING:
    from harness.model.interaction import InteractionModel
    from harness.results.folder import Manifest
    from harness.results.tables import Row, Tables
    from harness.scenario import Cell, EngineName, Scenario, Study

_PART_PAIRS = ((20, 1), (80, 5), (200, 10), (800, 25), (3_000, 50), (10_000, 100))
_MOST_PAIRS = 250
"""Below each number of pairs, the pairs of a part; and those of a part of more pairs.

Parts are small enough for workers to share a short run, and large enough for few files.  A run that
is resumed takes its own from the manifest.
"""

_DRIVERS = ("arms", "strategies", "perception", "actuation", "conflicts")
"""The sections of a scenario on which neither people nor road depend."""


class EpisodeId(NamedTuple):
    """An episode of a run."""

    cell: int
    pair: int
    arm: Arm


Tell = Callable[[EpisodeId | None, Sized | None], None]
"""Receives the episode that is about to begin, and what grows with every answer of its strategy, or
with every step of a simulation.

The latter is None while the strategy is made, and both are None between two episodes.
"""


class GivenUp(NamedTuple):
    """Why an episode was given up, and what failed."""

    reason: str
    failed_in: FailedIn


@dataclass(frozen=True)
class Task(Frozen):
    """Some pairs of cells that share people, road and model.

    Episodes that cells share (``arm_key``) are simulated once.

    Attributes:
        cells: the cells.
        model: their interaction model.
        first, count: the pairs.
        arms: the arms to simulate.
        traces: whether the rows of ``traces`` are returned.
        engine: the engine.
        outputs: the folder for SUMO's own outputs, for a task of one episode.
        folder: the run's folder, for what simulations keep.
        code: digests of the user's strategies that drive; a process that has imported another
            version is not used.
        files: digests of the user's SUMO files, which must not change during a run.
        given_up: the episodes that are not tried again.
        own: what a study simulates in place of the pairs.
    """

    cells: "tuple[Cell, ...]"
    model: "InteractionModel"
    first: int
    count: int
    arms: tuple[Arm, ...] = tuple(Arm)
    traces: bool = False
    engine: "EngineName" = "sumo"
    outputs: Path | None = None
    folder: Path | None = None
    code: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    given_up: Mapping[EpisodeId, GivenUp] = field(default_factory=dict)
    own: "Own | None" = None

    @property
    def pairs(self) -> range:
        """The pairs to simulate."""
        return range(self.first, self.first + self.count)

    def driver(self, episode: EpisodeId) -> str:
        """The name of the strategy that drives in an episode."""
        (scenario,) = (cell.scenario for cell in self.cells if cell.number == episode.cell)
        return scenario.arms.driver(episode.arm)

    def failed(
        self, cell: int, pair: int, arm: Arm, reason: str | None, traceback: str | None
    ) -> "Row":
        """The log's line of an arm that failed."""
        episode, why = EpisodeId(cell, pair, arm), {"reason": reason, "traceback": traceback}
        return {"event": "arm failed", **episode._asdict(), "strategy": self.driver(episode), **why}

    def without(self, episode: EpisodeId, failure: GivenUp) -> "Task":
        """The same task, with a further episode given up."""
        return replace(self, given_up={**self.given_up, episode: failure})


class Own(Protocol):
    """What a study simulates in tasks; ``first`` and ``count`` may be of what is no pair."""

    def run(self, task: Task, tell: Tell, /) -> "TaskRows":
        """The rows of a task."""
        ...


@dataclass(frozen=True)
class TaskRows(Frozen):
    """What a task returns: the tables of each cell by its number, and lines for the log."""

    tables: "Mapping[int, Tables]"
    events: "tuple[Row, ...]" = ()


def part_pairs(pairs: int) -> int:
    """Number of pairs of a part, from the number of pairs that a run asks for.

    >>> [part_pairs(pairs) for pairs in (1, 50, 300, 20_000)]
    [1, 5, 25, 250]
    """
    return next((size for below, size in _PART_PAIRS if pairs < below), _MOST_PAIRS)


def tasks_of(
    study: "Study", models: "Sequence[InteractionModel]", manifest: "Manifest"
) -> list[Task]:
    """All tasks of a study, by the cells' numbers and pairs.

    Args:
        study: the study.
        models: the interaction model of each cell.
        manifest: the run's manifest.
    """
    groups: dict[tuple[str, str], list[Cell]] = {}
    for cell, model in zip(study.cells, models, strict=True):
        groups.setdefault((but_for_drivers(cell.scenario), model.sha256), []).append(cell)
    pairs, size = study.base.experiment.pairs, manifest["pairs_per_part"]
    return [
        Task(
            tuple(cells),
            models[cells[0].number],
            first,
            min(size, pairs - first),
            traces=manifest["traces"],
            engine=manifest["engine"],
            code=manifest["simulated_with"]["strategies"],
            files=manifest["simulated_with"]["files"],
        )
        for cells in groups.values()
        for first in range(0, pairs, size)
    ]


def but_for_drivers(scenario: "Scenario") -> str:
    """The people and the road of a scenario, as text."""
    return repr(scenario.model_copy(update=dict.fromkeys(_DRIVERS)))
