"""Runs of the plain engine: SUMO's records without SUMO."""

from pathlib import Path

import pandas as pd
import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.old.studies.replay.rerun import debug
from harness.old.studies.runs.run_data import RunData
from tests.batches import FLOW, one_cell, run_inline
from tests.conftest import close_all

CRASHES = {**FLOW, "arms.av": "constant_speed", "experiment.pairs": 24}


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunData, RunData]:
    folder, study = tmp_path_factory.mktemp("both"), one_cell("cctc_flow", CRASHES)
    return run_inline(study, folder / "plain", engine="plain"), run_inline(study, folder / "sumo")


def test_every_record_is_sumos_and_is_replayed_there(both: tuple[RunData, RunData]) -> None:
    plain, sumo = (run.episodes for run in both)
    assert (plain["ending"] == "crashed").sum() > 3
    for name in plain.columns.drop("sumo_collision"):
        if pd.api.types.is_float_dtype(plain[name]):
            pd.testing.assert_series_equal(
                plain[name], sumo[name], rtol=1e-6, atol=1e-6, check_exact=False
            )
        else:
            assert plain[name].equals(sumo[name]), name
    assert plain["sumo_collision"].isna().all()
    close_all()
    repeated = debug(both[0].path, 3, [*Arm])
    assert [one.differences for one in repeated.values()] == [(), ()]


def test_refused(tmp_path: Path) -> None:
    study = one_cell("cctc_flow", {"traffic.flow_per_hour": 600})
    with pytest.raises(InputError, match=r"\[traffic\] needs SUMO"):
        run_inline(study, tmp_path / "run", engine="plain")
    assert not (tmp_path / "run").exists()
