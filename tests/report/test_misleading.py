"""Results that once looked calm and were not: each says so first, in words, in CSV and in JSON."""

import csv
import html
import json
import re
from itertools import count
from pathlib import Path
from typing import Any

import pytest

import harness
from harness.core.encounter import Observation
from harness.core.errors import InputError
from harness.model.interaction import InteractionModel
from harness.old.report.pages.page import write_report
from harness.old.report.screens.result_screen import screen_of
from harness.old.report.screens.run_document import run_document
from harness.old.report.screens.screen import screen_lines
from harness.old.report.screens.terminal import print_run
from harness.old.studies.kinds.tasks import Task
from harness.old.studies.runs.reported import knowledge_lines, reported
from harness.old.studies.runs.run_data import RunData
from harness.scenario import Options
from tests.batches import one_cell, printed, run_inline, scenario_file, sweep
from tests.made_up import Fate, made_up


class Told:
    """A run as it is told: on the terminal, in ``summary.csv``, as JSON, on the page."""

    def __init__(
        self, run: RunData, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from harness.old.report.pages import encounter_parts, page

        capsys.readouterr()
        print_run(run, full=True)
        self.text = " ".join(capsys.readouterr().out.split())
        self.screen = screen_lines(screen_of(reported(run)))
        with (run.path / "summary.csv").open(encoding="utf-8", newline="") as file:
            self.row = next(csv.DictReader(file))
        self.json: dict[str, Any] = json.loads(json.dumps(run_document(run)))
        self.cell = self.json["cells"][0]
        monkeypatch.setattr(encounter_parts, "pictures_of", lambda *_: iter(()))
        monkeypatch.setattr(page, "shown_pairs", lambda *_: [])
        self.page = write_report(run).page.read_text(encoding="utf-8")

    def says_first(self, words: str) -> None:
        """On the first screen, on which the page begins, and in JSON."""
        assert len(self.screen) <= 16
        assert words in " ".join(" ".join(self.screen).replace("\n", " ").split())
        page = html.unescape(self.page)
        rows = [line for line in self.screen if not line.startswith(("!", " "))][:-1]
        assert all(page.index(line) < page.index("<table") for line in rows)
        assert words in " ".join(page.partition("<table")[0].split())
        assert any(words in caveat for caveat in self.cell["caveats"])

    def shows_the_worst(self, *values: str) -> None:
        """In a row of the first screen."""
        (row,) = [line for line in self.screen if line.startswith("worst case ")]
        assert [value for value in values if value not in row] == []

    def number(self, name: str) -> float:
        """A column, the same in CSV and JSON."""
        value = self.cell["summary"][name]
        assert float(self.row[name]) == pytest.approx(value)
        return float(value)


@pytest.fixture
def told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Any:
    runs = count()

    def tell(
        fates: Any, pairs: int = 40, options: Options | None = None, **changes: object
    ) -> Told:
        study = one_cell("cctc", {"experiment.pairs": pairs, **changes})
        run = made_up(tmp_path / f"run-{next(runs)}", study, fates, options)
        return Told(harness.load_run(run), capsys, monkeypatch)

    return tell


FAILED = {"ending": "engine_failed", "failed_in": "strategy", "reason": "the strategy raised"}


def test_one_pair_is_not_1_pairs(told: Any) -> None:
    found = told(lambda _task, _pair: (9.0, 10.0), pairs=1)
    for text in ("\n".join(found.screen), found.page):
        assert "1 pair" in text
        assert not re.search(r"(?<![\d,.])1 (pairs|episodes)\b", text)


def test_pairs_that_were_chosen_for_their_crashes_are_no_sample(told: Any) -> None:
    drawn = [{"episode": number, "quantile": [0.5], "side": [0.2]} for number in range(3)]
    found = told(lambda *_: "crashed", pairs=3, **{"pedestrians.drawn": drawn})
    assert found.number("kappa") == 1
    found.says_first("The pairs were selected by their outcome")


def test_a_strategy_that_raises_whenever_it_meets_someone(told: Any) -> None:
    def fates(_task: Task, pair: int) -> tuple[Fate, Fate]:
        nobody = {"pass_time_s": 7.4, "pedestrians": 0}
        return (dict(FAILED), 10.0) if pair < 18 else (nobody, nobody)

    found = told(fates)
    found.says_first("18 of 40 pairs failed (AV 18, human_gmm 0; strategy 18, engine 0)")
    assert found.number("mu") == 1.0
    assert (found.number("failed_strategy"), found.number("failed_engine")) == (18, 0)
    assert found.number("kappa") == 0
    assert found.number("kappa_worst") == pytest.approx(18 / 40)
    # 18 arms at the time-out of 60 s against 10 s, 22 pairs alike.
    assert found.number("mu_worst") == pytest.approx((18 * 6 + 22) / 40)
    found.shows_the_worst("crashes 18 of 40", "μ 3.250")


class Touchy:
    """Raises as soon as somebody is on the crossing."""

    def decide(self, observation: Observation) -> float:
        """Nothing, until there is someone."""
        if any(pedestrian.on_crossing for pedestrian in observation.pedestrians):
            raise RuntimeError("help")
        return 0.0


def test_it_is_the_strategy_that_failed_in_a_real_run_too(tmp_path: Path) -> None:
    av = f"{__name__}:Touchy"
    run = run_inline(one_cell("cctc", {"experiment.pairs": 3, "arms.av": av}), tmp_path / "run")
    summary = run.results[0].summary
    assert (summary.failed_strategy, summary.failed_engine, summary.failed_av) == (3, 0, 3)
    assert summary.kappa_worst.value == 1.0
    # 60 s for the AV, in the worst case, against what each human took.
    human_s = run.pairs["human_time_s"].to_numpy()
    assert summary.mu_worst.value == pytest.approx((60 / human_s).mean())


class Informed(Touchy):
    """Is given what its pedestrians' speeds are drawn from."""

    def __init__(self, model: InteractionModel) -> None:
        self.model = model


def test_an_own_strategy_that_is_given_the_model_is_named(tmp_path: Path) -> None:
    av, human = f"{__name__}:Informed", f"{__name__}:Touchy"
    changes = {"experiment.pairs": 2, "arms.av": av, "arms.human": human}
    (line,) = knowledge_lines(run_inline(one_cell("cctc", changes), tmp_path / "run"))
    assert line.startswith(f"{av} knows the pedestrians' distribution")


def test_nobody_was_met_is_not_nothing_ran(told: Any) -> None:
    nobody = {"pass_time_s": 7.4, "pedestrians": 0, "arrivals": 0}
    found = told(lambda _task, _pair: (nobody, nobody))
    found.says_first("Neither driver met a pedestrian: nothing was tested")
    assert (found.number("met_nobody"), found.number("met_someone")) == (40, 0)
    assert found.cell["summary"]["mu_met_someone"] is None
    assert found.row["pedestrian_delay_s"] == ""
    found = told(lambda _task, _pair: ({**FAILED, "pedestrians": 0}, 10.0))
    found.says_first("Every episode of the AV failed: nothing was tested")
    assert found.number("met_nobody") == 0


def test_a_fallback_that_drives_has_its_name(told: Any) -> None:
    fell = {"pass_time_s": 12.0, "fallback": True}
    nobody = {"pass_time_s": 7.4, "pedestrians": 0}
    found = told(lambda _task, pair: fell if pair < 10 else (nobody, nobody))
    name = "soft_yield (hard_yield in 100 %)"
    assert name in found.text
    assert name in found.page
    assert found.cell["av"] == name
    found.says_first("hard_yield drove 10 of 40 passages (100 % of those that met someone)")
    assert (found.number("fallbacks"), found.number("fallback_share")) == (10, 1.0)


def test_mu_says_which_way_it_errs(told: Any) -> None:
    # Where the human crashes, slow people are about: the AV waits 35 s, they would have taken 8 s.
    def fates(_task: Task, pair: int) -> tuple[Fate, Fate]:
        if pair % 4:
            return 8.0 + 0.1 * (pair % 3), 10.0
        return 35.0 + pair % 3, {"ending": "crashed", "pass_time_ignoring_contact_s": 8.0}

    found = told(fates)
    found.says_first("μ makes the AV look faster than it is")
    crossed = sum((8.0 + 0.1 * (pair % 3)) / 10 for pair in range(40) if pair % 4)
    crashed = sum((35.0 + pair % 3) / 8 for pair in range(0, 40, 4))
    assert found.number("mu_all") == pytest.approx((crossed + crashed) / 40)
    assert found.number("mu") < found.number("mu_all_ci_low") < found.number("mu_all_ci_high")
    assert found.number("delay_difference_human_s") > 0 > found.number("mu") - 1


def test_the_model_was_asked_outside_its_data_or_within(told: Any) -> None:
    # 1 of 4 questions in the AV's arm, 3 of 4 in the human's; the largest excess of all counts.
    def fates(_task: Task, pair: int) -> tuple[Fate, Fate]:
        asked = {"pass_time_s": 8.0, "conditionings": 4}
        beyond = {"clamped_speed_excess_mps": 5.0 + pair / 100, "clamped_range_excess_m": 12.0}
        return {**asked, "clamped": 1, **beyond}, {**asked, "clamped": 3, **beyond}

    found = told(fates)
    found.says_first(
        "In 25 % (AV) and 75 % (human_gmm) of the cases the vehicle was outside the data of the "
        "interaction model, up to 5.39 m/s too fast and 12 m too far away"
    )
    assert (found.number("clamped_share"), found.number("clamped_share_human")) == (0.25, 0.75)
    assert found.number("clamped_speed_excess_mps") == pytest.approx(5.39)
    inside = {"pass_time_s": 8.0, "conditionings": 4, "clamped": 0, "near_clamped": 2}
    found = told(lambda _task, _pair: (inside, inside))
    assert "outside the data" not in found.text
    assert found.number("clamped_share") == 0


def test_half_timed_out(told: Any) -> None:
    found = told(lambda _task, pair: "timed_out" if pair % 2 else (8.0, "timed_out"))
    found.says_first("40 of 40 pairs timed out (AV 20, human_gmm 20)")
    assert (found.number("timed_out_av"), found.number("timed_out_human")) == (20, 20)
    # A human who never passed counts as free, not as slow: 7.4 s; the AV at 60 s against 10 s.
    assert found.number("mu_worst") == pytest.approx((20 * 6 + 20 * 8 / 7.4) / 40)
    assert found.number("kappa_worst") == 0.5


def test_a_time_out_shorter_than_a_free_pass_is_refused() -> None:
    """(30 + 5 + 2) m at 5 m/s take 7.4 s; a setting of a file is named as the file's."""
    with pytest.raises(InputError, match=r"experiment.timeout_s: 5 s is shorter .*at least 7.4 s"):
        one_cell("cctc", {"experiment.timeout_s": 5.0})
    assert one_cell("cctc", {"experiment.timeout_s": 7.4}).base.experiment.timeout_s == 7.4
    with pytest.raises(InputError, match=r"cctc.toml: experiment.timeout_s"):
        scenario_file("cctc", {"ego.initial_speed_mps": 0.5}).scenario()


def test_a_comparison_says_first_that_one_timed_out(tmp_path: Path) -> None:
    study = sweep("cctc", {"experiment.pairs": 10}, "arms.av=soft_yield,hard_yield")

    def fates(task: Task, pair: int) -> Fate:
        return "timed_out" if task.scenario.arms.av == "hard_yield" and pair < 1 else 9.0

    run = made_up(tmp_path / "run", study, fates)
    words = "Cell 1: 1 of 10 pairs timed out (AV 1, human_gmm 0)"
    assert words in " ".join(printed("compare", run).split())
    text = " ".join(printed("compare", run, "--full").split())
    assert words in text
    # Nine took 9 s, 1.6 s of it delay; the time-out is 60 s, the human takes 10 s.
    mu, delay_s = (9 * 0.9 + 6) / 10, (9 * 1.6 + 52.6) / 10
    document = json.loads(printed("compare", run, "--json"))["groups"][0]["cells"][1]
    worst = [document[name] for name in ("time_ratio_worst", "mu_worst", "delay_worst_s")]
    assert worst == pytest.approx([mu, mu, delay_s])
    # Ten pairs are too few: the star stands at the cell's own numbers too.
    assert f"{mu:.3f} *" in text
    assert "* unreliable" in text
    assert "differences A − B over the common pairs (negative: A takes less time)" in text


def test_crashes_that_a_ratio_of_times_leaves_out_show_its_worst_case(tmp_path: Path) -> None:
    study = sweep("cctc", {"experiment.pairs": 10}, "arms.av=soft_yield,constant_speed")

    def fates(task: Task, pair: int) -> Fate:
        return "crashed" if task.scenario.arms.av == "constant_speed" and pair < 5 else 8.0

    made_up(tmp_path / "run", study, fates)
    run = harness.load_run(tmp_path / "run")
    # Five took 8 s, five count with 60 s, the human takes 10 s; nobody failed or timed out.
    lines = screen_lines(screen_of(reported(run)))
    (heading,) = [line for line in lines if line.startswith("cell ")]
    column = heading.index("case")
    rows = [line[column:].split() for line in lines if line[:2] in ("0 ", "1 ")]
    # The first cell has no worst case: its next number stands there.
    assert (rows[0][0], rows[1][0]) == (f"{run.results[0].summary.mu.value:.3f}", "3.40")
    compared = [line.split() for line in printed("compare", tmp_path / "run").splitlines()]
    assert ["constant_speed", "0.80", "3.40"] in [line[1:4] for line in compared]
    assert "3.400 *" in " ".join(printed("compare", tmp_path / "run", "--full").split())
    document = run_document(run)["cells"][1]["summary"]
    assert document["time_ratio"] == pytest.approx(0.8)
    assert document["time_ratio_worst"] == pytest.approx(3.4)
