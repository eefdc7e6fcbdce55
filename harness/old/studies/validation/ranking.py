"""Ranks drivers by closeness to the recorded drivers."""

from collections.abc import Mapping, Sequence

import numpy as np

from harness.core.encounter import FloatArray
from harness.old.studies.validation.bootstrap import middle

Span = tuple[float, float] | None
"""An interval; None without an interval."""


def ranking(
    scores_s: Mapping[str, FloatArray], samples: Sequence["np.ndarray"]
) -> list[tuple[str, float, Span, tuple[str, ...]]]:
    """Rank drivers by their mean score, the lowest first.

    Args:
        scores_s: driver → scores of shape (passages,).
        samples: passages of resampled vehicles.

    Returns:
        For each driver: its name, its mean score minus the first driver's, the interval of that
        difference, and the drivers from which it does not differ significantly.
    """
    means = {driver: float(score_s.mean()) for driver, score_s in scores_s.items()}
    order = sorted(scores_s, key=means.__getitem__)

    def between(driver: str, other: str) -> Span:
        difference = scores_s[driver] - scores_s[other]
        return middle([float(difference[sample].mean()) for sample in samples])

    ranked = []
    for driver in order:
        spans = {other: between(driver, other) for other in order if other != driver}
        alike = [other for other, span in spans.items() if span is None or span[0] <= 0 <= span[1]]
        difference_s = means[driver] - means[order[0]]
        ranked.append((driver, difference_s, spans.get(order[0]), tuple(alike)))
    return ranked
