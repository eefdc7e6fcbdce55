"""What a screen may never hide, on findings and notes: of a run, of a sweep, of a comparison."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import pytest
from hypothesis import given, strategies as st

from harness.results.catalogue import ENTRIES
from harness.results.cell_findings import CellFindings, on_first_screen
from harness.results.estimators import EQUAL, zero_bound
from harness.results.finding import Finding, Form, Style
from harness.results.notes import Note, notes_of
from harness.results.references import opposite
from harness.results.result import Result, Shown, Versus
from harness.scenario import Scenario, load_scenario
from harness.scenario.sections import ActuationSection, PerceptionSection
from harness.studies.comparison import compare
from tests.cells import (
    FAILED,
    HUMAN_S,
    NOBODY,
    TIMED,
    Fate,
    cell_of,
    noisy,
    notes_by_key,
    result_of,
    run_of,
    study,
)

KINDS = {"run": (), "sweep": ("ego.length_m=4,5",), "comparison": ("arms.av=gap_yield,soft_yield",)}
"""What varies.  The last cell, Soft-Yield in a car of 5 m, is that of the news."""

Pair = tuple[Fate, Fate]


class Told(NamedTuple):
    result: Result
    cell: CellFindings
    """The cell of the news."""

    @property
    def notes(self) -> dict[str, str]:
        return {note.key: note.text for note in self.result.notes}

    @property
    def headings(self) -> str:
        """The headings of the first screen's rows and columns."""
        table = self.result.screen
        columns = [*table.columns, *(column for column, _ in table.same)]
        return str([*(column.heading for column in columns), *(row[0] for row in table.rows)])

    def shows(self, finding: Finding) -> bool:
        """Whether the first screen has a finding."""
        return finding in [shown.finding for shown in _shown(self.result)]


def _shown(result: Result) -> Iterator[Shown]:
    rows = [*result.screen.rows, tuple(value for _, value in result.screen.same)]
    for entered in (each for row in rows for each in row):
        if isinstance(entered, Shown):
            yield entered
        elif isinstance(entered, Versus):
            yield from entered


@pytest.fixture(params=KINDS)
def tell(request: pytest.FixtureRequest) -> Callable[..., Told]:
    def made(news: Callable[[int], Pair], pairs: int = 40, **changes: object) -> Told:
        def fates(scenario: Scenario, pair: int) -> Pair:
            here = scenario.arms.av == "soft_yield" and scenario.ego.length_m == 5
            return news(pair) if here else usual(pair)

        dotted = {key.replace("__", "."): value for key, value in changes.items()}
        run = run_of(study(dotted, *KINDS[request.param]), fates, pairs)
        result = compare(run) if request.param == "comparison" else run.result()
        return Told(result, run.cells[-1])

    return made


def usual(pair: int) -> Pair:
    """A reference for whom the AV's strategy changes nothing."""
    return noisy(pair), noisy(pair, 1, HUMAN_S)


def some(fate: Fate, others: Callable[[int], Pair] = usual) -> Callable[[int], Pair]:
    """Pairs of which the first three have this fate of the AV."""
    return lambda pair: (fate, others(pair)[1]) if pair < 3 else others(pair)


@pytest.mark.parametrize(
    ("fate", "key", "words", "scope"),
    [
        (
            FAILED,
            "failures",
            "3 of 80 episodes failed (AV 3, human_gmm 0; by the strategy 3)",
            ("3 failures", "3 pairs not in the ratio of times"),
        ),
        ("timed_out", "left_out", "had time-outs (AV 3, human_gmm 0)", ("3 time-outs",)),
        (
            "crashed",
            "left_out",
            "uses 37 of 40 pairs, μ and c_v use 37. The others had crashes (AV 3, human_gmm 0)",
            ("3 pairs not in the ratio of times",),
        ),
    ],
)
def test_what_did_not_cross_is_counted_and_the_worst_case_stands_beside(
    tell: Callable[..., Told], fate: Fate, key: str, words: str, scope: tuple[str, ...]
) -> None:
    told = tell(some(fate))
    assert words in told.notes[key]
    assert [each for each in scope if each not in told.result.scope] == []
    assert told.cell["kappa_worst"].events == 3
    for worst in (entry for entry in ENTRIES if entry.worst_of):
        assert told.shows(told.cell[worst.key])
    assert "worst case" in told.headings
    # Nothing is left out, so nothing is said.
    calm = tell(usual)
    assert {key, "left_out"} & {*calm.notes} == set()
    assert "worst case" not in calm.headings


@pytest.mark.parametrize("fate", ["timed_out", "crashed", FAILED])
def test_the_worst_case_stands_beside_what_the_reference_leaves_out(
    tell: Callable[..., Told], fate: Fate
) -> None:
    """A reference that times out counts with 60 s, which flatters the AV."""
    told = tell(lambda pair: (usual(pair)[0], fate if pair < 3 else usual(pair)[1]))
    assert told.shows(told.cell["time_ratio_worst"])
    assert "μ and c_v use 37" in told.notes["left_out"]
    assert "AV 0, human_gmm 3" in told.notes["left_out"]


@pytest.mark.parametrize("crashes", [0, 3])
def test_trials_stand_beside_crashes_and_the_bound_beside_none(
    tell: Callable[..., Told], crashes: int
) -> None:
    told = tell(some("crashed") if crashes else usual)
    kappas = [each for each in _shown(told.result) if each.style == Style(Form.EVENTS, 1)]
    assert told.shows(told.cell["kappa"])
    assert (told.cell["kappa"].events, told.cell["kappa"].n) == (crashes, 40)
    for finding, _ in kappas:
        assert (finding.n, finding.reliable) == (40, True)
        if finding.events == 0:
            assert zero_bound(finding.high) == pytest.approx(1 - 0.05 ** (1 / 40))


@pytest.mark.parametrize("pairs", [1, 2, 5, 50, 199])
def test_few_pairs_come_first_however_few(tell: Callable[..., Told], pairs: int) -> None:
    told = tell(usual, pairs)
    keys = [note.key for note in told.result.notes]
    assert {"few_pairs", "opposite", "not_validated"} <= {*keys}
    assert {*keys[: keys.index("few_pairs")]} <= {"few_differ"}
    assert f"(fewest: {pairs:,})" in told.notes["few_pairs"]
    assert "Needed: 200 (delay" in told.notes["few_pairs"]
    assert "1,000 (time to cross, ratio of times, μ" in told.notes["few_pairs"]

    # Those that are all equal have no interval that could be unreliable, and say even less.
    told = tell(lambda _: (8.0, HUMAN_S), pairs)
    assert f"(fewest: {pairs:,})" in told.notes["few_pairs"]
    assert "few_pairs" not in notes_by_key(cell_of([(8.0, HUMAN_S)] * 4_000))


def test_every_interval_of_the_first_screen_that_is_unreliable_or_missing_has_its_reason(
    tell: Callable[..., Told],
) -> None:
    """Also those of one arm: here the AV's delay is the same in all pairs."""
    told = tell(lambda pair: (9.0, noisy(pair, 1)), 300)
    assert told.cell["delay_s"].reason == EQUAL
    text = told.notes["equal"]
    assert "delay (AV)" in text
    # A wait of 0 in all episodes of both arms has no row.
    assert "people's wait" not in text
    for entry in on_first_screen(told.cell):
        for key in entry.keys:
            found, name = told.cell[key], entry.heading.partition(", ")[0]
            where = {EQUAL: "equal", None: None}.get(found.reason, "few_pairs")
            if where:
                assert name in told.notes[where], key


FELL = {"pass_time_s": 12.0, "fallback": True}


def test_who_drove_instead_of_the_reference(tell: Callable[..., Told]) -> None:
    def news(pair: int) -> Pair:
        return usual(pair)[0], (FELL if pair < 8 else usual(pair)[1])

    told = tell(news, arms__human="soft_yield")
    words = "hard_yield drove in 8 of 40 reference passages (20 % of those that met someone)"
    assert words in told.notes["fallback"]
    assert "AV" not in told.notes["fallback"].partition("hard_yield")[2]
    assert told.cell["fallback_share_human"].value == 8 / 40


def test_the_model_outside_its_data(tell: Callable[..., Told]) -> None:
    # 1 of 4 uses in the AV's arm, 3 of 4 in the reference's.
    def news(_pair: int) -> Pair:
        asked = {"conditionings": 4, "pass_time_s": 8.0}
        return {**asked, "clamped": 1}, {**asked, "clamped": 3}

    words = tell(news).notes["outside_model"]
    assert "outside its data in 25 % (AV) and 75 % (human_gmm) of its uses" in words
    inside = {"pass_time_s": 8.0, "conditionings": 4, "clamped": 0}
    assert "outside_model" not in tell(lambda _: (inside, inside)).notes


def test_a_reference_that_was_not_validated_in_such_scenes(tell: Callable[..., Told]) -> None:
    """One person at the trigger is no crowd; the order in recorded crowds is that of the file."""
    words = tell(usual).notes["not_validated"]
    assert "human_gmm was not validated against real drivers in such scenes" in words
    assert "its order of passing was right for 70 %" in words


@pytest.mark.parametrize("pairs", [20, 50, 200, 1_000])
def test_another_reference_says_the_opposite_at_any_number_of_pairs(
    tell: Callable[..., Told], pairs: int
) -> None:
    told = tell(usual, pairs)
    assert " as the reference " in told.notes["opposite"]
    assert told.notes["opposite"].count("With human_recorded ") == 1


def test_the_opposite_is_known_where_it_was_measured() -> None:
    def said(changes: dict, value: float, name: str = "cctc") -> str | None:
        return opposite(load_scenario(name, changes), value)

    assert "human_gmm as the reference soft_yield is faster" in str(
        said({"arms.human": "human_recorded"}, 1.2)
    )
    # With a flow only the other way was measured.
    assert said({"arms.human": "human_recorded"}, 1.2, "cctc_flow") is None
    assert "is slower" in str(said({}, 0.8, "cctc_flow"))
    for changes in (
        {"ego.initial_speed_mps": 6.0},
        {"arms.av": "constant_speed"},
        {"strategies.soft_yield.p1": 0.02},
        {"strategies.human_gmm.speed": "sampled"},
    ):
        assert said(changes, 0.8) is None


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        ((NOBODY, NOBODY), "Neither driver met a pedestrian: nothing was tested"),
        ((FAILED, HUMAN_S), "Every episode of the AV failed: nothing was"),
    ],
)
def test_nobody_met_is_not_nothing_ran(tell: Callable[..., Told], pair: Pair, words: str) -> None:
    assert words in tell(lambda _: pair).notes["nothing_tested"]
    # In every pair in which someone was met the AV failed, in the others nobody was.
    mixed = tell(lambda number: (FAILED, HUMAN_S) if number < 20 else (NOBODY, NOBODY))
    assert "Every pair that met a pedestrian failed" in mixed.notes["nothing_tested"]
    assert "20 pairs met nobody" in mixed.result.scope
    one = tell(lambda number: usual(number) if number == 7 else (NOBODY, NOBODY))
    assert "nothing_tested" not in one.notes


def test_pairs_that_were_selected_by_their_outcome(tell: Callable[..., Told]) -> None:
    drawn = [{"episode": n, "uniforms": {"quantile": [0.5], "side": [0.2]}} for n in range(3)]
    told = tell(usual, 3, pedestrians__drawn=drawn, experiment__pairs=3)
    assert "selected by their outcome" in told.notes["selected"]
    assert "selected by their outcome" in told.result.about


@pytest.mark.parametrize("vary", [KINDS["run"], KINDS["sweep"]])
def test_an_unfinished_run_says_so_first(vary: tuple[str, ...]) -> None:
    of = study({"experiment.pairs": 30}, *vary)
    result = result_of(of, lambda _, pair: some(FAILED)(pair), 10, finished=False)
    cells = max(1, 2 * len(vary))
    assert result.notes[0].key == "unfinished"
    assert f"{10 * cells} of {30 * cells} pairs are done" in result.notes[0].text
    assert result.facts["finished"] is False


ERRORS = {"latency_s": 0.3, "update_s": 0.5, "detection_probability": 0.9, "lag_s": 0.4}
ERRORS |= {"dropout_probability": 0.05, "position_sd_m": 0.4, "speed_sd_mps": 0.2}
ERRORS |= {"dead_time_s": 0.3, "max_jerk_mps3": 2.0}
CALM = {"correlation_s", "occlusion", "human"}
"""Fields that are no error by themselves."""


@pytest.mark.parametrize("human", [False, True])
@pytest.mark.parametrize(
    ("section", "key"),
    [
        (name, key)
        for name, of in (("perception", PerceptionSection), ("actuation", ActuationSection))
        for key in of.model_fields
        if key not in CALM
    ],
)
def test_errors_of_perception_and_actuation_are_told(
    tell: Callable[..., Told], section: str, key: str, human: bool
) -> None:
    value = ERRORS[key]
    changes = {f"{section}__{key}": value, f"{section}__human": human}
    about = tell(usual, 3, **changes).result.about
    who = "AV and reference" if human else "AV"
    assert f"{section} of {who}: {key} {value:g}" in about
    assert "AV:" not in tell(usual, 3).result.about


def test_all_episodes_are_the_same_one() -> None:
    drivers = {"arms__av": "constant_speed", "arms__human": "hard_yield"}
    cell = cell_of([(8.0, HUMAN_S)] * 30, **TIMED, **drivers)
    words = notes_by_key(cell)["repeated"].text
    assert words.startswith("All 30 episodes are equal (AV and hard_yield)")
    assert "model_fit" not in notes_by_key(cell)  # neither driver asks it, and speeds are given
    assert "repeated" not in notes_by_key(cell_of([usual(pair) for pair in range(3)]))


def test_the_worse_the_news_the_higher() -> None:
    crashed = {"ending": "crashed", "sumo_collision": True}
    bad: list[Pair] = [(FAILED, noisy(0, 1)), ("timed_out", noisy(1, 1)), (crashed, noisy(2, 1))]
    driven = {"conditionings": 4, "clamped": 1, "clamped_range_excess_m": 3.0, "fallback": True}
    driven |= {"max_speed_mps": 6.0, "pass_time_s": 8.0, "sumo_collision": True}
    bad += [(driven, noisy(pair, 1)) for pair in range(3, 60)]
    found = notes_of([cell_of(bad)])
    keys = [note.key for note in found]
    order = ["failures", "sumo_alone", "few_pairs", "opposite", "fallback", "left_out"]
    order += ["outside_model", "not_validated", "model_fit", "speeding", "repeated", "equal"]
    assert keys == [key for key in order if key in keys]
    seen = {"failures", "few_pairs", "opposite", "left_out", "fallback", "model_fit", "speeding"}
    assert seen <= {*keys}
    assert found[1].first == "SUMO alone reports 57 contacts (AV 57, human_gmm 0)."


def test_a_note_of_a_sweep_is_about_its_worst_cell_and_counts_the_others() -> None:
    failures = {3.0: 1, 4.0: 3, 5.0: 2, 6.0: 0}

    def fates(scenario: Scenario, pair: int) -> Pair:
        return (FAILED if pair < failures[scenario.ego.length_m] else 9.0), HUMAN_S

    vary = f"ego.length_m={','.join(map(str, failures))}"
    cells = run_of(study({}, vary), fates, 10).cells
    (note,) = [note for note in notes_of(cells) if note.key == "failures"]
    assert note.text.startswith("length_m 4: 3 of 20 episodes failed")
    assert note.first.endswith("(similar in 2 more cells).")
    assert note.cells == (0, 1, 2)
    (note,) = [note for note in notes_of(cells[2:]) if note.key == "failures"]
    assert note.text.startswith("length_m 5: 2 of 20")
    (alike,) = [note for note in notes_of(cells[:1] * 2) if note.key == "failures"]
    assert alike.text.startswith("1 of 20")
    assert alike.first.endswith("(likewise in 1 more cell).")


def test_json_and_csv_hide_nothing_that_the_screen_says(tell: Callable[..., Told]) -> None:
    told = tell(some(FAILED), actuation__dead_time_s=0.3)
    document = told.result.to_dict()
    assert "dead_time_s 0.3" in document["about"]
    assert "3 failures" in document["scope"]
    assert [note["text"] for note in document["notes"]] == [n.text for n in told.result.notes]
    row = told.result.frame().iloc[-1]
    for key, finding in told.result.records[-1].items():
        if isinstance(finding, Finding) and finding.reason is not None:
            assert row[f"{key}_reason"] == finding.reason
            assert document["records"][-1][key]["reason"] == finding.reason
    assert [name for name in row.index if name.endswith("_reason")]


@given(st.lists(st.tuples(st.integers(-10, 20), st.floats(-9, 9)), max_size=8))
def test_notes_are_ordered_by_rank_and_then_by_weight(of: list[tuple[int, float]]) -> None:
    given_notes = [Note("k", rank, "k", "k", weight=weight) for rank, weight in of]
    found = [(note.rank, -note.weight) for note in notes_of([], given_notes)]
    assert found == sorted((rank, -weight) for rank, weight in of)


def test_one_cell_of_a_sweep_keeps_its_name() -> None:
    """An unfinished sweep may have one cell only, and ``--vary`` may have one value."""
    vary = ("pedestrians.flow_per_hour=250", "ego.length_m=4", "crossing.length_m=12")
    result = result_of(study({}, *vary), lambda _, pair: usual(pair), 3, finished=False)
    for name in ("flow_per_hour 250", "ego.length_m 4", "crossing.length_m 12"):
        assert name in result.title
