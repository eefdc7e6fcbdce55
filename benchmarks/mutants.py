"""Which faults the tests notice: ``python -m benchmarks.mutants ROOM --number 25 --seed 1``.

One small fault at a time is put into a copy of the checkout: a comparison, an operator, a number,
a condition or a returned value is changed.  Then the tests of the room run until one fails.  A
mutant that no test notices has *survived*: either it changes nothing that can be observed (then it
is *equivalent*, which a person has to judge), or a test is missing.  Without an answer in time it
may loop for ever, or the machine was busy.  Slow tests do not run here.
"""

import argparse
import ast
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import cache_from_source
from pathlib import Path
from typing import NamedTuple

import pytest

CHECKOUT = Path(__file__).parents[1]


LIBRARIES = [
    "hypothesis",
    "pandas",
    "pyarrow.parquet",
    "pydantic",
    "pytest",
    "scipy.stats",
    "typer",
]
"""Imported once for all mutants."""


class Room(NamedTuple):
    """Patterns of modules, and the tests that are to notice their faults, the quickest first."""

    modules: list[str]
    tests: list[str]


def rooms() -> dict[str, Room]:
    """By name; everything in them is relative to the checkout."""
    document = tomllib.loads((CHECKOUT / "benchmarks/data/mutants.toml").read_text("utf-8"))
    return {name: Room(**room) for name, room in document.items()}


COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
"""The other side of a boundary, and the negation."""

OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}


class Mutant(NamedTuple):
    """One fault: a piece of a module and what replaces it."""

    module: str
    line: int
    start: int
    end: int
    """Bytes of the module."""
    before: str
    after: str


def changed(node: ast.AST) -> Iterator[tuple[ast.expr, str]]:
    """Pieces of a node with what may replace them."""
    match node:
        case ast.Compare(left, [operator], [right]):
            for other in COMPARISONS[type(operator)]:
                yield node, ast.unparse(ast.Compare(left, [other()], [right]))
        case ast.BinOp(left, operator, right) if type(operator) in OPERATORS:
            yield node, ast.unparse(ast.BinOp(left, OPERATORS[type(operator)](), right))
        case ast.BoolOp(operator, values):
            joined = ast.Or() if isinstance(operator, ast.And) else ast.And()
            yield node, ast.unparse(ast.BoolOp(joined, values))
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield node, ast.unparse(operand)
        case ast.Constant(bool() as value):
            yield node, str(not value)
        case ast.Constant(int() | float() as value):
            yield node, repr(value + 1)
        case ast.If(test) | ast.IfExp(test) | ast.While(test):
            yield test, f"not ({ast.unparse(test)})"
        case ast.Return(ast.expr() as value) if not isinstance(value, ast.Constant):
            yield value, "None"


def executed(node: ast.AST) -> Iterator[ast.AST]:
    """A node and all below it, without annotations, decorators and texts with values in them."""
    yield node
    unread = {"annotation", "returns", "decorator_list", "type_params"}
    if isinstance(node, ast.JoinedStr):
        return
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if name not in unread and isinstance(child, ast.AST):
                yield from executed(child)


def mutants(module: Path, root: Path) -> Iterator[Mutant]:
    """Every mutant of a module, in the order of its text."""
    source = module.read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    name = module.relative_to(root).as_posix()
    for node in executed(ast.parse(source)):
        for piece, after in changed(node):
            start = starts[piece.lineno - 1] + piece.col_offset
            end = starts[(piece.end_lineno or piece.lineno) - 1] + (piece.end_col_offset or 0)
            before = source[start:end].decode()
            yield Mutant(name, piece.lineno, start, end, before, f"({after})")


def _run(copy: Path, tests: list[str]) -> None:
    """The tests in a process and a session of their own; its exit code is pytest's."""
    os.setsid()
    os.chdir(copy)
    os.environ["PYTHONPATH"] = str(copy)
    sys.path.insert(0, str(copy))
    for name in [name for name in sys.modules if name.partition(".")[0] == "benchmarks"]:
        del sys.modules[name]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    words = ("-x", "-q", "-n0", "-m", "not slow", "-p", "no:cacheprovider", "--tb=no")
    os._exit(pytest.main([*tests, *words]))


def tests_pass(copy: Path, tests: list[str], limit_s: float) -> bool | None:
    """Whether the tests pass in the copy; None if they take too long."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LIBRARIES)
    process = context.Process(target=_run, args=(copy, tests))
    process.start()
    process.join(limit_s)
    passed = None if process.is_alive() else process.exitcode == 0
    with suppress(ProcessLookupError):
        os.killpg(process.pid or 0, signal.SIGKILL)
    process.join()
    return passed


def verdict(copy: Path, mutant: Mutant, tests: list[str], limit_s: float) -> str:
    """What becomes of a mutant; the module is as before afterwards."""
    module = copy / mutant.module
    source = module.read_bytes()
    module.write_bytes(source[: mutant.start] + mutant.after.encode() + source[mutant.end :])
    # A compiled module is trusted by its size and the second of its change.
    compiled = Path(cache_from_source(str(module)))
    compiled.unlink(missing_ok=True)
    try:
        passed = tests_pass(copy, tests, limit_s)
    finally:
        module.write_bytes(source)
        compiled.unlink(missing_ok=True)
    return {True: "SURVIVED", False: "killed", None: "NO ANSWER"}[passed]


def drawn(copy: Path, room: Room, number: int, seed: int) -> list[Mutant]:
    """Mutants of a room, each as likely as every other; the same seed draws the same ones."""
    paths = sorted({path for pattern in room.modules for path in copy.glob(pattern)})
    everything = [mutant for path in paths for mutant in mutants(path, copy)]
    return random.Random(seed).sample(everything, min(number, len(everything)))


def copied(folder: Path) -> Path:
    """The files of the checkout that git knows, in another folder."""
    listed = subprocess.run(["git", "ls-files"], cwd=CHECKOUT, capture_output=True, check=True)
    for name in listed.stdout.decode().splitlines():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(CHECKOUT / name, folder / name)
    return folder


def main() -> None:
    known = rooms()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", choices=sorted(known))
    parser.add_argument("--number", type=int, default=25)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit-s", type=float, default=180.0, help="Of one mutant's tests.")
    options = parser.parse_args()
    room, counts = known[options.room], Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        copy = copied(Path(folder))
        if not tests_pass(copy, room.tests, 10 * options.limit_s):
            raise SystemExit(f"the tests of {options.room} do not pass as they are")
        for mutant in drawn(copy, room, options.number, options.seed):
            started = time.monotonic()
            result = verdict(copy, mutant, room.tests, options.limit_s)
            counts[result] += 1
            place, took = f"{mutant.module}:{mutant.line}", time.monotonic() - started
            print(
                f"{result} ({took:.0f} s) {place}: {mutant.before!r} -> {mutant.after!r}",
                flush=True,
            )
    print(", ".join(f"{number} {result}" for result, number in sorted(counts.items())))


if __name__ == "__main__":
    main()
