"""Runs one pair in this process, for a notebook or a debugger.

There is no time limit, so ``breakpoint()`` works in a strategy.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from harness.core.errors import checked, whole_number
from harness.core.vocabulary import Arm
from harness.encounter.pairing import PairRunner
from harness.engine.shared import close_engine, open_engine
from harness.measures import Outcome
from harness.results.rows import trace_rows
from harness.scenario import EngineName, Scenario
from harness.studies.running.run import checked_models, scenario_file

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class PairOutcome:
    """Both arms of a pair, which met the same pedestrians.

    An arm's ``record`` has its ending and every measure (``pair.av.record.pet_s``), its ``trace``
    the ego's states and the pedestrians' walks, and ``traceback`` if the strategy raised.
    """

    scenario: Scenario
    pair: int
    av: Outcome
    human: Outcome

    @property
    def tau(self) -> float | None:
        """τ = AV's pass time / human's pass time; None if either did not pass."""
        av, human = self.av.record.pass_time_s, self.human.record.pass_time_s
        return None if av is None or human is None else av / human

    @cached_property
    def traces(self) -> "pd.DataFrame":
        """One row per arm, step and object, as in ``run.table("traces")``."""
        return cast("pd.DataFrame", trace_rows(0, [self.av, self.human]).to_pandas())

    def __repr__(self) -> str:
        """What a debugger shows."""
        endings = ", ".join(f"{each.arm} {each.record.ending}" for each in (self.av, self.human))
        return f"<PairOutcome {self.pair}: {endings}>"


@checked
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
        scenario: a scenario of encounters, its file, or the name of a shipped one.
        pair: index of the pair, ≥ 0.
        settings: changes to the scenario by dotted key.  A strategy may be a class, also one from
            a notebook's cell: ``{"arms.av": MyStrategy}``.
        engine: ``sumo``, or ``plain`` for the same kinematics without SUMO.

    Returns:
        The traces and records of both arms; an arm that failed has the reason in its record.

    Raises:
        InputError: the scenario, a setting or the pair is refused.
        HarnessError: SUMO does not start.

    >>> run_pair("cctc", 17, settings={"arms.av": "hard_yield"}, engine="plain").av.record.stops
    0
    """
    chosen = scenario_file(scenario, settings or {}).scenario()
    pair = whole_number("pair", pair, 0)
    (model,) = checked_models([chosen], engine)
    runner = PairRunner(chosen, model, lambda: open_engine(chosen, engine))
    try:
        return PairOutcome(chosen, pair, *(runner.run_arm(pair, arm) for arm in Arm))
    finally:
        close_engine()
