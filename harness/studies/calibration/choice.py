"""Ways to choose the number of components K from what was fitted."""

from collections.abc import Mapping
from typing import Literal

from harness.core.errors import InputError
from harness.studies.calibration.scores import HeldOut

Choice = Literal["bic", "rule", "held-out"]

RULE_SHARE = 0.10
"""The paper stops where a further component changes BIC by less than this."""


def by_bic(bic: Mapping[int, float]) -> int:
    """The K of the lowest BIC; the smaller one of equals."""
    return min(bic, key=lambda k: (bic[k], k))


def by_held_out(scores: Mapping[int, HeldOut]) -> int:
    """The K of the highest held-out score; the smaller one of equals.

    Raises:
        InputError: there is no score.
    """
    if not scores:
        raise InputError(
            "--choose held-out",
            "there are no held-out scores",
            "rows with identifiers of at least two vehicles and --folds of 2 or more",
        )
    return min(scores, key=lambda k: (-scores[k].mean, k))


def by_rule(bic: Mapping[int, float]) -> int | None:
    """The paper's rule in a form without units.

    The paper takes the K beyond which BIC changes by less than 10 %.  Relative to BIC itself that
    depends on the units of the data (a change of units adds a constant to every BIC), so the gain
    of the last component is compared with that of the second: the smallest K with
    BIC_K − BIC_{K+1} < 0.1 (BIC_1 − BIC_2).

    Returns:
        K, or None when the gains have not fallen so far within the range fitted.

    Raises:
        InputError: K = 1, 2, … without gaps up to at least 3 were not fitted.
    """
    last = max(bic)
    if last < 3 or sorted(bic) != list(range(1, last + 1)):
        raise InputError(
            "--choose rule", "needs every K from 1 to 3 or more", "e.g. --components 1..20"
        )
    for k in range(1, last):
        if bic[k] - bic[k + 1] < RULE_SHARE * (bic[1] - bic[2]):
            return k
    return None


def relative_gain(bic: Mapping[int, float]) -> dict[int, float]:
    """(BIC_{K−1} − BIC_K) / (BIC_1 − BIC_2) by K, where the neighbours were fitted; no units."""
    if not {1, 2} <= set(bic) or bic[1] == bic[2]:
        return {}
    return {k: (bic[k - 1] - bic[k]) / (bic[1] - bic[2]) for k in sorted(bic) if k - 1 in bic}
