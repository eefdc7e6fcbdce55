"""How a run is carried out; nothing of it changes what one pair gives."""

from dataclasses import dataclass

TASK_PAIRS = 50
"""Pairs in a task."""

HANG_AFTER_S = 120.0
HANG_AFTER_S_PER_STEP = 0.002
"""A worker that finishes no pair for so long, and so long for each of its steps, is ended."""


@dataclass(frozen=True)
class Precision:
    """``--until``: go on until the half-width of every cell's interval is this small.

    ``measure`` is ``mu`` or ``kappa``.
    """

    measure: str
    half_width: float


@dataclass(frozen=True)
class Options:
    """What the command line says beside the study; ``workers`` None means all cores."""

    traces: bool = False
    until: Precision | None = None
    workers: int | None = None
    hang_after_s: float = HANG_AFTER_S
    task_pairs: int = TASK_PAIRS
