"""The template of every page.  Pages work offline from disk, and all text is escaped."""

import base64
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2

from harness.core.documents import JsonObject
from harness.core.errors import InputError
from harness.core.files import write_file
from harness.core.versions import versions_of_runs
from harness.old.report.drawing import style
from harness.old.report.drawing.svg import inline_svg
from harness.old.report.screens.tables import Table
from harness.report.player import Player
from harness.scenario import as_written

_TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Drawn:
    """A picture as an ``<svg>`` element."""

    name: str
    title: str
    caption: str
    svg: str


@dataclass(frozen=True)
class Failures:
    """A list of failures under a sentence about them."""

    words: str
    lines: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Page:
    """The content of a page, in the order of ``templates/report.html`` from top to bottom.

    ``where`` describes ``folder``.  ``no_player`` replaces the player.  ``maker`` is the command
    that made the page, and ``made_from`` is its source.
    """

    kind: str
    title: str
    heading: str
    where: str
    folder: str
    screen: Sequence[str]
    opening: Sequence[str] = ()
    tables: Sequence[Table]
    remarks: Sequence[str]
    failures: Failures | None = None
    player: Player | None = None
    no_player: str = ""
    pictures: Sequence[Drawn] = ()
    figure_remarks: Sequence[str] = ()
    facts: Sequence[tuple[str, str]]
    scenario: Sequence[tuple[str, str]] = ()
    maker: str
    made_from: str


def page_in(folder: Path, out: Path | None) -> Path:
    """Return the path of a page: ``out``, or ``report.html`` in a folder.

    Raises:
        InputError: ``out`` is a folder.
    """
    page = out or folder / "report.html"
    if page.is_dir():
        raise InputError(f"--out {page}", "is a folder", "a file to write")
    return page


def drawn(picture: style.Picture) -> Drawn:
    """Return a picture in the template's form."""
    svg = inline_svg(picture.figure, f"f-{picture.name}", picture.title, picture.caption)
    return Drawn(picture.name, picture.title, picture.caption, svg)


def write_page(path: Path, page: Page) -> None:
    """Fill the template and write the page."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.get_template("report.html").render(
        vars(page),
        styles=(_TEMPLATES / "report.css").read_text(encoding="utf-8"),
        scripts=[_script(name) for name in ("page.js", "player.js")],
        version=versions_of_runs()["harness"],
    )
    # A file may contain bytes that are not text, but a page must be text.
    write_file(path, text.encode("utf-8", errors="replace"))


def _script(name: str) -> dict[str, str]:
    """Return a script with its hash.  The page allows only scripts with a listed hash."""
    text = (_TEMPLATES / name).read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return {"text": text, "hash": f"'sha256-{digest}'"}


def flat(tree: JsonObject, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield every key of the scenario with its value."""
    for key, value in tree.items():
        if isinstance(value, dict) and value:
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", "" if value is None else as_written(value)
