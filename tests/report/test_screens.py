"""Screens: texts of numbers, and tables of any content at any width."""

import re
from collections import Counter

import pytest
from hypothesis import given, strategies as st

from harness.report.screen import MOST_NOTES
from harness.report.words import DASH, text_of
from harness.results.estimators import clopper_pearson
from harness.results.finding import Finding, Form, Style
from harness.results.notes import Note
from harness.results.result import Column, Result, Shown, Table, Versus
from harness.scenario import Scenario
from tests.cells import HUMAN_S, Fate, noisy, result_of, screen_text, study

NUMBERS = st.floats(-1e4, 1e4, allow_subnormal=False)
SHARES = st.floats(0, 1, allow_subnormal=False)
NAMES = st.text("abcdefg_ μτ", min_size=1, max_size=24).map(str.strip).filter(bool)


@st.composite
def shown(draw: st.DrawFn, form: Form | None = None, digits: int | None = None) -> Shown:
    """A number that an estimator could return."""
    form = form or draw(st.sampled_from([Form.NUMBER, Form.SHARE, Form.EVENTS, Form.COUNT]))
    style = Style(form, draw(st.integers(0, 3)) if digits is None else digits)
    if draw(st.integers(0, 9)) == 0:
        return Shown(Finding(None, reason="nobody was met"), style)
    if form is Form.COUNT:
        return Shown(Finding(draw(st.integers(0, 100_000))), style)
    if form is Form.EVENTS:
        n = draw(st.integers(1, 10_000))
        events = draw(st.integers(0, n))
        low, high = clopper_pearson(events, n, 0.95)
        return Shown(Finding(events / n, low, high, n, events, reliable=True), style)
    low, value, high = sorted(draw(st.tuples(*[SHARES if form is Form.SHARE else NUMBERS] * 3)))
    ends = (low, high) if draw(st.booleans()) else (None, None)
    reliable = draw(st.booleans()) if ends[0] is not None else None
    return Shown(Finding(value, ends[0], ends[1], n=50, reliable=reliable), style)


@st.composite
def tables(draw: st.DrawFn) -> Table:
    """A table of names and numbers, with an empty column."""
    rows = draw(st.integers(1, 5))
    columns = [[draw(NAMES) for _ in range(rows)], [None] * rows]
    for _ in range(draw(st.integers(0, 6))):
        form, digits = draw(st.sampled_from([*Form][:4])), draw(st.integers(0, 3))
        number = shown(form, digits)
        both = draw(st.booleans())
        of = st.builds(Versus, number, number) if both else number
        columns.append([draw(of) for _ in range(rows)])
    headings = [Column(f"c{place}", draw(NAMES)) for place in range(len(columns))]
    headings[1] = Column("empty", "EMPTY")
    return Table("", tuple(headings), tuple(zip(*columns, strict=True)))


def result(screen: Table, *notes: str, full: tuple[Table, ...] = (), title: str = "t") -> Result:
    said = tuple(Note("warning", n, f"label {n}", text) for n, text in enumerate(notes))
    closing, facts = ("Page: harness report RUN",), {"confidence": 0.95}
    return Result("run", title, "50 pairs, seed 1", "", screen, full, said, closing, facts=facts)


def signs(text: str) -> Counter[str]:
    return Counter(re.sub(r"\s", "", text))


@given(tables(), st.integers(40, 200), st.booleans())
def test_a_table_of_any_content_fits_and_loses_nothing(
    table: Table, width: int, full: bool
) -> None:
    text = screen_text(result(table, full=(table,) if full else ()), width, full)
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    assert "EMPTY" not in text
    times = 2 if full else 1
    for row in table.rows:
        for cell in row:
            values = signs(text_of(cell, interval=False))
            assert all(signs(text)[sign] >= times * number for sign, number in values.items())
    if full:
        every = [text_of(cell) for row in table.rows for cell in row]
        headings = [column.heading for column in table.columns if column.heading != "EMPTY"]
        assert signs(text) >= signs("".join([*every, *headings]))


@given(shown(), st.integers(40, 200))
def test_a_bound_of_0_events_is_on_every_screen(number: Shown, width: int) -> None:
    """1 − 0.05^(1/n), which Clopper and Pearson (1934) is without events."""
    n = 50
    zero = Shown(Finding(0.0, 0.0, clopper_pearson(0, n, 0.95)[1], n, 0), Style(Form.EVENTS, 1))
    columns = tuple(Column(f"c{place}", f"heading {place}") for place in range(8))
    text = screen_text(result(Table("", columns, (("a row", zero, *[number] * 6),))), width)
    assert f"below {100 * (1 - 0.05 ** (1 / n)):.1f} %" in re.sub(r"\s+", " ", text)


@pytest.mark.parametrize(
    ("number", "style", "text"),
    [
        (Finding(0.754, 0.71, 0.8249), Style(), "0.75 (0.71 … 0.82)"),
        (Finding(-2.96, -3.46, -2.24, reliable=False), Style(digits=1), "−3.0* (−3.5 … −2.2)"),
        (Finding(-0.0001), Style(digits=1), "0.0"),
        (Finding(1_234_567), Style(Form.COUNT), "1,234,567"),
        (Finding(0.04, 0.0049, 0.137), Style(Form.SHARE, 0), "4.0 % (0.5 … 13.7 %)"),
        (Finding(0.0, 0.0, 0.0000369), Style(Form.SHARE, 0), "0.0000 % (0.0000 … 0.0037 %)"),
        (Finding(0.02, 0.0005, 0.1065, 50, 1), Style(Form.EVENTS, 1), "1 of 50 (0.1 … 10.7 %)"),
        (Finding(0.0, None, None, 50, 0), Style(Form.EVENTS, 1), "0 of 50"),
        (Finding(0.0004), Style(digits=3), "< 0.001"),
        (Finding(None), Style(), DASH),
    ],
)
def test_texts(number: Finding, style: Style, text: str) -> None:
    assert text_of(Shown(number, style)) == text


COLUMNS = [Column(name, name) for name in ("", "AV", "human_gmm")]
COLUMNS += [Column("paired", "AV against reference", interval=True)]
ROWS: list = [
    (name, *(Shown(Finding(of, of - 0.5, of + 0.5, 50), Style(digits=d)) for of in (9, 12, 3)))
    for d, name in enumerate(["time to cross, s", "delay, s", "spread of that ratio"])
]
PAPER = Table("", tuple(COLUMNS), tuple(ROWS))


def test_three_notes_the_worst_first_and_the_others_by_their_labels() -> None:
    notes = [f"Sentence {number}." for number in range(6)]
    text = screen_text(result(PAPER, *notes), 80)
    said = [line for line in text.splitlines() if line.startswith("!")]
    assert said[:MOST_NOTES] == [f"! {note}" for note in notes[:MOST_NOTES]]
    assert said[MOST_NOTES:] == ["! 3 more with --full: label 3; label 4; label 5."]
    assert all(f"! {note}" in screen_text(result(PAPER, *notes), 80, full=True) for note in notes)
    long = screen_text(result(PAPER, *["First sentence. And a second."] * 20), 80)
    # No label is cut: it stands for a note that no screen may hide.
    assert [of for of in range(3, 20) if f"label {of}" not in " ".join(long.split())] == []
    assert "…" not in long.partition("17 more")[2]


@pytest.mark.parametrize("width", [80, 100, 120])
@pytest.mark.parametrize("pairs", [5, 20, 50, 200])
def test_the_papers_numbers_have_16_lines(pairs: int, width: int) -> None:
    """With crashes, fallbacks and few pairs, so that all notes and the worst case are there."""

    def fates(_scenario: Scenario, pair: int) -> tuple[Fate, Fate]:
        fell = {"pass_time_s": noisy(pair), "fallback": True}
        return (fell if pair % 4 == 0 else noisy(pair)), ("crashed" if pair == 2 else HUMAN_S)

    made = result_of(study({"experiment.pairs": pairs}), fates, pairs)
    text = screen_text(made, width)
    assert len(text.splitlines()) <= 16
    words = ("0.7044", "4.54 %", f"1 of {pairs}", "(*)", "hard_yield drove", "below", "worst case")
    assert [each for each in words if each not in text] == []
    assert f"{len(made.notes) - MOST_NOTES} more with --full" in text
    whole = re.sub(r"\s+", "", screen_text(made, width, full=True))
    assert [note for note in made.notes if re.sub(r"\s+", "", note.text) not in whole] == []
