"""The findings of a validation, which ``--json``, the terminal and the page show."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from harness.old.statistics.entries import Findings
from harness.old.statistics.findings import Note

SCHEMA = 2
"""Version of ``validation.json`` and ``--json``; version 1 lacked ``findings`` and ``notes``."""


@dataclass(frozen=True, slots=True)
class DriverFindings:
    """A driver compared with the recorded drivers.

    Attributes:
        driver: name of the driver.
        rank: 1 is closest to the recorded drivers.
        not_told_apart: drivers whose scores do not differ significantly, because the 95 %
            bootstrap interval over vehicles of the paired difference includes 0.
        score_difference_s: mean score minus the mean score of the first driver.
        score_difference_interval_s: interval of this difference; None for the first driver or
            without an interval.
        draws: drives of each passage; 1 if the driver drew no random number.
        fitted_on_these_data: whether the driver was fitted to these passages and not refitted.
        folds: number of refits of its model, each without the vehicles of one fold.
        findings: findings of ``ENTRIES`` by key; ``n`` is the number of passages with a value.
    """

    driver: str
    rank: int
    not_told_apart: tuple[str, ...]
    score_difference_s: float
    score_difference_interval_s: tuple[float, float] | None
    draws: int
    fitted_on_these_data: bool
    folds: int
    findings: Findings


@dataclass(frozen=True, slots=True)
class ValidationFindings:
    """The findings of a validation.

    Attributes:
        sources: names of the data sets.
        passages: number of driven passages.
        vehicles: number of vehicles in these passages.
        encounters: pedestrians who crossed a vehicle's path after its passage began.
        contacts_recorded: passages with a contact of the recorded vehicle.
        left_out: reason of ``LEFT_OUT`` → number of excluded vehicles or passages.
        remarks: exclusions and assumptions that these data required.
        notes: notes, sorted by rank.
        drivers: drivers, the closest to the recorded drivers first.
    """

    sources: tuple[str, ...]
    passages: int
    vehicles: int
    encounters: int
    contacts_recorded: int
    left_out: Mapping[str, int]
    remarks: tuple[str, ...]
    notes: tuple[Note, ...]
    drivers: tuple[DriverFindings, ...]

    def document(self) -> list[dict[str, object]]:
        """Return one object per driver, the closest first, each including the shared values."""
        shared = {"schema": SCHEMA, **asdict(self)}
        del shared["drivers"]
        documents = []
        for driver in self.drivers:
            values = driver.findings
            documents.append(
                {
                    **asdict(driver),
                    **shared,
                    **{key: finding.value for key, finding in values.items()},
                    "intervals": {
                        key: None if finding.low is None else (finding.low, finding.high)
                        for key, finding in values.items()
                    },
                    "undefined": {
                        key: self.passages - finding.n
                        for key, finding in values.items()
                        if finding.n is not None
                    },
                }
            )
        return documents
