"""Strategies that look better than they are: one speeds, one stops and never goes on."""

from pathlib import Path

import pytest

from harness.core.encounter import Observation, PedestrianView
from harness.old.statistics import ENCOUNTERS, Rank, Verdict
from harness.old.studies.runs.compare import compare
from harness.old.studies.runs.notes import encounter_notes
from harness.old.studies.runs.run_data import RunData
from harness.strategies.hard_yield import HardYield
from tests.batches import one_cell, run_inline, sweep


class FullThrottle:
    """Always answers 3 m/s²."""

    def decide(self, _observation: Observation, /) -> float:
        """Wanted acceleration in m/s²."""
        return 3.0


# From 5 m/s over 30 m, 2 m of crosswalk and 5 m of car: v² = 25 + 2 · 3 · 37 = 247.
FASTEST_MPS = 247**0.5


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ({}, "above v0 of 5 m/s"),
        ({"crossing.road_speed_limit_mps": 13.9}, "above the road's limit of 13.9 m/s"),
        ({"crossing.road_speed_limit_mps": 16.0}, ""),
    ],
)
def test_speeding_is_said(tmp_path: Path, limit: dict[str, object], said: str) -> None:
    keys = {"arms.av": f"{__name__}:FullThrottle", "experiment.pairs": 4, **limit}
    study = one_cell("cctc", {**keys, "pedestrians.flow_per_hour": 0.0})
    (result,) = run_inline(study, tmp_path / "run", engine="plain").results
    assert result.summary.max_speed_mps == pytest.approx(FASTEST_MPS, rel=1e-9)
    assert result.summary.max_speed_human_mps == pytest.approx(5.0, rel=1e-9)
    notes = encounter_notes(result.cell.scenario, result.findings, ENCOUNTERS)
    lines = [note.text for note in notes if note.rank is Rank.SPEEDING]
    told = [f"The AV drove at up to 15.7 m/s, {said}" in line for line in lines]
    assert told == [True] * bool(said)


class NeverRestarts(HardYield):
    """Stops as Hard-Yield does for whoever crosses, and does not notice that they have gone.

    Args:
        seen_for_s: for so long somebody has to be seen.
    """

    def __init__(self, *, seen_for_s: float = 0.0) -> None:
        super().__init__()
        self._left_s = seen_for_s
        self._seen: tuple[PedestrianView, ...] = ()

    def decide(self, observation: Observation, /) -> float:
        """Wanted acceleration in m/s²."""
        crossing = tuple(who for who in observation.pedestrians if who.on_crossing)
        if crossing and not self._seen:
            self._left_s -= observation.step_s
            self._seen = crossing if self._left_s < 0 else ()
        return super().decide(observation._replace(pedestrians=self._seen or crossing))


NAME = f"{__name__}:NeverRestarts"


def of(folder: Path, *vary: str, **changes: object) -> RunData:
    wanted = {"experiment.pairs": 200, "experiment.timeout_s": 60.0, **changes}
    study = sweep("cctc_flow", wanted, *vary)
    return run_inline(study, folder, engine="plain")


def test_it_never_crashes_and_is_not_better(tmp_path: Path) -> None:
    run = of(tmp_path / "run", f"arms.av=soft_yield,{NAME}")
    soft, never = (result.summary for result in run.results)
    assert never.kappa.value == 0
    assert never.timed_out_av > 20
    # The paper's two numbers would make it the better one: it is quick wherever it arrives.
    assert never.mu.value < soft.mu.value
    (group,) = compare(run).groups
    # In times, and in crashes or time-outs.
    assert [group.beaten_by(0, by) for by in (0, 1)] == [[1], [1]]
    assert [group.beaten_by(1, by) for by in (0, 1)] == [[], []]


def test_it_is_not_allowed(tmp_path: Path) -> None:
    values = f'strategies."{NAME}".seen_for_s=0,0.1'
    run = of(tmp_path / "run", values, **{"arms.av": NAME})
    # Its crash rate and the mean of τ where both crossed lie within the limits.
    assert all(r.summary.mu.high < 1.2 and r.summary.kappa.high < 0.05 for r in run.results)
    (group,) = compare(run, mu0=1.2, kappa0=0.05).groups
    (found,) = group.sweeps
    assert [item.verdict for item in found.found.judgements] == [Verdict.DENIED] * 2
