"""Why SUMO's verdict and the geometric one differ, episode by episode.

The ego is 5 m long and 1.8 m wide; its lane's centre is y = 2.25 m, so it takes y = 1.35 … 3.15 m.
Its nose is at x = 5 (t − 6) m: 0.5 m further at each step, at 0 when t = 6 s.  SUMO's car has a
nose tapered to 0.6 of the width over 0.5 m; SUMO's person is a box that ends at their position and
begins 0.215 m behind it, 0.239 m to either side.
"""

from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest

from benchmarks import verdicts
from benchmarks.verdicts import (
    AGREE,
    BRIEF,
    FLANK,
    GRAZING,
    REASONS,
    STEP_LATE,
    UNEXPLAINED,
    explained,
    verdicts_of,
)
from harness.core.encounter import Side, Trace
from harness.measures import has_contact
from harness.store.reading import read_table
from harness.strategies.constant_speed import ConstantSpeed
from tests.batches import one_cell, run_inline
from tests.scenes import drive, play, scenario


def passing(y_at_6_s: float, speed: float) -> Trace:
    """A car at 5 m/s and somebody from the near side who is at that y when its nose is at 0."""
    return drive([0.0] * 80, [(6 - y_at_6_s / speed, Side.NEAR, speed)])


def reason(trace: Trace, seen: bool) -> str:
    return explained(replace(trace, sumo_collision=seen), has_contact(trace))


@pytest.mark.parametrize(
    ("y_at_6_s", "why"),
    [
        # Their disc reaches down to 3.10 m as the corner passes.  The box ends at 3.135 m, where
        # the nose is 1.48 m wide at first (to 2.96 m, 0.239 m behind its tip); when it has its full
        # width there, 0.052 s later, the box has moved up to 3.198 m.
        (3.35, GRAZING),
        # The same 0.08 m lower: the nose reaches the box after 2.79 + 0.72 (5 τ + 0.239) =
        # 3.055 + 1.2 τ, τ = 0.039 s, and it has left y = 3.15 m after τ = 0.079 s, within the step.
        (3.27, BRIEF),
        # They walk into its side: the box gets there, y = 1.35 m, when the nose is at 4 m, half a
        # metre past the junction's lane; the disc when it is at 2.96 m.
        (0.39, FLANK),
    ],
)
def test_a_contact_that_sumo_does_not_see(y_at_6_s: float, why: str) -> None:
    trace = passing(y_at_6_s, 1.2)
    assert has_contact(trace)
    assert reason(trace, seen=False) == why


def test_what_the_rule_does_not_allow() -> None:
    squarely = passing(2.25, 1.2)
    assert (reason(squarely, seen=True), reason(squarely, seen=False)) == (AGREE, UNEXPLAINED)
    long_gone = passing(8.0, 1.2)
    assert (reason(long_gone, seen=False), reason(long_gone, seen=True)) == (AGREE, UNEXPLAINED)


def test_sumo_sees_him_where_he_was_a_step_ago(sumo) -> None:
    # Nose at 0 at 8.955 s, when they are at 9 − 0.93 · 8.505 = 1.09 m: the disc, up to 1.34 m, has
    # just left the car's way; at 8.9 s, as the step began, they were at 1.14 m, the box to 1.36 m.
    scene = scenario(ego={"trigger_range_m": 60.0, "initial_speed_mps": 6.7})
    trace = play(ConstantSpeed(), [(0.45, Side.FAR, 0.93)], scene, sumo(scene))
    assert (has_contact(trace), trace.sumo_collision) == (False, True)
    assert explained(trace, crashed=False) == STEP_LATE


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """300 pairs without anybody who yields in time."""
    arms = {"arms.av": "constant_speed", "arms.human": "emergency_brake"}
    study = one_cell("cctc", {**arms, "experiment.pairs": 300})
    return run_inline(study, tmp_path_factory.mktemp("verdicts") / "run").path


@pytest.mark.usefixtures("no_simulation")
def test_every_disagreement_of_a_run_is_explained_and_a_wrong_rule_found_out(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = verdicts_of(run)
    episodes = read_table(run, "episodes").to_pandas()
    for arm in ("av", "human"):
        own, judged = episodes[episodes["arm"] == arm], found[0, arm]
        crashed, seen = own["ending"] == "crashed", own["sumo_collision"].astype(bool)
        assert (judged.episodes, judged.crashed, judged.seen) == (300, crashed.sum(), seen.sum())
        assert judged.reasons[AGREE] == (crashed == seen).sum()
        assert sum(judged.reasons[why] for why in REASONS) == 300
        assert judged.unexplained == []
    assert found[0, "av"].reasons[AGREE] < 300
    # A box three times as long would be hit more often than SUMO says.
    monkeypatch.setattr(verdicts, "BEHIND_M", 3 * verdicts.BEHIND_M)
    assert verdicts_of(run)[0, "av"].unexplained


@pytest.mark.usefixtures("no_simulation")
def test_a_run_that_is_not_what_it_says(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def later(folder: Path, name: str, cell: int | None = None) -> pa.Table:
        table = read_table(folder, name, cell)
        column = table.column_names.index("min_gap_m")
        return table.set_column(column, "min_gap_m", pa.nulls(len(table), pa.float64()))

    monkeypatch.setattr(verdicts, "read_table", later)
    with pytest.raises(SystemExit, match="min_gap_m"):
        verdicts_of(run)
