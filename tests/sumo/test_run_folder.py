"""The run folder as a user gets it, SUMO behind it."""

import csv
import json
import math
import shutil
from itertools import pairwise
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from harness.engine.network import place_of
from harness.engine.sumo import libsumo_engine
from harness.episode.pairing import PairRunner
from harness.old.store.episode_tables import episode_rows, pedestrian_rows, trace_rows
from harness.scenario import validate
from tests.batches import content, here, printed

FLOW = [
    "--set=pedestrians.flow_per_hour=700",
    "--set=pedestrians.max_count=4",
    "--set=pedestrians.first_at_trigger=false",
    "--set=arms.av=constant_speed",
]
TEXT, REAL, WHOLE, TRUTH = pa.string(), pa.float64(), "integer", pa.bool_()
KEYS = {"cell": WHOLE, "pair": WHOLE, "arm": TEXT}
# The columns of docs/files.md, with what a reader takes them for.
COLUMNS = {
    "episodes": KEYS
    | {"strategy": TEXT, "ending": TEXT, "reason": TEXT, "pass_time_s": REAL, "contact": TEXT}
    | {"contact_index": WHOLE, "contact_time_s": REAL, "contact_speed_mps": REAL}
    | {"sumo_collision": TRUTH, "fallback": TRUTH, "steps": WHOLE, "pedestrians": WHOLE}
    | {"min_gap_m": REAL, "min_ttc_s": REAL, "min_time_advantage_s": REAL, "pet_s": REAL}
    | {"max_deceleration_mps2": REAL, "stopped_s": REAL, "delay_s": REAL},
    "pedestrians": KEYS
    | {"index": WHOLE, "arrival_s": REAL, "start_s": REAL, "side": TEXT, "quantile": REAL}
    | {"speed_mps": REAL, "range_m": REAL, "vehicle_speed_mps": REAL, "cleared_s": REAL},
    "pairs": {"cell": WHOLE, "pair": WHOLE, "av_time_s": REAL, "human_time_s": REAL, "tau": REAL},
    "traces": KEYS
    | {"time_s": REAL, "object": TEXT, "x_m": REAL, "y_m": REAL, "speed_mps": REAL}
    | {"acceleration_mps2": REAL},
}
SUMMARY = [
    *("pairs", "defined_pairs", "timed_out", "failed", "fallbacks", "met_nobody"),
    *("mu", "mu_ci_low", "mu_ci_high", "cv", "cv_ci_low", "cv_ci_high"),
    *("kappa", "kappa_ci_low", "kappa_ci_high"),
    *("kappa_front", "kappa_front_ci_low", "kappa_front_ci_high"),
    *("kappa_human", "kappa_human_ci_low", "kappa_human_ci_high"),
]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs: the paper's twice into runs/, and one of a flow with crashes and time-outs."""
    folder = tmp_path_factory.mktemp("user")
    for options in (["--quiet"], ["--quiet"], [*FLOW, "--out", "flow"]):
        printed("run", "cctc", "--pairs", 12, "--traces", *options, cwd=folder)
    return folder


def rows(folder: Path, table: str) -> list[dict[str, object]]:
    found: list[dict[str, object]] = pq.read_table(folder / f"{table}.parquet").to_pylist()
    return found


def test_default_folders_are_numbered_and_the_same_seed_gives_the_same_bytes(runs: Path) -> None:
    """Nothing half-written is left."""
    first, second = folders = sorted((runs / "runs").iterdir())
    assert [folder.name for folder in folders] == ["cctc-1", "cctc-2"]
    assert content(first) == content(second)
    for folder in (*folders, runs / "flow"):
        assert {path.name for path in folder.iterdir()} == {
            *("manifest.json", "log.jsonl", "summary.csv", "cells.parquet", "episodes.parquet"),
            *("pedestrians.parquet", "pairs.parquet", "traces.parquet", "summary.parquet"),
            *("measures.csv", "conflicts.csv"),
        }


@pytest.mark.parametrize("table", COLUMNS)
def test_columns(runs: Path, table: str) -> None:
    schema = pq.read_schema(runs / "flow" / f"{table}.parquet")
    # In this order; a table may hold more than the contract asks for.
    assert [name for name in schema.names if name in COLUMNS[table]] == list(COLUMNS[table])
    for name, kind in COLUMNS[table].items():
        found = schema.field(name).type
        assert pa.types.is_integer(found) if kind == WHOLE else found == kind, name


def test_undefined_is_null(runs: Path) -> None:
    folder = runs / "flow"
    for table in COLUMNS:
        for row in rows(folder, table):
            for name, value in row.items():
                assert not (isinstance(value, float) and not math.isfinite(value)), (table, name)
    for row in rows(folder, "episodes"):
        crossed, hit = row["ending"] == "crossed", row["ending"] == "crashed"
        assert (row["pass_time_s"] is not None) is crossed
        assert (row["delay_s"] is not None) is crossed
        for name in ("contact", "contact_index", "contact_time_s", "contact_speed_mps"):
            assert (row[name] is not None) is hit
        assert (row["reason"] is not None) is (row["ending"] == "engine_failed")
        nobody = row["pedestrians"] == 0
        assert (row["min_gap_m"] is None) is nobody
        for name in ("min_ttc_s", "min_time_advantage_s", "pet_s"):
            assert row[name] is None or (row[name] >= 0 and not nobody)
    assert {"crossed", "crashed"} <= {row["ending"] for row in rows(folder, "episodes")}
    for row in rows(folder, "pedestrians"):
        went = row["start_s"] is not None
        for name in ("speed_mps", "range_m", "vehicle_speed_mps"):
            assert (row[name] is not None) is went
        assert row["cleared_s"] is None or went
        if row["cleared_s"] is not None:
            walk = row["start_s"] + 9.0 / row["speed_mps"]
            assert row["cleared_s"] == pytest.approx(walk, abs=1e-9)


def test_pairs_and_summary_follow_from_the_episodes(runs: Path) -> None:
    for folder in (runs / "flow", runs / "runs" / "cctc-1"):
        episodes, pairs = rows(folder, "episodes"), rows(folder, "pairs")
        assert rows(folder, "cells") == [{"cell": 0}]
        keys = [(row["cell"], row["pair"], row["arm"]) for row in episodes]
        assert keys == [(0, pair, arm) for pair in range(12) for arm in ("av", "human")]
        assert [row["pair"] for row in pairs] == list(range(12))
        times = {(row["pair"], row["arm"]): row["pass_time_s"] for row in episodes}
        for row in pairs:
            own, human = times[row["pair"], "av"], times[row["pair"], "human"]
            assert (row["av_time_s"], row["human_time_s"]) == (own, human)
            assert row["tau"] == (None if own is None or human is None else own / human)
        (row,) = csv_rows(folder, "summary")
        assert {*SUMMARY} <= {*row}
        av = [episode for episode in episodes if episode["arm"] == "av"]
        tau = [pair["tau"] for pair in pairs if pair["tau"] is not None]
        assert int(row["pairs"]) == len(av)
        assert int(row["defined_pairs"]) == len(tau)
        assert int(row["fallbacks"]) == sum(episode["fallback"] for episode in av)
        crashed = sum(episode["ending"] == "crashed" for episode in av)
        assert float(row["kappa"]) == pytest.approx(crashed / len(av))
        if tau:
            mean = sum(tau) / len(tau)
            assert float(row["mu"]) == pytest.approx(mean)
            assert float(row["mu_ci_low"]) <= mean <= float(row["mu_ci_high"])
            spread = math.sqrt(sum((t - mean) ** 2 for t in tau) / len(tau))
            assert float(row["cv"]) == pytest.approx(spread / mean)
        else:
            assert (row["mu"], row["mu_ci_low"], row["cv"]) == ("", "", "")


def test_manifest_and_log(runs: Path) -> None:
    manifest = json.loads((runs / "flow" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["seed"] == 1
    assert manifest["scenario"]["pedestrians"]["flow_per_hour"] == 700
    assert manifest["scenario"]["experiment"]["pairs"] == 12
    assert manifest["scenario"]["ego"]["length_m"] == 5.0  # defaults are filled in
    needed = {"harness", "sumo", "python", "numpy", "scipy", "pandas", "pyarrow"}
    made_with = manifest["simulated_with"]
    assert needed <= set(made_with["versions"])
    assert made_with["versions"]["sumo"] == "1.28.0"
    (model,) = made_with["models"]
    assert len(model["sha256"]) == 64
    counts = manifest["counts"]
    endings = ("crossed", "crashed", "timed_out", "engine_failed")
    assert sum(counts[ending] for ending in endings) == counts["episodes"] == 24
    lines = (runs / "flow" / "log.jsonl").read_text(encoding="utf-8").splitlines()
    assert lines
    assert all({"time", "event"} <= set(json.loads(line)) for line in lines)


def test_traces_show_the_walks_and_the_drive(runs: Path) -> None:
    folder = runs / "flow"
    walks = {(r["pair"], r["arm"], r["index"]): r for r in rows(folder, "pedestrians")}
    episodes = {(r["pair"], r["arm"]): r for r in rows(folder, "episodes")}
    steps: dict[tuple[object, object], list[dict[str, object]]] = {}
    walked = 0
    for row in rows(folder, "traces"):
        key = row["pair"], row["arm"]
        if row["object"] == "ego":
            steps.setdefault(key, []).append(row)
            assert row["y_m"] == 2.25
            continue
        walk = walks[*key, int(row["object"].removeprefix("pedestrian-"))]
        progress = walk["speed_mps"] * (row["time_s"] - walk["start_s"])
        expected = progress if walk["side"] == "near" else 9 - progress
        assert (row["x_m"], row["speed_mps"]) == (0.0, walk["speed_mps"])
        assert row["y_m"] == pytest.approx(expected, abs=1e-9)
        assert -1e-9 <= row["y_m"] <= 9 + 1e-9
        walked += 1
    assert walked > 200
    assert set(steps) == set(episodes)
    for key, drive in steps.items():
        assert len(drive) == episodes[key]["steps"] + 1
        assert (drive[0]["time_s"], drive[0]["x_m"], drive[0]["speed_mps"]) == (0.0, -30.0, 5.0)
        assert drive[-1]["acceleration_mps2"] is None
        for now, then in pairwise(drive):
            # Constant acceleration over the step.
            middle = (now["speed_mps"] + then["speed_mps"]) / 2 * 0.1
            assert then["x_m"] - now["x_m"] == pytest.approx(middle, abs=1e-6)
            gain = (then["speed_mps"] - now["speed_mps"]) / 0.1
            assert now["acceleration_mps2"] == pytest.approx(gain, abs=1e-9)


def test_export_to_csv(runs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(runs / "flow", folder)
    result = here("export", folder, "--csv", cwd=tmp_path)
    printed = {Path(line).name for line in result.stdout.splitlines()}
    assert printed == {f"{name}.csv" for name in (*COLUMNS, "cells")}
    for name, columns in COLUMNS.items():
        written = csv_rows(folder, name)
        assert list(written[0]) == pq.read_schema(folder / f"{name}.parquet").names
        for text, row in zip(written, rows(folder, name), strict=True):
            for column, value in row.items():
                if value is None:
                    assert text[column] == ""
                elif isinstance(value, float):
                    assert float(text[column]) == value  # every digit is kept
                elif columns.get(column) == WHOLE:
                    assert float(text[column]) == value


@pytest.mark.usefixtures("no_simulation")
def test_sumos_own_seed_decides_nothing(model) -> None:
    people = {"flow_per_hour": 700.0, "kerb_wait_s": 0.0}
    scenario = validate({"pedestrians": people, "arms": {"av": "constant_speed"}}, "test")

    def simulated(sumo_seed: int) -> list[object]:
        car, crosswalk = scenario.vehicle(), scenario.crosswalk()
        engine = libsumo_engine(place_of(scenario), car, crosswalk, 0.1, sumo_seed)
        try:
            outcomes = list(PairRunner(scenario, model, lambda: engine).run(range(12)))
        finally:
            engine.close()
        tables = (episode_rows, pedestrian_rows, trace_rows)
        return [repr(make(0, outcomes).to_pydict()) for make in tables]

    assert simulated(1) == simulated(987_654)


def csv_rows(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_measures_and_conflicts_follow_from_the_episodes(runs: Path) -> None:
    folder = runs / "flow"
    episodes = [row for row in rows(folder, "episodes") if row["ending"] != "engine_failed"]
    for row in csv_rows(folder, "measures"):
        own = [e[row["measure"]] for e in episodes if e["arm"] == row["arm"]]
        values = [float(value) for value in own if value is not None]
        assert int(row["defined"]) == len(values)
        if values:
            assert float(row["mean"]) == pytest.approx(sum(values) / len(values), abs=1e-12)
            assert min(values) <= float(row["p05"]) <= float(row["p50"]) <= float(row["p95"])
    for row in csv_rows(folder, "conflicts"):
        if row["conflict"] == "ttc":
            own = [e for e in episodes if e["arm"] == row["arm"]]
            near = [e["min_ttc_s"] is not None and e["min_ttc_s"] < 1.5 for e in own]
            found = [e["contact"] is not None or close for e, close in zip(own, near, strict=True)]
            assert (int(row["conflicts"]), int(row["episodes"])) == (sum(found), len(own))
    (summary,) = csv_rows(folder, "summary")
    avoidable = [bool(e["avoidable"]) for e in episodes if e["arm"] == "av"]
    assert float(summary["kappa_avoidable"]) == pytest.approx(sum(avoidable) / len(avoidable))
