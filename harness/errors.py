"""The few kinds of error a caller can act on.

Every message is one line that says where, what, what is allowed and, for a misspelt name, the
nearest valid one.
"""

import difflib
from collections.abc import Iterable


class HarnessError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(HarnessError):
    """The user's input was refused; the shell turns it into one line and exit code 2.

    Args:
        where: the file, key or option, e.g. ``cctc.toml: pedestrians.flow_per_hour``.
        problem: what was found there, with the value.
        allowed: what would have been accepted.
        nearest: the valid name closest to a misspelt one.
    """

    def __init__(
        self, where: str, problem: str, allowed: str | None = None, nearest: str | None = None
    ) -> None:
        self.where = where
        self.problem = problem
        self.allowed = allowed
        self.nearest = nearest
        parts = [f"{where}: {problem}"]
        if allowed:
            parts.append(f"allowed: {allowed}")
        if nearest:
            parts.append(f"did you mean {nearest!r}?")
        super().__init__(" ".join("; ".join(parts).split()))


class EngineError(HarnessError):
    """The simulation engine could not carry out an episode (not the user's fault)."""


class StrategyError(EngineError):
    """A strategy raised, or asked for something that is no acceleration."""


class InterruptedRunError(HarnessError):
    """A run was stopped from outside; what is finished is kept in its folder."""

    def __init__(self, folder: object) -> None:
        super().__init__(f"interrupted; go on with: harness run --resume {folder}")


def unknown_name(where: str, kind: str, name: str, valid: Iterable[str]) -> InputError:
    """The refusal of a name that is not in a known set, with the nearest valid one."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return InputError(
        where, f"unknown {kind} {name!r}", ", ".join(names), close[0] if close else None
    )
