"""Runs one pair in this process, for a notebook or a debugger.

There is no watchdog and no time limit, so ``breakpoint()`` works in a strategy.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from harness.core.encounter import Arm, Trace
from harness.core.errors import InputError
from harness.engine.installation import check_packages
from harness.engine.shared import close_engine, open_engine
from harness.episode.pairing import PairRunner
from harness.measures import EpisodeRecord, Outcome
from harness.model.interaction import load_model
from harness.old.store.episode_tables import trace_rows
from harness.scenario import EngineName, Scenario, engine_named, scenario_of_encounters


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

    def __repr__(self) -> str:
        """What a debugger shows."""
        tau = "undefined" if self.tau is None else f"{self.tau:.3f}"
        return f"<PairOutcome pair {self.pair}: τ = {tau}: {self.av!r}, {self.human!r}>"

    def _repr_html_(self) -> str:
        """Return both records as HTML for a notebook."""
        records = {each.arm.value: asdict(each.record) for each in (self.av, self.human)}
        html: str = pd.DataFrame(records).to_html()
        return html


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
