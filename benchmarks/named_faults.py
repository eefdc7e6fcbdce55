"""Whether the tests notice what must never go wrong: ``python -m benchmarks.named_faults``.

Each fault of named_faults.toml is put into a copy of the checkout, and its tests run there until
one fails.  A fault is noticed if a test fails on a number or an error of the harness, not on an
import, a name or a type.  Exit code 1: a fault is not noticed, or for the wrong reason.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from importlib.util import cache_from_source
from pathlib import Path
from queue import SimpleQueue
from typing import Any

CHECKOUT = Path(__file__).parents[1]
COPIED = ("harness", "tests", "benchmarks", "scenarios", "networks", "examples", "docs")
WRONG = re.compile(r"\b(Import|ModuleNotFound|Syntax|Indentation|Name|Attribute|Type)Error\b")
LIMIT_S = 300.0
NOTICED = "noticed"

Fault = dict[str, Any]


def faults() -> list[Fault]:
    """All faults: ``name``, ``file``, ``find``, ``replace`` and the list of ``tests``."""
    text = (CHECKOUT / "benchmarks/named_faults.toml").read_text("utf-8")
    found: list[Fault] = tomllib.loads(text)["fault"]
    return found


def copied(folder: Path) -> Path:
    """What tests need of the checkout, in another folder."""
    for name in COPIED:
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(CHECKOUT / name, folder / name, ignore=ignore)
    for path in CHECKOUT.iterdir():
        if path.is_file():
            shutil.copy2(path, folder)
    return folder


def first_failure(copy: Path, tests: list[str], limit_s: float = LIMIT_S) -> tuple[int, str]:
    """Pytest's exit code, and the line of the first failure."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-rfE", "--tb=no", "-m", "not slow"]
    environment = {**os.environ, "PYTHONPATH": str(copy), "CI": "1"}
    result = subprocess.run(
        [*command, *tests],
        cwd=copy,
        env=environment,
        timeout=limit_s,
        check=False,
        capture_output=True,
        text=True,
    )
    lines = [line for line in result.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return result.returncode, lines[0] if lines else result.stdout[-300:]


def verdict(copy: Path, fault: Fault) -> tuple[str, str]:
    """What becomes of a fault, and the line of the failure; the copy is as before afterwards."""
    module = copy / fault["file"]
    text = module.read_text("utf-8")
    # A compiled module is trusted by its size and the second of its change.
    compiled = Path(cache_from_source(str(module)))
    compiled.unlink(missing_ok=True)
    module.write_text(text.replace(fault["find"], fault["replace"]), "utf-8")
    try:
        code, line = first_failure(copy, fault["tests"])
    except subprocess.TimeoutExpired:
        return "NO ANSWER", ""
    finally:
        module.write_text(text, "utf-8")
        compiled.unlink(missing_ok=True)
    if code == 0:
        return "NOT NOTICED", ""
    wrong = code != 1 or WRONG.search(line.partition(" - ")[2][:60])
    return ("noticed for the WRONG REASON" if wrong else NOTICED), line


def main() -> None:
    """Try all faults, or those with a word in their name."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", metavar="WORD")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    chosen = [fault for fault in faults() if options.only in fault["name"]]
    counts, copies = Counter[str](), SimpleQueue[Path]()

    def tried(fault: Fault) -> tuple[Fault, str, str, float]:
        begin, copy = time.monotonic(), copies.get()
        try:
            return fault, *verdict(copy, fault), time.monotonic() - begin
        finally:
            copies.put(copy)

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.workers) as pool:
        for number in range(options.workers):
            copies.put(copied(Path(folder) / str(number)))
        tests = sorted({test for fault in chosen for test in fault["tests"]})
        code, line = first_failure(Path(folder) / "0", tests, 20 * LIMIT_S)
        if code:
            raise SystemExit(f"the tests do not pass as they are: {line}")
        for fault, result, line, took_s in pool.map(tried, chosen):
            counts[result] += 1
            print(f"{result} ({took_s:.0f} s): {fault['name']}\n    {line[:160]}", flush=True)
    print(", ".join(f"{number} {result}" for result, number in sorted(counts.items())))
    sys.exit(counts.keys() != {NOTICED})


if __name__ == "__main__":
    main()
