"""The first screen of users' own simulations, made from findings that were written by hand."""

from harness.old.report.screens.joined_notes import joined_notes
from harness.old.report.screens.result_screen import screen_of
from harness.old.report.screens.screen import MOST_LINES, screen_lines
from harness.old.statistics import CellFindings, Finding, Form, Note, Rank, RunFindings
from harness.old.store.simulations.simulation_catalogue import SIMULATIONS
from harness.old.studies.runs.simulation_notes import simulation_notes
from harness.scenario import Scenario

SCENARIO = Scenario.model_validate(
    {
        "simulation": {"config": "town.sumocfg", "crossings": [":J7_c0"]},
        "arms": {"av": "soft_yield", "human": "sumo_driver"},
    }
)


def findings(**changes: Finding) -> dict[str, Finding]:
    """Two pairs in which 62 vehicles of an arm reached the crosswalk and every vehicle is an AV."""
    names = {name: entry for entry in SIMULATIONS for name in entry.names if name is not None}
    calm = {
        name: Finding(0)
        if entry.form is Form.COUNT
        else Finding(None, reason=entry.undefined or None)
        for name, entry in names.items()
    }
    # 1 − 0.05^(1/2), the bound of Clopper and Pearson for two trials without an event.
    no_contact = Finding(0.0, 0.0, 1 - 0.025**0.5, 124, 0)
    return calm | {
        "av_time_loss_s": Finding(19.5, 10.0, 29.0, 2),
        "av_time_loss_s_human": Finding(20.6, 11.0, 30.0, 2),
        "av_time_loss_s_difference": Finding(-1.1, -4.9, 4.5, 2),
        "kappa": no_contact,
        "kappa_human": no_contact,
        "pairs": Finding(2),
        "automated": Finding(120),
        "automated_human": Finding(120),
        "driven": Finding(100),
        "av_passages": Finding(120),
        "passages": Finding(124),
        "passages_human": Finding(124),
        "not_measured": Finding(52),
        "not_measured_human": Finding(50),
        "confidence": Finding(0.95),
        **changes,
    }


def lines_of(width: int = 100, **changes: Finding) -> list[str]:
    numbers = findings(**changes)
    notes = simulation_notes(SCENARIO, numbers, SIMULATIONS)
    cell = CellFindings(
        0, {}, "soft_yield", "sumo_driver", 2, SCENARIO.conflicts.model_dump(), numbers, notes
    )
    run = RunFindings(SIMULATIONS, "town", "runs/town", "seed 1", 0.95, (cell,))
    return screen_lines(screen_of(run), width)


def test_vehicles_that_are_not_there_have_neither_row_nor_note() -> None:
    lines = lines_of()
    assert not any("other vehicles" in line or "commands cut" in line for line in lines)
    there = lines_of(other_time_loss_s=Finding(26.5, 20.0, 33.0, 2))
    assert any(line.startswith("time loss of other vehicles") for line in there)


def test_a_bound_of_few_pairs_names_them() -> None:
    (row,) = (line for line in lines_of() if line.startswith("contacts with people"))
    # 1 − 0.05^(1/2) = 77.6 %; 124 vehicles that are independent would have 2.4 %.
    assert row.rstrip().endswith("each below 77.6 % (2 pairs)")


def test_a_share_of_one_arm_has_one_interval_and_no_exponent() -> None:
    (row,) = (
        line
        for line in lines_of(cut_share=Finding(0.25, 1.4e-10, 0.99, 5_000, 1_250))
        if line.startswith("commands cut by SUMO")
    )
    assert row.rstrip().endswith("0 … 99 %")


def test_one_note_says_what_is_left_out_of_both_arms() -> None:
    lines = lines_of()
    who = "In the two arms 52 / 50 vehicles"
    assert f"! {who} turned at a crosswalk or met it on a bend: not measured." in lines
    assert all(len(screen) <= MOST_LINES for screen in (lines, lines_of(80)))


def test_passages_of_avs_that_the_strategy_did_not_drive_are_named_with_the_reasons() -> None:
    assert not any("passages of AVs" in line for line in lines_of())
    # 120 passages of AVs: 120 − 70 − 4 = 46.
    lines = lines_of(avs_bend=Finding(70), avs_uncommanded=Finding(4))
    words = "soft_yield drove 46 of 120 passages of AVs; the others: 70 bend within R0, 4 got no"
    assert words in " ".join(line.strip() for line in lines)
    lines = lines_of(avs_inside=Finding(120))
    words = "! soft_yield drove 0 of 120 passages of AVs; the others: 120 came onto the approach"
    assert any(line.startswith(words) for line in lines)


def test_driving_of_sumo_is_not_credited_to_the_strategy() -> None:
    lines = lines_of(cut_share=Finding(0.25, 0.06, 0.58, 5_000, 1_250))
    assert "! SUMO cut 25 % of soft_yield's commands: that driving is SUMO's." in lines
    assert not any("! SUMO cut" in line for line in lines_of(cut_share=Finding(0.02, 0.0, 0.1)))


def test_cells_share_a_note_on_what_is_left_out_with_the_ranges_of_its_counts() -> None:
    texts = ["In the two arms 1,244 / 240 trips (v2).", "In the two arms 1,240 / 240 trips (v2)."]
    cells = [(cell, [Note(Rank.LEFT_OUT, text)]) for cell, text in enumerate(texts)]
    (note,) = joined_notes(cells)
    assert note.text == "In the two arms 1,240 … 1,244 / 240 trips (v2)."
    (note,) = joined_notes([*cells, (2, [])])
    assert note.text == "Cells 0, 1: In the two arms 1,240 … 1,244 / 240 trips (v2)."
    # Failures are said cell by cell.
    failed = [(cell, [Note(Rank.FAILURES, f"{cell + 1} of 5 pairs failed.")]) for cell in range(2)]
    assert [note.text[:7] for note in joined_notes(failed)] == ["Cell 0:", "Cell 1:"]


def test_few_pairs_are_said_and_trips_that_did_not_end_are_no_pairs() -> None:
    """It is said of 3 pairs however many notes there are; no pair is left out."""
    many = {"unfinished": Finding(7), "teleports": Finding(3), "stuck": Finding(2)}
    many |= {"sumo_collisions": Finding(4), "avs_stop": Finding(5), "pairs": Finding(3)}
    lines = lines_of(40, **many)
    assert "! Few pairs: Each interval rests on 3" in lines
    (more,) = (n for n, line in enumerate(lines) if line.startswith("! More to know"))
    folded = " ".join(line.strip() for line in lines[more:])
    assert "trips that did not end" in folded
    assert "pairs left out" not in folded
    assert "few pairs" not in folded


def test_a_difference_that_is_equal_in_all_pairs_says_that_it_has_no_spread() -> None:
    """A queue of 0 m against one of 21 m in both pairs; one pair alone cannot show a spread."""
    queue = {
        "queue_p95_m": Finding(0.0),
        "queue_p95_m_human": Finding(21.0),
        "queue_p95_m_difference": Finding(-21.0),
    }
    (row,) = (line for line in lines_of(**queue) if line.startswith("queue, 95 %"))
    assert row.rstrip().endswith("−21.0 (no spread)")
    one = lines_of(**queue, failed=Finding(1))
    (row,) = (line for line in one if line.startswith("queue, 95 %"))
    assert row.rstrip().endswith("−21.0")
    (row,) = (line for line in lines_of() if line.startswith("time loss of AVs"))
    assert row.rstrip().endswith("−1.1 (−4.9 … 4.5)")
