"""The findings of a validation: of which ``--json``, terminal and page are views."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from harness.statistics.findings import Findings, Note

SCHEMA = 2
"""Of ``validation.json`` and ``--json``; 1 had neither ``findings`` nor ``notes``."""


@dataclass(frozen=True, slots=True)
class DriverFindings:
    """One driver held against the recorded ones.

    Attributes:
        driver: its name.
        rank: 1 is nearest to the recorded drivers.
        not_told_apart: the drivers from which the paired difference of the scores does not tell it
            apart: the 95 % interval of the bootstrap over vehicles includes 0.
        score_difference_s: its mean score less that of the first driver.
        score_difference_interval_s: of that; None for the first driver, and where there is none.
        draws: drives of each passage: 1 where the driver drew no random number.
        fitted_on_these_data: whether it was fitted on these passages, and not fitted again.
        folds: of vehicles, without each of which its model was fitted again.
        findings: of ``ENTRIES`` by key; ``n`` is the number of passages that have a value.
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
    """What a validation reports.

    Attributes:
        sources: names of the data sets.
        passages: how many were driven.
        vehicles: how many vehicles drove them.
        encounters: pedestrians who passed a vehicle's path after its passage began.
        contacts_recorded: passages with a contact of the recorded vehicle.
        left_out: reason of ``LEFT_OUT`` → vehicles, or ways through a group, that are no passage.
        remarks: what the data made necessary to leave out, or to assume.
        notes: in the order of their ranks.
        drivers: the nearest to the recorded drivers first.
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
        """One object for each driver, the nearest first, each with what all have in common."""
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
