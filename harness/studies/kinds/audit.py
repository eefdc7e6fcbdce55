"""Repeats a sample of the plain engine's episodes in SUMO and returns the differences."""

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
from harness.studies.kinds.watchdog import Watch


@dataclass(frozen=True)
class Audit:
    """Repeats every ``every``-th pair from pair ``first`` on; no pair if ``first`` is None."""

    every: int | None
    first: int

    def repeats(self, pair: int) -> bool:
        """Return whether both arms of a pair are repeated; crashed episodes always are."""
        return self.every is not None and pair % self.every == self.first


def audit_of(share: float, scenario: Scenario) -> Audit:
    """Return a systematic sample of at least one pair of a cell.  The seed chooses its start.

    Args:
        share: share of the pairs, 0 to 1; with 0 only crashed episodes are repeated.
        scenario: the cell's scenario.
    """
    if share == 0:
        return Audit(None, 0)
    every, experiment = max(1, round(1 / share)), scenario.experiment
    first = resampling(experiment.seed, "audit").integers(min(every, experiment.pairs))
    return Audit(every, int(first))


class Finding(NamedTuple):
    """The difference of both records and the time of the tie that caused it; None if absent."""

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
    """Yield each repeated episode with its finding.

    Args:
        outcomes: outcomes of the plain engine.
        audit: the pairs to repeat; crashed episodes are repeated too.
        runner: runs the same cell in SUMO.
        plain: runs the same cell on the plain engine.
        watch: notified of every episode.
        repeated: earlier findings by episode, because cells may share episodes.  New findings are
            added.
    """
    for outcome in outcomes:
        if audit.repeats(outcome.pair) or outcome.record.ending is Ending.CRASHED:
            key = runner.key(outcome.arm, outcome.pair)
            if key not in repeated:
                repeated[key] = _finding(outcome, runner, plain, watch)
            yield outcome, repeated[key]


def _finding(outcome: Outcome, runner: PairRunner, plain: PairRunner, watch: Watch) -> Finding:
    """Repeat an episode in SUMO and, if the records differ, once more on the plain engine."""
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
