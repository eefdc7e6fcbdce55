"""What the page of a run shows: its results, verdicts, and the pairs worth watching."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from harness.core.errors import HarnessError, InputError
from harness.core.vocabulary import Arm, Ending
from harness.results.folder import EVENTS, read_manifest
from harness.results.loaded_run import Run, load_run
from harness.results.result import Result
from harness.studies.allowed import Allowed, allowed_in
from harness.studies.candidates import groups_of
from harness.studies.comparison import compare
from harness.studies.running.replay import Key, traced

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa


ALL_BELOW = 50
"""If a run has at most this many pairs, all are worth watching."""

_EACH, _MOST_MEDIANS = 5, 12
"""Number of pairs for each reason, and of cells with a median pair."""


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


class PageContent(NamedTuple):
    """What a page shows.

    Attributes:
        run: a run with at least one pair; of a risk the run of its events.
        result: what the run or the risk says.
        compared: the comparison of the run's strategies.
        allowed: the verdicts on swept parameters, for the paper's figure.
        shown: pairs with traces for the player and the figures of speeds.
        warnings: why there are no such pairs, or which of them differ from their record.
    """

    run: Run
    result: Result
    compared: Result | None = None
    allowed: Sequence[Allowed] = ()
    shown: Sequence[ShownPair] = ()
    warnings: tuple[str, ...] = ()

    @property
    def has_episodes(self) -> bool:
        """Whether the run is one of episodes, which a player can show."""
        return self.run.kind == "encounters"


def page_content(
    folder: Path,
    settings: Mapping[str, Any] | None = None,
    *,
    mu0: float | None = None,
    kappa0: float | None = None,
) -> PageContent:
    """What the page of a run or risk shows; the pairs are simulated again if it kept no traces.

    Args:
        folder: the folder of a run or of a risk with events.
        settings: of a run, other thresholds of conflicts, as for ``load_run``.
        mu0, kappa0: as for ``compare``.

    Raises:
        InputError: the folder holds no run, no pair is finished, a limit is out of range, or a
            setting is refused.
    """
    if settings or read_manifest(folder)["kind"] != "risk":
        run = load_run(folder, settings)
        result = run.result()
    else:
        from harness.studies.risk.estimate import read_risk  # which no other page needs

        result = read_risk(folder)
        if not result.closing:
            allowed = "a risk with events; `harness show` has the numbers of this one"
            raise InputError(str(folder), "no episode ended in the event", allowed)
        run = load_run(folder / EVENTS)
        about = (note for note in run.result().notes if note.key in ("selected", "failures"))
        result = replace(result, notes=(*result.notes, *about))
    groups = groups_of([run]) if run.finished else []
    several = any(len(group) > 1 for group in groups)
    compared = compare(run, mu0=mu0, kappa0=kappa0) if several else None
    content = PageContent(run, result, compared, allowed_in(groups, mu0, kappa0, run.confidence))
    try:
        shown = shown_pairs(run) if content.has_episodes else []
    except HarnessError as error:
        return content._replace(warnings=(f"the page shows no episodes: {error}",))
    warnings = (
        f"cell {pair.cell} pair {pair.pair} differs from its record: {pair.differences[0]}"
        for pair in shown
        if pair.differences
    )
    return content._replace(shown=shown, warnings=tuple(warnings))


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
        "smallest PET": _most_striking(av, "pet_s"),
        "smallest TTC": _most_striking(av, "min_ttc_s"),
        "largest DRAC": _most_striking(av, "-max_drac_mps2"),
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
    return [*dict.fromkeys(zip(rows["cell"].tolist(), rows["pair"].tolist(), strict=True))][:most]
