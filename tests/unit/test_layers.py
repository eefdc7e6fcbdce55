"""Who may import whom, read from the sources; and what starting up costs."""

import ast
import re
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import harness

PACKAGE = Path(harness.__file__).parent

# The data's way, from below: a room imports its own level and those before it, never a later one.
ORDER = (
    "core | statistics site measures model | scenario | engine strategies | episode | store rl "
    "| studies | report | cli __main__"
)
LEVELS = {name: n for n, names in enumerate(ORDER.split(" | ")) for name in names.split()}
HEAVY = ("libsumo", "traci", "scipy", "pandas", "pyarrow", "matplotlib")


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


@cache
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
    """The level of a room and of every module in it; the face of the whole package has none."""
    _, _, inside = module.partition(".")
    return LEVELS.get(inside.partition(".")[0])


def test_every_module_has_a_level_and_the_architecture_names_every_room() -> None:
    without = [name for name in MODULES if name != "harness" and level_of(name) is None]
    assert without == []
    page = (PACKAGE.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert [name for name in LEVELS if f"`{name}`" not in page and name != "__main__"] == []


@pytest.mark.parametrize("module", [name for name in MODULES if level_of(name) is not None])
def test_lower_levels_never_import_higher_ones(module: str) -> None:
    own = level_of(module)
    imported = imports_of(MODULES[module]) & MODULES.keys()
    wrong = {name for name in imported if (level_of(name) or 0) > own}
    assert wrong == set()


@pytest.mark.parametrize(
    "module",
    [
        name
        for name in MODULES
        if ".report." in name and not name.endswith(("listings", "one_pair"))
    ],
)
def test_a_page_simulates_nothing(module: str) -> None:
    simulating = (
        "harness.studies.batch",
        "harness.engine.shared",
        "harness.engine.sumo",
        "harness.studies.replay.rerun",
        "harness.studies.workers.pool",
    )
    assert not [name for name in imports_of(MODULES[module]) if name.startswith(simulating)]


def test_no_room_in_between_asks_which_kind_a_run_is() -> None:
    """``Scenario.kind`` says it, once."""
    asking = re.compile(r"in_traffic|traffic is (not )?None|is_risk")
    asked = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if path.relative_to(PACKAGE).parts[0] != "scenario"
        if asking.search(path.read_text("utf-8"))
    }
    assert asked == set()


def test_rows_and_json_objects_have_one_name_each() -> None:
    """``Row`` and ``JsonObject``; everything else is typed."""
    untyped = re.compile(r"dict\[str, (Any|object)\]")
    rooms = ("report", "store", "studies/risk", "studies/batch", "studies/runs", "studies/kinds")
    paths = [path for room in rooms for path in (PACKAGE / room).rglob("*.py")]
    assert [path.name for path in paths if untyped.search(path.read_text("utf-8"))] == ["tables.py"]


def test_every_table_has_every_kind_of_run() -> None:
    """So that a kind that is added is added to each of them."""
    from harness.report.pages.kinds import PARTS
    from harness.store.kinds import KINDS
    from harness.studies.batch.scoring import SCORERS
    from harness.studies.export.scenes import SCENES
    from harness.studies.kinds.table import SIMULATIONS
    from harness.studies.runs.site_words import VEHICLE_WORDS
    from harness.studies.runs.views import VIEWS

    for table in (SIMULATIONS, SCORERS, VEHICLE_WORDS, VIEWS, SCENES, PARTS):
        assert table.keys() == KINDS.keys()


def path_of(module: str) -> str:
    return module.replace(".", "/")


def joined(imports: Mapping[str, set[str]], depth: int) -> dict[str, set[str]]:
    """The imports between the packages of a depth, without those of a package from itself."""

    def cut(module: str) -> str:
        return ".".join(module.split(".")[:depth])

    rooms: dict[str, set[str]] = {}
    for module, imported in imports.items():
        rooms.setdefault(cut(module), set()).update(map(cut, imported))
    return {room: others - {room} for room, others in rooms.items()}


def circle_in(imports: Mapping[str, set[str]]) -> list[str]:
    """Names that import each other in a ring, or nothing."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def modules_of(path: Path) -> set[str]:
    """The package's modules a file imports; ``from a import b`` is a.b where that is a module.

    Imports anywhere in it count, for the type checker alone and inside functions too.
    """
    found = imports_of(path) & MODULES.keys() - {"harness"}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and all(
            f"{node.module}.{alias.name}" in MODULES for alias in node.names
        ):
            found.discard(str(node.module))
    return found


INSIDE = {name: modules_of(path) for name, path in MODULES.items() if name != "harness"}


def test_neither_modules_nor_rooms_import_each_other_in_a_circle() -> None:
    assert circle_in(INSIDE) == []
    assert circle_in(joined(INSIDE, 2)) == []


@pytest.mark.parametrize("room", ["studies", "report", "model"])
def test_rooms_within_a_room_import_each_other_in_no_circle(room: str) -> None:
    inner = {
        name: imported
        for name, imported in joined(INSIDE, 3).items()
        if name.startswith(f"harness.{room}.")
    }
    assert len(inner) > 2
    assert circle_in(inner) == []
    page = (PACKAGE.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = [name.rpartition(".")[2] for name in inner if (PACKAGE.parent / path_of(name)).is_dir()]
    assert [name for name in named if f"`{name}`" not in page] == []


def importers_of(package: str) -> set[str]:
    return {
        module
        for module, path in MODULES.items()
        if any(name == package or name.startswith(f"{package}.") for name in imports_of(path))
    }


def test_libsumo_and_traci_have_one_importer_each() -> None:
    assert importers_of("libsumo") == {"harness.engine.sumo"}
    assert importers_of("traci") <= {"harness.engine.traci"}
    # SUMO's programs are started by this room alone; sumolib reads networks in one module.
    rooms = {name.split(".")[1] for name in importers_of("sumo")}
    assert rooms <= {"engine"}
    assert "harness.site.road_network" in importers_of("sumolib")
    assert {name.split(".")[1] for name in importers_of("sumolib")} <= {"site", "engine", "report"}


def test_what_strategies_the_mixture_and_the_comparison_may_import() -> None:
    engine = importers_of("harness.engine")
    for package in ("strategies", "measures", "statistics", "model", "core", "site"):
        assert not any(name.startswith(f"harness.{package}") for name in engine)
    known = {"harness.model.mixture", "harness.core.errors"}
    for module, path in MODULES.items():
        if module.startswith("harness.model.mixture"):
            own = {name for name in imports_of(path) if name in MODULES}
            assert all(any(name.startswith(base) for base in known) for name in own), module
    known = {"harness", "numpy", "scipy", "dataclasses", "collections", "copy", "enum"}
    known |= {"functools", "math", "typing"}
    for module, path in MODULES.items():
        if module.startswith("harness.statistics"):
            assert {name.split(".")[0] for name in imports_of(path)} <= known, module


def test_this_file_would_notice(tmp_path: Path) -> None:
    source = tmp_path / "made_up.py"
    source.write_text(
        "def late():\n    from harness.engine import sumo\n    import libsumo.libsumo\n"
    )
    assert imports_of(source) == {"harness.engine", "harness.engine.sumo", "libsumo.libsumo"}
    assert level_of("harness.engine.sumo") == 3
    assert level_of("harness.nowhere") is None
    ring = {"a": {"b"}, "b": {"c"}, "c": {"a"}}
    assert set(circle_in(ring)) == {"a", "b", "c"}
    assert circle_in({**ring, "c": set()}) == []
    typed = tmp_path / "typed.py"
    typed.write_text("if TYPE_CHECKING:\n    from harness.engine import sumo\n")
    assert "harness.engine.sumo" in imports_of(typed)


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
