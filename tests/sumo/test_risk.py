"""``harness risk`` from the shell: the same bytes on any number of workers, resumed, met again."""

import json
import re
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import harness
from harness.core.encounter import Arm
from harness.core.errors import InputError, InterruptedRunError
from harness.old.statistics.findings import Rank
from harness.old.studies.risk.asking import Settings
from harness.old.studies.risk.folder import estimate_risk, read_risk, resume_risk
from harness.old.studies.risk.writing import RESULT
from harness.scenario import Setting, read_scenario_file, validate
from tests.batches import CHECKOUT, Inline, here, printed, refusal

FILES = ("result.json", "failures.parquet", "critical.toml")


def settings(av: str = "constant_speed", **changes: object) -> Settings:
    scenario = read_scenario_file("cctc", [Setting("arms.av", av)]).scenario()
    return Settings("cctc", scenario, target_cv=0.3, **changes)


class Counting(Inline):
    """Counts the episodes that it is given, and is interrupted at a task."""

    def __init__(self, interrupted_at: int = 0) -> None:
        super().__init__(1)
        self.tasks, self.episodes, self._interrupted_at = 0, 0, interrupted_at

    def submit(self, function, argument):  # type: ignore[no-untyped-def]
        self.tasks += 1
        if self.tasks == self._interrupted_at:
            raise KeyboardInterrupt
        self.episodes += len(argument.numbers)
        return super().submit(function, argument)


COUNTING = Counting()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("risk") / "whole"
    return estimate_risk(settings(), out=out, make_executor=lambda _: COUNTING)


def test_the_interval_holds_the_quadrature(finished: Path, tmp_path: Path) -> None:
    """Its critical episodes crash again in SUMO."""
    result = json.loads((finished / RESULT).read_text())
    # docs/method.md: κ of constant_speed by quadrature.
    assert result["ci_low"] <= 0.2146 <= result["ci_high"]
    assert result["failed"] == 0
    words = ("run", finished / "critical.toml", "--out", tmp_path / "run", "--quiet")
    printed(*words, cwd=CHECKOUT)
    episodes = pq.read_table(tmp_path / "run" / "episodes").to_pandas()
    assert set(episodes[episodes["arm"] == "av"]["ending"]) == {"crashed"}
    assert len(episodes) >= 2


def test_same_bytes_after_interruptions_and_in_processes(finished: Path, tmp_path: Path) -> None:
    """Issue: a batch was kept when it was whole, and the last stage of a risk is one batch."""
    # In the first look's batch of 40 tasks, in the estimate, and in the checks in SUMO.
    again, estimate, last = tmp_path / "again", Counting(COUNTING.tasks // 2), Counting(5)
    first = Counting(30)
    with pytest.raises(InterruptedRunError, match="harness resume"):
        estimate_risk(settings(), out=again, make_executor=lambda _: first)
    assert not (again / RESULT).exists()
    with pytest.raises(InputError, match="is not finished; allowed: harness resume"):
        read_risk(again)
    for executor in (estimate, last):
        with pytest.raises(InterruptedRunError, match="harness resume"):
            resume_risk(again, make_executor=lambda _, executor=executor: executor)
    rest = Counting()
    resume_risk(shutil.copytree(again, tmp_path / "one"), make_executor=lambda _: rest)
    run = sum(executor.episodes for executor in (first, estimate, last, rest))
    # An interruption loses the tasks that are under way: at most two of 25 episodes.
    assert COUNTING.episodes <= run <= COUNTING.episodes + 3 * 2 * 25
    resume_risk(again, workers=2)
    for name in FILES:
        assert (again / name).read_bytes() == (finished / name).read_bytes()
    assert not (again / "batches").exists()


def test_what_failed_ends_with_exit_code_1(finished: Path, tmp_path: Path) -> None:
    """A damaged result is one line."""
    folder = tmp_path / "risk"
    shutil.copytree(finished, folder)
    result = json.loads((finished / RESULT).read_text())
    for wrong, code in (({}, 0), ({"failed": 1}, 1)):
        (folder / RESULT).write_text(json.dumps({**result, **wrong}))
        assert here("resume", folder).returncode == code
    (folder / RESULT).write_text("{}")
    assert "result.json: scenario: is missing" in refusal("resume", folder)


def test_a_risk_is_said_as_json_as_its_folder_and_in_a_browser(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = json.loads((finished / RESULT).read_text())
    assert json.loads(printed("resume", finished, "--json")) == stored
    assert stored["findings"]["probability"]["value"] == stored["probability"]
    assert printed("resume", finished, "--quiet") == f"{finished}\n"
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    page = tmp_path / "page.html"
    document = json.loads(printed("report", finished, "--out", page, "--open", "--json"))
    assert (document, opened) == ({"page": str(page)}, [page.as_uri()])
    # The page says the estimate and how to play.
    text = page.read_text()
    for words in (f" {stored['probability']:.3g} ", "harness run", "critical.toml"):
        assert words in text
    assert text.count('<table id="way-') == len(stored["ways"])
    # The player has the likeliest events; in every one of them the AV crashes.
    assert "The likeliest events of the estimate, simulated again in SUMO." in text
    shown = harness.load_run(finished / "shown").episodes
    assert set(shown[shown["arm"] == "av"]["ending"]) == {"crashed"}
    (data,) = re.findall(r'id="player-data">(.*?)</script>', text)
    assert json.loads(data)["episodes"]
    # It says m/s as these episodes walked, and neither quantiles nor updates.
    screen = printed("resume", finished, "--full")
    for shown in (text, screen, json.dumps(stored)):
        assert "quantile" not in shown
        assert "at update" not in shown
    walked = harness.load_run(finished / "shown").pedestrians
    first = stored["ways"][0]["critical_pairs"][0]
    walked = walked[(walked["arm"] == "av") & (walked["pair"] == first) & (walked["index"] == 0)]
    speed = f"walks at {walked['speed_mps'].item():.2f} m/s"
    assert speed in text
    assert speed in screen
    # A pair of critical.toml goes to another tool as any other.
    printed("export", finished, "--pair", 0, "--format", "trajectories", "--out", tmp_path / "out")
    assert (tmp_path / "out" / "trajectories.csv").is_file()
    # What a risk cannot do is refused.
    cluster = refusal("resume", finished, "--dask", "tcp://nowhere:1")
    assert "--dask: is not supported with a risk estimate" in cluster
    assert "a risk estimate has no figures" in refusal("report", finished, "--figures", tmp_path)
    out = tmp_path / "new"
    for command in (
        ["compare", finished],
        ["worst", finished],
        ["export", finished, "--csv"],
        ["replay", finished, "--pair", "0", "--out", out],
    ):
        message = refusal(*command)
        assert message.startswith(f"harness: {finished}: is a risk estimate, not a run")
        assert f"harness run {finished / 'critical.toml'}" in message
    assert "is not empty" in refusal("run", "cctc", "--out", finished)


def test_the_human_arm_and_another_event(tmp_path: Path) -> None:
    asked = settings(arm=Arm.HUMAN, event="min_gap_m<1000", most_episodes=60)
    folder = estimate_risk(asked, out=tmp_path / "risk", make_executor=Inline)
    result = json.loads((folder / RESULT).read_text())
    # Everybody who steps off is nearer than a kilometre.
    assert result["probability"] == 1.0
    assert result["strategy"] == "human_gmm"


def test_draws_that_are_not_sampled_are_said(finished: Path, tmp_path: Path) -> None:
    # The human driver that samples its speed draws at every decision.
    tree = read_scenario_file("cctc").scenario().model_dump()
    tree["arms"]["av"], tree["strategies"]["human_gmm"] = "human_gmm", {"speed": "sampled"}
    asked = Settings("cctc", validate(tree, "test"), event="min_gap_m<1000", most_episodes=60)
    drawing = estimate_risk(asked, out=tmp_path / "risk", make_executor=Inline)
    (note,) = read_risk(drawing).notes
    assert note.rank is Rank.LEFT_OUT
    assert "what the strategy draws after its first 2 random numbers" in note.text
    assert read_risk(finished).notes == ()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cctc", "--event", "crush"], "--event crush: is not an event"),
        (["cctc", "--event", "min_tcc_s<1"], "did you mean 'min_ttc_s'?"),
        (["cctc", "--arm", "humans"], "'humans' is not one of 'av', 'human'"),
        (["cctc", "--target-cv", "0"], "--target-cv"),
        (["euro_ncap_vru"], "--set ego.initial_speed_mps=… --set pedestrians.timed_case=…"),
        (["euro_ncap_vru", "--set", "pedestrians.timed_case=CPNA-25"], "ego.initial_speed_mps=…"),
        (["cctc_flow", "--set", "traffic.flow_per_hour=300"], "without [traffic]"),
        (["cctc", "--set", "arms.av=sumo_driver"], "drives only with [simulation]"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], words: str, tmp_path: Path) -> None:
    assert words in refusal("risk", *arguments, "--out", tmp_path / "risk")
    assert not (tmp_path / "risk").exists()
