"""Checks that separate runs met the same pedestrians, which a comparison requires."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from harness.core.errors import InputError
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.strategy_groups import StrategyGroup, all_but_the_strategy
from harness.scenario import as_written, flatten

TOLERANCE = 1e-6
"""Numbers of two engines or versions are equal if they differ by at most this, absolutely or
relatively."""

_NAMED = 5
"""Number of keys that a refusal lists."""

_OF_THE_HUMAN = ("ending", "steps", "pedestrians", "arrivals", "pass_time_s", "pedestrian_delay_s")
"""Columns that are equal if the reference arm met the same pedestrians and drove equally."""


def names_of(runs: Sequence[RunData]) -> list[str]:
    """Return a name for each run: the folder's name, or the full path if names are not unique."""
    short = [run.path.resolve().name for run in runs]
    return short if len({*short}) == len(short) else [str(run.path) for run in runs]


def check_same_pairs(runs: Sequence[RunData], groups: Sequence[StrategyGroup]) -> None:
    """Refuse runs of encounters that cannot be compared pair by pair.

    Args:
        runs: two or more finished runs.
        groups: the groups of all their cells together.

    Raises:
        InputError: see ``check_same_scenario``; or a run used another model, or has other results
            in its reference arm.
    """
    check_same_scenario(runs, groups)
    _refuse_other_models(runs)
    for group in groups:
        first = group.cells[0]
        for member in group.cells[1:]:
            if member.run != first.run:
                _refuse_other_humans(
                    (runs[first.run], first.cell.number), (runs[member.run], member.cell.number)
                )


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


def _refuse_other_models(runs: Sequence[RunData]) -> None:
    """Refuse runs in which the same model name stands for different files."""
    known: dict[str, tuple[str, RunData]] = {}
    for run in runs:
        for entry in run.manifest["simulated_with"]["models"]:
            name, sha256 = entry["name"], entry.get("refits", entry)["sha256"]
            before, first = known.setdefault(name, (sha256, run))
            if before != sha256:
                raise InputError(
                    str(run.path),
                    f"its model {name} differs from that of {first.path} "
                    f"(sha256 {sha256[:8]}… instead of {before[:8]}…)",
                    "the same model",
                )


def _refuse_other_humans(first: tuple[RunData, int], other: tuple[RunData, int]) -> None:
    """Refuse cells with different reference arms, since the AV cannot cause such a difference."""
    episodes = []
    for run, cell in (first, other):
        rows = run.episodes[(run.episodes["cell"] == cell) & (run.episodes["arm"] == "human")]
        episodes.append(rows.sort_values("pair").set_index("pair"))
    a, b = episodes
    common = a.index.intersection(b.index)
    for name in _OF_THE_HUMAN:
        before, after = a.loc[common, name], b.loc[common, name]
        if name == "ending":
            same = (before == after).to_numpy()
        else:
            a_values, b_values = (values.to_numpy(dtype=float) for values in (before, after))
            same = np.isclose(a_values, b_values, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True)
        if not same.all():
            pair = common[int(np.argmin(same))]
            raise InputError(
                str(other[0].path),
                f"its reference arm differs from that of {first[0].path}: pair {pair} has {name} "
                f"{after.loc[pair]} instead of {before.loc[pair]}",
                "runs whose reference drove the same, or one sweep over both strategies",
            )
