"""First screens, made from findings that were written by hand."""

from harness.comparison.findings import Note, Rank
from harness.report.screen import Screen, screen_lines

NOTES = tuple(
    Note(rank, f"A sentence about {rank.name.lower()} that is as long as such a sentence can be.")
    for rank in Rank
)
ROWS = tuple((f"row {number}, s", "1.0", "2.0", "3.0", "0.7") for number in range(7))
SCREEN = Screen(
    "name: one against another",
    "50 pairs, seed 1",
    ("", "AV", "b", "both", "paper"),
    ROWS,
    NOTES,
    "-",
)


def test_notes_that_do_not_fit_share_a_line_but_no_failure_does() -> None:
    lines = screen_lines(SCREEN)
    assert len(lines) == 16
    noted = [line for line in lines if line.startswith("! ")]
    assert [line[19:40].split(" that")[0] for line in noted[:4]] == [
        "nothing_tested",
        "failures",
        "time_outs",
        "left_out",
    ]
    assert noted[-1].startswith("! More to know, shown by --full: ")
    assert noted[-1].endswith("the reference, few pairs.")
    # Where failures and what was left out do not fit either, they stand there all the same.
    many = screen_lines(Screen(*(SCREEN.title, "", ("", "AV"), ROWS * 3, NOTES, "-")), 40)
    assert sum("left_out" in line for line in many) == 1
