"""Keeping the memory of freed arrays, for the next ones."""

import numpy as np

# Bytes: just under the most that glibc takes as a hint.
_HINT = 32_000_000


def keep_freed_memory() -> None:
    """Make glibc keep up to 64 MB of freed memory instead of handing it back at once.

    Arrays of more than 128 kB are otherwise mapped afresh, and their pages faulted in one by one,
    whenever they are made: on a virtual machine that takes longer than filling them (draws on the
    curve: a third of their time). glibc raises both of its thresholds when a block it had mapped is
    freed (mallopt(3), M_MMAP_THRESHOLD); the block here is never touched, so it costs nothing.
    With another C library nothing changes.
    """
    np.empty(_HINT, dtype=np.uint8)
