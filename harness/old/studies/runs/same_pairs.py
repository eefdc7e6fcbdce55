"""Checks that separate runs met the same pedestrians, which a comparison requires."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from harness.core.errors import InputError
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.strategy_groups import StrategyGroup, all_but_the_strategy
from harness.scenario import as_written, flatten

TOLERANCE = 1e-6
"""Numbers of two engines or versions are equal if they differ by at most this, absolutely or
relatively."""

_NAMED = 5
"""Number of keys that a refusal lists."""


def names_of(runs: Sequence[RunData]) -> list[str]:
    """Return a name for each run: the folder's name, or the full path if names are not unique."""
    short = [run.path.resolve().name for run in runs]
    return short if len({*short}) == len(short) else [str(run.path) for run in runs]


def check_same_scenario(runs: Sequence[RunData], groups: Sequence[StrategyGroup]) -> None:
    """Refuse runs whose scenarios cannot be compared pair by pair.

    Args:
        runs: two or more finished runs of any kind.
        groups: the groups of all their cells together.

    Raises:
        InputError: a run is given twice, or differs in more than the AV's strategy (the message
            names the keys).
    """
    for number, run in enumerate(runs):
        if run.path.resolve() in [other.path.resolve() for other in runs[:number]]:
            raise InputError(str(run.path), "is named twice", "different runs")
    # A run without comparable cells is refused with its differences from the first run.
    for number in (*range(1, len(runs)), 0):
        together = {m.run for group in groups if _has(group, number) for m in group.cells}
        if together == {number}:
            _refuse_other_scenario(runs[0 if number else 1], runs[number])


def _has(group: StrategyGroup, run: int) -> bool:
    return any(member.run == run for member in group.cells)


def _refuse_other_scenario(first: RunData, other: RunData) -> None:
    """Raise an error that names the keys in which the two most similar cells differ."""
    trees = [
        [flatten(all_but_the_strategy(cell.scenario)) for cell in run.study.cells]
        for run in (first, other)
    ]
    differences = min(([*_different(a, b)] for a in trees[0] for b in trees[1]), key=len)
    named = ", ".join(differences[:_NAMED])
    more = f" and {len(differences) - _NAMED} more" if len(differences) > _NAMED else ""
    raise InputError(
        str(other.path),
        f"differs from {first.path} in more than the AV's strategy: {named}{more}",
        "the same seed, pedestrians, ego and reference",
    )


def _different(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[str]:
    for key in dict.fromkeys([*a, *b]):
        if a.get(key) != b.get(key):
            before, after = (
                "none" if value is None else as_written(value) for value in (a.get(key), b.get(key))
            )
            yield f"{key} {after} instead of {before}"
