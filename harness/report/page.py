"""The page of a result: one file that works from disk, with every text escaped."""

import base64
import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jinja2

from harness.core.errors import checked
from harness.core.files import check_target, write_file
from harness.core.versions import versions_of_runs
from harness.report.pictures import DrawnPicture, pictures_of, pictures_of_result
from harness.report.player import player_of
from harness.report.screen import below, confidence_of, filled
from harness.report.style import save, styled
from harness.report.svg import inline_svg
from harness.report.words import numbers_of, plain_text, text_and_ends
from harness.results.loaded_run import Run
from harness.results.result import Entered, Result, Table
from harness.results.tables import TABLES_OF
from harness.scenario.variation import flatten
from harness.studies.page_content import PageContent, page_content

_TEMPLATES = Path(__file__).parent / "templates"
_NO_BREAK = "\N{NO-BREAK SPACE}"
_MOST_FAILURES = 10
"""Failures that a page lists; it says how many more there are."""
_MOST_VALUES = 12
"""Distinct texts of a list on a page; a sign says that there are more."""


class Written(NamedTuple):
    """The files of a page, and what its reader should know about its episodes."""

    page: Path
    figures: tuple[Path, ...]
    warnings: tuple[str, ...] = ()


class _Cell(NamedTuple):
    """A cell of a table; ``sort`` is a number's sort key, empty if it is undefined."""

    text: str
    small: str = ""
    sort: str | None = None


class _Table(NamedTuple):
    id: str
    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[_Cell]]
    lines: Sequence[str] = ()
    sortable: bool = False


class _RunParts(NamedTuple):
    """What the page of a run has besides results."""

    folder: str = ""
    failures: tuple[str, ...] = ()
    episodes: bool = False
    player: object = None
    scenario: _Table | None = None


@checked
def write_report(
    folder: Path | str,
    out: Path | str | None = None,
    figures: Path | str | None = None,
    settings: Mapping[str, Any] | None = None,
    *,
    mu0: float | None = None,
    kappa0: float | None = None,
) -> Written:
    """Write the page of a run or risk: results, comparison, figures and a player of episodes.

    Args:
        folder: the folder of a run or of a risk with events.
        out: the file; by default ``report.html`` in the folder.
        figures: a folder for the figures, made if it is missing.
        settings: of a run, other thresholds of conflicts, as for ``load_run``.
        mu0, kappa0: as for ``compare``.

    Returns:
        The files.  A warning says why there are no episodes, or which differ from their record.

    Raises:
        InputError: the folder holds no run, no pair is finished, a limit is out of range, or a
            setting is refused.
        HarnessError: a file cannot be written.
    """
    page = Path(out or Path(folder) / "report.html")
    check_target(page)
    content = page_content(Path(folder), settings, mu0=mu0, kappa0=kappa0)
    return write_page(content, page, Path(figures) if figures else None)


def write_page(content: PageContent, page: Path, figures: Path | None = None) -> Written:
    """Write a run's page, and on request its figures as PNG and PDF.

    Args:
        content: what it shows.
        page: the file.
        figures: a folder for the figures, made if it is missing.

    Raises:
        HarnessError: a file cannot be written.
    """
    run, shown, written = content.run, content.shown, list[Path]()
    with styled():
        drawn = list(pictures_of(content))
        if figures is not None:
            for picture, caption, figure in drawn:
                written += save(figure, caption, figures, picture.name)
        _write(
            page,
            [content.result, *([content.compared] if content.compared else [])],
            [(picture.name, picture.title, caption, figure) for picture, caption, figure in drawn],
            [*_facts(run, content.result)],
            _RunParts(
                str(run.path),
                (*_failures(run), *content.warnings),
                episodes=content.has_episodes,
                player=player_of(run, shown) if shown else None,
                scenario=_scenario(run),
            ),
        )
    return Written(page, tuple(written), content.warnings)


def write_result(result: Result, page: Path, drawn: Sequence[DrawnPicture] = ()) -> Path:
    """Write the page of a result that has no run.

    Args:
        result: the result.
        page: the file.
        drawn: its pictures, in place of those of its first table.

    Raises:
        HarnessError: the file cannot be written.
    """
    facts = [(name, plain_text(value)) for name, value in result.facts.items()]
    with styled():
        _write(page, [result], drawn or pictures_of_result(result), facts, _RunParts())
    return page


def _write(
    page: Path,
    results: Sequence[Result],
    drawn: Iterable[DrawnPicture],
    facts: Sequence[tuple[str, str]],
    of_run: _RunParts,
) -> None:
    """Write a page; call this inside ``styled``."""
    result = results[0]
    pictures = [
        {
            "name": name,
            "title": title,
            "caption": caption,
            "svg": inline_svg(figure, f"f-{name}", title, caption),
        }
        for name, title, caption, figure in drawn
    ]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES), autoescape=True,
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    text = environment.get_template("report.html").render(
        result=result,
        screen=_table(result.screen, "screen", confidence_of(result)),
        notes=_notes(results),
        pictures=pictures,
        tables=list(_tables(results)),
        remarks=[remark for result in results for remark in result.remarks],
        facts=facts,
        **of_run._asdict(),
        styles=(_TEMPLATES / "report.css").read_text(encoding="utf-8"),
        scripts=[_script(name) for name in ("page.js", "player.js")],
        version=versions_of_runs()["harness"],
    )  # fmt: skip
    # A file may contain bytes that are not text, but a page must be text.
    write_file(page, text.encode("utf-8", errors="replace"))


def _notes(results: Sequence[Result]) -> list[str]:
    """All notes, the worst first; later results add none with a key of the first result."""
    said = {note.key for note in results[0].notes}
    more = (note for each in results[1:] for note in each.notes if note.key not in said)
    return [note.text for note in sorted((*results[0].notes, *more), key=lambda note: note.rank)]


def _tables(results: Iterable[Result]) -> Iterator[_Table]:
    """Yield the tables of all numbers; that of a comparison's screen comes first."""
    for number, result in enumerate(results):
        screen = [] if number == 0 else [result.screen]
        for place, table in enumerate([*screen, *result.full]):
            yield _table(table, f"table-{number}-{place}", confidence_of(result), result.title)


def _table(table: Table, name: str, confidence: float, title: str = "") -> _Table:
    """A table with intervals below its numbers; it can be sorted if its rows are no measures."""
    table = filled(table)
    headings = [column.heading for column in table.columns]
    rows = [[_cell(cell, confidence) for cell in row] for row in table.rows]
    sortable = len(rows) > 1 and headings[0] != ""
    return _Table(name, table.title or title, headings, rows, below(table, confidence), sortable)


def _cell(cell: Entered, confidence: float) -> _Cell:
    if not (numbers := numbers_of(cell)):
        number = isinstance(cell, int | float) and not isinstance(cell, bool)
        return _Cell(plain_text(cell), "", repr(cell) if number else None)
    text, small = text_and_ends(cell, confidence)
    value = numbers[0].finding.value
    return _Cell(_unbroken(text), _unbroken(small), "" if value is None else repr(value))


def _unbroken(text: str) -> str:
    """A text that is broken only between the numbers of both arms."""
    return text.replace(" ", _NO_BREAK).replace(f"/{_NO_BREAK}", "/ ")


def _failures(run: Run) -> Iterator[str]:
    for cell, pair, arm, reason in run.failures[:_MOST_FAILURES]:
        yield f"cell {cell}, pair {pair}, {arm}: {reason}"
    if (more := len(run.failures) - _MOST_FAILURES) > 0:
        yield f"… and {more:,} more, in the table {TABLES_OF[run.kind][0].name}."


def _facts(run: Run, result: Result) -> Iterator[tuple[str, str]]:
    """Yield what a run was made of and with: name and value."""
    for name, value in result.facts.items():
        yield name, plain_text(value)
    for key in run.study.cells[0].varied:
        yield f"varied: {key}", _first_few(plain_text(cell.varied[key]) for cell in run.study.cells)
    made = run.manifest["simulated_with"]
    yield "simulated with", ", ".join(f"{name} {each}" for name, each in made["versions"].items())
    for name, digest in made["strategies"].items():
        yield f"strategy {name}", f"sha256 {digest[:16]}…"
    for name, digest in made["models"].items():
        yield "interaction model", f"{name}, sha256 {digest[:16]}…"
    if knowing := run.manifest["know_the_model"]:
        yield "given the interaction model", ", ".join(knowing)
    yield "traces", "kept" if run.manifest["traces"] else "not kept"


def _scenario(run: Run) -> _Table:
    """Every key of the scenario with its values in all cells."""
    values: dict[str, list[str]] = {}
    for cell in run.study.cells:
        for key, value in flatten(cell.scenario.model_dump()).items():
            values.setdefault(key, []).append(plain_text(value))
    rows = [[_Cell(key), _Cell(_first_few(texts))] for key, texts in values.items()]
    return _Table("scenario", "All keys of the scenario", ("key", "value"), rows)


def _first_few(texts: Iterable[str]) -> str:
    """The distinct texts; of many, the first few."""
    each = list(dict.fromkeys(texts))
    return ", ".join(each[:_MOST_VALUES]) + (" …" if len(each) > _MOST_VALUES else "")


def _script(name: str) -> dict[str, str]:
    """A script with its hash; the page allows only scripts with such a hash."""
    text = (_TEMPLATES / name).read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return {"text": text, "hash": f"'sha256-{digest}'"}
