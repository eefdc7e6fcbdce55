"""Runs of the plain engine: SUMO's records without SUMO."""

import pandas as pd
import pytest

from harness.core.encounter import Arm
from harness.results.run import Run
from harness.studies.replay import debug
from harness.studies.run import run
from tests.batches import FLOW
from tests.conftest import close_all

CRASHES = {**FLOW, "arms.av": "constant_speed", "experiment.pairs": 24}


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Run]:
    close_all()
    folder = tmp_path_factory.mktemp("both")
    here = {"settings": CRASHES, "workers": 0}
    plain = run("cctc_flow", engine="plain", out=folder / "plain", **here)
    return plain, run("cctc_flow", out=folder / "sumo", **here)


def test_every_record_is_sumos_and_is_replayed_there(both: tuple[Run, Run]) -> None:
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
    repeated = debug(both[0], 0, range(3, 4), [*Arm])
    assert [one.differences for one in repeated] == [(), ()]
