"""Yield rates of drivers at marked crosswalks, by the crosswalk's treatment.

Source: NCHRP Project 17-87, working paper, table D2: unstaged crossings, mean over studies and the
range of the studies.
"""

from typing import NamedTuple

from harness.core.errors import InputError, unknown_name

SOURCE = "NCHRP Project 17-87, working paper, table D2, unstaged crossings"


class Treatment(NamedTuple):
    """The mean yield rate and the range of the studies; None where the source has none."""

    mean: float | None
    low: float | None = None
    high: float | None = None

    @property
    def words(self) -> str:
        """The mean and the range in per cent.

        >>> Treatment(0.79, 0.45, 0.95).words
        '79 % (studies 45 to 95 %)'
        """
        mean = "no mean" if self.mean is None else f"{100 * self.mean:.0f} %"
        if self.low is None or self.high is None:
            return f"{mean} (no range)"
        return f"{mean} (studies {100 * self.low:.0f} to {100 * self.high:.0f} %)"


TREATMENTS = {
    "sign_overhead_or_in_street": Treatment(0.71, 0.51, 0.97),
    "refuge_island": Treatment(0.80, 0.65, 0.92),
    "high_visibility_signs_and_markings": Treatment(0.20, 0.04, 0.35),
    "continental_markings": Treatment(0.79),
    "rrfb": Treatment(0.79, 0.45, 0.95),
    "pedestal_beacon": Treatment(0.57),
    "overhead_beacon_push_button": Treatment(0.51, 0.13, 0.91),
    "overhead_beacon_passive": Treatment(0.73, 0.61, 0.76),
    "in_road_lights": Treatment(0.58, 0.53, 0.65),
    "crossing_guards_with_rrfb": Treatment(None, 0.81, 0.98),
    "hybrid_beacon": Treatment(0.88, 0.83, 1.00),
    "half_signal": Treatment(0.98, 0.96, 1.00),
    "any_markings": Treatment(0.56, 0.42, 0.70),
    "crossing_flags": Treatment(0.74, 0.72, 0.80),
}
"""Every treatment of the table: ``rrfb`` is a rectangular rapid-flashing beacon, ``hybrid_beacon``
the pedestrian hybrid beacon (HAWK)."""


def rate_of(treatment: str, where: str) -> float:
    """The mean yield rate of a treatment, 0 to 1.

    Raises:
        InputError: the treatment is unknown, or the source has no mean; ``where`` is its key.
    """
    usable = [name for name, row in TREATMENTS.items() if row.mean is not None]
    if treatment not in TREATMENTS:
        raise unknown_name(where, "treatment", treatment, usable)
    row = TREATMENTS[treatment]
    if row.mean is None:
        why = f"{treatment!r} has {row.words}, so the source gives no rate"
        raise InputError(where, why, "yield_rate, within that range")
    return row.mean
