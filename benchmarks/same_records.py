"""Whether a change left the records as they were: ``python -m benchmarks.same_records FOLDER``.

The first time it runs the scenarios below into the folder; every further time it runs them again
and compares all tables: words and counts equal, numbers within 1e-6.  So it is run once before a
change and once after it.
"""

import argparse
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

TOLERANCE = 1e-6

FLOW = ["pedestrians.flow_per_hour=1000"]
WIDE = ["crossing.length_m=13", "crossing.lanes=2"]
RUNS: dict[str, tuple[str, int, list[str], str]] = {
    "paper": ("cctc", 100, [], ""),
    "control": ("cctc", 100, ["arms.av=constant_speed", "arms.human=emergency_brake"], ""),
    "faster": ("cctc", 100, ["ego.initial_speed_mps=7.5", "experiment.step_s=0.05"], ""),
    "flow": ("cctc_flow", 100, FLOW, "arms.av=soft_yield,hard_yield,gap_yield,sumo_driver"),
    "nobody waits": ("cctc_flow", 100, [*FLOW, "pedestrians.kerb_wait_s=0"], ""),
    "gaps": ("cctc_flow", 100, [*FLOW, "pedestrians.behaviour=gap_acceptance"], ""),
    "reactive": ("cctc_flow", 100, [*FLOW, "pedestrians.behaviour=reactive"], ""),
    "SUMO's people": ("cctc_flow", 100, [*FLOW, "pedestrians.behaviour=sumo"], ""),
    "busy": ("cctc_flow", 100, [*FLOW, "pedestrians.warm_up_s=60"], ""),
    "two lanes": ("cctc_flow", 100, [*FLOW, *WIDE], "ego.lane=0,1"),
    "test track": ("euro_ncap_vru", 1, [], ""),
    "eyes": (
        "cctc_flow",
        100,
        [*FLOW, "perception.latency_s=0.3", "perception.detection_probability=0.2"],
        "arms.av=gap_yield,emergency_brake",
    ),
    "traffic": ("penetration", 1, ["traffic.duration_s=600"], ""),
}
"""By name: scenario, pairs of each cell, keys set, a key varied."""

RENAMED = {
    "untouched_pass_time_s": "pass_time_ignoring_contact_s",
    "late_s": "trace_offset_s",
}
"""Columns of the kept records that have another name now."""


def run(name: str, out: Path) -> None:
    """Run one of them on one worker."""
    scenario, pairs, settings, varied = RUNS[name]
    swept = scenario in ("euro_ncap_vru", "penetration")
    command = [sys.executable, "-m", "harness", "sweep" if swept else "run", scenario, "-q"]
    command += ["--workers", "1", "--traces", "--out", str(out), "--pairs", str(pairs)]
    for setting in settings:
        command += ["--set", setting]
    command += ["--vary", varied] if varied else []
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def differences(kept: Path, new: Path) -> Iterator[str]:
    """What is not the same in the tables of two run folders."""
    names = sorted(file.name for file in kept.glob("*.parquet"))
    if missing := {*names} - {file.name for file in new.glob("*.parquet")}:
        yield f"no {', '.join(sorted(missing))}"
        return
    for name in names:
        old, now = (pd.read_parquet(folder / name) for folder in (kept, new))
        old = old.rename(columns=RENAMED)
        # A new column that is empty in every row says nothing about these scenarios.
        added = [name for name in now.columns if name not in old.columns]
        now = now.drop(columns=[name for name in added if now[name].isna().all()])
        if list(old.columns) != list(now.columns) or len(old) != len(now):
            yield f"{name}: other columns or rows"
            continue
        for column in old.columns:
            pairs = zip(old[column], now[column], strict=True)
            different = sum(not same(a, b) for a, b in pairs)
            if different:
                yield f"{name}: {column} in {different} of {len(old)} rows"


def same(one: object, other: object) -> bool:
    """Whether two values are equal, floats within the tolerance."""
    if isinstance(one, float) and isinstance(other, float):
        both_missing = math.isnan(one) and math.isnan(other)
        return both_missing or one == other or abs(one - other) <= TOLERANCE
    if isinstance(one, np.ndarray | list) and isinstance(other, np.ndarray | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return list(one) == list(other) and all(map(same, one.values(), other.values()))
    return repr(one) == repr(other)


def main() -> None:
    """Run all; compare with what is kept, or keep them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the records are kept")
    parser.add_argument("--only", choices=RUNS, action="append")
    options = parser.parse_args()
    wrong = 0
    for name in options.only or RUNS:
        kept = options.folder / name.replace(" ", "-")
        if not kept.exists():
            run(name, kept)
            print(f"{name}: kept", flush=True)
            continue
        with tempfile.TemporaryDirectory() as folder:
            new = Path(folder) / "run"
            run(name, new)
            found = list(differences(kept, new))
        wrong += bool(found)
        print(f"{name}: {'; '.join(found) or 'the same'}", flush=True)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
