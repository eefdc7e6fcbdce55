"""Runs a notebook's cells as Jupyter does: in ``__main__``, each cell's last value displayed."""

import ast
import json
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def as_main() -> Iterator[dict[str, Any]]:
    """The names of a fresh ``__main__``, which stands in the place of this process's meanwhile."""
    module, before = types.ModuleType("__main__"), sys.modules["__main__"]
    sys.modules["__main__"] = module
    try:
        yield vars(module)
    finally:
        sys.modules["__main__"] = before


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run one cell; returns the value of its last line, None where that is no expression."""
    tree = ast.parse(source)
    ends = bool(tree.body) and isinstance(tree.body[-1], ast.Expr)
    last: Any = tree.body.pop() if ends else None
    exec(compile(tree, "<cell>", "exec"), names)
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)


def run_notebook(path: Path) -> list[Any]:
    """The values that every code cell displays."""
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document["nbformat"] == 4
    cells = [cell for cell in document["cells"] if cell["cell_type"] == "code"]
    with as_main() as names:
        return [run_cell("".join(cell["source"]), names) for cell in cells]
