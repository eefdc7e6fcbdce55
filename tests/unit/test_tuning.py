"""A search of parameters: limits and verdicts by hand, trials that go on, a toy's known optimum."""

import json
import math
from dataclasses import replace

import pytest
import typer

from harness.cli.tune import resume_search
from harness.core.errors import InputError, InterruptedRunError
from harness.report.pages.tune_page import write_tune_page
from harness.report.screens.tune_screen import tune_lines
from harness.scenario import Options, read_scenario_file, study_of
from harness.statistics import ENCOUNTERS, Finding, proportion
from harness.statistics.limits import (
    ONE_SIDED,
    Limit,
    Shown,
    binding,
    judged,
    numbers_of,
    parse_limit,
    unless_failed,
)
from harness.store.kinds import KINDS, limits_of
from harness.store.reading import kind_of_folder
from harness.store.run_folder import claim_folder
from harness.studies.batch.experiment import run_study
from harness.studies.batch.plan import plan_of
from harness.studies.risk.asking import Settings, question_of
from harness.studies.runs.opening import load_run
from harness.studies.runs.under_limits import judged_limits
from harness.studies.tuning import search as searching, tune as tuning
from harness.studies.tuning.folder import NAMES, Judged, Search, read_judged, read_search
from harness.studies.tuning.search import (
    Goal,
    Parameter,
    Trial,
    best_of,
    front_of,
    next_candidate,
    parse_parameter,
)
from harness.studies.tuning.tune import resume_tune, tune

RARE = Limit("kappa", 1e-3, above=False)
GAP = Parameter("strategies.gap_yield.critical_gap_s", 0.0, 4.0)


def crashes(events: int, pairs: int) -> Finding:
    (entry,) = (entry for entry in ENCOUNTERS if entry.key == "kappa")
    return entry.finding("kappa", proportion(events, pairs, ONE_SIDED), 100)


@pytest.mark.parametrize(
    ("events", "pairs", "shown"),
    [
        # 0.999ⁿ < 0.05 from n = 2,995 on: the rule of three.
        (0, 2_994, Shown.NOT_SHOWN),
        (0, 2_995, Shown.SATISFIED),
        # One crash needs n with (1 + n/999) 0.999ⁿ < 0.05, from 4,742 on.
        (1, 4_741, Shown.NOT_SHOWN),
        (1, 4_742, Shown.SATISFIED),
        # At least k crashes in 3,000 episodes of rate 0.001: 8.4 % for k = 6, 3.3 % for k = 7.
        (6, 3_000, Shown.NOT_SHOWN),
        (7, 3_000, Shown.VIOLATED),
    ],
)
def test_the_verdict_of_a_rate_is_exact(events, pairs, shown) -> None:
    assert RARE.judged(crashes(events, pairs))[0] is shown


def test_what_is_not_known_is_not_shown() -> None:
    limit = parse_limit("delay_s > 2", NAMES, "")
    assert limit == Limit("delay_s", 2.0, above=True)
    assert limit.judged(Finding(3.0, 2.5, 3.5))[0] is Shown.SATISFIED
    assert limit.judged(Finding(3.0, 1.5, 3.5))[0] is Shown.NOT_SHOWN
    assert limit.judged(Finding(1.0, 0.5, 1.5))[0] is Shown.VIOLATED
    for unknown in (
        Finding(None, reason="nobody"),
        Finding(3.0),
        Finding(3.0, 2.5, 3.5, reliable=False, reason="few"),
    ):
        assert limit.judged(unknown)[0] is Shown.NOT_SHOWN
    # A value at the limit does not keep it.
    assert limit.excess(2.0) > 0


def test_no_limit_is_satisfied_with_failures_unless_its_number_counts_them() -> None:
    found = {name: Finding(0.0, 0.0, 0.01) for name in ("kappa", "kappa_worst", "kappa_all")}
    limits = [Limit(name, 0.1, above=False) for name in found]
    verdicts = [judged(limit, found[limit.name]) for limit in limits]
    assert unless_failed(verdicts, 0) == tuple(verdicts)
    kappa, *others = unless_failed(verdicts, 1)
    assert (kappa.shown, kappa.reason) == (Shown.NOT_SHOWN, "failures in 1 pair")
    assert others == verdicts[1:]


def test_the_binding_limit_has_the_worst_verdict_and_then_the_least_margin() -> None:
    rate, delay = Limit("kappa", 0.02, above=False), Limit("delay_s", 2.0, above=False)
    gap, change = Limit("gap_s", 4.0, above=True), Limit("delay_difference_s", 0.0, above=False)
    kept = [
        judged(rate, Finding(0.0, 0.0, 0.015)),  # (0.02 − 0.015) / 0.02
        judged(delay, Finding(1.8, 1.7, 1.9)),  # (2 − 1.9) / 2
        judged(gap, Finding(6.0, 5.0, 7.0)),  # (5 − 4) / 4, by the lower bound
        judged(change, Finding(-1.0, -2.0, -0.5)),  # nothing is relative to 0
    ]
    assert [each.margin for each in kept] == [*map(pytest.approx, (0.25, 0.05, 0.25)), None]
    assert binding(kept) is kept[1]
    open_ = judged(rate, Finding(0.0, 0.0, 0.03))
    assert open_.margin == pytest.approx(-0.5)
    assert binding([*kept, open_]) is open_
    missed = judged(delay, Finding(2.01, 2.005, 2.02))
    assert missed.margin == pytest.approx(-0.01)
    assert binding([*kept, open_, missed]) is missed
    unknown = judged(gap, Finding(None, reason="nobody"))
    assert (binding([unknown, open_]), unknown.margin, binding([])) == (open_, None, None)


def test_every_number_of_every_kind_can_be_limited_and_others_are_refused() -> None:
    for kind in KINDS.values():
        names = numbers_of(kind.catalogue)
        assert len(names) > 20
        assert {"confidence", "av"}.isdisjoint(names)
        assert all(parse_limit(f"{name}>1", names, "").name == name for name in names)
    hours = read_scenario_file("traffic", {"limits.subject_to": ["crashes_per_hour<1"]}).scenario()
    with pytest.raises(InputError, match=r"limits.subject_to: unknown number 'crashes_per_hour'"):
        limits_of(hours)
    study = study_of(read_scenario_file("cctc", {"limits.subject_to": ["kapa<1e-3"]}))
    with pytest.raises(InputError, match="did you mean 'kappa'"):
        plan_of(study, Options())


def test_a_risk_refuses_a_limit_on_an_unknown_number() -> None:
    file = read_scenario_file("cctc", {"limits.subject_to": ["kapa<1e-3"]})
    with pytest.raises(InputError, match="did you mean 'kappa'"):
        question_of(Settings("cctc", file.scenario()))


GOAL = Goal("delay_s", "minimize", (Limit("kappa", 0.1, above=False),))


def trial(number: int, x: float, delay: float | None, kappa: float) -> Trial:
    return Trial(number, {GAP.key: x}, {"delay_s": delay, "kappa": kappa})


def test_the_best_keeps_every_limit_and_the_front_is_not_beaten() -> None:
    trials = [
        trial(0, 0.5, 1.0, 0.3),
        trial(1, 1.0, 2.0, 0.05),
        trial(2, 1.5, 2.0, 0.05),
        trial(3, 2.0, 3.0, 0.05),
        trial(4, 2.5, None, 0.0),
    ]
    best = best_of(GOAL, trials)
    assert best is not None
    assert best.number == 1
    assert [of.number for of in front_of(GOAL, trials)] == [0, 1, 2]
    assert best_of(GOAL, trials[:1]) is None


def test_the_search_finds_a_toys_optimum_at_the_limit() -> None:
    """Delay grows with the gap, κ falls below 0.1 at 2: the optimum is 2."""
    trials: list[Trial] = []
    for number in range(40):
        x = next_candidate([GAP], GOAL, trials, 1)[GAP.key]
        trials.append(trial(number, x, x, 0.1 * math.exp(2.0 - x) - 1e-9))
    best = best_of(GOAL, trials)
    assert best is not None
    assert best.candidate[GAP.key] == pytest.approx(2.0, abs=0.15)
    assert next_candidate([GAP], GOAL, trials[:25], 1) == dict(trials[25].candidate)
    assert next_candidate([GAP], GOAL, trials[:25], 2) != dict(trials[25].candidate)
    # The first ten are drawn at random; with one seed for all trials they would be the same.
    assert len({of.candidate[GAP.key] for of in trials[:10]}) == 10


def made() -> Search:
    file = read_scenario_file("cctc_flow", {"arms.av": "gap_yield"})
    return Search(file, (GAP,), GOAL, trials=5, pairs=4, fresh=4, engine="plain")


class FailsNearby:
    """Drives on, and gives up ``within_m`` of the crosswalk."""

    def __init__(self, *, within_m: float = 10.0) -> None:
        self.within_m = within_m

    def decide(self, observation):
        if observation.ego.range_m < self.within_m:
            raise RuntimeError("emergency stop not implemented")
        return 0.0


def shown(search: Search, judged: Judged) -> str:
    return " ".join(" ".join(tune_lines(search, judged)).split())


FAILING = "tests.unit.test_tuning:FailsNearby"


class FailsForSomebody:
    def decide(self, observation):
        if any(person.on_crossing for person in observation.pedestrians):
            raise RuntimeError("not implemented")
        return 0.0


def test_a_run_with_failures_satisfies_no_limit(tmp_path) -> None:
    limits = ["kappa<0.99", "kappa<1e-9"]
    settings = {
        "arms.av": "tests.unit.test_tuning:FailsForSomebody",
        "experiment.pairs": 20,
        "limits.subject_to": limits,
    }
    study = study_of(read_scenario_file("cctc_flow", settings))
    options = Options(workers=0, engine="plain", audit=0.0)
    run = run_study(study, options, out=tmp_path / "run")
    (cell,) = run.study.cells
    verdicts = judged_limits(run, cell, limits_of(cell.scenario))
    assert 0 < len(run.failures) < 20
    assert [each.shown for each in verdicts] == [Shown.NOT_SHOWN] * 2
    assert verdicts[0].reason == f"failures in {len(run.failures)} pairs"


def test_a_trial_in_which_the_av_failed_is_never_the_best_nor_on_the_front() -> None:
    failed = replace(trial(0, 0.5, 0.1, 0.0), failed_av=1, failure="pair 3 av: raised")
    worse = trial(1, 1.0, 2.0, 0.05)
    assert best_of(GOAL, [failed, worse]) == worse
    assert front_of(GOAL, [failed, worse]) == [worse]
    free = Goal("delay_s", "minimize", ())
    assert best_of(free, [failed, worse]) == worse
    assert best_of(free, [failed]) is None
    assert (GOAL.excesses(failed) or {})["failed_av"] == 1.0


def test_the_search_is_steered_away_from_failures() -> None:
    """Delay falls with the gap, and the AV fails above 2."""
    trials: list[Trial] = []
    for number in range(40):
        x = next_candidate([GAP], GOAL, trials, 1)[GAP.key]
        trials.append(replace(trial(number, x, -x, 0.0), failed_av=100 if x > 2.0 else 0))
    best = best_of(GOAL, trials)
    assert best is not None
    assert best.candidate[GAP.key] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("limits", [GOAL.limits, ()])
def test_a_search_in_which_every_episode_failed_says_why(tmp_path, limits) -> None:
    file = read_scenario_file("cctc_flow", {"arms.av": FAILING})
    goal = replace(GOAL, limits=limits)
    within = Parameter(f'strategies."{FAILING}".within_m', 5.0, 10.0)
    search = Search(file, (within,), goal, trials=2, pairs=3, fresh=3, engine="plain")
    judged = tune(search, out=tmp_path / "run", workers=0, progress=lambda *_: None)
    assert (judged.best, judged.front, judged.any_failed) == (None, (), True)
    assert [of.failed_av for of in judged.trials] == [3, 3]
    reason = "RuntimeError: emergency stop not implemented"
    assert all(f"pair 0 av: the strategy raised {reason}" in of.failure for of in judged.trials)
    screen = shown(search, judged)
    assert reason in screen
    assert "Pareto front" not in screen
    assert ("No trial keeps every limit" in screen) == bool(limits)
    assert ("No trial has delay_s without a failure" in screen) == (not limits)
    assert read_judged(tmp_path / "run", search) == judged
    assert reason in write_tune_page(search, judged).read_text(encoding="utf-8")
    with pytest.raises(typer.Exit) as exited:
        resume_search(tmp_path / "run", None, None, full=False, quiet=True, as_json=False)
    assert exited.value.exit_code == 1


def test_no_limit_is_satisfied_if_the_av_failed_on_fresh_pairs(tmp_path) -> None:
    findings = {
        "delay_s": Finding(1.0, 0.9, 1.1),
        "kappa": Finding(0.0, 0.0, 0.01, n=98, events=0),
        "failed": Finding(2),
        "failed_av": Finding(2),
        "timed_out_av": Finding(0),
    }
    limits = (*GOAL.limits, Limit("delay_s", 0.5, above=False))
    search = replace(made(), goal=replace(GOAL, limits=limits), fresh=100)
    whole = Judged(
        tmp_path, 100, (), (), trial(0, 1.0, 1.0, 0.0), findings, "pair 7 av: fell", search.goal
    )
    kept, missed = whole.verdicts
    assert (kept.shown, kept.reason) == (Shown.NOT_SHOWN, "failures in 2 pairs")
    assert missed.shown is Shown.VIOLATED
    screen = shown(search, whole)
    assert "2 fresh pairs failed and are left out. The first: pair 7 av: fell" in screen
    assert "kappa<0.1 not shown" in screen
    none = {**findings, "failed": Finding(0), "failed_av": Finding(0)}
    assert replace(whole, findings=none).verdicts[0].shown is Shown.SATISFIED


def test_trials_that_tie_with_the_best_are_counted_with_their_ranges(tmp_path) -> None:
    tied = [trial(number, x, 1.0, 0.0) for number, x in enumerate((1.0, 1.55, 0.18))]
    others = [trial(3, 3.0, 1.5, 0.0), trial(4, 0.1, 1.0, 0.2), replace(tied[0], failed_av=1)]
    names = ("delay_s", "kappa", "failed", "failed_av", "timed_out_av")
    findings = dict.fromkeys(names, Finding(0, n=4, events=0))

    def screen(trials: list[Trial]) -> str:
        return shown(made(), Judged(tmp_path, 4, tuple(trials), (), tied[0], findings, None, GOAL))

    words = f"3 trials tie, with the same delay_s: {GAP.key} from 0.18 to 1.55"
    assert words in screen([*tied, *others])
    assert "trials tie" not in screen([tied[0], *others])


def test_an_interrupted_search_goes_on_to_the_same_trials(tmp_path) -> None:
    def run(folder, stops_after: int | None = None):
        def progress(done: int, _planned: int, _what: str) -> None:
            if done == stops_after:
                raise KeyboardInterrupt

        return tune(made(), out=folder, workers=0, progress=progress)

    whole = run(tmp_path / "whole")
    with pytest.raises(InterruptedRunError, match="harness resume"):
        run(tmp_path / "stopped", stops_after=2)
    assert len((tmp_path / "stopped" / "trials.jsonl").read_text().splitlines()) == 2
    with pytest.raises(InputError, match="is not finished; allowed: `harness resume"):
        read_judged(tmp_path / "stopped", read_search(tmp_path / "stopped"))
    done: list[int] = []
    search, resumed = resume_tune(
        tmp_path / "stopped", workers=0, progress=lambda number, *_: done.append(number)
    )
    assert done == [3, 4, 5]  # the first two are not repeated
    assert replace(resumed, folder=whole.folder) == whole
    assert read_judged(tmp_path / "stopped", search) == resumed
    for name in ("trials.jsonl", "result.json", "tune.json"):
        both = [(tmp_path / folder / name).read_bytes() for folder in ("whole", "stopped")]
        assert both[0] == both[1], name
    document = json.loads((tmp_path / "whole" / "result.json").read_text())
    assert document["verdicts"]["kappa<0.1"]["verdict"] == "not shown"  # 4 pairs
    page = write_tune_page(made(), whole).read_text(encoding="utf-8")
    assert "kappa&lt;0.1 not shown (bound " in page
    assert "5 trials, search data" in page
    best = read_scenario_file(tmp_path / "whole" / "best.toml").scenario()
    assert whole.best is not None
    assert best.strategies["gap_yield"] == {"critical_gap_s": whole.best.candidate[GAP.key]}


def test_the_screen_fits_80_columns_and_keeps_values_and_commands_whole(tmp_path) -> None:
    judged = tune(made(), out=tmp_path / ("long" * 20), workers=0, progress=lambda *_: None)
    lines = list(tune_lines(made(), judged, 80))
    paths = [line for line in lines if str(tmp_path) in line]
    assert all(len(line) <= 80 for line in lines if line not in paths)
    # A command can be copied, however long its path is.
    assert [line.partition(": ")[0] for line in paths] == ["To check it", "To run it", "All trials"]
    values = [f"{GAP.key} = {value:g}" for value in judged.best.candidate.values()]
    assert any(value in line for value in values for line in lines)
    # On a page, and on a wide terminal, a line has at most 100 columns.
    assert max(len(line) for line in tune_lines(made(), judged, 200) if line not in paths) <= 100


def test_other_commands_name_the_run_that_they_need(tmp_path) -> None:
    assert kind_of_folder(tmp_path) == "run"
    (tmp_path / "tune.json").write_text("{}")
    assert kind_of_folder(tmp_path) == "tune"
    with pytest.raises(InputError, match="is a search of harness tune, not a run; allowed: a run;"):
        load_run(tmp_path)
    (tmp_path / "best.toml").write_text("")
    with pytest.raises(InputError, match=r"its best candidate: `harness run .*best.toml`"):
        load_run(tmp_path)
    with pytest.raises(InputError, match="already contains a search of harness tune"):
        claim_folder(tmp_path, "cctc")
    with pytest.raises(InputError, match="is damaged"):
        read_search(tmp_path)


def test_the_verdict_is_on_pairs_that_the_search_never_saw(tmp_path, monkeypatch) -> None:
    driven: list[range] = []
    drive = tuning.Session.drive

    def noted(self, scenarios, pairs, **more):
        driven.append(pairs)
        return drive(self, scenarios, pairs, **more)

    monkeypatch.setattr(tuning.Session, "drive", noted)
    tune(made(), out=tmp_path / "run", workers=0, progress=lambda *_: None)
    assert driven[-1] == range(4, 8)
    assert {*driven[2:-1]} == {range(4)}


@pytest.mark.parametrize(
    ("text", "words"),
    [("a=4:0", "begins at 4"), ("a=0:1:log", "logarithm"), ("a", "LOW:HIGH"), ("a=0:2:x", "LOW:")],
)
def test_a_wrong_range_is_refused(text, words) -> None:
    with pytest.raises(InputError) as refused:
        parse_parameter(text)
    assert words in str(refused.value)


def test_an_unknown_number_names_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean 'max_jerk_p95_mps3'"):
        parse_limit("max_jerk_p95<10", NAMES, "--subject-to")


def test_an_unknown_number_does_not_list_them_all() -> None:
    with pytest.raises(InputError) as refused:
        parse_limit("dely_s<10", NAMES, "--subject-to")
    assert refused.value.nearest == "delay_s"
    assert "delay_human_s" in str(refused.value)
    assert len(str(refused.value)) < 300
    assert sum(name in str(refused.value) for name in NAMES) < 12


@pytest.mark.parametrize("key", ["experiment.seed", "experiment.pairs"])
def test_what_chooses_the_people_cannot_be_searched(key) -> None:
    with pytest.raises(InputError, match="who meet the same people"):
        parse_parameter(f"{key}=1:9:int")


def test_without_optuna_it_says_how_to_install_it(monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "optuna", None)
    with pytest.raises(InputError, match=r"pip install .crosswalk-harness\[tune\]"):
        searching.import_optuna()
