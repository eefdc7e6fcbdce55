"""Every difference that a comparison of two cells reports, each defined once."""

from dataclasses import dataclass, replace

import numpy as np

from harness.old.statistics.bootstrap import Resampled
from harness.old.statistics.entries import Entry, Finding
from harness.old.statistics.over_model import OverModel, over_model
from harness.old.statistics.pair_columns import PairColumns
from harness.old.statistics.paired import Difference, paired_difference, ratio_difference


@dataclass(frozen=True)
class ComparedColumns:
    """The columns of two cells over their common pairs; entry i of both belongs to pair i.

    The other attributes are as in ``EncounterColumns``.
    """

    first: PairColumns
    second: PairColumns
    timeout_s: float
    free_pass_s: float
    rng: np.random.Generator | None

    def over_model(
        self, key: str, usual: Difference, refits: int, effective_vehicles: float
    ) -> OverModel:
        """A difference with its interval over pairs and refits, if pair p uses refit p mod R."""
        entry = next(entry for entry in DIFFERENCES if entry.key == key)
        refit = np.arange(len(self.first.tau)) % refits
        parts = [
            replace(self, first=self.first.where(own), second=self.second.where(own), rng=None)
            for own in (refit == number for number in range(refits))
        ]
        found = [entry.findings(part, 0)[key].number for part in parts]
        finding = Finding(usual.value, usual.low, usual.high, usual.informative)
        return over_model(finding, found, effective_vehicles)

    def time_ratio(self) -> Difference:
        """The difference of the ratio of times, over the pairs that count in both cells."""
        a, reference = self.first.times_counted(self.timeout_s)
        b, _ = self.second.times_counted(self.timeout_s)
        return ratio_difference(a, b, reference, self.rng)

    def mu(self) -> Difference:
        """The difference of μ."""
        return self._mean(self.first.tau, self.second.tau)

    def mu_worst(self) -> Difference:
        """The difference of μ in the worst case, over all pairs."""
        times = self.timeout_s, self.free_pass_s
        return self._mean(self.first.tau_worst(*times), self.second.tau_worst(*times))

    def delay(self) -> Difference:
        """The difference of the AV's delay."""
        return self._mean(self.first.delay_s[0], self.second.delay_s[0])

    def delay_worst(self) -> Difference:
        """The difference of the AV's delay in the worst case, over all pairs."""
        times = self.timeout_s, self.free_pass_s
        return self._mean(self.first.times_worst(*times)[0], self.second.times_worst(*times)[0])

    def _mean(self, a: np.ndarray, b: np.ndarray) -> Difference:
        return paired_difference(a, b, self.rng)


DIFFERENCES: tuple[Entry[ComparedColumns], ...] = (
    Entry(
        "time_ratio_difference",
        "ratio of times",
        "Difference of the ratio of times, over the pairs that count in both cells.",
        digits=3,
        paired=ComparedColumns.time_ratio,
        interval=Resampled,
        reliable_from=500,
        first_screen=True,
    ),
    Entry(
        "mu_difference",
        "μ",
        "Difference of μ, over the pairs that have a τ in both cells.",
        digits=3,
        paired=ComparedColumns.mu,
        interval=Resampled,
        reliable_from=500,
        first_screen=True,
    ),
    Entry(
        "delay_difference_s",
        "delay",
        "Difference of the AV's delay, over the pairs in which it crossed in both cells.",
        unit="s",
        paired=ComparedColumns.delay,
        interval=Resampled,
        reliable_from=500,
        first_screen=True,
    ),
    Entry(
        "mu_worst_difference",
        "μ, worst case",
        "Difference of μ in the worst case, over all pairs.",
        digits=3,
        paired=ComparedColumns.mu_worst,
        interval=Resampled,
        reliable_from=2_000,
    ),
    Entry(
        "delay_worst_difference_s",
        "delay, worst case",
        "Difference of the AV's delay in the worst case, over all pairs.",
        unit="s",
        paired=ComparedColumns.delay_worst,
        interval=Resampled,
        reliable_from=1_000,
    ),
)
"""The catalogue of a comparison: cell A minus cell B."""
