"""Takes the contacts among the events of a risk estimate and returns how bad they are."""

import math

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from scipy import stats

from harness.core.encounter import Contact, FloatArray
from harness.statistics.intervals import CONFIDENCE
from harness.statistics.severity import share_below
from harness.studies.risk.findings import Severity

_ROUNDING = 1e-9
"""Risks that differ by less are equal."""


def severity_of(weights: FloatArray, events: pa.Table, column: str) -> Severity:
    """Return the weighted mean R = Σ w r/Σ w of the risks of an injury.

    The interval is R ± t s with s² = Σ w² (r − R)²/(Σ w)² (Owen, Monte Carlo theory, methods and
    examples, eq. 9.8) and Student's t with the effective number of contacts minus one as degrees of
    freedom.  Equal risks have no interval, because they do not show their spread.

    Args:
        weights: φ/q of the events, shape (n,).
        events: their scores, n rows.
        column: column of the risk, which is null if the event is no contact with the front.
    """
    risks = pc.fill_null(events[column], math.nan).to_numpy()
    front = ~np.isnan(risks)
    weights, risks = weights[front], risks[front]
    if not len(risks):
        return Severity(per_contact=None, ci_low=None, ci_high=None, below_curve=None,
                        contacts=0, effective_contacts=0.0)  # fmt: skip
    total, squares = float(weights.sum()), float(np.sum(weights**2))
    mean, size = float(weights @ risks) / total, total**2 / squares
    low = high = None
    error = math.sqrt(float(np.sum((weights * (risks - mean)) ** 2))) / total
    if error > _ROUNDING * mean:
        half = float(stats.t.ppf((1 + CONFIDENCE) / 2, max(size - 1, 1))) * error
        low, high = max(0.0, mean - half), min(1.0, mean + half)
    return Severity(
        per_contact=mean,
        ci_low=low,
        ci_high=high,
        below_curve=share_below(risks, weights),
        contacts=len(risks),
        effective_contacts=size,
    )


def side_share(weights: FloatArray, events: pa.Table) -> float | None:
    """Return the share of the contacts that are with the side, by weight; None without a contact.

    See ``severity_of`` for the arguments.
    """
    contacts = events["contact"].to_pylist()
    by_contact = {
        contact: float(weights[[each == contact for each in contacts]].sum()) for contact in Contact
    }
    total = sum(by_contact.values())
    return by_contact[Contact.SIDE] / total if total else None
