"""The findings of a cell, from nine pairs counted by hand; and a sweep's rows."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from harness.results import catalogue
from harness.results.cell_findings import CellFindings
from harness.results.columns import PairSample
from harness.results.estimators import EQUAL, FEW, REPEATED
from harness.results.finding import Finding, finding_to_dict
from harness.results.result import flat
from tests.cells import (
    FAILED,
    FREE_S,
    HUMAN_S,
    TIMED,
    Fate,
    cell_of,
    episodes,
    noisy,
    run_of,
    study,
)
from tests.scenes import refusal_of

FRONT = {"ending": "crashed", "avoidable": True, "avoidable_attentive": True}
SIDE = {"ending": "crashed", "contact": "side", "avoidable": False}
# As if untouched, an AV that crashed would have passed after 4.5 s: no number may gain by that.
HURRIED = {"pass_time_ignoring_contact_s": 4.5}
UNHURT_8 = {"ending": "crashed", "contact": "side", "pass_time_ignoring_contact_s": 8.0}
STUCK = {"ending": "crashed", "contact": "side"}


def met(fate: Fate, people: int, waits: tuple[int, float] | None = None, **more: object) -> Fate:
    """A fate with people who stepped off and, of those who arrived, the sum of their waits."""
    changes = {"pass_time_s": fate} if isinstance(fate, float) else fate
    changes = {"ending": changes} if isinstance(changes, str) else changes
    arrivals, waited_s = waits or (0, 0.0)
    each = waited_s / arrivals if arrivals else None
    counted = {"pedestrians": people, "arrivals": arrivals, "pedestrian_delay_s": each}
    return {**changes, **counted, **more}


PAIRS = [  # the AV, the reference: time to cross, or how else it ended
    (met(6.0, 1, (1, 2.0)), met(10.0, 1)),  # τ = 0.6
    (met(9.0, 1, (2, 0.0), fallback=True), met(10.0, 0)),  # τ = 0.9
    (met(12.0, 0), met(8.0, 0)),  # τ = 1.5, nobody was met
    (met({**SIDE, **HURRIED}, 1, (1, 1.0)), met(9.0, 0)),
    (met({**FRONT, **HURRIED}, 1, (1, 3.0)), met(9.0, 0)),
    (met("timed_out", 2, (2, 10.0)), met(30.0, 1)),
    (met(15.0, 0), met("timed_out", 0)),  # nobody was met
    (met(FAILED, 0, (5, 99.0)), met(STUCK, 1)),
    (met(20.0, 1, (1, 4.0)), met(UNHURT_8, 1)),  # as if untouched: τ = 2.5
]


USUAL = cell_of([(noisy(pair), noisy(pair, 1)) for pair in range(20)])


@pytest.fixture(scope="module")
def nine() -> CellFindings:
    return cell_of(PAIRS)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        # Pairs 0, 1, 2, 5, 6 and 8: nobody failed and the AV did not crash.  A time-out is 60 s,
        # the reference that crashed in pair 8 drives on and takes 8 s.
        ("time_s", (6 + 9 + 12 + 60 + 15 + 20) / 6),
        ("time_s_human", (10 + 10 + 8 + 30 + 60 + 8) / 6),
        ("time_ratio", 122 / 126),
        ("mu", (0.6 + 0.9 + 1.5) / 3),
        ("cv", math.sqrt((0.4**2 + 0.1**2 + 0.5**2) / 3)),
        ("mu_all", (0.6 + 0.9 + 1.5 + 2.5) / 4),
        ("mu_met_someone", (0.6 + 0.9) / 2),
        # Against the AV: its four with 60 s, a reference that never passed is free, 7.4 s.
        ("time_ratio_worst", (122 + 3 * 60) / (10 + 10 + 8 + 9 + 9 + 30 + 7.4 + 7.4 + 8)),
        ("mu_worst", np.mean([0.6, 0.9, 1.5, 60 / 9, 60 / 9, 2, 15 / 7.4, 60 / 7.4, 2.5])),
        ("delay_worst_s", (122 + 3 * 60) / 9 - FREE_S),
        ("delay_worst_s_human", (10 + 10 + 8 + 9 + 9 + 30 + 7.4 + 7.4 + 8) / 9 - FREE_S),
        # The delays of those who crossed, and of the pairs in which the AV did.
        ("delay_s", (6 + 9 + 12 + 15 + 20) / 5 - FREE_S),
        ("delay_s_human", (10 + 10 + 8 + 9 + 9 + 30) / 6 - FREE_S),
        ("delay_difference_s", (-4 - 1 + 4 + 12) / 4),
        ("delay_met_someone_s", (6 + 9 + 20) / 3 - FREE_S),
        # 20 s of waits of 8 people: those of the episode that failed do not count.
        ("pedestrian_wait_s", 20 / 8),
        ("fallback_share", 1 / 6),
        ("fallback_share_human", 0),
    ],
)
def test_values_by_hand(nine: CellFindings, key: str, value: float) -> None:
    assert nine[key].value == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("key", "events", "trials"),
    [
        # Eight AV episodes ran; four crashed, failed or timed out in nine pairs.
        ("kappa", 2, 8),
        ("kappa_human", 2, 9),
        ("kappa_avoidable", 1, 8),
        ("kappa_avoidable_attentive", 1, 8),
        ("kappa_avoidable_human", 0, 9),
        ("kappa_worst", 4, 9),
        ("kappa_all", 4, 9),
        # Seven pairs met someone, in one of which the AV failed.
        ("kappa_met_someone", 2, 6),
    ],
)
def test_shares_by_hand(nine: CellFindings, key: str, events: int, trials: int) -> None:
    found = nine[key]
    assert (found.events, found.n, found.value) == (events, trials, events / trials)
    low = stats.beta.ppf(0.025, events, trials - events + 1) if events else 0.0
    high = stats.beta.ppf(0.975, events + 1, trials - events)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-10)
    assert found.reliable


def test_counts_by_hand(nine: CellFindings) -> None:
    counts = {"pairs": 9, "met_someone": 7, "met_nobody": 2, "not_in_time_ratio": 3, "mu_pairs": 3}
    counts |= {"timed_out": 1, "timed_out_human": 1, "failed": 1, "failed_human": 0}
    counts |= {"failed_strategy": 1, "failed_strategy_human": 0, "fallbacks": 1}
    assert {key: nine[key].value for key in counts} == counts
    # The first is no number of encounters.
    refusal_of(lambda: nine.total("sumo_people"), "unknown finding 'sumo_people'")
    refusal_of(lambda: nine["kapa"], "unknown finding 'kapa'", "did you mean 'kappa'")


def test_nine_pairs_are_too_few_and_undefined_numbers_say_why(nine: CellFindings) -> None:
    mu = nine["mu"]
    words = "unreliable below 1,000 informative pairs (has 3)"
    assert (mu.n, mu.reliable, mu.reason) == (3, False, words)
    assert mu.low < 1 < mu.high
    nobody = nine["pedestrian_wait_s_human"]
    assert (nobody.value, nobody.reason) == (None, "nobody arrived")
    # What has an interval says whether it is reliable; what has none does not.
    for key, finding in nine.findings.items():
        assert (finding.low is None) == (finding.reliable is None), key


def test_a_reference_that_crashed_and_never_passes_counts_with_the_time_out() -> None:
    stuck = [*PAIRS[:8], (PAIRS[8][0], met(STUCK, 1))]
    assert cell_of(stuck)["time_ratio"].value == pytest.approx(122 / (126 - 8 + 60))


def test_all_failed() -> None:
    failed = cell_of([(FAILED, {**FAILED, "failed_in": "engine"})] * 3)
    assert [failed[f"failed_strategy{end}"].value for end in ("", "_human")] == [3, 0]
    undefined = {key: each for key, each in failed.findings.items() if each.value is None}
    assert {"mu", "cv", "time_ratio", "time_s", "kappa", "kappa_human", "stops"} <= {*undefined}
    assert [key for key, finding in undefined.items() if not finding.reason] == []
    assert failed["kappa_worst"].value == 1.0


def test_braking_is_that_of_whoever_met_someone() -> None:
    def driven(people: int, most_mps2: float) -> dict[str, float]:
        return {"pass_time_s": 8.0, "pedestrians": people, "max_deceleration_mps2": most_mps2}

    alone = driven(0, 9.0)
    cell = cell_of([(driven(1, 4.0), alone), (driven(1, 2.0), alone), (alone, alone)])
    assert cell["max_deceleration_p95_mps2"].value == 4.0


@pytest.mark.parametrize(
    ("key", "column", "threshold", "inside", "outside"),
    [
        ("conflict_pet", "pet_s", "pet_s", 1.4, 1.5),
        ("conflict_ttc", "min_ttc_s", "ttc_s", 1.4, 1.5),
        ("conflict_time_advantage", "min_time_advantage_s", "time_advantage_s", 1.4, 1.5),
        ("conflict_drac", "max_drac_mps2", "drac_mps2", 3.4, 3.35),
    ],
)
def test_conflicts_by_thresholds(
    key: str, column: str, threshold: str, inside: float, outside: float
) -> None:
    """Beyond the threshold, not on it; a crash is a conflict of every kind; undefined is none."""
    fates: list = [{"pass_time_s": 8.0, column: value} for value in (inside, outside, None)]
    pairs = [(fate, HUMAN_S) for fate in fates] + [("crashed", HUMAN_S), (FAILED, HUMAN_S)]
    cell = cell_of(pairs)
    assert (cell[key].events, cell[key].n) == (2, 4)
    assert (cell[f"{key}_human"].events, cell[f"{key}_human"].n) == (0, 5)
    assert cell_of(pairs, **{f"conflicts__{threshold}": inside})[key].events == 1


def test_equal_single_and_repeated_pairs_have_no_interval() -> None:
    equal = cell_of([(8.0, HUMAN_S)] * 30)["mu"]
    assert equal == Finding(equal.value, n=0, reason=EQUAL)
    assert equal.value == pytest.approx(0.8)
    single = cell_of([(8.0, HUMAN_S)])["mu"]
    assert (single.value, single.low, single.reliable, single.reason) == (0.8, None, None, FEW)
    drivers = {"arms__av": "constant_speed", "arms__human": "hard_yield"}
    once = cell_of([(8.0, HUMAN_S)] * 30, **TIMED, **drivers)
    assert (once["kappa"].low, once["kappa"].reason) == (None, REPEATED)
    # Somebody's own strategy may draw what it likes.
    drivers["arms__av"] = "tests.planner:Planner"
    own = cell_of([(8.0, HUMAN_S)] * 30, **TIMED, **drivers)
    assert own["kappa"].reliable


@pytest.mark.parametrize(
    "entry", [e for e in catalogue.ENTRIES if e.estimate.reliable_from], ids=lambda e: e.key
)
def test_few_pairs_are_said_to_be_few(entry: catalogue.Entry) -> None:
    least = entry.estimate.reliable_from
    (cell,) = study({}).cells
    sample = PairSample(episodes([(8.0, HUMAN_S)], cell.scenario), cell.scenario, 0.95)
    for n, reliable in ((least - 1, False), (least, True)):
        given = Finding(1.0, 0.9, 1.1, n, reliable=True)
        made = entry._replace(estimate=entry.estimate._replace(by=lambda *_, given=given: given))
        found = made.findings(sample)[entry.key]
        assert found.reliable is reliable
        few = f"unreliable below {least:,} informative pairs (has {n:,})"
        assert found.reason == (None if reliable else few)


@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf, np.float64("nan")])
@pytest.mark.parametrize("place", ["value", "low", "high", "p"])
def test_no_finding_is_a_number_that_is_not_finite(odd: float, place: str) -> None:
    changed: dict = {place: odd}
    found = replace(Finding(0.4, 0.3, 0.5, n=7, p=0.1, reliable=True), **changed)
    assert found == Finding(None, n=7, reason="it is no finite number")


def test_a_sweep_has_a_row_a_cell_and_no_column_that_is_empty_or_equal() -> None:
    """Delays differ; nobody waits, for two reasons; all else is the same."""
    vary = ("pedestrians.flow_per_hour=100,200", "ego.length_m=4", "crossing.length_m=9")
    cells = []
    for cell in study({}, *vary, "pedestrians.group_size=[0.5,0.5]", name="cctc_flow").cells:
        waits = Finding(None, n=cell.number, reason=f"reason {cell.number}")
        own = {"delay_s": Finding(float(cell.number)), "pedestrian_wait_s": waits}
        own |= {"pedestrian_wait_s_human": waits}
        cells.append(
            CellFindings(cell.number, cell.varied, cell.scenario, {**USUAL.findings, **own})
        )
    result = replace(run_of(study({}), lambda *_: (8.0, HUMAN_S), 1), cells=tuple(cells)).result()
    table = result.screen
    columns = [column.key for column in table.columns]
    assert columns == ["pedestrians.flow_per_hour", "delay_s"]
    assert [row[0] for row in table.rows] == [100.0, 200.0]
    assert [[shown.finding for shown in row[1]] for row in table.rows] == [
        [cell["delay_s"], cell["delay_s_human"]] for cell in cells
    ]
    same = {column.key: column.heading for column, _ in table.same}
    assert {"time_ratio", "pedestrian_wait_s", "kappa", "conflict_pet"} <= {*same}
    assert {"ego.length_m", "crossing.length_m", "group_size"} <= {*same.values()}
    for record, cell in zip(result.to_dict()["records"], cells, strict=True):
        assert record["pedestrians.flow_per_hour"] == cell.varied["pedestrians.flow_per_hour"]
        assert record["delay_s"] == finding_to_dict(cell["delay_s"])
        assert record["pedestrians.group_size"] == [0.5, 0.5]


def test_flat_names() -> None:
    """One column for each part that a number has; what it lacks has none."""
    parts = (0.04, 0.005, 0.137, 50, 2, True, "a reason", 0.2)
    row = flat({"cell": 3, "kappa": Finding(*parts), "mu": Finding(None, n=0, reason="why")})
    ends = ("", "_ci_low", "_ci_high", "_n", "_events", "_reliable", "_reason", "_p")
    kappa = {f"kappa{end}": part for end, part in zip(ends, parts, strict=True)}
    assert row == {"cell": 3, **kappa, "mu": None, "mu_n": 0, "mu_reason": "why"}
