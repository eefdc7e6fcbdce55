"""Episodes of the plain engine repeated in SUMO: a share of the pairs, and every crash."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from harness.core.encounter import Ending
from harness.core.seeding import resampling
from harness.episode.pairing import EpisodeKey, PairRunner
from harness.episode.ties import Decision, tie_s
from harness.measures import Outcome
from harness.measures.agreement import difference
from harness.scenario import Scenario
from harness.studies.workers.watchdog import Watch


@dataclass(frozen=True)
class Audit:
    """Which pairs are repeated whole: one of ``every`` from ``first`` on, none where it is None."""

    every: int | None
    first: int

    def repeats(self, pair: int) -> bool:
        """Whether both arms of a pair are repeated, however they ended."""
        return self.every is not None and pair % self.every == self.first


def audit_of(share: float, scenario: Scenario) -> Audit:
    """A systematic sample of a cell's pairs, at least one, with a start that the seed chooses.

    Args:
        share: of the pairs, 0 to 1; 0: only crashes are repeated.
        scenario: the cell.
    """
    if share == 0:
        return Audit(None, 0)
    every, experiment = max(1, round(1 / share)), scenario.experiment
    first = resampling(experiment.seed, "audit").integers(min(every, experiment.pairs))
    return Audit(every, int(first))


class Finding(NamedTuple):
    """What differs in SUMO's record, None where nothing does; by a tie of the strategy when."""

    difference: str | None
    tie_s: float | None


def repeated_in_sumo(
    outcomes: Iterable[Outcome],
    audit: Audit,
    runner: PairRunner,
    plain: PairRunner,
    watch: Watch,
    repeated: dict[EpisodeKey, Finding],
) -> Iterator[tuple[Outcome, Finding]]:
    """The chosen episodes, each with what was found.

    Args:
        outcomes: of the plain engine.
        audit: which pairs are repeated beside the crashes.
        runner: of the same cell, in SUMO.
        plain: of the same cell, which made the outcomes.
        watch: told of every episode.
        repeated: what came of the episodes that another cell shares; those that are repeated now
            are added.
    """
    for outcome in outcomes:
        if audit.repeats(outcome.pair) or outcome.record.ending is Ending.CRASHED:
            key = runner.key(outcome.arm, outcome.pair)
            if key not in repeated:
                repeated[key] = _finding(outcome, runner, plain, watch)
            yield outcome, repeated[key]


def _finding(outcome: Outcome, runner: PairRunner, plain: PairRunner, watch: Watch) -> Finding:
    """Repeat an episode in SUMO and, where the records differ, on the plain engine once more."""
    pair, arm = outcome.pair, outcome.arm
    sumo_decisions: list[Decision] = []
    again = runner.run_arm(pair, arm, watch.begins, decisions=sumo_decisions)
    watch.alive()
    differs = difference(outcome.record, again.record)
    if differs is None:
        return Finding(None, None)
    plain_decisions: list[Decision] = []
    plain.run_arm(pair, arm, watch.begins, decisions=plain_decisions)
    watch.alive()
    return Finding(differs, tie_s(plain_decisions, sumo_decisions))
