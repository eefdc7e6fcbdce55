"""Runs one pair in this process, for a notebook, a plot or a debugger.

There is no watchdog and no time limit, so ``breakpoint()`` works in a strategy.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from harness.core.encounter import Arm, Ending, Trace
from harness.core.errors import InputError
from harness.engine.installation import check_packages
from harness.engine.shared import close_engine, open_engine
from harness.episode.pairing import PairRunner
from harness.measures import EpisodeRecord, Outcome
from harness.measures.catalogue import MEASURES
from harness.model.interaction import load_model
from harness.scenario import EngineName, Scenario, engine_named, scenario_of_encounters
from harness.store.episode_tables import trace_rows
from harness.studies.runs.notebook import figure_html, table_html

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHOWN = ("pass_time_s", "delay_s", "pet_s", "min_ttc_s", "max_drac_mps2", "contact_speed_mps")
"""Measures that a notebook's table shows; ``record`` has all measures."""


@dataclass(frozen=True)
class EpisodeOutcome:
    """One arm of a pair, with its record, its trace, and the trace as a table."""

    outcome: Outcome

    @property
    def arm(self) -> Arm:
        """The arm of the pair."""
        return self.outcome.arm

    @property
    def record(self) -> EpisodeRecord:
        """The ending, the contact and every measure (``record.pet_s``)."""
        return self.outcome.record

    @property
    def trace(self) -> Trace:
        """The ego's states and the pedestrians' walks, and ``traceback`` if the strategy raised."""
        return self.outcome.trace

    @cached_property
    def rows(self) -> pd.DataFrame:
        """One row per step and object, as in ``RunData.traces``."""
        frame: pd.DataFrame = trace_rows(0, [self.outcome]).to_pandas()
        return frame

    def __repr__(self) -> str:
        """Return a short text for a debugger, without the trace."""
        return f"<EpisodeOutcome pair {self.outcome.pair}, {self.arm.value}: {self.record.ending}>"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return _html(f"pair {self.outcome.pair}, {self.arm.value}", [self])


@dataclass(frozen=True)
class PairOutcome:
    """Both arms of a pair, which met the same pedestrians."""

    scenario: Scenario
    pair: int
    av: EpisodeOutcome
    human: EpisodeOutcome

    @property
    def tau(self) -> float | None:
        """τ = AV's pass time / human's pass time; None if either did not pass."""
        av, human = self.av.record.pass_time_s, self.human.record.pass_time_s
        return None if av is None or human is None else av / human

    @cached_property
    def traces(self) -> pd.DataFrame:
        """The rows of ``EpisodeOutcome.rows`` of both arms."""
        return pd.concat([self.av.rows, self.human.rows], ignore_index=True)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw both egos' speed over the distance to the crosswalk, by default in a new figure."""
        from matplotlib import pyplot as plt

        from harness.report.drawing.episode_figures import draw_speed_over_distance

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
        return _html(self._title, [self.av, self.human])


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
        scenario: a scenario of encounters (not of traffic), its file, or the name of a shipped one.
        pair: index of the pair, ≥ 0.
        settings: changes to the scenario by dotted key.  A strategy may be a class, also one from
            a notebook's cell: ``{"arms.av": MyStrategy}``.
        engine: ``sumo``, or ``plain`` for the same kinematics without SUMO.

    Raises:
        InputError: the scenario, a setting or the pair is refused.
        HarnessError: SUMO does not start.

    >>> run_pair("cctc", 17, settings={"arms.av": "hard_yield"}, engine="plain").av.record.stops
    0
    """
    chosen, engine = scenario_of_encounters(scenario, settings), engine_named(engine)
    if pair < 0:
        raise InputError("pair", f"{pair}", "0 or more")
    check_packages()
    model = load_model(*chosen.model.file_and_refits)
    try:
        runner = PairRunner(chosen, model, lambda: open_engine(chosen, engine))
        av, human = (EpisodeOutcome(runner.run_arm(pair, arm)) for arm in Arm)
    finally:
        if engine == "sumo":
            close_engine()
    return PairOutcome(chosen, pair, av, human)


def _html(title: str, episodes: list[EpisodeOutcome]) -> str:
    """Return HTML with the episodes' measures, their speeds over the distance, and tracebacks."""
    from harness.report.drawing.episode_figures import draw_speed_over_distance
    from harness.report.drawing.style import new_figure

    units = {measure.column: measure.unit for measure in MEASURES}
    measures = (f"{name.removesuffix('_s')} ({units[name]})" for name in _SHOWN)
    table = pd.DataFrame({"": ["strategy", "ending", *measures]})
    for episode in episodes:
        values = [getattr(episode.record, name) for name in _SHOWN]
        written = ("none" if value is None else f"{value:.3g}" for value in values)
        table[episode.arm.value] = [episode.outcome.strategy, episode.record.ending, *written]
    figure, (axes,) = new_figure()
    rows = pd.concat([episode.rows for episode in episodes])
    draw_speed_over_distance(axes, {title: rows}, episodes[0].trace.crossing.width_m)
    html = table_html(title, table) + figure_html(figure)
    for episode in episodes:
        if episode.record.ending is Ending.ENGINE_FAILED:
            why = episode.trace.traceback or episode.record.reason or ""
            html += f"<pre>{escape(f'{episode.arm.value} failed: {why}')}</pre>"
    return html
