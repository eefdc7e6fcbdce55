"""Writes the page of a run folder."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from harness.core.encounter import Arm
from harness.old.report.drawing import style
from harness.old.report.drawing.plots import save
from harness.old.report.pages.inputs import models_of, strategies_of
from harness.old.report.pages.kinds import parts_of
from harness.old.report.pages.player import run_player
from harness.old.report.pages.template import Failures, Page, drawn, flat, page_in, write_page
from harness.old.report.screens.result_screen import screen_of
from harness.old.report.screens.result_tables import cells_table, full_tables
from harness.old.report.screens.screen import screen_lines
from harness.old.report.screens.tables import Table, counted
from harness.old.studies.runs.model_use import model_cells
from harness.old.studies.runs.notes import sentence
from harness.old.studies.runs.reported import remarks as remarks_on, reported
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import shown_pairs
from harness.scenario import as_written, remarks

_MOST_FAILURES = 20
_MOST_VALUES = 12
_MOST_TABLES = 50
"""Maximum number of cells whose full tables are on the page; ``summary.csv`` has all cells."""


@dataclass(frozen=True)
class Written:
    """The files of ``write_report``; ``differing`` lists episodes whose repetition differs."""

    page: Path
    figures: tuple[Path, ...]
    differing: tuple[str, ...]


def write_report(
    run: RunData, out: Path | None = None, figures: Path | None = None, missing: str = ""
) -> Written:
    """Write a run's page, and on request its figures as PDF and PNG.

    Nothing is simulated.  If a run kept no traces, the page shows the pairs of ``write_shown``.

    Args:
        run: a run.
        out: the file; default ``report.html`` in the run folder.
        figures: a folder for the figures, made if missing.
        missing: the reason if there are no episodes to show.

    Raises:
        InputError: tables are damaged, or a file cannot be written.
    """
    page = page_in(run.path, out)
    # Damaged tables raise before anything is written.
    content = _content(run)
    shown = shown_pairs(run, page)
    pictures, figure_remarks = parts_of(run).pictures(run, shown)
    written: list[Path] = []
    drawn_pictures = []
    with style.styled():
        for picture in pictures:
            drawn_pictures.append(drawn(picture))
            if figures is not None:
                style.caption(picture.figure, picture.caption)
                written += save(picture.figure, figures, picture.name)
    content = replace(
        content,
        player=run_player(run, shown) if shown else None,
        no_player=missing or "The run has no traces, so there are no episodes to show.",
        pictures=drawn_pictures,
        figure_remarks=figure_remarks,
    )
    write_page(page, content)
    differing = (f"cell {p.cell} pair {p.pair}: {p.differences[0]}" for p in shown if p.differences)
    return Written(page, tuple(written), tuple(differing))


def _content(run: RunData) -> Page:
    """Return the content of the page without episodes and figures."""
    scenario = run.scenario
    arms = f"{scenario.arms.av} against {scenario.arms.human}"
    heading = f"{run.name}: a sweep" if run.varied_keys else f"{run.name}: {arms}"
    screen, results = _results(run)
    return Page(
        title=f"{heading}, run report",
        heading=heading,
        folder=str(run.path),
        opening=[parts_of(run).opening(run)],
        screen=screen,
        tables=results,
        remarks=[
            *dict.fromkeys(
                sentence(line) for cell in run.study.cells for line in remarks(cell.scenario)
            ),
            *remarks_on(run),
        ],
        failures=_failures(run),
        facts=list(_facts(run)),
        scenario=list(_ran(run).items()),
        kind="run report",
        where="Run folder",
        maker="harness report",
        made_from="the run folder alone",
    )


def _results(run: RunData) -> tuple[list[str], list[Table]]:
    """Return the first screen, and the folded tables of all numbers."""
    findings = reported(run)
    *screen, _ = screen_lines(replace(screen_of(findings), most_lines=None))
    if run.varied_keys:
        tables = [cells_table(findings), *full_tables(findings)[:_MOST_TABLES]]
    else:
        tables = full_tables(findings)
    return screen, [*tables, *parts_of(run).tables(run)]


def _failures(run: RunData) -> Failures | None:
    failed = run.failures
    if not failed:
        return None
    lines = [
        f"cell {cell} pair {pair} {arm}: {reason}"
        for cell, pair, arm, reason in failed[:_MOST_FAILURES]
    ]
    more = f"; the first {_MOST_FAILURES} are listed" if len(failed) > _MOST_FAILURES else ""
    words = f"{counted(len(failed), 'episode')} failed in the engine or in a strategy{more}:"
    return Failures(words, lines)


def _facts(run: RunData) -> Iterator[tuple[str, str]]:
    manifest, ran = run.manifest, _ran(run)
    yield "scenario", run.name
    yield "arms", f"{strategies_of(run, Arm.AV)} (AV), {strategies_of(run, Arm.HUMAN)} (human)"
    for entry in models_of(run):
        yield "interaction model", f"{entry.get('name')}, sha256 {str(entry.get('sha256'))[:16]}…"
    if any(cell.scenario.walks_by_model for cell in run.study.cells):
        yield "how walking speeds are drawn from the model", ran["model.pedestrian_reading"]
    yield "seed", str(manifest["seed"])
    yield "step", f"{ran['experiment.step_s']} s, time-out {ran['experiment.timeout_s']} s"
    for key in run.varied_keys:
        yield f"varied: {key}", _listed(as_written(cell.varied[key]) for cell in run.study.cells)
    made = manifest["simulated_with"]
    yield "simulated with", _named(made["versions"])
    for name, digest in made["strategies"].items():
        yield f"strategy {name}", f"sha256 {digest[:16]}…"
    yield "traces", "stored" if run.kept_traces else "not stored"


def _ran(run: RunData) -> dict[str, str]:
    """Return every key of the scenario that the run used, with its values in all cells."""
    values: dict[str, list[str]] = {}
    modelled = bool(model_cells(run))
    for cell in run.study.cells:
        tree, arms = cell.scenario.model_dump(), cell.scenario.arms.model_dump().values()
        tree["strategies"] = {
            name: tree["strategies"][name] for name in tree["strategies"] if name in arms
        }
        if not modelled:
            del tree["model"]
        for key, text in flat(tree):
            values.setdefault(key, []).append(text)
    return {key: _listed(texts) for key, texts in values.items()}


def _listed(texts: Iterable[str]) -> str:
    """Join the distinct texts; if there are many, only the first few."""
    each = list(dict.fromkeys(texts))
    return ", ".join(each[:_MOST_VALUES]) + (" …" if len(each) > _MOST_VALUES else "")


def _named(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in versions.items())
