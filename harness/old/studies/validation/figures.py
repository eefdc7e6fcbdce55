"""The catalogue of a validation's numbers: how close a driver model is to recorded drivers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from harness.core.encounter import FloatArray
from harness.old.statistics.entries import Entry, Finding, Form
from harness.old.studies.validation.bootstrap import middle
from harness.old.studies.validation.outcomes import HORIZONS_S, DriverOutcome

Outcomes = Sequence[Sequence[DriverOutcome]]
"""Outcomes of a driver by passage and draw; only a random model has several draws."""


@dataclass(frozen=True, eq=False)
class Drives:
    """A driver's outcomes as arrays whose first axis is the passage.

    The draws of a random model share the weight of their passage.  In the last three arrays the
    last column belongs to the recorded vehicle.  NaN means undefined.
    """

    error_s: FloatArray  # (passages, draws), error of the pass time
    score_s: FloatArray  # (passages,), ranks the drivers, see ``pass_time_score``
    squared_m2: FloatArray  # (passages, horizons), NaN if either vehicle has passed
    right: FloatArray  # (passages,) sums over pedestrians of the share of correct draws
    brier: FloatArray  # (passages,) sums over pedestrians
    people: FloatArray  # (passages,)
    contact: FloatArray  # (passages,) share of draws with a contact
    explained: FloatArray
    timed_out: FloatArray
    least_speed_mps: FloatArray  # (passages, draws + 1)
    pet_s: FloatArray
    time_advantage_s: FloatArray

    def sample(self, passages: "np.ndarray") -> "Drives":
        """Return the drives of some passages, shape (n,); a passage may occur several times."""
        return Drives(*(values[passages] for values in vars(self).values()))


def drives_of(outcomes: Outcomes, recorded: Sequence[DriverOutcome]) -> Drives:
    """Return the outcomes of one driver and of the recorded vehicles as arrays."""

    def column(value: Callable[[DriverOutcome], Any], *, real: bool = False) -> FloatArray:
        rows = [
            [value(drive) for drive in (*drives, *[truth] * real)]
            for drives, truth in zip(outcomes, recorded, strict=True)
        ]
        return np.array(rows, dtype=np.float64)

    pass_times_s = column(lambda drive: drive.pass_time_s)
    real_s = np.array([drive.pass_time_s for drive in recorded])
    squared, right, brier = [], [], []
    for drives, truth in zip(outcomes, recorded, strict=True):
        squared.append(np.mean([(drive.x_m - truth.x_m) ** 2 for drive in drives], axis=0))
        before = np.mean([drive.first for drive in drives], axis=0)
        right.append(float(np.where(truth.first, before, 1 - before).sum()))
        brier.append(float(((before - truth.first) ** 2).sum()))
    return Drives(
        error_s=pass_times_s - real_s[:, None],
        score_s=np.array(list(map(pass_time_score, pass_times_s, real_s))),
        squared_m2=np.array(squared),
        right=np.array(right),
        brier=np.array(brier),
        people=np.array([float(len(drive.first)) for drive in recorded]),
        contact=column(lambda drive: drive.contact).mean(axis=1),
        explained=column(lambda drive: drive.contact_explained).mean(axis=1),
        timed_out=column(lambda drive: drive.timed_out).mean(axis=1),
        least_speed_mps=column(lambda drive: drive.least_speed_mps, real=True),
        pet_s=column(lambda drive: drive.pet_s, real=True),
        time_advantage_s=column(lambda drive: drive.time_advantage_s, real=True),
    )


def pass_time_score(pass_times_s: FloatArray, recorded_s: float) -> float:
    """Return the continuous ranked probability score of one passage's pass times, in s.

    The score is E|X − y| − ½ E|X − X'| over draws X, X' of the model and the recorded y.  For a
    model without randomness it is the absolute error.  It penalises a spread that is too wide or
    too narrow.  It is unbiased for any number of draws, because X and X' are different draws.

    Source: Gneiting, Raftery 2007, Journal of the American Statistical Association 102.

    Args:
        pass_times_s: (draws,) the model's pass times X.
        recorded_s: the recorded pass time y.

    >>> pass_time_score(np.array([7.0]), 5.0)
    2.0
    >>> pass_time_score(np.array([4.0, 6.0]), 5.0)
    0.0
    """
    error = float(np.abs(pass_times_s - recorded_s).mean())
    n = len(pass_times_s)
    if n == 1:
        return error
    spread = float(np.abs(pass_times_s[:, None] - pass_times_s[None]).sum()) / (n * (n - 1))
    return error - spread / 2


def _distance(values: FloatArray) -> float | None:
    """Return the Wasserstein distance between the simulated and the recorded values."""
    simulated, recorded = values[:, :-1].ravel(), values[:, -1]
    simulated, recorded = simulated[~np.isnan(simulated)], recorded[~np.isnan(recorded)]
    if not len(simulated) or not len(recorded):
        return None
    return float(stats.wasserstein_distance(simulated, recorded))


def _rmse(squared_m2: FloatArray) -> float | None:
    defined = squared_m2[~np.isnan(squared_m2)]
    return float(np.sqrt(defined.mean())) if len(defined) else None


def _position(place: int, horizon_s: float) -> Entry[Drives]:
    return Entry(
        f"position_rmse_{horizon_s:g}s_m",
        f"position after {horizon_s:g} s",
        f"Root mean square error of the position after {horizon_s:g} s.",
        unit="m",
        paired=lambda drives: _rmse(drives.squared_m2[:, place]),
        undefined="Every vehicle had passed by then.",
    )


_NEVER = "No passage has a value."

ENTRIES: tuple[Entry[Drives], ...] = (
    Entry(
        "pass_time_score_s",
        "score",
        "Continuous ranked probability score of the pass time, mean; without randomness the mean "
        "absolute error.",
        unit="s",
        paired=lambda drives: float(drives.score_s.mean()),
        first_screen=True,
    ),
    Entry(
        "pass_time_error_mean_s",
        "mean error",
        "Simulated minus recorded pass time, mean.",
        unit="s",
        paired=lambda drives: float(drives.error_s.mean()),
        first_screen=True,
    ),
    Entry(
        "pass_time_error_median_s",
        "median |error|",
        "Absolute error of the pass time, median.",
        unit="s",
        paired=lambda drives: float(np.median(np.abs(drives.error_s))),
        first_screen=True,
    ),
    Entry(
        "pass_time_error_p90_s",
        "90 % |error|",
        "Absolute error of the pass time, 90 % quantile.",
        unit="s",
        paired=lambda drives: float(np.quantile(np.abs(drives.error_s), 0.9)),
    ),
    *(_position(place, horizon_s) for place, horizon_s in enumerate(HORIZONS_S)),
    Entry(
        "order_right",
        "order right",
        "Share of pedestrians whose order of passing with the vehicle is as recorded.",
        Form.SHARE,
        digits=1,
        paired=lambda drives: float(drives.right.sum() / drives.people.sum()),
        first_screen=True,
    ),
    Entry(
        "order_brier",
        "Brier score",
        "Brier score of that order; without randomness, the share of wrong orders.",
        digits=3,
        paired=lambda drives: float(drives.brier.sum() / drives.people.sum()),
    ),
    Entry(
        "contacts",
        "contacts",
        "Passages with a contact.",
        Form.COUNT,
        paired=lambda drives: float(drives.contact.sum()),
        first_screen=True,
    ),
    Entry(
        "contacts_explained",
        "explained",
        "Passages whose contact happened only because recorded pedestrians cannot react.",
        Form.COUNT,
        paired=lambda drives: float(drives.explained.sum()),
        first_screen=True,
    ),
    Entry(
        "timed_out",
        "timed out",
        "Passages more than 30 s longer than recorded; that limit counts as their pass time.",
        Form.COUNT,
        paired=lambda drives: float(drives.timed_out.sum()),
    ),
    Entry(
        "least_speed_distance_mps",
        "least speed",
        "Wasserstein distance of the lowest speeds.",
        unit="m/s",
        paired=lambda drives: _distance(drives.least_speed_mps),
        undefined=_NEVER,
    ),
    Entry(
        "pet_distance_s",
        "PET",
        "Wasserstein distance of the post-encroachment times.",
        unit="s",
        paired=lambda drives: _distance(drives.pet_s),
        undefined=_NEVER,
    ),
    Entry(
        "pet_contacts",
        "no PET: contact",
        "Passages that the PET leaves out because the driver touched someone.",
        Form.COUNT,
        paired=lambda drives: float(
            (np.isnan(drives.pet_s[:, :-1]).any(axis=1) & (drives.contact > 0)).sum()
        ),
    ),
    Entry(
        "time_advantage_distance_s",
        "time advantage",
        "Wasserstein distance of the smallest time advantages.",
        unit="s",
        paired=lambda drives: _distance(drives.time_advantage_s),
        undefined=_NEVER,
    ),
)
"""The numbers that a validation reports for each driver.

Counts are sums over passages.  All other numbers have a 95 % bootstrap interval over vehicles."""


def findings_of(
    drives: Drives, samples: Sequence["np.ndarray"], doubt: str | None
) -> dict[str, Finding]:
    """Return the findings of one driver by key.

    Args:
        drives: the drives of every passage.
        samples: passages of resampled vehicles, which are the same for every driver.
        doubt: reason why the intervals are unreliable; None if they are reliable.
    """
    defined = _defined(drives)
    resampled = [drives.sample(sample) for sample in samples]
    findings = {}
    for entry in ENTRIES:
        assert entry.paired is not None
        finding = entry.finding(entry.paired(drives))
        finding = replace(finding, n=defined.get(entry.key))
        if entry.form is not Form.COUNT:
            values = [entry.finding(entry.paired(sample)).number for sample in resampled]
            low, high = middle(values) or (None, None)
            reliable = None if finding.value is None else doubt is None
            reason = finding.reason or doubt
            finding = replace(finding, low=low, high=high, reliable=reliable, reason=reason)
        findings[entry.key] = finding
    return findings


def _defined(drives: Drives) -> dict[str, int]:
    """Count the passages with a value, by key, for numbers that may be undefined."""
    squared = {
        f"position_rmse_{horizon_s:g}s_m": drives.squared_m2[:, place, None]
        for place, horizon_s in enumerate(HORIZONS_S)
    }
    distances = {
        "least_speed_distance_mps": drives.least_speed_mps,
        "pet_distance_s": drives.pet_s,
        "time_advantage_distance_s": drives.time_advantage_s,
    }
    return {
        key: int((~np.isnan(values)).all(axis=1).sum())
        for key, values in (squared | distances).items()
    }
