"""``harness compare`` on a run whose episodes are made by hand: every number can be counted."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.core.errors import InputError
from harness.old.statistics import SweepVerdict, Verdict
from harness.old.studies.kinds.tasks import Task
from harness.old.studies.runs.compare import compare
from harness.old.studies.runs.comparisons import RunComparison
from harness.old.studies.runs.opening import load_run
from harness.scenario import Study
from tests.batches import one_cell, printed, refusal, sweep
from tests.made_up import FREE_S, Fate, Fates, made_up


def by_hand(task: Task, pair: int) -> Fate:
    """At 50 per hour they differ, at 250 two of three drive alike."""
    strategy = task.scenario.arms.av
    if task.scenario.pedestrians.flow_per_hour == 250:
        return 7.0 if strategy == "constant_speed" else 8.0
    if strategy == "constant_speed":
        return "crashed" if pair < 10 else 7.0
    if strategy == "hard_yield":
        return "timed_out" if pair == 3 else 9.0
    return 8.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    vary = ("arms.av=soft_yield,hard_yield,constant_speed", "pedestrians.flow_per_hour=50,250")
    study = sweep("cctc_flow", {"experiment.pairs": 40}, *vary)
    return made_up(tmp_path_factory.mktemp("run") / "run", study, by_hand)


def over_strategies(pairs: int, *strategies: str) -> Study:
    return sweep("cctc", {"experiment.pairs": pairs}, f"arms.av={','.join(strategies)}")


def test_differences_by_hand(run: Path) -> None:
    first, second = compare(run).groups
    assert [cell.cell.number for cell in first.group.cells] == [0, 2, 4]
    soft_hard, soft_constant, hard_constant = first.comparisons
    # τ: 0.8, 0.9 and 0.7; without spread an interval is the point.
    for item, difference, defined in (
        (soft_hard, -0.1, 39),
        (soft_constant, 0.1, 30),
        (hard_constant, 0.2, 30),
    ):
        assert item.mu_difference.value == pytest.approx(difference)
        assert item.mu_difference.low == item.mu_difference.high == item.mu_difference.value
        assert item.defined_in_both == defined
        assert item.delay_difference_s.value == pytest.approx(10 * difference)
    # Pair 3 counts with 300 s; the ten crashes are left out, as the human takes 10 s in all.
    soft_times = soft_hard.time_ratio_difference.value
    assert soft_times == pytest.approx((39 * -1 + 8 - 300) / (40 * 10))
    assert soft_constant.time_ratio_difference.value == pytest.approx(0.1)
    counts = [(item.counted_in_both, item.counted_in_one) for item in first.comparisons]
    assert counts == [(40, 0), (30, 10), (30, 10)]
    assert soft_hard.delay_worst_difference_s.value == pytest.approx((39 * -1 + 8 - 300) / 40)
    assert soft_constant.delay_worst_difference_s.value == pytest.approx((30 - 10 * 292) / 40)
    # Pair 3 timed out after 300 s: τ = 30 against 0.8, and so does each of the ten crashes.
    worst = [item.mu_worst_difference.value for item in (soft_hard, soft_constant)]
    lost = 0.8 - 30.0
    assert worst == pytest.approx([(39 * -0.1 + lost) / 40, (30 * 0.1 + 10 * lost) / 40])
    assert {item.mu_difference.value for item in second.comparisons[:1]} == {0.0}
    assert second.comparisons[1].mu_difference.value == pytest.approx(0.1)


def test_crashes_and_cells_by_hand(run: Path) -> None:
    first, second = compare(run).groups
    tests = [(t.crashes.only_a, t.crashes.only_b, t.crashes.p) for t in first.comparisons]
    p = 2 / 2**10
    misses = [(t.misses.only_a, t.misses.only_b) for t in first.comparisons]
    # Pair 3 is one of the ten.
    assert misses == [(0, 1), (0, 10), (0, 9)]
    assert tests == [(0, 0, 1.0), (0, 10, pytest.approx(p)), (0, 10, pytest.approx(p))]
    assert first.comparisons[1].crashes.kappa_difference == pytest.approx(-10 / 40)
    # Six tests in the run: the smallest p counts six times, the next is no smaller.
    adjusted = [item.p_holm for group in (first, second) for item in group.comparisons]
    assert adjusted == pytest.approx([1.0, 6 * p, 6 * p, 1.0, 1.0, 1.0])
    # Hard-Yield is slower than Soft-Yield, but whether its one time-out is chance cannot be told.
    assert [first.beaten_by(cell, 1) for cell in range(3)] == [[2], [2], []]
    assert [second.beaten_by(cell, 0) for cell in range(3)] == [[], [], [0, 1]]
    _, hard, constant = first.summaries
    assert (hard.pairs, hard.defined_pairs, hard.timed_out) == (40, 39, 1)
    assert hard.mu.value == pytest.approx(0.9)
    assert hard.mu_worst.value == pytest.approx((39 * 0.9 + 30) / 40)
    assert hard.delay_s.value == pytest.approx(9.0 - FREE_S)
    assert (constant.kappa.successes, constant.kappa.trials) == (10, 40)


def noisy(task: Task, pair: int) -> Fate:
    """Times that differ from pair to pair and from strategy to strategy."""
    shared = np.random.default_rng(pair).gamma(9.0, 1.0)
    own = np.random.default_rng((pair, *task.scenario.arms.av.encode())).normal(0.0, 0.3)
    return float(shared + own + 2.0)


def test_a_comparison_does_not_depend_on_the_others_nor_on_the_run(tmp_path: Path) -> None:
    both = ("soft_yield", "hard_yield")
    two, three = over_strategies(60, *both), over_strategies(60, "constant_speed", *both)
    apart = [over_strategies(60, name) for name in both]
    folders = [
        made_up(tmp_path / str(number), study, noisy)
        for number, study in enumerate((two, three, *apart))
    ]
    alone = compare(folders[0]).groups[0].comparisons[0]
    among = compare(folders[1]).groups[0].comparisons[2]
    assert alone.mu_difference == among.mu_difference
    assert alone.delay_difference_s == among.delay_difference_s
    # Pairs share what is common to both: the interval is that of the noise of their own alone.
    reach = 1.96 * 0.1 * 0.3 * np.sqrt(2 / 60)
    assert alone.mu_difference.high - alone.mu_difference.low == pytest.approx(2 * reach, rel=0.4)
    assert compare(*folders[2:]).groups[0].comparisons == (alone,)


def margins(folder: Path, fates: Fates) -> Path:
    study = sweep("cctc", {"experiment.pairs": 200}, "strategies.soft_yield.p1=0.3,0.1,0.2")
    return made_up(folder, study, fates)


def bolder_with_less(task: Task, pair: int) -> Fate:
    """At 0.1 it crashes often, at 0.3 it is slow."""
    p1 = task.scenario.strategies["soft_yield"]["p1"]
    if p1 == 0.1 and pair % 4 == 0:
        return "crashed"
    return 5.0 + 20 * p1


def only(result: RunComparison) -> Any:
    (sweep_result,) = result.groups[0].sweeps
    return sweep_result


def test_allowed_values(tmp_path: Path) -> None:
    run = margins(tmp_path / "run", bolder_with_less)
    found = only(compare(str(run), mu0=1.0, kappa0=0.05))
    assert found.sweep.values == (0.1, 0.2, 0.3)
    # τ 0.7, 0.9, 1.1; 50 of 200 crashed at 0.1. Nothing of 200 at 1 − 0.05/6: below 2.4 %.
    assert [judgement.verdict for judgement in found.found.judgements] == [
        Verdict.DENIED,
        Verdict.ALLOWED,
        Verdict.DENIED,
    ]
    kappa = found.found.judgements[1].swept.kappa
    assert kappa.high == pytest.approx(1 - (0.05 / 6) ** (1 / 200), rel=1e-6)
    assert only(compare(run, mu0=0.8, kappa0=0.05)).found.verdict is SweepVerdict.NONE
    few = only(compare(run, mu0=1.0, kappa0=0.01)).found
    assert few.verdict is SweepVerdict.TOO_FEW_PAIRS
    assert few.pairs_needed == int(np.ceil(np.log(0.05 / 6) / np.log(0.99)))
    # Without limits nothing is judged.
    assert compare(run).groups[0].sweeps == ()


def test_limits_need_a_swept_parameter(run: Path) -> None:
    assert "no parameter is swept" in refusal("compare", run, "--mu0", 1, "--kappa0", 0.05)


def test_the_findings_of_some_numbers_are_those_of_all(run: Path) -> None:
    data = load_run(run)
    (cell, *_), names = data.study.cells, {"kappa", "delay_s", "mu_worst"}
    some, every = (
        data.kind.findings(data.rows_of_cell(0), cell, 0.9, only) for only in (names, None)
    )
    assert {"kappa", "kappa_human", "delay_s", "mu_worst"} < some.keys() < every.keys()
    assert some == {name: every[name] for name in some}


def test_json_and_csv(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "comparison.csv"
    document = json.loads(printed("compare", run, "--json", "--out", out))
    first = document["groups"][0]
    assert first["shared"] == {"pedestrians.flow_per_hour": 50}
    assert first["comparisons"][2]["a"] == "hard_yield"
    with out.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6
    assert [row["pedestrians.flow_per_hour"] for row in rows] == ["50"] * 3 + ["250"] * 3
    assert (rows[1]["cell_a"], rows[1]["cell_b"], rows[1]["crashed_in_b_alone"]) == ("0", "4", "10")
    assert float(rows[1]["mu_difference"]) == pytest.approx(0.1)
    assert float(rows[1]["mcnemar_p_holm"]) == pytest.approx(12 / 2**10)
    assert rows[1]["indicative"].split() == [
        *("time_ratio_difference", "mu_difference", "delay_difference_s"),
        *("mu_worst_difference", "delay_worst_difference_s"),
    ]
    # 30 pairs differ in time, all of one sign, and the ten crashes besides in the worst case.
    assert rows[1]["time_ratio_difference_ci_informative"] == "30"
    assert rows[1]["mu_worst_difference_ci_informative"] == "40"
    assert 2 / 2**30 < float(rows[1]["time_ratio_difference_p"]) < 1e-7
    # The same file is not written over.
    assert "exists already" in refusal("compare", run, "--out", out)


def test_tables(run: Path) -> None:
    text = printed("compare", run, "--full")
    words = ("pedestrians.flow_per_hour = 50", "0 / 10")
    assert all(word in text for word in (*words, "corrected for all 6 tests of this comparison"))
    assert max(len(line) for line in text.splitlines()) <= 120


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (
            (1.0, 0.05),
            "Allowed: p1 = 0.2: μ below 1 and κ below 0.05, with 95 % confidence for all 3 values "
            "together.",
        ),
        ((0.8, 0.05), "No value is allowed"),
        (
            (1.0, 0.01),
            "At the present estimates about 477 pairs would show that one of them is allowed",
        ),
    ],
)
def test_verdicts_in_words(tmp_path: Path, limits: tuple[float, float], said: str) -> None:
    run = margins(tmp_path / "run", bolder_with_less)
    text = printed("compare", run, "--mu0", limits[0], "--kappa0", limits[1])
    assert said in " ".join(text.split())


def test_an_unreliable_bound_of_mu_is_said_wherever_it_decides(tmp_path: Path) -> None:
    """The AV takes from 5 to 9 s, the human 10 s: τ has five values, each in 40 of 200 pairs."""
    run = margins(tmp_path / "run", lambda _task, pair: 5.0 + pair % 5)
    options = ("compare", run, "--mu0", 0.9, "--kappa0", 0.05)
    text = " ".join(printed(*options).split())
    assert "Too few pairs to tell: p1 = 0.1, 0.2, 0.3 undecided." in text
    why = "unreliable: too few informative pairs"
    assert f"The bound of μ at p1 = 0.1, 0.2, 0.3 is {why}." in text
    # 160 of 200 pairs differ from the most common value: 2,000 of them need 2,500 pairs.
    assert "about 2,500 pairs would show that one of them is allowed" in text
    assert printed(*options, "--full").count("undecided (unreliable: too few") == 3


def test_the_first_screen_says_who_is_better_in_what(run: Path) -> None:
    lines = printed("compare", run).splitlines()
    # constant_speed took 7 s and soft_yield 8, and crashed in ten pairs of 40, in which nobody else
    # did; hard_yield timed out once, which decides nothing.
    soft, constant = (
        next(line for line in lines if line.startswith("50 ") and name in line)
        for name in ("soft_yield", "constant_speed")
    )
    said = [[text.strip() for text in row.split("  ") if text.strip()] for row in (soft, constant)]
    assert said[0][4:] == ["0 of 40", "4", "2"]
    # In the worst case the ten count with 300 s, the human with 10 s: (30 · 7 + 10 · 300) / 400.
    assert said[1][4:] == ["8.03", "10 of 40", "–", "all"]
    # 1 − 0.05^(1/40) is the rate at which 40 passages are free of crashes in 5 %.
    assert "0 crashes in a tested cell: the rate is below 7.2 % (95 % confidence)." in "\n".join(
        lines
    )
    assert "40 pairs each, seed 1" in lines[0]
    assert len(lines) <= 16
    assert max(map(len, lines[:-1])) <= 100


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--mu0", 0.9], "--kappa0: is missing"),
        (["--kappa0", 0.01], "--mu0: is missing"),
        (["--mu0", 0, "--kappa0", 0.01], "--mu0: 0 is not accepted"),
        (["--mu0", "nan", "--kappa0", 0.01], "--mu0: nan is not accepted"),
        (["--mu0", 0.9, "--kappa0", 1.5], "--kappa0: 1.5 is not accepted"),
        (["--out", "nowhere/comparison.csv"], "there is no folder nowhere"),
    ],
)
def test_refused(run: Path, options: list[object], words: str) -> None:
    assert words in refusal("compare", run, *options)


def test_runs_that_cannot_be_compared(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a run folder"):
        compare(tmp_path)
    single = made_up(tmp_path / "single", one_cell("cctc", {"experiment.pairs": 3}), noisy)
    with pytest.raises(InputError, match="no two cells that differ only in the AV's strategy"):
        compare(single)
    flows = sweep("cctc", {"experiment.pairs": 3}, "pedestrians.flow_per_hour=50,100")
    with pytest.raises(InputError, match="no two cells"):
        compare(made_up(tmp_path / "flows", flows, noisy))
    manifest = tmp_path / "flows" / "manifest.json"
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "counts": None}))
    with pytest.raises(InputError, match="is not finished"):
        compare(tmp_path / "flows")


def version(folder: Path, seconds: float, **changes: object) -> Path:
    """A run of one strategy that takes so long in every pair."""
    keys = {"experiment.pairs": 30, "arms.av": "gap_yield", **changes}
    return made_up(folder, one_cell("cctc", keys), lambda _task, pair: seconds + 0.1 * (pair % 3))


def test_runs_made_at_different_times(tmp_path: Path) -> None:
    yesterday = version(tmp_path / "yesterday", 9.0)
    today = version(tmp_path / "today", 8.0, **{"experiment.pairs": 20, "conflicts.ttc_s": 2.0})
    (group,) = compare(yesterday, today).groups
    labels = [member.label for member in group.group.cells]
    assert labels == ["gap_yield (yesterday)", "gap_yield (today)"]
    assert [(member.run, member.number) for member in group.group.cells] == [(0, 0), (1, 1)]
    (item,) = group.comparisons
    # Over the 20 pairs that both have; the human takes 10 s in all of them.
    assert (item.defined_in_both, item.crashes.pairs) == (20, 20)
    assert item.mu_difference.value == pytest.approx(0.1)
    assert item.mu_difference.low == pytest.approx(0.1)
    document = json.loads(printed("compare", yesterday, today, "--json"))
    folders = [str(yesterday), str(today)]
    assert document["folders"] == folders
    cells = [(cell["cell"], cell["folder"]) for cell in document["groups"][0]["cells"]]
    assert cells == [*enumerate(folders)]
    assert "(today)" in printed("compare", yesterday, today)


def test_runs_of_other_people_or_another_reference_are_refused(tmp_path: Path) -> None:
    one = version(tmp_path / "one", 9.0)
    others = {"pedestrians.flow_per_hour": 500, "ego.initial_speed_mps": 6.0}
    for number, (changes, said) in enumerate(
        [
            ({"experiment.seed": 2}, "experiment.seed 2 instead of 1"),
            (others, "pedestrians.flow_per_hour 500 instead of"),
            ({"strategies.human_gmm.speed": "sampled"}, "strategies.human_gmm.speed sampled"),
        ]
    ):
        with pytest.raises(InputError, match=said):
            compare(one, version(tmp_path / str(number), 8.0, **changes))
    study = one_cell("cctc", {"experiment.pairs": 30, "arms.av": "gap_yield"})
    slower = made_up(tmp_path / "other", study, lambda _, pair: (8.0, 10.0 + (pair == 7)))
    with pytest.raises(InputError, match=r"pair 7 has pass_time_s 11\.0 instead of 10\.0"):
        compare(one, slower)
    with pytest.raises(InputError, match="is named twice"):
        compare(one, one)
    manifest = slower / "manifest.json"
    document = json.loads(manifest.read_text())
    document["simulated_with"]["models"][0]["sha256"] = "0" * 64
    manifest.write_text(json.dumps(document))
    with pytest.raises(InputError, match="its model dut differs from that"):
        compare(one, slower)
