"""A run of hours as a user sees it: tables, bytes on any number of workers, page, refusals."""

from pathlib import Path

import pytest

import harness
from harness.batch.experiment import run_study
from harness.errors import InputError
from harness.report.page import write_report
from harness.results.tables import HOUR_TABLES
from harness.scenario import Options, read_scenario_file, study_of
from harness.workers.pool import LocalPool

SCENARIO = """
arms = {av = "gap_yield", human = "human_yield"}
ego = {initial_speed_mps = 8.0}
pedestrians = {flow_per_hour = 600}
traffic = {flow_per_hour = 300, oncoming_per_hour = 200, duration_s = 60, warm_up_s = 20}
experiment = {pairs = 2}
"""

FAULTY = """
class Faulty:
    def __init__(self, *, rng):
        self.number = rng.random()

    def decide(self, observation):
        if self.number < 0.6:
            raise ValueError("a vehicle that fails")
        return 0.0
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The same study on one worker and on two."""
    folder = tmp_path_factory.mktemp("hours")
    (folder / "busy.toml").write_text(SCENARIO, encoding="utf-8")
    file = read_scenario_file(folder / "busy.toml")
    study = study_of(file, [])
    found = []
    for workers in (1, 2):
        out = folder / f"run-{workers}"
        run_study(study, Options(workers=workers), out=out, make_executor=LocalPool)
        found.append(out)
    return found


def test_bytes_do_not_depend_on_workers(runs: list[Path]) -> None:
    for name in (*(f"{table}.parquet" for table in HOUR_TABLES), "summary.csv"):
        assert (runs[0] / name).read_bytes() == (runs[1] / name).read_bytes()


def test_what_a_run_says(runs: list[Path], tmp_path: Path) -> None:
    run = harness.load_run(runs[0])
    assert len(run.hours) == 2 * 2
    assert set(run.passages["direction"]) == {"forward", "oncoming"}
    mean_of_hours = run.passages.groupby(["arm", "pair"])["delay_s"].mean().groupby("arm").mean()
    (row,) = run.summary.to_dict("records")
    assert row["vehicle_delay_s"] == pytest.approx(mean_of_hours["av"], rel=1e-9)
    assert row["vehicle_delay_s_human"] == pytest.approx(mean_of_hours["human"], rel=1e-9)
    # One minute with two lanes, two pairs and arms; everybody let through is counted once.
    assert len(run.queues) == 2 * 2 * 2
    through = run.queues[run.queues["arm"] == "av"]["let_through"].sum() / 2
    assert float(through) == pytest.approx(row["throughput_per_hour"] / 60)
    written = write_report(run, tmp_path / "report.html")
    assert "Hours of traffic" in written.page.read_text(encoding="utf-8")


def test_one_vehicle_that_fails_fails_its_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "faulty.py").write_text(FAULTY, encoding="utf-8")
    (tmp_path / "busy.toml").write_text(
        SCENARIO.replace('"gap_yield"', '"faulty:Faulty"'), encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    study = study_of(read_scenario_file(tmp_path / "busy.toml"), [])
    run = run_study(study, Options(workers=1), out=tmp_path / "run", make_executor=LocalPool)
    assert {arm for _, _, arm, _ in run.failures} == {"av"}
    assert all("vehicle " in reason and "fails" in reason for *_, reason in run.failures)
    assert run.summary["failed"].tolist() == [2]
    assert set(run.passages["arm"]) == {"human"}


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("traffic.av_share = 1.5", "traffic.av_share"),
        ("traffic.duration_s = 0", "traffic.duration_s"),
        ("traffic.flow_per_hour = 5000", "5000 vehicles on 1 lanes"),
        ("traffic.flow_per_hour = [1, 2]", "2 values; allowed: 4"),
        ("traffic.tau_s = 0.05", "traffic.tau_s"),
        ("traffic.folowing = 'IDM'", "did you mean 'following'"),
        ("pedestrians.behaviour = 'sumo'", "pedestrians.behaviour"),
        ("pedestrians.first_at_trigger = true", "pedestrians.first_at_trigger"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / "bad.toml").write_text(f"{line}\ntraffic.occupancy = 1.5\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        study_of(read_scenario_file(tmp_path / "bad.toml"), [])
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
