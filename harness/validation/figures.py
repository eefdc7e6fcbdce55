"""How near a driver model comes to the recorded drivers: figures with intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from harness.encounter import FloatArray
from harness.validation.bootstrap import middle, resamples
from harness.validation.outcomes import HORIZONS_S, DriverOutcome
from harness.validation.passages import Passage

Outcomes = Sequence[Sequence[DriverOutcome]]
"""Outcomes of one driver: for each passage one, or one for each draw of a random model."""


@dataclass(frozen=True, eq=False)
class DriverFigures:
    """One driver held against the recorded ones.

    Attributes:
        driver: its name.
        draws: how many drives there are of a passage: 1 where draws do not differ.
        values: figure → value over all passages, None where undefined (``FIGURES`` has the words).
        intervals: figure → 95 % interval of a bootstrap over vehicles, None where undefined.
        score_s: (passages,) what drivers are ranked by, see ``pass_time_score``.
        left_out: figure → passages without it.
    """

    driver: str
    draws: int
    values: Mapping[str, float | None]
    intervals: Mapping[str, tuple[float, float] | None]
    score_s: FloatArray
    left_out: Mapping[str, int]

    @property
    def random(self) -> bool:
        """Whether the model draws random numbers that matter."""
        return self.draws > 1


FIGURES: Mapping[str, str] = {
    "pass_time_error_mean_s": "simulated less recorded pass time, mean",
    "pass_time_error_median_s": "its absolute value, median",
    "pass_time_error_p90_s": "its absolute value, 90 % quantile",
    "pass_time_score_s": "its continuous ranked probability score, mean; without randomness the "
    "mean absolute error",
    **{
        f"position_rmse_{horizon:g}s_m": f"root mean square error of position after {horizon:g} s"
        for horizon in HORIZONS_S
    },
    "order_right": "share of pedestrians whom the vehicle passes before or after as recorded",
    "order_brier": "Brier score of that order; without randomness 1 less the share right",
    "contacts": "passages with a contact",
    "contacts_explained": "those that only a pedestrian who cannot react explains",
    "timed_out": "passages that did not end within 30 s after the recorded one",
    "least_speed_distance_mps": "Wasserstein distance of the least speeds",
    "pet_distance_s": "Wasserstein distance of the post-encroachment times",
    "time_advantage_distance_s": "Wasserstein distance of the least time advantages",
}
"""Every figure with its meaning; the order in which they are shown."""


def figures_of(
    driver: str,
    passages: Sequence[Passage],
    outcomes: Outcomes,
    recorded: Sequence[DriverOutcome],
    seed: int,
) -> DriverFigures:
    """The figures of one driver.

    A random model's draws of a passage share its weight.  Intervals are percentiles over
    resamples of whole vehicles, the same ones for every driver.

    Args:
        driver: its name.
        passages: all that were driven.
        outcomes: of the driver.
        recorded: of the recorded vehicles.
        seed: of the resamples.
    """
    table = _Table.of(outcomes, recorded)
    everything = np.arange(len(passages))
    values = {name: figure(table, everything) for name, figure in _COMPUTE.items()}
    samples = resamples(passages, seed)
    intervals = {
        name: middle([figure(table, sample) for sample in samples])
        for name, figure in _COMPUTE.items()
        if name not in _COUNTED
    }
    return DriverFigures(
        driver=driver,
        draws=table.draws,
        values={name: values[name] for name in FIGURES},
        intervals={name: intervals.get(name) for name in FIGURES},
        score_s=table.score_s,
        left_out=table.left_out(),
    )


def pass_time_score(pass_times_s: FloatArray, recorded_s: float) -> float:
    """The continuous ranked probability score of one passage's pass times, s ≥ 0.

    E|X − y| − ½ E|X − X'| over draws X, X' of the model and the recorded y: the absolute error for
    a model without randomness; for a random one it rewards neither a wide nor a narrow spread
    that is not so.  Unbiased for the number of draws: X and X' are different draws.

    Source: Gneiting, Raftery 2007, Journal of the American Statistical Association 102.

    Args:
        pass_times_s: (draws,).
        recorded_s: y.

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


@dataclass(frozen=True, eq=False)
class _Table:
    """A driver's outcomes as arrays, passages first."""

    draws: int
    error_s: FloatArray  # (passages, draws)
    score_s: FloatArray  # (passages,)
    squared_m2: FloatArray  # (passages, horizons), NaN where either has passed
    right: FloatArray  # (passages,) sums over pedestrians of the share of draws that are right
    brier: FloatArray  # (passages,) sums over pedestrians
    people: FloatArray  # (passages,)
    contact: FloatArray  # (passages,) share of draws
    explained: FloatArray
    timed_out: FloatArray
    distributions: Mapping[str, tuple[FloatArray, FloatArray]]  # (passages, draws), (passages,)

    @classmethod
    def of(cls, outcomes: Outcomes, recorded: Sequence[DriverOutcome]) -> "_Table":
        draws = max(len(of) for of in outcomes)
        times = [np.array([one.pass_time_s for one in of]) for of in outcomes]
        error = np.array([t - r.pass_time_s for t, r in zip(times, recorded, strict=True)])
        score = [pass_time_score(t, r.pass_time_s) for t, r in zip(times, recorded, strict=True)]
        squared, right, brier = [], [], []
        for of, real in zip(outcomes, recorded, strict=True):
            squared.append(np.mean([(one.x_m - real.x_m) ** 2 for one in of], axis=0))
            before = np.mean([one.first for one in of], axis=0)
            right.append(float(np.where(real.first, before, 1 - before).sum()))
            brier.append(float(((before - real.first) ** 2).sum()))
        return cls(
            draws=draws,
            error_s=error,
            score_s=np.array(score),
            squared_m2=np.array(squared),
            right=np.array(right),
            brier=np.array(brier),
            people=np.array([float(len(real.first)) for real in recorded]),
            contact=_shares(outcomes, lambda one: one.contact),
            explained=_shares(outcomes, lambda one: one.contact_explained),
            timed_out=_shares(outcomes, lambda one: one.timed_out),
            distributions={
                name: (
                    np.array([[_number(get(one)) for one in of] for of in outcomes]),
                    np.array([_number(get(real)) for real in recorded]),
                )
                for name, get in _DISTRIBUTIONS.items()
            },
        )

    def left_out(self) -> dict[str, int]:
        counts = {
            f"position_rmse_{horizon:g}s_m": int(np.isnan(self.squared_m2[:, at]).sum())
            for at, horizon in enumerate(HORIZONS_S)
        }
        for name, (ours, theirs) in self.distributions.items():
            counts[name] = int((np.isnan(ours).any(axis=1) | np.isnan(theirs)).sum())
        return counts


_DISTRIBUTIONS: Mapping[str, Callable[[DriverOutcome], float | None]] = {
    "least_speed_distance_mps": lambda one: one.least_speed_mps,
    "pet_distance_s": lambda one: one.pet_s,
    "time_advantage_distance_s": lambda one: one.time_advantage_s,
}


def _distance(name: str) -> Callable[[_Table, np.ndarray], float | None]:
    def distance(table: _Table, sample: np.ndarray) -> float | None:
        ours, theirs = (values[sample].ravel() for values in table.distributions[name])
        ours, theirs = ours[~np.isnan(ours)], theirs[~np.isnan(theirs)]
        if not len(ours) or not len(theirs):
            return None
        return float(stats.wasserstein_distance(ours, theirs))

    return distance


def _rmse(at: int) -> Callable[[_Table, np.ndarray], float | None]:
    def rmse(table: _Table, sample: np.ndarray) -> float | None:
        squared = table.squared_m2[sample, at]
        known = squared[~np.isnan(squared)]
        return float(np.sqrt(known.mean())) if len(known) else None

    return rmse


_COUNTED = ("contacts", "contacts_explained", "timed_out")
"""Sums over passages, whose interval over vehicles would say nothing."""

_COMPUTE: Mapping[str, Callable[[_Table, np.ndarray], float | None]] = {
    "pass_time_error_mean_s": lambda t, s: float(t.error_s[s].mean()),
    "pass_time_error_median_s": lambda t, s: float(np.median(np.abs(t.error_s[s]))),
    "pass_time_error_p90_s": lambda t, s: float(np.quantile(np.abs(t.error_s[s]), 0.9)),
    "pass_time_score_s": lambda t, s: float(t.score_s[s].mean()),
    **{f"position_rmse_{horizon:g}s_m": _rmse(at) for at, horizon in enumerate(HORIZONS_S)},
    "order_right": lambda t, s: float(t.right[s].sum() / t.people[s].sum()),
    "order_brier": lambda t, s: float(t.brier[s].sum() / t.people[s].sum()),
    "contacts": lambda t, s: float(t.contact[s].sum()),
    "contacts_explained": lambda t, s: float(t.explained[s].sum()),
    "timed_out": lambda t, s: float(t.timed_out[s].sum()),
    **{name: _distance(name) for name in _DISTRIBUTIONS},
}


def _shares(outcomes: Outcomes, of: Callable[[DriverOutcome], bool]) -> FloatArray:
    return np.array([np.mean([of(one) for one in draws]) for draws in outcomes])


def _number(value: float | None) -> float:
    return np.nan if value is None else value
