"""Which faults the tests notice: ``python -m benchmarks.mutants ROOM --number 25 --seed 1``.

One small fault at a time is put into a copy of the checkout: a comparison, an operator, a number,
a condition or a returned value is changed.  Then the tests of the room run until one fails.  A
mutant that no test notices has *survived*: either it changes nothing that can be observed (then it
is *equivalent*, which a person has to judge), or a test is missing.  Without an answer in time it
may loop for ever, or the machine was busy.  Slow tests do not run here.
"""

import argparse
import ast
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

CHECKOUT = Path(__file__).parents[1]


class Room(NamedTuple):
    """Modules, and the tests that are to notice their faults, the quickest first."""

    modules: tuple[str, ...]
    tests: tuple[str, ...]


def named(pattern: str, names: str) -> list[str]:
    """Paths of one pattern."""
    return [pattern.format(name) for name in names.split()]


def units(names: str) -> list[str]:
    """Paths of unit tests, then the examples in docstrings."""
    return [*named("tests/unit/test_{}.py", names), "tests/unit/test_public.py::test_examples"]


ROOMS = {
    "actuation": Room(
        ("harness/core/actuation.py", "harness/scenario/actuation.py"),
        (*units("actuation gap_yield step_size warm_up"), "tests/sumo/test_actuation.py"),
    ),
    "episode": Room(
        ("harness/episode/*.py", "harness/episode/traffic/*.py"),
        (
            *units(
                "closed_forms passages walking lanes demand ties gap_acceptance vehicle_mix "
                "reactive_pedestrians human_driver warm_up step_size timed_pedestrians perception "
                "actuation threshold arrivals saturation pairs people_experiments risk rl"
            ),
            "tests/sumo/test_engines_agree.py",
            "tests/sumo/test_traffic.py",
            "tests/sumo/test_pedestrians.py",
            "tests/conformance",
        ),
    ),
    "measures": Room(
        ("harness/measures/*.py", "harness/measures/motion/*.py"),
        (
            *units(
                "measure_tables passages walking measures measures_braking harm lanes episode "
                "properties conflicts pairs"
            ),
            "tests/conformance/test_measures.py",
            "tests/sumo/test_one_pair.py",
            "tests/sumo/test_conflicts.py",
        ),
    ),
    "people": Room(
        (
            *named(
                "harness/episode/{}.py",
                "arrivals crowd deciding threshold walkers walking_speeds",
            ),
            "harness/scenario/people*.py",
            "harness/engine/people.py",
        ),
        (
            *units(
                "walking gap_acceptance scenario lanes reactive_pedestrians timed_pedestrians "
                "perception threshold arrivals pairs people_experiments shipped_scenarios ties"
            ),
            "tests/sumo/test_engines_agree.py",
            "tests/sumo/test_pedestrians.py",
            "tests/statistical/test_walking_speeds.py",
        ),
    ),
    "simulation": Room(
        (
            "harness/episode/simulation/*.py",
            "harness/engine/simulation/*.py",
            "harness/store/simulations/*.py",
            "harness/site/crosswalks.py",
        ),
        (
            *units(
                "simulation_screen simulation_statistics passages vehicle_types lookout "
                "simulation_waits conflicts"
            ),
            "tests/report/test_own_simulations.py",
            *named(
                "tests/sumo/test_simulation_{}.py",
                "driving trips deadlocks midblock unseen outputs reference",
            ),
            "tests/sumo/test_conflicts.py",
        ),
    ),
    "statistics": Room(
        ("harness/statistics/*.py",),
        (
            *units(
                "simulation_screen simulation_statistics measure_tables compare_arms "
                "comparison_allowed comparison_pareto comparison_paired strategy_groups "
                "model_support screen hour_summaries comparison nearness trust tuning over_model"
            ),
            "tests/report/test_catalogue.py",
            "tests/report/test_compare.py",
            "tests/report/test_hours.py",
            "tests/report/test_misleading.py",
            "tests/report/test_too_good.py",
        ),
    ),
    "strategies": Room(
        ("harness/strategies/*.py", "harness/strategies/perception/*.py"),
        (
            *units(
                "human_recorded lanes strategy_groups human_driver emergency_brake hard_yield "
                "step_size own_strategy warm_up perception soft_yield_margin actuation human_yield "
                "gap_yield rl program all_strategies validation people_experiments"
            ),
            "tests/conformance/test_strategies.py",
            "tests/sumo/test_soft_yield.py",
            "tests/sumo/test_constant_speed.py",
            "tests/sumo/test_engines_agree.py",
        ),
    ),
}
"""By name, as patterns and paths relative to the checkout."""

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
            other = ast.Or() if isinstance(operator, ast.And) else ast.And()
            yield node, ast.unparse(ast.BoolOp(other, values))
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


def tests_pass(copy: Path, tests: tuple[str, ...], limit_s: float) -> bool | None:
    """Whether the tests pass in the copy; None if they take too long."""
    command = (sys.executable, "-m", "pytest", *tests, "-x", "-q", "-n0", "-m", "not slow")
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    with subprocess.Popen(
        [*command, "-p", "no:cacheprovider", "--no-header", "--tb=no"],
        cwd=copy,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    ) as process:
        try:
            process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return None
    return process.returncode == 0


def verdict(copy: Path, mutant: Mutant, tests: tuple[str, ...], limit_s: float) -> str:
    """What becomes of a mutant; the module is as before afterwards."""
    module = copy / mutant.module
    source = module.read_bytes()
    module.write_bytes(source[: mutant.start] + mutant.after.encode() + source[mutant.end :])
    # A compiled module is trusted by its size and the second of its change.
    shutil.rmtree(module.parent / "__pycache__", ignore_errors=True)
    try:
        passed = tests_pass(copy, tests, limit_s)
    finally:
        module.write_bytes(source)
        shutil.rmtree(module.parent / "__pycache__", ignore_errors=True)
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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", choices=sorted(ROOMS))
    parser.add_argument("--number", type=int, default=25)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit-s", type=float, default=180.0, help="Of one mutant's tests.")
    options = parser.parse_args()
    room, counts = ROOMS[options.room], Counter[str]()
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
