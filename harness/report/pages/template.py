"""The template of every page: it opens from disk without a network and escapes all text."""

import base64
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jinja2

from harness.core.errors import InputError
from harness.core.files import write_file
from harness.core.versions import versions_of_runs
from harness.report.drawing import style
from harness.report.drawing.svg import inline_svg
from harness.scenario import as_written

_TEMPLATES = Path(__file__).parent / "templates"

_EMPTY: dict[str, Any] = {
    "unfinished": "",
    "screen": [],
    "opening": [],
    "caveats": [],
    "failures": None,
    "player": None,
    "no_player": "",
    "pictures": [],
    "figure_remarks": [],
    "scenario": [],
}
"""Parts of a page that some pages leave empty."""


def page_in(folder: Path, out: Path | None) -> Path:
    """The path of a page: ``out``, or ``report.html`` in a folder.

    Raises:
        InputError: ``out`` is a folder.
    """
    page = out or folder / "report.html"
    if page.is_dir():
        raise InputError(f"--out {page}", "is a folder", "a file to write")
    return page


def drawn(picture: style.Picture) -> dict[str, str]:
    """A picture in the form that the template takes."""
    return {
        "name": picture.name,
        "title": picture.title,
        "caption": picture.caption,
        "svg": inline_svg(picture.figure, f"f-{picture.name}", picture.title, picture.caption),
    }


def write_page(path: Path, context: dict[str, Any]) -> None:
    """Fill the template and write the page; ``context`` overrides ``_EMPTY``."""
    # A file may hold bytes that are not text; a page must be text.
    write_file(path, _filled(_EMPTY | context).encode("utf-8", errors="replace"))


def _filled(context: dict[str, Any]) -> str:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    shared = {
        "styles": (_TEMPLATES / "report.css").read_text(encoding="utf-8"),
        "scripts": [_script(name) for name in ("page.js", "player.js")],
        "version": versions_of_runs()["harness"],
    }
    return environment.get_template("report.html").render(context | shared)


def _script(name: str) -> dict[str, str]:
    """A script with its hash, by which the page allows this script and no other."""
    text = (_TEMPLATES / name).read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return {"text": text, "hash": f"'sha256-{digest}'"}


def flat(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Every key of the scenario with its value."""
    for key, value in tree.items():
        if isinstance(value, dict) and value:
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", "" if value is None else as_written(value)
