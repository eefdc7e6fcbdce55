"""Nothing in a file is unpickled or evaluated, nor imported to look at a run (docs/files.md)."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import harness

PACKAGE = Path(harness.__file__).parent
SOURCES = sorted(PACKAGE.rglob("*.py"))

FORBIDDEN_MODULES = {
    *("pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve", "joblib"),
    *("yaml", "runpy", "code", "codeop", "imp", "zipimport", "ctypes", "pty"),
}
FORBIDDEN_NAMES = {"eval", "exec", "compile", "__import__", "execfile", "breakpoint"}
FORBIDDEN_ATTRIBUTES = {
    *("read_pickle", "to_pickle", "unsafe_load", "full_load", "literal_eval"),
    *("system", "popen", "eval", "query", "exec_module", "load_module", "import_string"),
}
IMPORTERS = {
    "import_module": {
        *("strategies/own.py", "engine/session.py", "studies/running/children.py", "cli/app.py")
    },
    "find_spec": {"studies/running/workers.py"},
}
"""Who may import by name: a strategy's module, SUMO's library or its client, and the command line
the module of a command."""


def strange(source: str, name: str) -> Iterator[str]:
    """What of a module could run what a file holds."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            modules = [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            modules = []
        yield from {one for one in modules if one.split(".")[0] in FORBIDDEN_MODULES}
        if isinstance(node, ast.Name) and node.id in FORBIDDEN_NAMES:
            yield node.id
        called = node.attr if isinstance(node, ast.Attribute) else None
        called = node.id if isinstance(node, ast.Name) else called
        if isinstance(node, ast.Attribute) and called in FORBIDDEN_ATTRIBUTES:
            yield f".{called}"
        if called in IMPORTERS and name not in IMPORTERS[called]:
            yield called
        if isinstance(node, ast.keyword) and node.arg in ("allow_pickle", "shell"):
            yield f"{node.arg}="


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_nothing_unpickles_or_evaluates(path: Path) -> None:
    name = path.relative_to(PACKAGE).as_posix()
    assert list(strange(path.read_text(encoding="utf-8"), name)) == []
