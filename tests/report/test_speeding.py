"""Who saves time by speeding is told so; the commands are not cut."""

from pathlib import Path

import pytest

from harness.core.encounter import Observation
from harness.statistics import ENCOUNTERS, Rank
from harness.studies.runs.notes import encounter_notes
from tests.batches import one_cell, run_inline


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
    (result,) = run_inline(study, tmp_path / "run", engine="plain", audit=0.0).results
    assert result.summary.max_speed_mps == pytest.approx(FASTEST_MPS, rel=1e-9)
    assert result.summary.max_speed_human_mps == pytest.approx(5.0, rel=1e-9)
    notes = encounter_notes(result.cell.scenario, result.findings, ENCOUNTERS)
    lines = [note.text for note in notes if note.rank is Rank.SPEEDING]
    told = [f"The AV drove at up to 15.7 m/s, {said}" in line for line in lines]
    assert told == [True] * bool(said)
