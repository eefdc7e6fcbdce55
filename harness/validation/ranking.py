"""Drivers in the order of their nearness to the recorded ones."""

from collections.abc import Sequence
from dataclasses import dataclass

from harness.validation.bootstrap import middle, resamples
from harness.validation.figures import DriverFigures
from harness.validation.passages import Passage


@dataclass(frozen=True, slots=True)
class Ranked:
    """A driver's place: 1 is nearest to the recorded drivers.

    ``not_told_apart`` names the drivers from which the paired difference of the scores does not
    tell it apart: the 95 % interval of the bootstrap over vehicles includes 0.
    """

    driver: str
    rank: int
    difference_s: float
    difference_interval_s: tuple[float, float] | None
    not_told_apart: tuple[str, ...]


def ranking(
    figures: Sequence[DriverFigures], passages: Sequence[Passage], seed: int
) -> list[Ranked]:
    """Drivers by their mean score, the lowest first.

    ``difference_s`` is a driver's mean score less the first one's, passage by passage.
    """
    order = sorted(figures, key=lambda one: float(one.score_s.mean()))
    samples = resamples(passages, seed)

    def between(one: DriverFigures, other: DriverFigures) -> tuple[float, float] | None:
        difference = one.score_s - other.score_s
        return middle([float(difference[sample].mean()) for sample in samples])

    ranked = []
    for place, one in enumerate(order, start=1):
        alike = [
            other.driver
            for other in order
            if other is not one
            and ((span := between(one, other)) is None or span[0] <= 0 <= span[1])
        ]
        best = float(one.score_s.mean() - order[0].score_s.mean())
        span = None if one is order[0] else between(one, order[0])
        ranked.append(Ranked(one.driver, place, best, span, tuple(alike)))
    return ranked
