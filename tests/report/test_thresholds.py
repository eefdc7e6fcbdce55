"""``harness score --set conflicts.…``: other thresholds, counted by hand, nothing simulated."""

from pathlib import Path

import pandas as pd
import pytest

import harness
from harness.core.errors import InputError
from harness.scenario import Setting
from harness.studies.batch.scoring import score
from harness.studies.kinds.tasks import Task
from harness.studies.runs.export import export_csv
from tests.batches import one_cell, sweep
from tests.made_up import Fate, made_up
from tests.scenes import refuses


def near_misses(_task: Task, pair: int) -> Fate:
    """PET of 0, 0.5, 1 … 4.5 s."""
    return {"pass_time_s": 8.0, "pet_s": pair / 2}


def test_other_thresholds_count_other_conflicts(tmp_path: Path) -> None:
    run = made_up(tmp_path / "run", one_cell("cctc", {"experiment.pairs": 10}), near_misses)
    for threshold, expected in ((1.5, 3), (2.5, 5), (0.5, 1)):
        again = score(run, tmp_path / f"{threshold}", [Setting("conflicts.pet_s", threshold)])
        rates = harness.load_run(again).conflicts.set_index(["arm", "conflict"])
        pet = rates.loc[("av", "pet")]
        assert (pet["conflicts"], pet["threshold"], pet["episodes"]) == (expected, threshold, 10)
        assert rates.loc[("av", "ttc"), "conflicts"] == 0
    # Everything that rests on no threshold is as it was.
    one, other = (pd.read_csv(of / "summary.csv") for of in (run, again))
    rest = [name for name in one.columns if not name.startswith("conflict_")]
    pd.testing.assert_frame_equal(one[rest], other[rest])
    assert one["conflict_pet"][0] != other["conflict_pet"][0]


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (Setting("conflicts.pets", 1.0), "did you mean 'conflicts.pet_s'"),
        (Setting("ego.initial_speed_mps", 6.0), "other changes need a new simulation"),
        (Setting("conflicts.pet_s", -1.0), "greater than or equal to 0"),
        (Setting("conflicts.pet_s", 3.0), "varies in this run"),
    ],
)
def test_what_is_no_threshold_or_varies_is_refused(
    tmp_path: Path, setting: Setting, words: str
) -> None:
    varied = ["conflicts.pet_s=1.0,2.0"] if "varies" in words else []
    run = made_up(tmp_path / "run", sweep("cctc", {"experiment.pairs": 2}, *varied), near_misses)
    with pytest.raises(InputError) as caught:
        score(run, tmp_path / "again", [setting])
    assert words in str(caught.value)
    assert str(caught.value).startswith(f"--set {setting.key}")
    assert not (tmp_path / "again").exists()


def test_a_damaged_run_leaves_nothing_behind(tmp_path: Path) -> None:
    run = made_up(tmp_path / "run", one_cell("cctc", {"experiment.pairs": 4}), near_misses)
    table = run / "pedestrians.parquet"
    table.write_bytes(table.read_bytes()[:100])
    with pytest.raises(InputError, match=r"pedestrians\.parquet: is damaged"):
        score(run, tmp_path / "again", [Setting("conflicts.pet_s", 1.0)])
    assert not (tmp_path / "again").exists()
    before = {path.name for path in run.iterdir()}
    refuses(r"pedestrians\.parquet: is damaged", lambda: export_csv(run))
    table.unlink()
    refuses(r"pedestrians\.parquet: is missing", lambda: export_csv(run))
    assert {path.name for path in run.iterdir()} == before - {table.name}
