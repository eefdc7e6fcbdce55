"""The page of a search: its screen, the Pareto front as a picture, and all trials."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from harness.core.encounter import FloatArray
from harness.report.drawing.plots import save
from harness.report.drawing.style import Picture, caption, new_figure, styled
from harness.report.drawing.tuning_figures import Tried, draw_trials
from harness.report.pages.template import Page, drawn, flat, page_in, write_page
from harness.report.screens.tables import Table, TableCell, sort_key, value_cell
from harness.report.screens.tune_screen import tune_lines
from harness.studies.tuning.folder import Judged, Search

_CAPTION = (
    "Search data: each point is a candidate's estimate on the pairs that steered the search, so "
    "the best ones flatter themselves. The verdict above is on fresh pairs."
)


def write_tune_page(
    search: Search, judged: Judged, out: Path | None = None, figures: Path | None = None
) -> Path:
    """Write the page of a finished search, and on request its figures as PDF and PNG.

    Args:
        search: what was searched.
        judged: its result.
        out: the file; default ``report.html`` in the folder.
        figures: a folder for the figures, made if missing.
    """
    page, pictures = page_in(judged.folder, out), []
    with styled():
        for picture in _pictures(search, judged):
            pictures.append(drawn(picture))
            if figures is not None:
                caption(picture.figure, picture.caption)
                save(picture.figure, figures, picture.name)
    content = Page(
        kind="tune",
        title=f"{search.file.name}, tuning",
        heading=f"{search.file.name}: tuning of {', '.join(p.key for p in search.parameters)}",
        where="Folder",
        folder=str(judged.folder),
        screen=list(tune_lines(search, judged)),
        tables=[_trials(search, judged)],
        remarks=[],
        pictures=pictures,
        no_player="A search shows no episodes; run best.toml to see them.",
        facts=[
            ("pairs of the search", f"{search.pairs:,}"),
            ("fresh pairs", f"{search.fresh:,}"),
            ("engine", search.engine),
        ],
        scenario=list(flat(search.file.scenario().model_dump(mode="json"))),
        maker="harness tune",
        made_from="the search's trials and the fresh pairs",
    )
    write_page(page, content)
    return page


def _pictures(search: Search, judged: Judged) -> Iterator[Picture]:
    goal = search.goal
    known = [
        trial for trial in judged.trials if goal.excesses(trial) is not None and not trial.failed_av
    ]
    numbers = {
        name: np.array([trial.numbers[name] for trial in known], float) for name in goal.names
    }
    front = np.array([trial in judged.front for trial in known], float)
    best = None if judged.best is None else known.index(judged.best)
    across: dict[str, tuple[FloatArray, float | None]] = {
        limit.name: (numbers[limit.name], limit.limit) for limit in goal.limits
    }
    for each in () if across else search.parameters:
        across[each.key] = np.array([trial.candidate[each.key] for trial in known], float), None
    for number, (name, (x, limit)) in enumerate(across.items()):
        figure, (axes,) = new_figure()
        tried = Tried(x, numbers[goal.objective], front, best)
        draw_trials(axes, tried, (name, goal.objective), limit)
        title = f"Pareto front: {goal.objective} and {name} (search data)"
        yield Picture(f"front-{number}", title, _CAPTION, figure)


def _trials(search: Search, judged: Judged) -> Table:
    keys = [parameter.key for parameter in search.parameters]
    rows = []
    for trial in judged.trials:
        numbers = [trial.numbers.get(name) for name in search.goal.names]
        place = "best" if trial == judged.best else "front" if trial in judged.front else ""
        rows.append(
            (
                value_cell(trial.number),
                *(value_cell(trial.candidate[key]) for key in keys),
                *(TableCell("" if n is None else f"{n:.4g}", sort=sort_key(n)) for n in numbers),
                TableCell(trial.refused or trial.failure or place),
            )
        )
    headings = ("trial", *keys, *search.goal.names, "remark")
    caption = "Every trial, with its estimates on the search's pairs (search data)"
    return Table("trials", caption, headings, tuple(rows), sortable=True, folded=True)
