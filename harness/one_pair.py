"""One pair run in this process: for a notebook, a plot, a debugger.

There is no watchdog and no time limit, so ``breakpoint()`` in a strategy stops there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from harness.encounter import Arm, Ending, Trace
from harness.engine.installation import check_packages
from harness.engine.shared import close_engine, open_engine
from harness.episode.pairing import PairRunner
from harness.errors import InputError
from harness.interaction import load_model
from harness.measures import EpisodeRecord, Outcome
from harness.measures.catalogue import MEASURES
from harness.results.episode_tables import trace_rows
from harness.results.tables import table_of
from harness.scenario import EngineName, Scenario, engine_named, load_scenario
from harness.sketch import html_table, lines_sketch

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHOWN = ("pass_time_s", "delay_s", "pet_s", "min_ttc_s", "max_drac_mps2", "contact_speed_mps")
"""Measures in the table that a notebook shows; ``record`` has all."""


@dataclass(frozen=True)
class EpisodeOutcome:
    """One arm of a pair: its record, its trace, and the trace as a table."""

    outcome: Outcome

    @property
    def arm(self) -> Arm:
        """Which arm."""
        return self.outcome.arm

    @property
    def record(self) -> EpisodeRecord:
        """Ending, contact and every measure (``record.pet_s``)."""
        return self.outcome.record

    @property
    def trace(self) -> Trace:
        """The ego's states and the pedestrians' walks; ``traceback`` of a strategy that raised."""
        return self.outcome.trace

    @cached_property
    def rows(self) -> pd.DataFrame:
        """One row per step and object, as ``RunData.traces``."""
        frame: pd.DataFrame = table_of("traces", trace_rows(0, [self.outcome])).to_pandas()
        return frame

    def __repr__(self) -> str:
        """What a debugger shows: the whole trace would bury it."""
        return f"<EpisodeOutcome pair {self.outcome.pair}, {self.arm.value}: {self.record.ending}>"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        title = f"pair {self.outcome.pair}, {self.arm.value}"
        return _table(title, [self]) + _picture(title, [self]) + _problems([self])


@dataclass(frozen=True)
class PairOutcome:
    """Both arms of a pair, which met the same people."""

    scenario: Scenario
    pair: int
    av: EpisodeOutcome
    human: EpisodeOutcome

    @property
    def tau(self) -> float | None:
        """τ = the AV's pass time / the human's; None where either did not cross."""
        av, human = self.av.record.pass_time_s, self.human.record.pass_time_s
        return None if av is None or human is None else av / human

    @cached_property
    def traces(self) -> pd.DataFrame:
        """The rows of both arms."""
        return pd.concat([self.av.rows, self.human.rows], ignore_index=True)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw both egos' speed over the distance to the crosswalk.

        Args:
            axes: drawn into; None: those of a new figure.
        """
        from matplotlib import pyplot as plt

        from harness.report.episode_figures import draw_speed_over_distance

        drawn = plt.subplots()[1] if axes is None else axes
        traces = {f"pair {self.pair}": self.traces}
        draw_speed_over_distance(drawn, traces, self.scenario.crosswalk().width_m)
        return drawn

    def __repr__(self) -> str:
        """What a debugger shows."""
        return f"<PairOutcome {self._title}: {self.av!r}, {self.human!r}>"

    @property
    def _title(self) -> str:
        tau = "undefined" if self.tau is None else f"{self.tau:.3f}"
        return f"pair {self.pair}: τ = {tau}"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        both, title = [self.av, self.human], self._title
        return _table(title, both) + _picture(title, both) + _problems(both)


def run_pair(
    scenario: Scenario | str | Path,
    pair: int = 0,
    *,
    settings: Mapping[str, Any] | None = None,
    engine: EngineName = "sumo",
) -> PairOutcome:
    """Run both arms of one pair in this process.

    The records are those of ``harness run`` with the same scenario and seed.

    Args:
        scenario: a scenario, a file, or the name of a shipped one; of encounters, not of traffic.
        pair: index of the pair, ≥ 0.
        settings: changes to it by dotted key; a strategy may be a class, of a notebook's cell too:
            ``{"arms.av": MyStrategy}``.
        engine: ``sumo``, or ``plain``: the same kinematics without SUMO.

    Raises:
        InputError: the scenario, a setting or the pair is refused.
        HarnessError: SUMO does not start.

    >>> run_pair("cctc", 17, settings={"arms.av": "hard_yield"}, engine="plain").av.record.stops
    0
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, settings or {})
    elif settings:
        raise InputError("settings", "stand beside a Scenario", "a name or file, or no settings")
    if scenario.traffic is not None:
        raise InputError("scenario", "is of hours of traffic", "a scenario without [traffic]")
    if pair < 0:
        raise InputError("pair", f"{pair}", "0 or more")
    engine = engine_named(engine)
    check_packages()
    chosen = scenario
    model = load_model(scenario.model.name, scenario.model.path)
    try:
        runner = PairRunner(scenario, model, lambda: open_engine(chosen, engine))
        av, human = (EpisodeOutcome(runner.run_arm(pair, arm)) for arm in Arm)
    finally:
        if engine == "sumo":
            close_engine()
    return PairOutcome(scenario, pair, av, human)


def _table(title: str, episodes: list[EpisodeOutcome]) -> str:
    units = {measure.column: measure.unit for measure in MEASURES}
    rows = [
        ["strategy", *(episode.outcome.strategy for episode in episodes)],
        ["ending", *(str(episode.record.ending) for episode in episodes)],
    ]
    for name in _SHOWN:
        values = [getattr(episode.record, name) for episode in episodes]
        written = ["none" if value is None else f"{value:.3g}" for value in values]
        rows.append([f"{name.removesuffix('_s')} ({units[name]})", *written])
    return html_table(title, ["", *(episode.arm.value for episode in episodes)], rows)


def _picture(title: str, episodes: list[EpisodeOutcome]) -> str:
    lines = []
    for episode in episodes:
        ego = episode.rows[episode.rows["object"] == "ego"]
        points = zip(ego["x_m"].tolist(), ego["speed_mps"].tolist(), strict=True)
        lines.append((episode.arm.value, list(points)))
    return lines_sketch(lines, f"{title}: speed over the distance to the crosswalk")


def _problems(episodes: list[EpisodeOutcome]) -> str:
    """The tracebacks of strategies that raised."""
    failed = [of for of in episodes if of.record.ending is Ending.ENGINE_FAILED]
    words = [[of.arm.value, of.trace.traceback or of.record.reason or ""] for of in failed]
    return html_table("failed", ["arm", "why"], words) if words else ""
