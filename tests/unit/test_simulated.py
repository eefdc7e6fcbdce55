"""Simulations in the results: estimators, numbers counted by hand, notes, screens and folders."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from harness.core.vocabulary import Arm
from harness.measures.queues import growth, level_of_service
from harness.report.page import write_report
from harness.results.catalogue import entries_of
from harness.results.cell_findings import CellFindings, on_first_screen
from harness.results.estimators import EQUAL
from harness.results.finding import Finding
from harness.results.folder import write_findings, write_manifest, write_part
from harness.results.loaded_run import Run, load_run
from harness.results.notes import notes_of
from harness.results.student import ALONE, ONE, clustered_share, t_mean, t_ratio_difference
from harness.scenario import Setting, read_scenario_file, study_of
from harness.simulation.arm import ENDED
from harness.studies.comparison import compare
from harness.studies.defaults import WhoDrove
from harness.studies.running.claimed_folder import manifest_of
from harness.studies.worst import worst
from tests.batches import printed
from tests.simulations import (
    Rows,
    arm,
    failed,
    findings_of,
    ordinary,
    passage,
    person,
    tables_of,
    trip,
)

Simulation = dict[str, Rows]
Pairs = list[tuple[Simulation, Simulation]]

FLOATS = st.lists(st.floats(0, 100), min_size=2, max_size=12)


@settings(max_examples=50)
@given(FLOATS, st.sampled_from([0.9, 0.95]))
def test_a_mean_has_the_interval_and_the_p_of_a_t_test(values: list[float], level: float) -> None:
    found, sample = t_mean(np.array([*values, np.nan]), level), np.array(values)
    assert found.value == pytest.approx(np.mean(sample))
    if np.ptp(np.round(sample, 9)) == 0:
        assert (found.low, found.reason) == (None, EQUAL)
        return
    test = stats.ttest_1samp(sample, 0.0)
    ends = test.confidence_interval(level)
    assert (found.low, found.high) == pytest.approx((ends.low, ends.high), rel=1e-6, abs=1e-6)
    assert found.p == pytest.approx(test.pvalue, abs=1e-6)
    assert found.reliable is (len(values) >= 5)
    cut = t_mean(sample, level, least=0.0)
    assert cut.low == pytest.approx(max(0.0, ends.low), rel=1e-6, abs=1e-6)


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=3, max_size=9))
def test_a_difference_of_shares_of_equal_pairs_is_a_paired_t_test(
    events: list[tuple[int, int]],
) -> None:
    a, b = np.array(events, float).T
    trials = np.full(len(a), 20.0)
    found = t_ratio_difference((a, trials), (b, trials), 0.95)
    assert found.value == pytest.approx(np.mean(a - b) / 20)
    if np.ptp(a - b) and a.any() | b.any():
        ends = stats.ttest_rel(a / 20, b / 20).confidence_interval(0.95)
        assert (found.low, found.high) == pytest.approx((ends.low, ends.high), abs=1e-9)
    else:
        assert found.low is None


def test_a_share_of_correlated_passages_is_worth_fewer_of_them() -> None:
    """Korn and Graubard by SciPy's quantiles, with the design effect by hand."""
    events, trials = np.array([0.0, 4.0, 0.0, 0.0]), np.full(4, 50.0)
    p, effect = 4 / 200, (4 / 3) * (3 * 1**2 + 3**2) / (200 * 0.02 * 0.98)
    worth = (stats.t.ppf(0.975, 199) / stats.t.ppf(0.975, 3)) ** 2
    n = 200 / effect * worth
    ends = stats.beta.ppf(0.025, p * n, n - p * n + 1), stats.beta.ppf(0.975, p * n + 1, n - p * n)
    found = clustered_share(events, trials, 0.95)
    told = found.low, found.high, found.value, found.events, found.n
    assert told == pytest.approx((*ends, p, 4, 200))
    none = clustered_share(0 * events, trials, 0.95)
    assert none.high == pytest.approx(1 - 0.025 ** (1 / (200 * worth)))
    # Simulated samples (docs/method.md) are covered if 5 pairs or more have the event.
    few = [clustered_share(np.arange(9.0) // k, np.full(9, 50.0), 0.95).reliable for k in (4, 5)]
    assert few == [True, False]


def test_one_pair_has_a_bound_at_nothing_and_no_other_interval() -> None:
    none, high = clustered_share(np.zeros(1), np.full(1, 300.0), 0.95), 1 - 0.025 ** (1 / 300)
    assert (none.high, none.reliable, none.reason) == (pytest.approx(high), False, ALONE)
    one = clustered_share(np.ones(1), np.array([300.0]), 0.95)
    assert (one.value, one.low, one.reason) == (1 / 300, None, ONE)
    assert clustered_share(np.zeros(1), np.zeros(1), 0.95).value is None


@given(st.floats(0.0, 0.3), st.floats(5.0, 60.0))
def test_a_network_fills_with_those_whom_it_does_not_serve(left: float, trip_s: float) -> None:
    due_s = np.arange(0.0, 900.0, 1.0)
    never = np.arange(900) % 100 < round(100 * left)
    found = growth(due_s, np.where(never, np.nan, due_s + trip_s), 0.0, 900.0)
    assert found == pytest.approx(round(100 * left) / 100, abs=2 / 300)


def test_levels_of_service_are_the_handbooks() -> None:
    """HCM 2010, exhibit 19-2: up to 5, 10, 20, 30 and 45 s."""
    assert [level_of_service(s) for s in (0, 5, 5.1, 45, 46)] == ["A", "A", "B", "E", "F"]
    with pytest.raises(ValueError, match="undefined"):
        level_of_service(np.nan)


AV = arm(
    [
        passage("a", delay_s=4.0, pet_s=1.0, share_strategy=0.5, share_leader=0.5),
        passage("b", delay_s=6.0, crosswalk=":b_c0", fallback=True, pedestrians=0),
        passage("c", driven=False, driver="sumo", not_driven_because="it came late", steps=0,
                share_strategy=None, share_leader=None, delay_s=2.0, pedestrians=0),
        passage("d", automated=False, delay_s=1.0, contact_person="p", pet_s=None),
        passage("e", automated=False, front_s=None, rear_s=None, ended="cut", delay_s=None),
    ],
    [trip("a", time_loss_s=8.0), trip("d", automated=False, arrival_s=None, time_loss_s=2.0)],
    [person("p", wait_s=2.0, delay_s=4.0),
     person("p", crosswalk=":b_c0", wait_s=8.0, let_go=False, cleared_s=None, delay_s=None),
     person("q", start_s=None, wait_s=5.0, delay_s=5.0, let_go=None)],
    queues=(2.0, 7.0), teleports=2,
)  # fmt: skip
REFERENCE = arm(
    [
        passage("a", delay_s=1.0),
        passage("b", delay_s=3.0, crosswalk=":b_c0"),
        passage("d", automated=False, driven=False, driver="sumo", steps=0, delay_s=9.0),
    ],
    [trip("a"), trip("d", automated=False)],
    [person("p", wait_s=1.0)],
    queues=(3.0, 4.0),
)


@pytest.fixture(scope="module")
def counted() -> CellFindings:
    """Two pairs, and one in which an arm failed."""
    return findings_of((AV, REFERENCE), (AV, REFERENCE), (AV, failed()))


NUMBERS = {
    "av_delay_s": (4 + 6 + 2) / 3, "av_delay_s_human": 2.0, "av_delay_s_difference": 2.0,
    "other_delay_s": 1.0, "other_delay_s_human": 9.0, "other_delay_s_difference": -8.0,
    "people_wait_s": 5.0, "people_wait_s_difference": 4.0, "people_los": 5.0,
    "queue_p95": 7.0, "queue_p95_human": 4.0, "queue_p95_difference": 3.0,
    "conflicts_pet": 2 / 4, "conflicts_pet_human": 0.0, "av_conflicts_pet": 1 / 3,
    "contacts": 1 / 4, "contacts_difference": 1 / 4, "av_contacts": 0 / 3, "other_contacts": 1 / 1,
    "share_strategy": 150 / 200, "share_leader": 50 / 200, "driven": 2 / 3, "not_driven": 2,
    "let_go": 1 / 2, "throughput_per_hour": 4 * 6, "people": 2 * 2,
    "av_time_loss_s": 8.0, "other_time_loss_s_difference": -3.0,
    "passages": 2 * 5, "cut_off": 2 * 1, "unfinished": 2 * 1, "never_went": 2 * 1,
    "still_crossing": 2 * 1, "people_delay_s": (4 + 5) / 2, "fallbacks": 2 * 1, "fallback_share": 0,
    "teleports": 2 * 2, "teleports_human": 0, "pairs": 3, "failed": 0, "failed_human": 1,
    "failed_strategy": 0, "failed_strategy_human": 1,
}  # fmt: skip


@pytest.mark.parametrize("key", NUMBERS)
def test_numbers_by_hand(counted: CellFindings, key: str) -> None:
    assert counted[key].value == pytest.approx(NUMBERS[key])


def test_numbers_of_a_crosswalk_by_hand(counted: CellFindings) -> None:
    near, far = counted.by_crosswalk[":a_c0"], counted.by_crosswalk[":b_c0"]
    assert (near["av_delay_s"].value, far["av_delay_s"].value) == (3.0, 6.0)
    assert (near["people_wait_s"].value, far["people_wait_s"].value) == (3.5, 8.0)
    assert (near["people"].value, far["people"].value) == (4, 2)
    assert (near["queue_p95_difference"].value, far["queue_p95"].value) == (-1.0, 7.0)
    assert near["contacts"].events == 2
    whole = {key for entry in entries_of("simulations") if entry.network for key in entry.keys}
    assert near.keys() == counted.findings.keys() - whole
    (text,) = [note.text for note in notes_of([counted]) if note.key == "who_drove"]
    assert "Left to SUMO: 2 of 6 passages: 2 it came late" in text


def test_the_first_screen_does_not_repeat_a_row() -> None:
    alike = arm([passage("a")], [trip("a")], [person("p")])
    both = {"people_delay_s", "av_contacts"}
    assert both <= {entry.key for entry in on_first_screen(findings_of(*USUAL))}
    assert not both & {entry.key for entry in on_first_screen(findings_of(*[(alike, alike)] * 6))}


def several(*more: dict[str, Any]) -> Pairs:
    """Six ordinary pairs, with changes to the AV's and the reference's arm."""
    pairs = [(ordinary(pair), ordinary(pair, False)) for pair in range(6)]
    for both in pairs:
        for of, changes in zip(both, more, strict=False):
            of["arms"] = [dict(of["arms"][0]) | changes]
    return pairs


def altered(pairs: Pairs, **columns: Any) -> Pairs:
    """The same, with other values in all passages of the AV's arms."""
    return [
        (av | {"passages": [{**each, **columns} for each in av["passages"]]}, human)
        for av, human in pairs
    ]


def filling(pairs: Pairs) -> Pairs:
    """The same, in the AV's arms of which each third trip does not end."""
    for av, _ in pairs:
        ends = enumerate(av["vehicles"])
        av["vehicles"] = [each if n % 3 else {**each, "arrival_s": None} for n, each in ends]
    return pairs


USUAL = altered(several(), share_strategy=1.0)
DRIVEN = sum(each["driven"] for av, _ in USUAL for each in av["passages"])

SAID: dict[str, tuple[Pairs, str]] = {
    "failures": (
        [*USUAL, (ordinary(7), failed())],
        "1 of 14 simulations failed (AV 0, human_yield 1; by the strategy 1)",
    ),
    "nothing_tested": ([(arm([passage("a", pedestrians=0)], [trip("a")]), arm())] * 2, "met a ped"),
    "few_pairs": (USUAL[:1], "a number rests on one pair"),
    "few_pairs (events)": ([*altered(USUAL[:4], contact_person="p"), *USUAL[4:]], "pairs decide"),
    "collisions": (
        several({"vehicle_collisions": 2, "overlaps": 1}, {"overlaps": 4}),
        "vehicle collisions (AV 12, human_yield 0)",
    ),
    "fills": (
        filling(altered(several(), share_strategy=1.0)),
        "% of those due in a third of the time (AV)",
    ),
    "fills (teleports)": (
        altered(several({"teleports": 1}, {"teleports": 1}), share_strategy=1.0),
        "A jam: SUMO teleported vehicles (AV 6, human_yield 6).",
    ),
    "fills (a jam)": (
        [*USUAL[1:], (arm([passage("a")], [trip("a", arrival_s=None)]), ordinary(0, False))],
        "whether roads fill (AV 1, human_yield 0).",
    ),
    "who_drove": (several(), "SUMO decided 30 % of soft_yield's steps."),
    "sumo_alone": (altered(USUAL, sumo_contact=True), "720 contacts (AV 720, human_yield 0)"),
    "people_of_sumo": (several({"sumo_people": 3}), "until the car stands"),
    "nothing_tested (all)": ([(USUAL[0][0], failed()), (failed(), USUAL[0][1])], "every pair f"),
    "fallback": (altered(USUAL, fallback=True), f"{DRIVEN} of {DRIVEN} AV passages (100 %"),
    "fallback (alone)": (altered(USUAL, fallback=True, pedestrians=0), f"in {DRIVEN} of {DRIVEN}"),
    "left_out": ([(arm([passage("b", rear_s=None)]), arm())] * 6, "did not end (AV 6, human_yi"),
    "left_out (waits)": ([(arm([], [], [person("p", start_s=None)]), arm())] * 6, "the end (AV 6,"),
    "left_out (brief)": (several(*[{"people_left_out": 2}] * 2), "(AV 12, human_yield 12)."),
    "outside_model": (several({"conditionings": 8, "clamped": 2}), "in 25 % (AV) of its uses"),
}


@pytest.mark.parametrize("key", SAID)
def test_what_misleads_is_said_and_what_does_not_is_not(key: str) -> None:
    pairs, words = SAID[key]
    told = {note.key: note.text for note in notes_of([findings_of(*pairs)])}
    key = key.partition(" ")[0]
    assert words in told[key], told[key]
    assert key not in {note.key for note in notes_of([findings_of(*USUAL)])}


def test_a_mean_delay_below_0_has_its_whole_interval() -> None:
    pairs = [(arm([], [], [person("p", delay_s=-early)]), arm()) for early in (1.0, 2.0, 3.0)]
    found, ends = findings_of(*pairs)["people_delay_s"], stats.t.interval(0.95, 2, -2.0, 3**-0.5)
    assert (found.low, found.value, found.high) == pytest.approx((ends[0], -2.0, ends[1]))


def written(folder: Path, *shares: float, pairs: int = 6, of: Pairs | None = None) -> Run:
    """A run in a folder; of ordinary pairs a greater share is slower by as many seconds."""
    changes = {"experiment.pairs": pairs, "arms.av": "gap_yield"}
    file = read_scenario_file("traffic", [Setting(key, of) for key, of in changes.items()])
    flow = "pedestrians.flow_per_hour", [250.0]
    study = study_of(file, [("traffic.av_share", [*shares]), flow])
    folder.mkdir()
    manifest = manifest_of(study, [], traces=False, engine="sumo", pairs_per_part=1)
    write_manifest(folder, manifest)
    for cell in study.cells:
        for pair in range(pairs):
            slower_s = shares[cell.number] * (pair + 1)
            both = of[pair] if of else (ordinary(pair, slower_s=slower_s), ordinary(pair, False))
            tables = tables_of([both], cell.number, pair)
            write_part(folder, cell.number, pair, tables, str(manifest["digest"]))
    return load_run(folder)


@pytest.mark.parametrize(
    ("arm_of", "driver", "vehicles"),
    [
        ("av", None, ["e", "d", "c", "a"]),
        ("av", "av", ["c", "a"]),
        ("av", "reference", ["d"]),
        ("av", "sumo", ["e"]),
        ("human", "reference", ["a"]),
    ],
)
def test_the_worst_passages_are_those_of_a_driver_that_ended(
    tmp_path: Path, arm_of: Arm, driver: WhoDrove | None, vehicles: list[str]
) -> None:
    passages = [
        passage("a", delay_s=1.0),
        passage("b", delay_s=90.0, ended=ENDED, rear_s=None),
        passage("c", delay_s=2.0, share_strategy=0.25),
        passage("d", delay_s=3.0, automated=False, driver="human_yield"),
        passage("e", delay_s=4.0, driven=False, driver="sumo"),
    ]
    pair = arm(passages, [trip("a")]), arm(passages[:1], [trip("a")])
    run = written(tmp_path / "run", 1.0, pairs=1, of=[pair])
    write_findings(run.path, run.manifest, run.cells)
    found = worst(load_run(run.path), "delay_s", arm=arm_of, driver=driver)
    assert [record["vehicle"] for record in found.records] == vehicles
    assert found.closing == (f"harness replay {run.path} --pair 0 --arm {arm_of} --gui",)


def test_cells_are_compared_by_their_avs_over_pairs(tmp_path: Path) -> None:
    run = written(tmp_path / "run", 0.25, 0.5, 1.0)
    write_findings(run.path, run.manifest, run.cells)
    result = compare(load_run(run.path))
    assert len(result.records) == 3
    first, means = result.records[0], run.table("passages")
    means = means[(means["arm"] == "av") & means["automated"]]
    a, b = (means[means["cell"] == cell].groupby("pair")["delay_s"].mean() for cell in (0, 1))
    test = stats.ttest_rel(a, b)
    found = first["av_delay_s_a_minus_b"]
    assert isinstance(found, Finding)
    ends = test.confidence_interval()
    assert (found.low, found.high, found.p) == pytest.approx((ends.low, ends.high, test.pvalue))
    rows: Any = result.records
    ps = sorted(record["av_delay_s_a_minus_b"].p for record in rows)
    adjusted = sorted(record["av_delay_s_a_minus_b_p_holm"] for record in rows)
    assert adjusted[0] == pytest.approx(3 * ps[0])
    told = json.loads(printed("compare", run.path, "--set", "conflicts.pet_s=8", "--json"))
    assert told["records"][0]["conflicts_pet_a"]["value"] == 1.0  # every PET is below 8 s
    assert "In 3 of 3 rows A and B have different shares of AVs" in result.notes[0].text


def test_a_page_has_the_figures_of_simulations(tmp_path: Path) -> None:
    one, many = written(tmp_path / "one", 1.0), written(tmp_path / "many", 0.25, 0.5, 1.0)
    drawn = {}
    for run in (one, many):
        page = write_report(run.path, figures=tmp_path / f"{run.path.name}-figures")
        drawn[run.path.name] = {path.stem for path in page.figures}
        text = page.page.read_text(encoding="utf-8")
        assert text.count("<svg") >= len(drawn[run.path.name])
        assert ":a_c0" in text
    assert drawn == {"one": {"map", "crosswalks"}, "many": {"curves"}}
