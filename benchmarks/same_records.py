"""Whether the rows of shipped scenarios are those of the reference revision.

``python -m benchmarks.same_records`` runs each scenario in a worktree of the reference revision and
in this checkout, and compares the tables below.  A row belongs to its cell's varied keys, its pair,
its arm and its pedestrian, not to a cell's number.  Texts are equal, numbers within 1e-9.  Columns
and cells that only one side has are listed.  Exit code 1: a value differs, or a row has no partner.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

CHECKOUT = Path(__file__).parents[1]
REFERENCE = "f9c771c"
TOLERANCE = 1e-9
SCENARIOS = ("cctc", "cctc_flow", "strategies", "euro_ncap_vru", "aggressiveness", "perception")
GONE = {"strategies": '"arms.av": "sumo_driver"'}
"""Cells of the reference, by a part of their keys, that this checkout may lack."""
KEYS = {"episodes": ["cell", "pair", "arm"], "pedestrians": ["cell", "pair", "arm", "index"]}


def run(checkout: Path, scenario: str, pairs: int, workers: int, out: Path) -> None:
    """Run a scenario of a checkout with its own package; one pair where pairs repeat each other."""
    command = [sys.executable, "-m", "harness", "run", f"scenarios/{scenario}.toml", "-q"]
    command += ["--pairs", str(1 if scenario == "euro_ncap_vru" else pairs)]
    command += ["--workers", str(workers), "--out", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    subprocess.run(command, check=True, cwd=checkout, env=environment, stdout=subprocess.DEVNULL)


def cell_words(cells: pd.DataFrame) -> dict[int, str]:
    """The varied keys of each cell as text, by the number of the cell."""
    rows: list[dict[str, Any]] = json.loads(cells.to_json(orient="records"))
    varied = {row.pop("cell"): row for row in rows}
    return {
        number: json.dumps({key: keys[key] for key in sorted(keys) if pd.notna(keys[key])})
        for number, keys in varied.items()
    }


def reference_rows(folder: Path, table: str) -> pd.DataFrame:
    """A table of a run folder of the reference, with the keys of the cells as ``cell``."""
    cells = cell_words(pd.read_parquet(folder / "cells.parquet"))
    rows = pd.read_parquet(folder / f"{table}.parquet")
    return rows.assign(cell=rows["cell"].map(cells))


def present_rows(folder: Path, table: str) -> pd.DataFrame:
    """The same of a run folder of this checkout, whose tables are folders of parts."""
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    varied = [{"cell": number, **keys} for number, keys in enumerate(manifest["cells"])]
    cells = cell_words(pd.DataFrame(varied))
    rows = pd.read_parquet(folder / table)
    return rows.assign(cell=rows["cell"].map(cells))


def same(one: object, other: object) -> bool:
    """Whether two values are equal, numbers within the tolerance; missing equals missing."""
    if isinstance(one, np.ndarray | list) and isinstance(other, np.ndarray | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, float | int) and isinstance(other, float | int):
        return bool(np.isclose(one, other, rtol=0, atol=TOLERANCE, equal_nan=True))
    return one == other or all(np.ravel(pd.isna([one, other])))


def different(old: pd.Series, new: pd.Series) -> int:
    """The number of rows in which two aligned columns differ."""
    if pd.api.types.is_float_dtype(old) and pd.api.types.is_float_dtype(new):
        return int((~np.isclose(old, new, rtol=0, atol=TOLERANCE, equal_nan=True)).sum())
    return sum(not same(*values) for values in zip(old, new, strict=True))


def differences(table: str, old: pd.DataFrame, new: pd.DataFrame, gone: str) -> Iterator[str]:
    """What is not the same in a table of both sides."""
    old = old[~old["cell"].str.contains(gone, regex=False)] if gone else old
    for side, one, other in (("the reference", old, new), ("this checkout", new, old)):
        for cell in sorted({*one["cell"]} - {*other["cell"]}):
            yield f"{table}: only {side} has the cell {cell}"
    old, new = (rows.set_index(KEYS[table]) for rows in (old, new))
    assert old.index.is_unique
    assert new.index.is_unique
    without = len(old.index.symmetric_difference(new.index))
    if without:
        yield f"{table}: {without} rows have no partner"
    both = old.index.intersection(new.index)
    old, new = old.loc[both], new.loc[both]
    for column in old.columns.intersection(new.columns):
        count = different(old[column], new[column])
        if count:
            yield f"{table}: {column} differs in {count} of {len(both)} rows"


def compared(scenario: str, old: Path, new: Path) -> int:
    """Print what two run folders of a scenario share, and return the number of differences."""
    wrong = 0
    for table in KEYS:
        before, now = reference_rows(old, table), present_rows(new, table)
        found = [*differences(table, before, now, GONE.get(scenario, ""))]
        wrong += len(found)
        columns = before.columns.intersection(now.columns)
        print(f"{scenario}: {table}: {len(now):,} rows, {len(columns)} columns on both sides")
        for side, alone in (("gone", before.columns), ("new", now.columns)):
            if names := [name for name in alone if name not in columns]:
                print(f"    {side}: {', '.join(names)}")
        print(*(f"    DIFFERENT {words}" for words in found), sep="\n", end="\n" if found else "")
    sys.stdout.flush()
    return wrong


def main() -> None:
    """Run and compare all scenarios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=300)
    parser.add_argument("--only", choices=SCENARIOS, action="append")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    wrong = 0
    git = ["git", "-C", str(CHECKOUT), "worktree"]
    with tempfile.TemporaryDirectory() as folder:
        reference = Path(folder) / "reference"
        subprocess.run([*git, "add", "-q", "--detach", str(reference), REFERENCE], check=True)
        try:
            for scenario in options.only or SCENARIOS:
                old, new = (Path(folder) / f"{scenario}-{side}" for side in ("old", "new"))
                run(reference, scenario, options.pairs, options.workers, old)
                run(CHECKOUT, scenario, options.pairs, options.workers, new)
                wrong += compared(scenario, old, new)
        finally:
            subprocess.run([*git, "remove", "--force", str(reference)], check=True)
    print("the same" if not wrong else f"{wrong} differences")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
