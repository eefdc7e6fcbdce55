"""``harness risk`` from the shell: the same rows on any number of workers, resumed, met again."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

import harness
from harness.results import folder
from harness.studies.risk.estimate import read_risk
from harness.studies.running.claimed_folder import RunFolder
from tests.batches import QUICK, here, options_of, printed, refusal
from tests.scenes import refuses

UNHINDERED = ("risk", "cctc", "--set", "arms.av=constant_speed", "--target-cv", 0.3)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("risk") / "whole"
    assert printed(*UNHINDERED, "--out", out, "--quiet") == f"{out}\n"
    return out


def test_the_interval_holds_the_quadrature_and_its_events_crash_again(finished: Path) -> None:
    document = json.loads(printed("show", finished, "--json"))
    (record,) = document["records"]
    # docs/method.md: κ of constant_speed by quadrature.
    assert record["probability"]["low"] <= 0.2146 <= record["probability"]["high"]
    # The last round alone is the estimate; every draw is independent and nominal.
    draws = pd.read_parquet(finished / "draws")
    last = draws[draws["cell"] == draws["cell"].max()]
    assert record["probability"]["value"] == pytest.approx(last["event"].mean())
    assert record["episodes"]["value"] == draws["episodes"].sum() == 2 * len(last)
    events = harness.load_run(finished / "events").episodes
    assert set(events[events["arm"] == "av"]["ending"]) == {"crashed"}
    assert "crashed" in printed("worst", finished / "events", "-n", 1)
    screen = printed("show", finished)
    assert f"{100 * record['probability']['value']:.2f} %" in screen
    assert "brute force" in screen


def test_its_page_has_the_estimate_and_plays_its_events(finished: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    printed("report", finished, "--out", page)
    text = page.read_text("utf-8")
    assert "probability of the event" in text
    assert 'id="player-data"' in text
    for command in (["compare", finished], ["worst", finished], ["replay", finished, "--pair", 0]):
        assert "is a risk estimate" in refusal(*command, *["--gui"] * (command[0] == "replay"))


def test_a_finished_one_is_only_shown_and_an_edited_one_is_refused(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    again = Path(shutil.copytree(finished, tmp_path / "again"))
    assert printed("resume", again, "--quiet") == f"{again}\n"
    stored = read_risk(again)
    monkeypatch.setattr(folder, "code_digest", lambda: "of other code")
    assert read_risk(again) == stored  # from the draws
    min((again / "draws").iterdir()).unlink()
    refuses("draws: parts are missing", lambda: read_risk(again))
    (again / "findings.json").write_text("{}")
    assert "findings.json: is damaged" in refusal("resume", again)


def test_a_folder_at_which_another_process_works_gets_no_manifest(tmp_path: Path) -> None:
    other = RunFolder(tmp_path)
    assert "another process is working" in refusal(*UNHINDERED, "--out", tmp_path)
    other.close()
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]


RAISES = """
class Raises:
    def decide(self, observation):
        if any(person.speed_mps > 1.6 for person in observation.pedestrians):
            raise ValueError("too fast")
        return 0.0
"""


def test_failures_are_said_and_end_with_exit_code_1(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(RAISES)
    words = ("risk", "cctc", "--target-cv", 0.5, "--out", "out", "--json")
    done = here(*words, "--set", "arms.av=own:Raises", cwd=tmp_path)
    assert done.returncode == 1
    document = json.loads(done.stdout)
    (record,) = document["records"]
    assert record["failures"]["value"] > 0
    assert record["probability_worst"]["value"] > record["probability"]["value"]
    assert document["notes"][0]["key"] == "failures"
    draws = pd.read_parquet(tmp_path / "out" / "draws")
    assert not (draws["event"] & draws["reason"].notna()).any()
    assert draws["reason"].str.contains("too fast").sum() == record["failures"]["value"]


def test_without_an_event_there_is_no_page_and_none_is_named(tmp_path: Path) -> None:
    """Nothing ends in an event if all fails."""
    (tmp_path / "raising.py").write_text(RAISES.replace("1.6", "0.0"))
    words = ("risk", "cctc", "--set", "arms.av=raising:Raises", "--out", "out")
    done = here(*words, cwd=tmp_path)
    assert done.returncode == 1
    assert ("probability" in done.stdout, "harness report" in done.stdout) == (True, False)
    (tmp_path / "raising.py").unlink()  # looking at a risk imports nothing
    assert "no episode ended in the event" in refusal("report", "out", cwd=tmp_path)
    assert [path.name for path in tmp_path.rglob("*.html")] == []


def test_draws_that_are_not_sampled_are_said(tmp_path: Path) -> None:
    """The human driver that samples its speed draws at every decision."""
    sampled = {"arms.human": "human_gmm", "strategies.human_gmm.speed": "sampled"}
    settings = options_of({**QUICK, **sampled})
    words = ("risk", "cctc", *settings, "--event", "min_gap_m<1000", "--arm", "human", "--json")
    document = json.loads(printed(*words, "--out", tmp_path / "risk", "--target-cv", 0.5))
    # Everybody who steps off is nearer than a kilometre.
    assert document["records"][0]["probability"]["value"] == 1.0
    said = {note["key"]: note["text"] for note in document["notes"]}
    assert "what the strategy draws after its first 2 random numbers" in said["not_sampled"]
    assert {"not_validated", "model_fit"} < said.keys()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cctc", "--event", "crush"], "--event crush: is not an event"),
        (["cctc", "--event", "pet_s>1"], "after one of pet_s< min_ttc_s<"),
        (["cctc", "--arm", "humans"], "'humans' is not one of 'av', 'human'"),
        (["cctc", "--target-cv", "0"], "--target-cv"),
        (["euro_ncap_vru"], "one value of ego.initial_speed_mps, pedestrians.timed_case"),
        (["field_sites"], "a scenario of simulations"),
        (["cctc", "--set", "arms.av=sumo_driver"], "drives only"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], words: str, tmp_path: Path) -> None:
    assert words in refusal("risk", *arguments, "--out", tmp_path / "risk")
    assert not (tmp_path / "risk").exists()
