"""First screens and notes, made from findings that were written by hand."""

import io
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from harness.old.cli.output import print_wrapped
from harness.old.report.screens import run_document, terminal
from harness.old.report.screens.console import print_table
from harness.old.report.screens.result_screen import screen_of
from harness.old.report.screens.result_tables import _remark
from harness.old.report.screens.result_texts import zero_lines
from harness.old.report.screens.screen import Screen, screen_lines, wrapped
from harness.old.report.screens.tables import Table, TableCell, entry_limits, per_cent
from harness.old.statistics import (
    ENCOUNTERS,
    ENTRIES,
    CellFindings,
    Entry,
    Finding,
    Form,
    Note,
    Rank,
    RunFindings,
)
from harness.old.store.hour_catalogue import HOURS
from harness.old.store.kinds import HourKind
from harness.old.studies.runs.hour_notes import hour_notes
from harness.old.studies.runs.notes import av_label, encounter_notes
from harness.old.studies.runs.references import agreement, disagreement, reference_lines
from harness.old.studies.runs.reported import is_the_papers, walker_lines
from harness.old.studies.runs.site_words import site_words
from harness.scenario import load_scenario, parse_setting
from tests.batches import printed

FEW = "unreliable below 1,000 informative pairs (has 50)"
CALM: dict[str, Finding] = {
    "time_s": Finding(8.9, 8.3, 9.8, 50),
    "time_human_s": Finding(11.9, 11.3, 12.5, 50),
    "time_ratio": Finding(0.75, 0.71, 0.8, 50, None, False, FEW),
    "mu": Finding(0.755, 0.72, 0.81, 50, None, False, FEW),
    "mu_all": Finding(0.755, 0.72, 0.81, 50),
    "cv": Finding(0.21, 0.15, 0.29, 50, None, False, FEW),
    "kappa": Finding(0.0, 0.0, 0.071, 50, 0),
    "kappa_human": Finding(0.0, 0.0, 0.071, 50, 0),
    "delay_s": Finding(1.5, 1.0, 2.0, 50),
    "delay_human_s": Finding(4.5, 4.0, 5.0, 50),
    "delay_difference_human_s": Finding(-3.0, -3.5, -2.2, 1_200),
    "pedestrian_delay_s": Finding(0.0, 0.0, 0.0, 0),
    "pedestrian_delay_human_s": Finding(0.0, 0.0, 0.0, 0),
    "conflict_pet": Finding(0.3, 0.18, 0.45, 50, 15),
    "conflict_pet_human": Finding(0.04, 0.005, 0.14, 50, 2),
    "max_speed_mps": Finding(5.0),
    "max_speed_human_mps": Finding(5.0),
    **{
        name: Finding(50)
        for name in ("pairs", "met_someone", "time_ratio_pairs", "defined_pairs", "pairs_all")
    },
}
"""Findings of 50 pairs in which nothing went wrong; all other counts are 0."""


def nothing(entries: Sequence[Entry]) -> dict[str, Finding]:
    """Undefined findings, or 0 if they are a count."""
    named = ((entry, name) for entry in entries for name in filter(None, entry.names))
    return {name: Finding(0 if entry.form is Form.COUNT else None) for entry, name in named}


def cell_with(
    number: int = 0,
    varied: dict[str, Any] | None = None,
    settings: dict[str, Any] | None = None,
    **changes: Finding,
) -> CellFindings:
    scenario = load_scenario("cctc", settings or {})
    findings = nothing(ENCOUNTERS) | CALM | changes
    return CellFindings(
        cell=number,
        varied=varied or {},
        av=av_label(scenario.arms.av, findings),
        reference=scenario.arms.human,
        pairs=findings["pairs"].count,
        thresholds=scenario.conflicts.model_dump(),
        findings=findings,
        notes=encounter_notes(scenario, findings, ENCOUNTERS),
    )


def run_with(*cells: CellFindings, paper: bool = False, notes: tuple[Note, ...] = ()) -> Screen:
    return screen_of(
        RunFindings(ENCOUNTERS, "cctc", "runs/cctc-1", "seed 1", 0.95, paper, cells, notes)
    )


def test_one_cell_in_100_and_in_80_columns() -> None:
    screen = run_with(cell_with(fallbacks=Finding(5), fallback_share=Finding(0.1)), paper=True)
    assert (
        "\n".join(screen_lines(screen))
        == """\
cctc: soft_yield against human_gmm                                                  50 pairs, seed 1
                           AV       human_gmm  AV against reference   paper, N = 50
time to cross, s           8.9      11.9       0.75 (0.71 … 0.80)
μ, mean ratio of times                         0.755 (0.720 … 0.810)  0.7044
c_v, spread of that ratio                      21 % (15 … 29)         4.54 %
crashes                    0 of 50  0 of 50    each below 5.8 %       0
delay, s                   1.5      4.5        −3.0 (−3.5 … −2.2)
people's wait, s           0.0      0.0
PET below 1.5 s            30 %     4.0 %      18 … 45 / 0.50 … 14 %
! hard_yield drove 5 of 50 passages, for which soft_yield has no valid plan.
! Against human_recorded soft_yield is slower: the result depends on the reference.
! Few pairs: intervals are unreliable below 1,000 informative pairs (ratio of times and μ), 4,000
  (c_v).
All measures: --full. Page: harness report runs/cctc-1"""
    )
    narrow = screen_lines(screen, 80)
    assert narrow[1] == "                           AV       human_gmm  AV against reference"
    assert narrow[9] == "paper, N = 50: μ 0.7044, c_v 4.54 %, crashes 0"
    assert (len(narrow), max(map(len, narrow)) <= 80) == (16, True)


def test_a_cell_in_which_much_went_wrong() -> None:
    screen = run_with(
        cell_with(
            settings={"arms.av": "soft_yield", "arms.human": "own:Driver"},
            failed=Finding(3),
            failed_strategy=Finding(2),
            failed_engine=Finding(1),
            failed_av=Finding(2),
            failed_human=Finding(1),
            timed_out=Finding(4),
            timed_out_av=Finding(4),
            kappa=Finding(0.0426, 0.005, 0.145, 47, 2),
            kappa_human=Finding(0.02, 0.001, 0.106, 50, 1),
            kappa_worst=Finding(0.18, 0.086, 0.314, 50, 9),
            time_ratio_pairs=Finding(45),
            time_ratio_worst=Finding(1.7, 1.2, 2.4, 50),
            mu_worst=Finding(1.9, 1.3, 2.7, 50),
            delay_worst_s=Finding(9.5, 6.0, 13.0, 50),
            defined_pairs=Finding(40),
            mu_all=Finding(0.9, 0.82, 1.0, 45),
            pedestrian_delay_s=Finding(None, reason="nobody arrived"),
            pedestrian_delay_human_s=Finding(None, reason="nobody arrived"),
            fallbacks=Finding(30),
            fallback_share=Finding(0.6),
            max_speed_mps=Finding(15.7),
            clamped_share=Finding(0.25),
            clamped_share_human=Finding(0.75),
            clamped_speed_excess_mps=Finding(5.39),
        )
    )
    assert (
        "\n".join(screen_lines(replace(screen, most_lines=None)))
        == """\
cctc: soft_yield (hard_yield in 60 %) against own:Driver                            50 pairs, seed 1
                           AV       own:Driver  AV against reference
time to cross, s           8.9      11.9        0.75 (0.71 … 0.80)
μ, mean ratio of times                          0.755 (0.720 … 0.810)
c_v, spread of that ratio                       21 % (15 … 29)
crashes                    2 of 47  1 of 50     0.50 … 14.5 / 0.10 … 10.6 %
delay, s                   1.5      4.5         −3.0 (−3.5 … −2.2)
people's wait, s           –        –
PET below 1.5 s            30 %     4.0 %       18 … 45 / 0.50 … 14 %
worst case                 ratio of times 1.70, crashes 9 of 50, μ 1.900, delay 9.5 s
! 3 of 50 pairs failed (AV 2, own:Driver 1; strategy 2, engine 1); only the worst case counts them.
! 4 of 50 pairs timed out (AV 4, own:Driver 0): only the ratio of times uses them, as 60 s.
! The ratio of times uses 45 of 50 pairs, μ and c_v use 40 (crashes: AV 2, own:Driver 1).
! μ makes the AV look faster than it is: over all pairs μ is 0.900 (0.820 … 1.000), if own:Driver
  counts as driving on after a crash.
! The difference of delays counts a crashed own:Driver as driving on.
! Undefined: people's wait (nobody arrived).
! hard_yield drove 30 of 50 passages (60 % of those that met someone), for which soft_yield has no
  valid plan.
! The AV drove at up to 15.7 m/s, above v0 of 5 m/s, and saves time by speeding.
! In 25 % (AV) and 75 % (own:Driver) of the cases the vehicle was outside the data of the
  interaction model, up to 5.39 m/s too fast; the model used the nearest state in its data.
! Few pairs: intervals are unreliable below 1,000 informative pairs (ratio of times and μ), 4,000
  (c_v).
All measures: --full. Page: harness report runs/cctc-1"""
    )
    # Beyond 16 lines the last notes share one; no failure does.
    lines = screen_lines(screen)
    assert lines[:13] == screen_lines(replace(screen, most_lines=None))[:13]
    assert lines[13:] == [
        "! More to know (--full): what is left out, undefined numbers, the fallback, speeding, "
        "the model's",
        "  range, unreliable intervals (few pairs).",
        "All measures: --full. Page: harness report runs/cctc-1",
    ]


def test_the_rate_that_0_events_leave_open() -> None:
    # Each interval has its own confidence; the bound is the one-sided one of 95 %, 1 − 0.05^(1/n).
    wide = Finding(0.0, 0.0, 1 - 0.0125 ** (1 / 1_500), 1_500, 0), 0.975
    usual = Finding(0.0, 0.0, 1 - 0.025 ** (1 / 1_000), 1_000, 0), 0.95
    single, some = Finding(0.0, 0.0, 0.975, 1, 0), Finding(0.1, 0.0, 0.4, 10, 1)
    crashes = ENTRIES["kappa"]
    words = "0 crashes in a tested cell: the rate is below {} % (95 % confidence)."
    assert zero_lines(crashes, [wide]) == [words.format("0.20")]
    assert zero_lines(crashes, [wide, usual]) == [words.format("0.30")]
    assert zero_lines(crashes, [(single, 0.95), (some, 0.95)]) == []


def test_a_sweep_has_a_row_for_each_cell() -> None:
    crashed = cell_with(
        1,
        {"arms.av": "constant_speed"},
        {"arms.av": "constant_speed"},
        kappa=Finding(0.1, 0.033, 0.218, 50, 5),
        time_ratio_pairs=Finding(45),
        defined_pairs=Finding(45),
        time_ratio_worst=Finding(3.4, 2.4, 4.4, 50),
    )
    calm = cell_with(0, {"arms.av": "soft_yield"})
    note = Note(Rank.FAILURES, "2 of 9 records differ.")
    assert (
        "\n".join(screen_lines(run_with(calm, crashed, notes=(note,))))
        == """\
cctc: 2 cells; values: AV / human_gmm                                          50 pairs each, seed 1
                                          crashes  worst                          people's
cell  av              ratio of times      of 50    case   μ      c_v   delay, s   wait, s
0     soft_yield      0.75 (0.71 … 0.80)  0 / 0           0.755  21 %  1.5 / 4.5  0.0 / 0.0
1     constant_speed  0.75 (0.71 … 0.80)  5 / 0    3.40   0.755  21 %  1.5 / 4.5  0.0 / 0.0
Not shown here: PET below 1.5 s.
0 crashes in a tested cell: the rate is below 5.8 % (95 % confidence).
! 2 of 9 records differ.
! Cell 1: The ratio of times, μ and c_v use 45 of 50 pairs (crashes: AV 5, human_gmm 0).
! Cell 0: Against human_recorded soft_yield is slower: the result depends on the reference.
! Few pairs: intervals are unreliable below 1,000 informative pairs (ratio of times and μ), 4,000
  (c_v).
All measures: --full. Page: harness report runs/cctc-1"""
    )
    # What does not fit is named; the number of pairs is that of a cell where it differs.
    longer = cell_with(1, {"arms.av": "hard_yield"}, {"arms.av": "hard_yield"}, pairs=Finding(90))
    narrow = screen_lines(run_with(calm, longer), 60)
    assert narrow[1:6] == [
        "                                             crashes",
        "cell  av          pairs  ratio of times      of 50    μ",
        "0     soft_yield  50     0.75 (0.71 … 0.80)  0 / 0    0.755",
        "1     hard_yield  90     0.75 (0.71 … 0.80)  0 / 0    0.755",
        "Not shown here: c_v; delay, s; people's wait, s; PET below",
    ]
    # Crashes stay whatever else has to go.
    narrow = screen_lines(run_with(calm, longer), 40)
    assert max(map(len, narrow[:-1])) <= 40
    table = [line.split() for line in narrow]
    assert ["cell", "av", "pairs", "times", "of", "50"] in table
    assert ["0", "soft_", "50", "0.75", "0", "/", "0"] in table


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


def test_nobody_met_shows_neither_a_bound_nor_a_spread() -> None:
    alike = "unreliable: all values are equal"
    cell = cell_with(
        met_nobody=Finding(50),
        met_someone=Finding(0),
        mu=Finding(1.0, 1.0, 1.0, 0, None, False, alike),
        cv=Finding(0.0, 0.0, 0.0, 0, None, False, alike),
    )
    rows = {line[:7]: line for line in screen_lines(run_with(cell))}
    assert rows["crashes"].split() == ["crashes", "0", "of", "50", "0", "of", "50"]
    assert rows["c_v, sp"].endswith("–")
    assert rows["μ, mean"].endswith("1.000")


def test_the_trials_of_crashes_are_a_range_where_they_differ() -> None:
    hours = [
        replace(
            hour_with({}, kappa=Finding(0, 0, 0.004, 1_000 + number, 0)),
            cell=number,
            varied={"arms.av": "hard_yield"},
        )
        for number in range(2)
    ]
    run = RunFindings(HOURS, "hours", "runs/h", "seed 1", 0.95, False, tuple(hours))
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


def test_the_list_of_commands_cuts_no_sentence(monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    overview = printed("--help")
    assert "conflicts   Measure" in overview
    assert "..." not in overview.partition("Commands:")[2]


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


def test_no_sweep_leaves_out_crashes_or_how_many_pairs_met_nobody() -> None:
    drove = {"fallback_share": Finding(0.98), "met_nobody": Finding(30), "fallbacks": Finding(20)}
    varied = {"perception.detection_probability": 0.2, "perception.latency_s": 1.0}
    cells = [
        cell_with(
            number, {"arms.av": "soft_yield", **varied}, kappa=Finding(0.1, 0, 1, 50, 5), **drove
        )
        for number in range(2)
    ]
    lines = screen_lines(run_with(*cells))
    assert "50 pairs each (60 of 100 met nobody), seed 1" in "".join(lines[:2])
    headings = next(line for line in lines if line.startswith("cell")).split()
    assert headings.count("50") == 1
    assert any("crashes" in line for line in lines)
    assert "5 / 0" in next(line for line in lines if line.startswith("1 "))
    assert "50 pairs (30 met nobody), seed 1" in "".join(
        screen_lines(run_with(cell_with(**drove)))[:2]
    )


def test_notes_that_were_merged_stand_in_full_and_few_pairs_are_never_merged(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    same = Note(Rank.VERY_FEW_PAIRS, "All 50 episodes are the same.")
    fast = {"max_speed_mps": Finding(20.0), "clamped_share": Finding(0.3)}
    cell = cell_with(timed_out=Finding(9), timed_out_av=Finding(9), **fast)
    run = RunFindings(ENCOUNTERS, "cctc", "runs/c", "seed 1", 0.95, False, (cell,), (same,))
    monkeypatch.setattr(terminal, "reported", lambda _: run)
    monkeypatch.setattr(terminal, "remarks", lambda _: [])
    monkeypatch.setattr(terminal, "paired_tables", lambda _: [])
    for full in (False, True):
        terminal.print_run(None, full)  # type: ignore[arg-type]
        lines = capsys.readouterr().out
        assert same.text in lines
        assert ("More to know" in lines) is not full
        assert ("the nearest state" in " ".join(lines.split())) is full


def test_an_arm_that_never_ran_takes_no_bound_from_the_other() -> None:
    gone = {"kappa_human": Finding(None, reason="every episode failed")}
    row = next(line for line in screen_lines(run_with(cell_with(**gone))) if "crashes " in line)
    assert row.split("0 of 50")[1].split("–", 1)[1].strip() == "0.0 … 7.1 / – %"


@pytest.mark.parametrize(
    ("changes", "settings", "rank", "text"),
    [
        ({"met_nobody": Finding(50)}, {}, Rank.NOTHING_TESTED,
         "Neither driver met a pedestrian: nothing was"),
        ({"failed_av": Finding(50), "met_nobody": Finding(0)}, {}, Rank.NOTHING_TESTED,
         "Every episode of the AV failed: nothing was tested."),
        ({}, {"pedestrians.drawn": [{"episode": 1, "quantile": [0.5], "side": [0.2]}],
              "experiment.pairs": 1}, Rank.NOTHING_TESTED,
         "The pairs were selected by their outcome (pedestrians.drawn), so no number"),
        ({"mu": Finding(1.2), "mu_all": Finding(0.9, 0.8, 1.0, 50)}, {}, Rank.LEFT_OUT,
         "μ makes the AV look slower than it is: "),
        ({"max_speed_human_mps": Finding(14.2)}, {"crossing.road_speed_limit_mps": 13.9},
         Rank.SPEEDING, "human_gmm drove at up to 14.2 m/s, above the road's limit of 13.9 m/s"),
        ({"time_ratio": Finding(1.02, 0.97, 1.08, 2_000)}, {}, Rank.FEW_PAIRS,
         "The interval of the ratio of times includes 1: neither is shown to be faster."),
        # docs/strategies.md, cctc: Gap-Yield is faster than human_gmm, slower than human_recorded.
        ({"time_ratio": Finding(1.1, 1.05, 1.15, 2_000)},
         {"arms.av": "gap_yield", "arms.human": "human_recorded"}, Rank.REFERENCE,
         "Against human_gmm gap_yield is faster: the result depends on the reference"),
    ],
)  # fmt: skip
def test_what_has_to_be_read_with_the_numbers(changes, settings, rank, text) -> None:
    cell = cell_with(settings=settings, **changes)
    (note,) = [note for note in cell.notes if note.text.startswith(text)]
    assert note.rank is rank
    assert [*cell.notes] == sorted(cell.notes, key=lambda note: note.rank)
    plain = cell_with(settings={"arms.av": "gap_yield", "arms.human": "human_gmm"})
    assert not any(note.text.startswith(text) for note in plain.notes)


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


def test_only_what_was_validated_is_said_of_a_reference() -> None:
    as_validated, changed, other = (
        load_scenario("cctc", {"arms.human": name, **more})
        for name, more in (
            ("human_recorded", {}),
            ("human_gmm", {"strategies.human_gmm.speed": "sampled"}),
            ("own:Driver", {}),
        )
    )
    lines = reference_lines([as_validated, changed, other, as_validated])
    # docs/validation.md: 85.7 % of the orders, 1.40 s, 9 of 34 passages.
    assert "right for 86 %, the median error of its pass time was 1.4 s" in lines[0]
    assert "hit somebody in 9 passages" in lines[0]
    assert lines[1:] == [
        f"{name} was not compared with recorded drivers (harness validate)."
        for name in ("human_gmm with these settings", "own:Driver")
    ]


def test_where_another_reference_says_the_opposite_is_known_of_the_study_alone() -> None:
    def words(av: str, human: str, ratio: float, file: str = "cctc", **more: object) -> str:
        driven = {"arms.av": av, "arms.human": human}
        return disagreement(load_scenario(file, {**driven, **more}), ratio)

    slower = "Against human_recorded gap_yield is slower: the result depends on the reference"
    assert words("gap_yield", "human_gmm", 0.72).startswith(slower)
    assert words("gap_yield", "human_yield", 0.96).startswith(slower)
    assert "Against human_gmm hard_yield is faster" in words("hard_yield", "human_recorded", 1.2)
    assert words("gap_yield", "human_gmm", 1.1) == words("gap_yield", "human_recorded", 0.7) == ""
    assert words("gap_yield", "own.driver", 0.72) == ""
    assert words("constant_speed", "human_gmm", 0.8) == ""
    assert words("hard_yield", "own:Driver", 0.8) == ""
    gap = ("gap_yield", "human_gmm", 0.9)
    thousand = {"pedestrians.flow_per_hour": 1000.0, "experiment.seed": 7}
    assert words(*gap, "cctc_flow", **thousand).startswith(slower)
    # docs/strategies.md has these alone: elsewhere, or with other parameters, nothing is known.
    assert words("hard_yield", "human_recorded", 1.2, "cctc_flow") == ""
    for other in (
        {"crossing.length_m": 12.0},
        {"ego.initial_speed_mps": 6.0},
        {"strategies.gap_yield.critical_gap_s": 1.0},
        {"pedestrians.flow_per_hour": 400.0},
        {"perception.dropout_probability": 0.1},
    ):
        assert words(*gap, "cctc_flow", **other) == "", other


@pytest.mark.parametrize(
    ("setting", "papers"),
    [
        ("experiment.pairs=2000", True),
        ("model.name=dut-k10", True),
        ("ego.initial_speed_mps=6", False),
        ("arms.av=hard_yield", False),
        ("crossing.oncoming_lanes=0", False),
        ("strategies.soft_yield.time_margin_s=0", True),
        ("strategies.soft_yield.time_margin_s=1", False),
        ("strategies.human_gmm.reading=marginal", False),
        ("pedestrians.behaviour=reactive", False),
        ("pedestrians.max_count=2", False),
    ],
)
def test_the_papers_numbers_stand_beside_its_own_experiment_alone(setting, papers) -> None:
    assert is_the_papers(load_scenario("cctc", [parse_setting(setting)])) is papers


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
    return RunFindings(HOURS, "hours", path, "seed 1", 0.95, False, cells)


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


def test_the_json_of_hours_has_the_notes_of_the_first_screen(monkeypatch) -> None:
    cell = hour_with({}, never_went=Finding(3))
    monkeypatch.setattr(run_document, "reported", lambda _: hours_of(cell))
    result = SimpleNamespace(cell=None, findings=cell.findings)
    given = {"path": "runs/h", "engine": "sumo", "kind": HourKind()}
    run: Any = SimpleNamespace(**given, results=[result], failures=[])
    cells: Any = run_document.run_document(run)["cells"]
    assert cells[0]["caveats"] == [note.text for note in cell.notes] != []
    assert cells[0]["summary"]["never_went"] == 3


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
