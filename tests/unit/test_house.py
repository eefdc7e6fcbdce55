"""How large the house may be, who may import whom in it, and what starting up costs.

The limits only ever fall.
"""

import ast
import io
import re
import subprocess
import sys
import tokenize
import tomllib
from functools import cache
from graphlib import TopologicalSorter
from importlib import metadata
from pathlib import Path

import pytest

from harness.core.files import PACKAGE
from harness.results.folder import COMPUTES, MAKES_ROWS

CHECKOUT = Path(__file__).parents[2]
CODE = {"harness": 19_000, "tests": 13_000, "benchmarks": 1_700, "docs": 600, "examples": 201}
ROOMS = {
    "core": 639,
    "scenario": 983,
    "model": 2_019,
    "strategies": 1_332,
    "engine": 1_287,
    "encounter": 1_035,
    "measures": 1_186,
    "simulation": 1_553,
    "site": 280,
    "results": 2_136,
    "report": 1_559,
    "rl": 170,
    "cli": 714,
    "studies": 4_249,
}
CODE |= {f"harness/{room}": lines for room, lines in ROOMS.items()}
RUNNING = (
    "running/tasks running/episodes running/children running/workers running/run running/replay "
    "evaluate candidates differences comparison worst"
)
MODULES, MODULE, FUNCTION, PARAMETERS, FIELDS = 200, 300, 50, 7, 16
LARGER = {
    "harness.studies.running.run.run": "each option of a command is a keyword for Python's users",
    "harness.studies.risk.estimate.risk": "the same",
    "harness.engine.sumo_engine.SumoEngine": "each function of SUMO is bound once, for every step",
    "harness.encounter.walkers.Walker": "what is read at every step is an attribute of its own",
}
"""What has more parameters or fields, and why."""
DECLARE = {"BaseModel", "Section", "TypedDict", "Measured"}
"""Tables of keys and of columns; the commands of ``cli``, too, are declarations: of options."""
DOORS, PAGES, WEB, PASSED = 14, 2_800, 700, 15
LINE, IGNORED, UNCOVERED, COVERED = 100, 3, 2, 97
DOCSTRINGS = ["D101", "D102", "D103", "D104", "D106"]
# The data's way, from below: a room imports its own level and those before it, never a later one.
ORDER = (
    "core | site measures model | scenario | engine strategies | encounter | simulation | results "
    "| studies | report | rl | cli | __main__"
)
LEVELS = {name: n for n, names in enumerate(ORDER.split(" | ")) for name in names.split()}
HEAVY = ("libsumo", "traci", "scipy", "pandas", "pyarrow", "matplotlib")
SESSION, INTERFACES = "harness.engine.session", {"libsumo", "traci"}
OF_SUMO = r'"(libsumo|traci|sumolib)"|[!=]= ":"|(with|prefix)\(["\']:|crosswalk-harness-'
OF_SUMO += r"|VehicleType\(|width_m: float = \d"
"""SUMO's interfaces, how ids inside junctions and names of its folders begin, and its defaults."""
_SILENT = "COMMENT NL NEWLINE INDENT DEDENT ENDMARKER"
SEALED = "CrossingPaths Evaluation Extraction GivenDensity HeldOut Normals RecordedPassage RowFile"
"""Records whose makers make arrays read-only, or give frames that belong to whoever asked."""
NO_CODE = {getattr(tokenize, name) for name in _SILENT.split()}


def files_of(folder: str, *endings: str) -> list[Path]:
    paths = sorted((CHECKOUT / folder).rglob("*"))
    return [path for path in paths if path.suffix in endings and "__pycache__" not in path.parts]


def code_lines(text: str) -> set[int]:
    """The lines with a token that is no comment, without docstrings."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", None)
        for part in body if isinstance(body, list) else []:
            match part:
                case ast.Expr(ast.Constant(str())):
                    lines -= {*range(part.lineno, (part.end_lineno or 0) + 1)}
    return lines


def test_what_counts_as_code() -> None:
    text = '"""Said."""\n\n# why\ndef one(\n    two,\n):\n    """Said."""\n    return two\n'
    assert code_lines(text) == {4, 5, 6, 8}


@pytest.mark.parametrize("folder", CODE)
def test_lines_of_code(folder: str) -> None:
    texts = (path.read_text("utf-8") for path in files_of(folder, ".py"))
    assert sum(map(len, map(code_lines, texts))) <= CODE[folder]


def test_lines_of_code_that_run_and_compare() -> None:
    files = [CHECKOUT / "harness" / "studies" / f"{name}.py" for name in RUNNING.split()]
    assert sum(len(code_lines(path.read_text("utf-8"))) for path in files) <= 1_550


def fields_of(node: ast.ClassDef) -> set[str]:
    """What a class declares, and what its methods set."""
    declared = {ast.unparse(of.target) for of in node.body if isinstance(of, ast.AnnAssign)}
    stored = [of for of in ast.walk(node) if isinstance(getattr(of, "ctx", None), ast.Store)]
    return declared | {*re.findall(r"(?m)^self\.(\w+)$", "\n".join(map(ast.unparse, stored)))}


def test_sizes_of_modules_functions_and_classes() -> None:
    larger = set[str]()
    for name, path in PATHS.items():
        lines = code_lines(path.read_text("utf-8"))
        assert len(lines) <= MODULE, name
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef):
                inside = lines & {*range(node.lineno, (node.end_lineno or 0) + 1)}
                assert len(inside) <= FUNCTION, (name, node.name)
                given = {*re.findall(r"arg\(arg='(\w+)'", ast.dump(node.args))} - {"self", "cls"}
                if len(given) > PARAMETERS and not name.startswith("harness.cli."):
                    larger.add(f"{name}.{node.name}")
            elif isinstance(node, ast.ClassDef):
                named = {node.name, *map(ast.unparse, node.bases)}
                if len(fields_of(node)) > FIELDS and not named & DECLARE:
                    larger.add(f"{name}.{node.name}")
    assert larger == LARGER.keys()


def test_other_sizes() -> None:
    assert len(files_of("harness", ".py")) <= MODULES
    web = files_of("harness", ".html", ".js", ".css", ".toml")
    assert sum(len(path.read_text("utf-8").splitlines()) for path in web) <= WEB
    pages = (CHECKOUT / "docs").glob("*.md")
    assert sum(len(path.read_text("utf-8").splitlines()) for path in pages) <= PAGES
    inside = {path.name for path in (CHECKOUT / "harness").iterdir()}
    face = {"__init__.py", "__init__.pyi", "__main__.py", "py.typed", "__pycache__"}
    assert len(inside - face) <= DOORS


def test_no_check_is_looser() -> None:
    tools = tomllib.loads((CHECKOUT / "pyproject.toml").read_text("utf-8"))["tool"]
    ruff, coverage = tools["ruff"], tools["coverage"]
    assert ruff["line-length"] <= LINE
    assert len(ruff["lint"]["ignore"]) <= IGNORED
    assert ruff["lint"].keys() == {"select", "ignore", "per-file-ignores", "isort"}
    assert {*ruff["lint"]["select"]} >= {*DOCSTRINGS}
    assert ruff["lint"]["per-file-ignores"] == dict.fromkeys(("tests/**", "*.ipynb"), DOCSTRINGS)
    assert coverage["report"]["fail_under"] >= COVERED
    assert len(coverage["report"]["exclude_also"]) <= UNCOVERED
    assert "omit" not in coverage["run"] | coverage["report"]
    assert coverage["run"]["source"] == ["harness"]
    assert coverage["run"]["branch"]
    assert tools["mypy"]["strict"]
    assert {*tools["mypy"]["files"]} >= {"harness", "tests", "benchmarks", "examples"}


def name_of(path: Path) -> str:
    parts = path.relative_to(CHECKOUT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


PATHS = {name_of(path): path for path in files_of("harness", ".py")}


@cache
def imports_of(path: Path) -> set[str]:
    """Everything a file imports, wherever in it; ``from a import b`` is a.b if that is a module."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inside & PATHS.keys()
            found |= set() if inside <= PATHS.keys() else {str(node.module)}
    return found


def test_no_module_imports_a_higher_level() -> None:
    levels = {name: LEVELS[name.split(".")[1]] for name in PATHS if name != "harness"}
    upward = [
        f"{name} imports {other}"
        for name, level in levels.items()
        for other in imports_of(PATHS[name]) & levels.keys()
        if levels[other] > level
    ]
    assert upward == []


@pytest.mark.parametrize("depth", [2, 3, 9], ids=["rooms", "folders", "modules"])
def test_no_imports_in_a_circle(depth: int) -> None:
    def cut(name: str) -> str:
        return ".".join(name.split(".")[:depth])

    graph: dict[str, set[str]] = {}
    for name, path in PATHS.items():
        inside = {cut(other) for other in imports_of(path) & PATHS.keys() - {"harness"}}
        graph.setdefault(cut(name), set()).update(inside - {cut(name)})
    TopologicalSorter(graph).prepare()


def knows_sumo(path: Path) -> bool:
    """Whether a file imports SUMO's interfaces, or asks for those of a session."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        match node:
            case ast.Call(ast.Name("import_module") | ast.Attribute(attr="import_module"), args):
                if INTERFACES & {*re.findall(r"\w+", " ".join(map(ast.unparse, args)))}:
                    return True
            case ast.Attribute(value, "api" | "_api") if ast.unparse(value) != "pd":
                return True
    return bool(INTERFACES & {imported.split(".")[0] for imported in imports_of(path)})


def test_one_module_knows_sumos_interfaces() -> None:
    assert [name for name, path in PATHS.items() if knows_sumo(path)] == [SESSION]
    # A town is read by SUMO's own library of networks.
    reads = {name for name, path in PATHS.items() for of in imports_of(path) if "sumolib" in of}
    assert reads == {"harness.engine.town_reader"}


def test_the_engine_alone_knows_the_words_of_sumo() -> None:
    """The names of SUMO's options, of its files' contents and of TraCI that are no usual words."""
    packages = Path(str(metadata.distribution("eclipse-sumo").locate_file("")))
    files = [*packages.glob("sumo/data/xsd/**/*.xsd"), *packages.glob("traci/*.py")]
    text = "".join(file.read_text("utf-8") for file in files)
    names = re.findall(r'(?:name="|value="|def |=")([\w.-]+)', text)
    words = {name for name in names if re.search(r"\w[.-]|[a-z][A-Z]|[A-Z]_", name)}
    assert words >= {"net-file", "laneData", "vType", "getLeader", "DEFAULT_PEDTYPE"}
    for name in PATHS:
        if name.startswith("harness.engine.") or name == "harness.core.versions":
            continue
        text = PATHS[name].read_text("utf-8")
        assert not re.search(OF_SUMO, text), name
        said = re.findall(r'(?<=")[\w.-]+(?=")|(?<=\.)\w+', text)
        assert not words & {*said}, name


def test_frozen_records_have_nothing_that_can_be_written_to() -> None:
    arrays, found = r"\w*Array|ndarray|DataFrame|Tables", set[str]()
    for path in PATHS.values():
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            record = ast.unparse(node) if isinstance(node, ast.ClassDef) else "(Frozen"
            words = arrays if "(NamedTuple)" in record else rf"list|dict|Mapping|Sequence|{arrays}"
            kept = re.search(rf"(?m)^    \w+: (?!.*Callable)[^=\n]*\b({words})\b", record)
            is_frozen = re.search(r"\(NamedTuple\)|dataclass\(frozen=True", record)
            if kept and is_frozen and "(Frozen" not in record:
                found |= {*re.findall(r"(?m)^class (\w+)", record)}
    assert found == {*SEALED.split()}


def test_help_imports_nothing_heavy() -> None:
    script = (
        "import sys; sys.argv = ['harness', '--help']\n"
        "from harness.cli.app import main\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n    assert end.code == 0, end.code\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)\n"
    )
    command = [sys.executable, "-c", script]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert "run" in result.stdout
    assert result.stderr.strip() == "[]"


NAMED = re.compile(r"`([\w./]+\.py)`")

KAPPA = (
    "engine/sumo_engine encounter/loop encounter/pairing measures/chunk measures/contacts "
    "measures/record studies/running/episodes results/rows results/folder results/columns "
    "results/estimators results/catalogue results/cell_findings results/cell_tables report/screen"
)


def test_files_that_a_number_passes_on_its_way_to_the_screen() -> None:
    """Every file of κ's way but SUMO's own imports one of the others, or is imported by it."""
    assert len(KAPPA.split()) <= PASSED
    names = ["harness." + file.replace("/", ".") for file in KAPPA.split()]
    for at, name in enumerate(names[2:], 2):
        linked = imports_of(PATHS[name]) & {*names}
        linked |= {other for other in names[:at] if name in imports_of(PATHS[other])}
        assert linked, name


def test_what_the_page_on_additions_names_exists() -> None:
    page = (CHECKOUT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("## To add something")[2]
    house = [f"/{file.relative_to(CHECKOUT).as_posix()}" for file in PATHS.values()]
    files = {name: [f for f in house if f.endswith(f"/{name}")] for name in NAMED.findall(table)}
    assert all(files.values()), files
    for word, name in re.findall(r"`(?:\w+\.)?(\w+)`[^`|]* in `([\w./]+\.py)`", table):
        sources = [(CHECKOUT / file[1:]).read_text(encoding="utf-8") for file in files[name]]
        assert any(re.search(rf"\b{word}\b", source) for source in sources), (word, name)


def test_a_modules_name_occurs_once_in_the_house() -> None:
    modules = [path.name for path in PATHS.values() if path.name != "__init__.py"]
    assert len(modules) == len({*modules})


@pytest.mark.parametrize("modules", [COMPUTES, MAKES_ROWS], ids=["findings", "rows"])
def test_results_know_the_code_that_makes_them(modules: str) -> None:
    """What the modules that compute import inside the house, and so on, is in their digest."""
    known = {path for name in modules.split() for path in PACKAGE.glob(f"{name}.py")}
    used = {name_of(path) for path in known}
    # estimate.py runs and stores a risk, and tasks.py imports types.
    ends = {"harness.studies.risk.estimate", "harness.studies.running.tasks"}
    while (
        further := set().union(*(imports_of(PATHS[n]) for n in used - ends)) & PATHS.keys() - used
    ):
        used |= further
    assert [name for name in used if PATHS[name] not in known] == []
