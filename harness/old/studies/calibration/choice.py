"""Takes the BIC or held-out score of every fitted K and returns the chosen K."""

from collections.abc import Mapping
from typing import Literal

from harness.core.errors import InputError
from harness.old.studies.calibration.scores import HeldOut

Choice = Literal["bic", "rule", "held-out"]

RULE_SHARE = 0.10
"""The paper stops adding components when BIC changes by less than this share."""


def by_bic(bic: Mapping[int, float]) -> int:
    """Return the K with the lowest BIC, or the smallest such K."""
    return min(bic, key=lambda k: (bic[k], k))


def by_held_out(scores: Mapping[int, HeldOut]) -> int:
    """Return the K with the highest mean held-out score, or the smallest such K.

    Raises:
        InputError: ``scores`` is empty.
    """
    if not scores:
        raise InputError(
            "--choose held-out",
            "there are no held-out scores",
            "rows with identifiers of at least two vehicles and --folds of 2 or more",
        )
    return min(scores, key=lambda k: (-scores[k].mean, k))


def by_rule(bic: Mapping[int, float]) -> int | None:
    """Return the smallest K with BIC_K − BIC_{K+1} < 0.1 (BIC_1 − BIC_2).

    The paper takes the K beyond which BIC changes by less than 10 %.  That share depends on the
    units of the data, because a change of units adds a constant to every BIC.  This rule therefore
    compares the gain of the next component with the gain of the second component.

    Returns:
        K; None if no fitted K meets the rule.

    Raises:
        InputError: the fitted K are not 1, 2, … without gaps up to at least 3.
    """
    last = max(bic)
    if last < 3 or sorted(bic) != list(range(1, last + 1)):
        raise InputError(
            "--choose rule", "needs every K from 1 to at least 3", "e.g. --components 1..20"
        )
    for k in range(1, last):
        if bic[k] - bic[k + 1] < RULE_SHARE * (bic[1] - bic[2]):
            return k
    return None


def relative_gain(bic: Mapping[int, float]) -> dict[int, float]:
    """Return (BIC_{K−1} − BIC_K) / (BIC_1 − BIC_2) for every K with a fitted K − 1."""
    if not {1, 2} <= set(bic) or bic[1] == bic[2]:
        return {}
    return {k: (bic[k - 1] - bic[k]) / (bic[1] - bic[2]) for k in sorted(bic) if k - 1 in bic}
