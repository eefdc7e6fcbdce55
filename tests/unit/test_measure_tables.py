"""Statistics of measures and conflict rates, from episodes counted by hand."""

from typing import Any

import pyarrow as pa
import pytest
from scipy import stats

from harness.measures import MEASURES
from harness.old.statistics import CONFLICTS
from harness.old.store.measure_tables import conflict_rows, measure_rows
from harness.old.store.schemas import EPISODES
from harness.old.store.summaries import summarise_cell
from harness.scenario import Cell, ConflictsSection, Scenario

# ending, min_ttc_s, pet_s, max_drac_mps2, avoidable
AV = [
    ("crossed", 1.49, 0.0, 3.36, None),
    ("crossed", 1.5, 1.5, 3.35, None),
    ("crossed", 8.0, 4.0, 0.5, None),
    ("crossed", None, 6.0, None, None),
    ("crashed", 0.05, None, None, True),
    ("crashed", None, None, None, False),
    ("timed_out", 2.0, None, 1.0, None),
    ("engine_failed", 0.1, 0.1, 9.0, None),
]
HUMAN = [("crossed", None, None, None, None)] * len(AV)


def table(av: list[tuple[object, ...]], human: list[tuple[object, ...]]) -> pa.Table:
    """Two rows for each pair; what is not named is null."""
    names = ("ending", "min_ttc_s", "pet_s", "max_drac_mps2", "avoidable")
    rows = []
    for pair, arms in enumerate(zip(av, human, strict=True)):
        for arm, values in zip(("av", "human"), arms, strict=True):
            row = {"cell": 0, "pair": pair, "arm": arm}
            rows.append(row | dict(zip(names, values, strict=True)))
    return pa.Table.from_pylist(rows, schema=EPISODES)


def row_of(arm: str, measure: str) -> dict[str, object]:
    rows = measure_rows(table(AV, HUMAN))
    (found,) = [row for row in rows if (row["arm"], row["measure"]) == (arm, measure)]
    return found


def test_every_measure_has_a_row_for_each_arm_and_every_threshold_a_measure() -> None:
    named = [(row["arm"], row["measure"]) for row in measure_rows(table(AV, HUMAN))]
    assert named == [(arm, measure.column) for arm in ("av", "human") for measure in MEASURES]
    assert {entry.threshold for entry in CONFLICTS} == set(ConflictsSection.model_fields)
    assert {entry.column for entry in CONFLICTS} <= {measure.column for measure in MEASURES}
    expected = ConflictsSection(ttc_s=1.5, time_advantage_s=1.5, pet_s=1.5, drac_mps2=3.35)
    assert Scenario().conflicts == expected


def test_statistics_by_hand() -> None:
    # 0.05, 1.49, 1.5, 2.0, 8.0; the failed episode's 0.1 does not count.
    ttc = row_of("av", "min_ttc_s")
    assert (ttc["defined"], ttc["p50"]) == (5, 1.5)
    assert ttc["mean"] == pytest.approx((0.05 + 1.49 + 1.5 + 2.0 + 8.0) / 5)
    # A fifth of the way from the first to the second; four fifths from the fourth to the fifth.
    assert ttc["p05"] == pytest.approx(0.05 + 0.2 * 1.44)
    assert ttc["p95"] == pytest.approx(2.0 + 0.8 * 6.0)
    # Truth counts as 1: the share of the crashes.
    assert (row_of("av", "avoidable")["defined"], row_of("av", "avoidable")["mean"]) == (2, 0.5)
    row = row_of("human", "min_ttc_s")
    assert row["defined"] == 0
    assert [row[name] for name in ("mean", "p05", "p50", "p95")] == [None] * 4


def rates_of(
    episodes: pa.Table, thresholds: ConflictsSection, confidence: float = 0.95
) -> list[dict[str, Any]]:
    """The rates of a cell with these thresholds."""
    scenario = Scenario(conflicts=thresholds)
    summary = summarise_cell(episodes, Cell(0, {}, scenario), confidence)
    return conflict_rows(summary.findings, thresholds)


def counted(thresholds: ConflictsSection) -> dict[tuple[str, str], tuple[int, int]]:
    rates = rates_of(table(AV, HUMAN), thresholds)
    return {(row["arm"], row["conflict"]): (row["conflicts"], row["episodes"]) for row in rates}


def test_conflicts_by_hand_at_the_thresholds_of_the_scenario() -> None:
    # Of seven that ran: 1.49 s and both crashes; a threshold itself is no conflict.
    found = counted(ConflictsSection())
    assert found["av", "ttc"] == (3, 7)
    assert found["av", "pet"] == (3, 7)
    assert found["av", "drac"] == (3, 7)
    # No time advantage is known of any of them: the crashes alone.
    assert found["av", "time_advantage"] == (2, 7)
    assert {found["human", conflict.name] for conflict in CONFLICTS} == {(0, 8)}
    found = counted(ConflictsSection(ttc_s=2.1, pet_s=0.0, drac_mps2=0.4))
    assert found["av", "ttc"] == (5, 7)
    assert found["av", "pet"] == (2, 7)
    assert found["av", "drac"] == (6, 7)


def test_those_who_met_somebody_are_told_apart() -> None:
    """Pairs 0, 1 and 4 met somebody: pair 1 in the human's arm alone; nobody else counts."""
    episodes = table(AV, HUMAN)
    met = [
        1 if key in {(0, "av"), (1, "human"), (4, "av")} else 0
        for key in zip(episodes["pair"].to_pylist(), episodes["arm"].to_pylist(), strict=True)
    ]
    place = episodes.schema.get_field_index("pedestrians")
    episodes = episodes.set_column(
        place, EPISODES.field(place), pa.array(met, EPISODES.field(place).type)
    )
    found = measure_rows(episodes)
    (ttc,) = [row for row in found if (row["arm"], row["measure"]) == ("av", "min_ttc_s")]
    # 1.49, 1.5 and 0.05 of five.
    assert (ttc["defined"], ttc["defined_met_someone"], ttc["p50_met_someone"]) == (5, 3, 1.49)
    assert ttc["mean_met_someone"] == pytest.approx((1.49 + 1.5 + 0.05) / 3)
    rows = rates_of(episodes, ConflictsSection())
    (row,) = [row for row in rows if (row["arm"], row["conflict"]) == ("av", "ttc")]
    assert (row["conflicts_met_someone"], row["episodes_met_someone"]) == (2, 3)
    assert row["rate_met_someone_ci_low"] == pytest.approx(stats.beta.ppf(0.025, 2, 2))
    assert (row["conflicts"], row["episodes"]) == (3, 7)


def test_interval_of_a_rate_and_of_none() -> None:
    rates = rates_of(table(AV, HUMAN), ConflictsSection(), 0.9)
    row = rates[0]
    assert (row["arm"], row["conflict"], row["threshold"]) == ("av", "ttc", 1.5)
    assert (row["episodes"], row["conflicts"], row["rate"]) == (7, 3, 3 / 7)
    assert row["ci_low"] == pytest.approx(stats.beta.ppf(0.05, 3, 5))
    assert row["ci_high"] == pytest.approx(stats.beta.ppf(0.95, 4, 4))
    failed = [("engine_failed", None, None, None, None)]
    rates = rates_of(table(failed, failed), ConflictsSection())
    assert {(row["rate"], row["ci_low"], row["episodes"]) for row in rates} == {(None, None, 0)}
