"""First screens and notes, made from findings that were written by hand."""

import io
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

from harness.old.cli.output import print_wrapped
from harness.old.report.screens.console import print_table
from harness.old.report.screens.result_screen import screen_of
from harness.old.report.screens.result_tables import _remark
from harness.old.report.screens.result_texts import zero_lines
from harness.old.report.screens.screen import Screen, screen_lines, wrapped
from harness.old.report.screens.tables import Table, TableCell, entry_limits, per_cent
from harness.old.statistics import (
    CellFindings,
    Entry,
    Finding,
    Form,
    Note,
    Rank,
    RunFindings,
)
from harness.old.store.hour_catalogue import HOURS
from harness.old.studies.runs.hour_notes import hour_notes
from harness.old.studies.runs.references import agreement
from harness.old.studies.runs.reported import walker_lines
from harness.old.studies.runs.site_words import site_words
from harness.scenario import load_scenario, parse_setting


def nothing(entries: Sequence[Entry]) -> dict[str, Finding]:
    """Undefined findings, or 0 if they are a count."""
    named = ((entry, name) for entry in entries for name in filter(None, entry.names))
    return {name: Finding(0 if entry.form is Form.COUNT else None) for entry, name in named}


def test_the_rate_that_0_events_leave_open() -> None:
    # Each interval has its own confidence; the bound is the one-sided one of 95 %, 1 − 0.05^(1/n).
    wide = Finding(0.0, 0.0, 1 - 0.0125 ** (1 / 1_500), 1_500, 0), 0.975
    usual = Finding(0.0, 0.0, 1 - 0.025 ** (1 / 1_000), 1_000, 0), 0.95
    single, some = Finding(0.0, 0.0, 0.975, 1, 0), Finding(0.1, 0.0, 0.4, 10, 1)
    (crashes,) = (entry for entry in HOURS if entry.key == "kappa")
    words = "0 crashes in a tested cell: the rate is below {} % (95 % confidence)."
    assert zero_lines(crashes, [wide]) == [words.format("0.20")]
    assert zero_lines(crashes, [wide, usual]) == [words.format("0.30")]
    assert zero_lines(crashes, [(single, 0.95), (some, 0.95)]) == []


def test_a_site_names_its_flows_and_what_is_varied() -> None:
    hours = [
        load_scenario("penetration", {"traffic.av_share": share, "ego.initial_speed_mps": 8})
        for share in (0.25, 0.5)
    ]
    traffic, people = hours[0].known_traffic, hours[0].pedestrians.flow_per_hour
    flows = f"{traffic.flow_per_hour:g} + {traffic.oncoming_per_hour:g} vehicles/h"
    ends = f"{flows}; {people:g} people/h; behaviour threshold."
    assert site_words(hours[:1]).endswith(f"lanes; v0 8 m/s; 25 % AVs; {ends}")
    assert site_words(hours).endswith(f"lanes; v0 8 m/s; share of AVs varied; {ends}")


def test_a_site_says_how_late_the_cars_obey_and_what_they_do_not_see() -> None:
    late = {"actuation.dead_time_s": 0.3, "actuation.lag_s": 0.4, "perception.latency_s": 0.5}
    one = load_scenario("cctc_flow", late)
    ends = "; AV: dead time 0.3 s, lag 0.4 s; sensor of the AV: 0.5 s late."
    assert site_words([one]).endswith(ends)
    half = {"perception.detection_probability": 0.8, "perception.position_sd_m": 0.2}
    both = {"actuation.max_jerk_mps3": 20, "actuation.human": True, "perception.human": True}
    ends = (
        "; both arms: dead time 0.3 s, lag 0.4 s, jerk up to 20 m/s³; "
        "sensors of both arms: 0.5 s late, 20 % undetected, errors of 0.2 m."
    )
    assert site_words([load_scenario("cctc_flow", late | half | both)]).endswith(ends)
    other = load_scenario("cctc_flow", late | {"actuation.lag_s": 0})
    assert site_words([one, other]).endswith("; actuation varied; sensor of the AV: 0.5 s late.")
    own = load_scenario("cctc_flow", {"perception.human": True, "actuation.human": True})
    assert site_words([own]) == site_words([load_scenario("cctc_flow")])


def test_the_trials_of_crashes_are_a_range_where_they_differ() -> None:
    hours = [
        replace(
            hour_with({}, kappa=Finding(0, 0, 0.004, 1_000 + number, 0)),
            cell=number,
            varied={"arms.av": "hard_yield"},
        )
        for number in range(2)
    ]
    run = RunFindings(HOURS, "hours", "runs/h", "seed 1", 0.95, tuple(hours))
    assert "crashes of 1,000 … 1,001" in screen_of(run).headings


def test_few_pairs_of_hours_are_counted() -> None:
    three = hour_with({}, pairs=Finding(4), failed=Finding(1))
    assert three.notes[-1].text == "Few pairs: each interval rests on 3 pairs of hours."
    assert not any("rests on" in note.text for note in hour_with({}).notes)


def test_failures_of_many_cells_fit_and_name_each_cell() -> None:
    failures = [
        Note(Rank.FAILURES, f"Cell {number}: {number} of 50 pairs failed, for one of many reasons.")
        for number in range(1, 11)
    ]
    time_outs = [
        Note(Rank.TIME_OUTS, f"Cell {number}: {number} timed out.") for number in (3, 4, 7)
    ]
    few = Note(Rank.FEW_PAIRS, "Few pairs.")
    rows = tuple((str(number), "1") for number in range(6))
    notes = (*failures, *time_outs, few)
    screen = Screen("many", "50 pairs", ("cell", "AV"), rows, notes, "All: --full.")
    assert screen_lines(screen)[8:] == [
        "! Cell 1: 1 of 50 pairs failed, for one of many reasons.",
        "! Cells 2, 3, 4, 5, 6, 7, 8, 9, 10: failures (--full).",
        "! Cell 3: 3 timed out.",
        "! Cells 4, 7: time-outs (--full).",
        "! More to know (--full): unreliable intervals (few pairs).",
        "All: --full.",
    ]
    assert len(screen_lines(replace(screen, most_lines=None))) == 8 + len(notes) + 1


def test_names_are_broken_before_intervals() -> None:
    row = ("1", "soft_yield (hard_yield in 97 %)", "0.75 (0.71 … 0.80)")
    screen = Screen("c", "", ("cell", "AV", "ratio of times"), (row,), (), "All.", always=3)
    assert screen_lines(screen, 43)[2:-1] == [
        "1     soft_yield         0.75 (0.71 … 0.80)",
        "      (hard_yield in",
        "      97 %)",
    ]


def test_an_interval_is_not_broken_where_a_sentence_is() -> None:
    text = "with the model: PET below 1.5 s 0 … 77 / 0 … 33 %"
    for width in range(12, 60):
        lines = wrapped(text, width, "  ")
        assert " ".join(line.strip() for line in lines) == text
        assert all(len(line) <= width for line in lines)
        assert any("0 … 33 %" in line for line in lines)


def test_a_terminal_wraps_a_line_that_a_pipe_gets_whole(capsys, monkeypatch) -> None:
    text = ":a_c0; 1 + 1 lanes; " * 8 + "usable"
    monkeypatch.setenv("COLUMNS", "80")
    print_wrapped(text, "    ")
    assert capsys.readouterr().out == f"    {text}\n"
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    print_wrapped(text, "    ")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 1
    assert all(len(line) <= 80 for line in lines)
    assert " ".join(line.strip() for line in lines) == text


def test_a_remark_names_the_arm_whose_number_is_undefined() -> None:
    nobody, known = Finding(None, reason="no contact"), Finding(1.0)
    for av, reference, text in (
        (known, nobody, "reference: no contact"),
        (nobody, known, "AV: no contact"),
        (nobody, nobody, "no contact"),
        (None, nobody, "no contact"),
        (known, known, ""),
    ):
        assert _remark(av, reference, None) == text


def table_lines(width: int, *rows: tuple[TableCell, ...]) -> list[str]:
    console = Console(width=width, file=io.StringIO(), markup=False)
    headings = ("measure", "AV", "reference", "remark")
    print_table(console, Table("all", "every measure", headings, rows))
    return console.file.getvalue().splitlines()


def test_a_table_on_a_narrow_terminal_breaks_no_number_and_leaves_out_no_column() -> None:
    name = "time advantage below 1.5 s, pairs that met someone, of all that were counted"
    value, limits = "16.843 %", "0.127 … 24.873"
    why = "Nobody was hit by the front of a moving vehicle in any of these episodes."
    row = (TableCell(name), TableCell(value, limits), TableCell(value, limits), TableCell(why))
    lines = table_lines(80, row)
    assert all(len(line) <= 80 for line in lines)
    text = " ".join(" ".join(lines).split())
    for word in ("measure", "AV", "reference", "remark", *name.split(), *why.split()):
        assert word in text.split()
    assert text.count("16.843") == 2
    assert text.count("24.873") == 2
    # Nothing is wrapped where everything fits.
    assert any(name in line and why in line for line in table_lines(200, row))
    # A name is wrapped only after the texts beside it.
    short = (TableCell("time to cross, s"), *row[1:])
    assert any("time to cross, s" in line for line in table_lines(80, short))


@pytest.mark.parametrize(
    ("share", "decimals", "text"),
    [(0.05818, 1, "5.8"), (0.5, 1, "50.0"), (1.0, 1, "100.0"), (0.0, 1, "0.0"),
     (0.000307, 1, "0.031"), (0.0099, 1, "0.99"), (0.000378, 2, "0.038"),
     (1.5e-7, 2, "0.000015"), (0.0711, 2, "7.11")],
)  # fmt: skip
def test_small_shares_keep_two_digits(share: float, decimals: int, text: str) -> None:
    assert per_cent(share, decimals) == text


def test_a_lower_limit_far_below_the_upper_one_has_few_digits() -> None:
    """Writing it as 0 makes the interval wider; an upper limit keeps its digits."""
    crashes: Entry[Any] = Entry("kappa", "crashes", "", form=Form.EVENTS, digits=1)
    for low, high, text in ((3.4e-7, 0.27, "0.0 … 27.0"), (3.4e-7, 2.9e-6, "0.000034 … 0.00029")):
        assert entry_limits(crashes, Finding(low, low, high, n=2, events=1)) == text


@pytest.mark.parametrize(
    ("ratios", "text"),
    [
        (((0.8, 0.7, 0.9), (0.9, 0.8, 0.99)), "takes less time than every reference: "),
        (((1.2, 1.1, 1.3), (1.5, 1.4, 1.6)), "takes more time than every reference: "),
        (((1.0, 0.9, 1.1), (0.9, 0.7, 1.2)), "The AV is not shown to be faster or slower"),
        (((0.8, 0.7, 0.9), (1.2, 1.1, 1.3)), "than a human depends on the reference: "),
        # An interval that includes 1 says neither, and does not contradict one that excludes it.
        (((0.8, 0.7, 0.9), (0.9, 0.8, 1.01)), "takes less time than some of the references; "),
        (((0.8, 0.7, 0.9), (None, None, None)), "human_yield undefined"),
    ],
)
def test_references_agree_where_their_intervals_lie_on_one_side(ratios: Any, text: str) -> None:
    names = ("human_gmm", "human_yield")
    findings = [(name, Finding(*ratio)) for name, ratio in zip(names, ratios, strict=True)]
    assert text in agreement(findings)


@pytest.mark.parametrize(
    ("setting", "drawn"),
    [
        ("experiment.pairs=20", True),
        ("model.pedestrian_reading=unconditional", False),
        ("model.name=dut-k10", False),
    ],
)
def test_walking_speeds_of_dut_are_said_to_hardly_depend_on_the_car(setting, drawn) -> None:
    assert bool(walker_lines([load_scenario("cctc", [parse_setting(setting)])])) is drawn


HOUR = {
    "pairs": Finding(5),
    "automated_delay_s": Finding(5.2, 4.1, 6.3),
    "automated_delay_s_human": Finding(4.0, 3.1, 4.9),
    "automated_delay_s_difference": Finding(1.2, 0.4, 2.0),
    "kappa": Finding(0.002, 0.0, 0.007, 1_000, 2),
    "kappa_human": Finding(0.0, 0.0, 0.004, 1_000, 0),
}


def hour_with(settings: dict[str, Any], **changes: Finding) -> CellFindings:
    scenario = load_scenario("penetration", {"traffic.av_share": 0.3, **settings})
    findings = nothing(HOURS) | HOUR | changes
    notes = hour_notes(scenario, findings, HOURS)
    thresholds = scenario.conflicts.model_dump()
    return CellFindings(0, {}, "hard_yield", "human_yield", 5, thresholds, findings, notes)


def hours_of(*cells: CellFindings, path: str = "runs/h") -> RunFindings:
    return RunFindings(HOURS, "hours", path, "seed 1", 0.95, cells)


def test_hours_say_what_went_wrong_of_each_arm() -> None:
    cell = hour_with(
        {},
        failed=Finding(1),
        saturated_human=Finding(True),
        growth_human=Finding(0.2),
        growth_bound_human=Finding(0.08),
        rising_s=Finding(40.0, 20.0, 60.0),
        not_through_human=Finding(7),
        never_went_human=Finding(3),
        fallback_share=Finding(208 / 414),
    )
    lines = screen_lines(replace(screen_of(hours_of(cell)), most_lines=None))
    row = next(line for line in lines if line.startswith("delay of AVs, s"))
    assert [text.strip() for text in row.split("  ") if text][1:3] == ["5.2", "4.0"]
    texts = [note.text for note in cell.notes]
    assert texts[0] == "1 of 5 pairs failed; no row counts them."
    # A fifth of the arrivals stayed on the road.
    for text in (
        "hard_yield's arm: after a crash traffic continued as if nobody had been hit, so",
        "human_yield: 7 vehicles never passed",
        "human_yield: 3 pedestrians never started to cross.",
        "human_yield: the road was saturated. The number of vehicles on it grew by 20 % of the "
        "arrivals (limit 5 %; chance explains up to 8 %)",
        "hard_yield's arm: the delay grew from the first third of the hour to the last by 40.0 "
        "(20.0 … 60.0) s",
        "hard_yield's arm: its fallback drove 50 % of the passages that met someone",
    ):
        assert [found for found in texts if found.startswith(text)], text
    calm = hour_with({}, kappa=Finding(0.0, 0.0, 0.004, 1_000, 0))
    assert calm.notes == ()


def test_no_crash_in_few_hours_shows_how_little_that_says() -> None:
    # Of 55 vehicles that count as 55 independent ones, 1 − 0.05^(1/55).
    high = 1 - 0.025 ** (1 / 55)
    nothing = {f"kappa{end}": Finding(0.0, 0.0, high, 55, 0) for end in ("", "_human")}
    cell = hour_with({}, **nothing)
    lines = screen_lines(screen_of(hours_of(cell)))
    row = next(line for line in lines if line.startswith("crashes"))
    assert row.split("  ")[-1].strip() == "each below 5.3 %"
    assert not any(line.startswith("worst case") for line in lines)


def test_a_permanent_queue_shows_its_capacity_first_and_no_worst_case() -> None:
    capacity = {
        "throughput_per_hour": Finding(1400.0, 195.3, 2604.7),
        "throughput_per_hour_human": Finding(2010.0, 1007.4, 3012.6),
        "throughput_per_hour_difference": Finding(-610.0, -849.6, -370.4),
    }
    cell = replace(hour_with({}, **capacity), varied={"arms.av": "hard_yield"})
    lines = screen_lines(screen_of(hours_of(cell, cell)))
    assert any("1,400 / 2,010" in line for line in lines)
    assert not any("worst" in line for line in lines)
    alone = screen_lines(screen_of(hours_of(replace(cell, varied={}))))
    row = next(line for line in alone if line.startswith("throughput"))
    assert row.split()[2:] == ["1,400", "2,010", "−610", "(−850", "…", "−370)"]


def test_a_sweep_of_hours_shows_no_column_without_a_number() -> None:
    others = {"other_delay_s": Finding(None, reason="no such vehicle")}
    some = hour_with({}, other_delay_s=Finding(3.0, 2.0, 4.0))
    cells = tuple(
        replace(hour_with({}, **others), cell=number, varied={"arms.av": "hard_yield"})
        for number in (0, 1)
    )
    run = hours_of(*cells, path="runs/a b")
    screen = screen_of(run)
    assert screen.headings[2] == "delay of AVs, AV − reference, s"
    assert "delay of other vehicles, s" not in screen.headings
    assert screen.footer.endswith("harness report 'runs/a b'")
    measured = replace(run, cells=(*cells, replace(some, cell=2, varied={"arms.av": "hard_yield"})))
    assert "delay of other vehicles, s" in screen_of(measured).headings


def test_the_limits_of_a_negative_difference_of_shares_are_negative() -> None:
    yielded: Entry[Any] = Entry("yielded", "yielded", "", form=Form.SHARE, digits=1)
    assert entry_limits(yielded, Finding(-0.306, -0.352, -0.26, n=5)) == "−35.2 … −26.0"
    assert entry_limits(yielded, Finding(-0.005, -0.04, 0.03, n=5)) == "−4.0 … 3.0"
