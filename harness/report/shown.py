"""The pairs worth watching with their traces, simulated again if the run kept none."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from harness.core.vocabulary import Arm, Ending
from harness.results.loaded_run import Run
from harness.studies.running.replay import Key, traced

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa


ALL_BELOW = 50
"""If a run has at most this many pairs, all are worth watching."""

_EACH, _MOST_MEDIANS = 5, 12
"""Number of pairs for each reason, and of cells with a median pair."""

_DANGEROUS = {
    "smallest PET": "pet_s",
    "smallest TTC": "min_ttc_s",
    "largest DRAC": "-max_drac_mps2",
}
"""Reasons by danger, with the AV's column; a minus before it selects the largest values."""


@dataclass(frozen=True)
class ShownPair:
    """A pair with the traces of both arms.

    Attributes:
        cell, pair: which pair.
        reasons: why it is shown.
        traces, people: its rows of the tables ``traces`` and ``pedestrians``.
        repeated: whether it was simulated again, because the run kept no traces.
        differences: how a repeated pair differs from its record.
    """

    cell: int
    pair: int
    reasons: tuple[str, ...]
    traces: "pa.Table"
    people: "pa.Table"
    repeated: bool = False
    differences: tuple[str, ...] = ()


def shown_pairs(run: Run) -> list[ShownPair]:
    """The pairs of ``chosen_pairs`` with their traces, each once.

    Args:
        run: a run with at least one finished pair.

    Raises:
        HarnessError: pairs cannot be simulated again.
    """
    reasons: dict[Key, list[str]] = {}
    for reason, keys in chosen_pairs(run).items():
        for key in keys:
            reasons.setdefault(key, []).append(reason)
    found, shown = traced(run, reasons, tuple(Arm)), []
    repeated = not run.manifest["traces"]
    for key, whys in reasons.items():
        tables, differences = found[key]
        traces, people = (tables[name] for name in ("traces", "pedestrians"))
        shown.append(ShownPair(*key, tuple(whys), traces, people, repeated, differences))
    return shown


def chosen_pairs(run: Run) -> dict[str, list[Key]]:
    """The pairs worth watching by reason, the most dangerous first.

    Contacts come first, then the AV's smallest PET and TTC and its largest DRAC.  Cells share their
    pedestrians, so for a measure each pair counts once, in the cell with the most extreme value.
    The last reason, ``other pairs``, completes a small run.
    """
    episodes = run.episodes[run.episodes["ending"] != Ending.FAILED]
    av, human = (episodes[episodes["arm"] == arm] for arm in Arm)
    tau = (pairs := run.pairs).dropna(subset="tau").sort_values("tau", kind="stable")
    middles = [rows.iloc[[(len(rows) - 1) // 2]] for _, rows in tau.groupby("cell", sort=True)]
    chosen = {
        "crash of the AV": _keys(av[av["ending"] == Ending.CRASHED]),
        "crash of the human": _keys(human[human["ending"] == Ending.CRASHED]),
        **{reason: _most_striking(av, column) for reason, column in _DANGEROUS.items()},
        "slowest AV": _most_striking(av, "-pass_time_s"),
        "timed out": _keys(episodes[episodes["ending"] == Ending.TIMED_OUT]),
        "fallback": _keys(av[av["fallback"]]),
        "lowest τ": _keys(tau)[:1],
        "median τ": [key for middle in middles[:_MOST_MEDIANS] for key in _keys(middle)],
        "highest τ": _keys(tau.iloc[::-1])[:1],
    }
    everyone = _keys(pairs, len(pairs))
    if len(everyone) <= ALL_BELOW:
        shown = {key for keys in chosen.values() for key in keys}
        chosen["other pairs"] = [key for key in everyone if key not in shown]
    return {reason: keys for reason, keys in chosen.items() if keys}


def _most_striking(rows: "pd.DataFrame", column: str) -> list[Key]:
    """The pairs of smallest values, or of largest ones if the name begins with a minus."""
    name = column.removeprefix("-")
    order = rows.dropna(subset=name).sort_values(name, ascending=name == column, kind="stable")
    return _keys(order.drop_duplicates("pair"))


def _keys(rows: "pd.DataFrame", most: int = _EACH) -> list[Key]:
    keys = dict.fromkeys(zip(rows["cell"].tolist(), rows["pair"].tolist(), strict=True))
    return [*keys][:most]
