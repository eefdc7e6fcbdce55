"""Who may import whom (DESIGN, section 6), read from the sources; and what starting up costs."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import harness

PACKAGE = Path(harness.__file__).parent

# Lower levels never import higher ones.  A package stands for all its modules; a module that has
# a line of its own stands apart from its package.
LEVELS = {
    "harness.encounter": 0,
    "harness.errors": 0,
    "harness.seeding": 0,
    "harness.resources": 0,
    "harness.mixture": 1,
    "harness.comparison": 1,
    "harness.scenario": 1,
    "harness.site": 1,
    "harness.network": 1,
    "harness.contact": 1,
    "harness.walking": 1,
    "harness.piecewise": 1,
    "harness.trajectories": 2,
    "harness.curve_components": 2,
    "harness.curve_path": 2,
    "harness.curve_reading": 2,
    "harness.model_file": 2,
    "harness.interaction": 2,
    "harness.strategies": 2,
    "harness.measures": 2,
    "harness.place": 2,
    "harness.study": 2,
    "harness.options": 2,
    "harness.engine": 3,
    "harness.episode": 3,
    "harness.strategy_groups": 3,
    "harness.walkers": 3,
    "harness.results": 4,
    "harness.summaries": 4,
    "harness.tasks": 4,
    "harness.measure_tables": 4,
    "harness.run_folder": 4,
    "harness.shards": 4,
    "harness.calibration": 4,
    "harness.plan": 5,
    "harness.pairing": 5,
    "harness.worker": 5,
    "harness.pool": 5,
    "harness.execution": 5,
    "harness.manifest": 5,
    "harness.until": 5,
    "harness.finish": 5,
    "harness.cluster": 5,
    "harness.upload": 5,
    "harness.conformance": 5,
    "harness.replay": 5,
    "harness.sumo_outputs": 5,
    "harness.stored": 5,
    "harness.watch": 5,
    "harness.scoring": 5,
    "harness.compare": 5,
    "harness.experiment": 5,
    "harness.run_data": 5,
    "harness.report": 5,
    "harness.rl": 5,
    "harness.cli": 6,
    "harness.__main__": 6,
}
HEAVY = ("libsumo", "traci", "scipy", "pandas", "pyarrow", "matplotlib")


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imports_of(path: Path) -> set[str]:
    """Every module a file imports, wherever in it; ``from a import b`` counts as a and a.b."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            found.add(node.module)
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def level_of(module: str) -> int | None:
    parts = module.split(".")
    for length in range(len(parts), 1, -1):
        name = ".".join(parts[:length])
        if name in LEVELS:
            return LEVELS[name]
    return None


def test_every_module_has_a_level() -> None:
    without = [name for name in MODULES if name != "harness" and level_of(name) is None]
    assert without == []


@pytest.mark.parametrize("module", [name for name in MODULES if level_of(name) is not None])
def test_lower_levels_never_import_higher_ones(module: str) -> None:
    own = level_of(module) or 0
    known = {*MODULES, *LEVELS}
    wrong = {name for name in imports_of(MODULES[module]) & known if (level_of(name) or 0) > own}
    assert wrong == set()


def importers_of(package: str) -> set[str]:
    return {
        module
        for module, path in MODULES.items()
        if any(name == package or name.startswith(f"{package}.") for name in imports_of(path))
    }


def test_libsumo_and_traci_have_one_importer_each() -> None:
    assert importers_of("libsumo") == {"harness.engine.sumo"}
    assert importers_of("traci") <= {"harness.engine.traci"}


def test_strategies_measures_and_statistics_know_no_engine() -> None:
    engine = importers_of("harness.engine")
    for package in ("strategies", "measures", "comparison", "interaction", "mixture", "encounter"):
        assert not any(name.startswith(f"harness.{package}") for name in engine)


def test_the_mixture_knows_no_traffic() -> None:
    known = {"harness.mixture", "harness.errors"}
    for module, path in MODULES.items():
        if module.startswith("harness.mixture"):
            own = {name for name in imports_of(path) if name in MODULES}
            assert all(any(name.startswith(base) for base in known) for name in own), module


def test_the_comparison_needs_numpy_and_scipy_alone() -> None:
    known = {
        "dataclasses",
        "harness",
        "numpy",
        "scipy",
        "collections",
        "enum",
        "math",
        "typing",
    }
    for module, path in MODULES.items():
        if module.startswith("harness.comparison"):
            assert {name.split(".")[0] for name in imports_of(path)} <= known, module


def test_this_file_would_notice(tmp_path: Path) -> None:
    source = tmp_path / "made_up.py"
    source.write_text(
        "def late():\n    from harness.engine import sumo\n    import libsumo.libsumo\n"
    )
    assert imports_of(source) == {"harness.engine", "harness.engine.sumo", "libsumo.libsumo"}
    assert level_of("harness.engine.sumo") == 3
    assert level_of("harness.nowhere") is None


def test_help_imports_nothing_heavy() -> None:
    script = (
        "import sys\n"
        "sys.argv = ['harness', '--help']\n"
        "from harness.cli.app import main\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n    assert end.code == 0, end.code\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=120
    )
    assert "run" in result.stdout
    assert result.stderr.strip() == "[]"
