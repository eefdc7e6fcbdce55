"""A validation's tables and JSON document, for the terminal and the page alike."""

from collections.abc import Sequence
from typing import Any

from harness.comparison import Interval
from harness.errors import one_line
from harness.report.console import make_console, print_table
from harness.report.tables import Table, TableCell, count_cell, interval_cell, number, share_cell
from harness.validation import FIGURES, LEFT_OUT, DriverFigures, Validation

_DIGITS = 2


def validation_document(validation: Validation) -> list[dict[str, Any]]:
    """One object for each driver, the nearest to the recorded drivers first."""
    passages = validation.passages
    shared = {
        "passages": len(passages.used),
        "vehicles": passages.vehicles,
        "encounters": passages.encounters,
        "contacts_recorded": sum(one.contact for one in validation.recorded),
        "left_out": dict(passages.left_out),
        "remarks": list(validation.remarks),
    }
    documents = []
    for place in validation.ranked:
        figures = validation.figures[place.driver]
        documents.append(
            {
                "driver": place.driver,
                "rank": place.rank,
                "not_told_apart": list(place.not_told_apart),
                "score_difference_s": place.difference_s,
                "score_difference_interval_s": place.difference_interval_s,
                "draws": figures.draws,
                "sources": list(validation.sources),
                "fitted_on_these_data": place.driver in validation.in_sample,
                "folds": validation.folds.get(place.driver, 0),
                **shared,
                **figures.values,
                "intervals": dict(figures.intervals),
                "undefined": dict(figures.left_out),
            }
        )
    return documents


def validation_tables(validation: Validation) -> list[Table]:
    """The ranking, what else was measured, and what was left out."""
    ordered = [(place, validation.figures[place.driver]) for place in validation.ranked]
    ranking = []
    for place, figures in ordered:
        ranking.append(
            (
                TableCell(str(place.rank), sort=str(place.rank)),
                TableCell(place.driver, _fitted(validation, place.driver)),
                _cell(figures, "pass_time_score_s"),
                _cell(figures, "pass_time_error_mean_s"),
                _cell(figures, "pass_time_error_median_s"),
                _cell(figures, "pass_time_error_p90_s"),
                share_cell(_interval(figures, "order_right")),
                _contacts(figures),
                TableCell(", ".join(place.not_told_apart) or "–"),
            )
        )
    recorded = sum(one.contact for one in validation.recorded)
    zero = TableCell("0", sort="0")
    ranking.append(
        (
            TableCell(""),
            TableCell("recorded drivers"),
            *(zero,) * 4,
            TableCell("100.0 %", sort="1"),
            TableCell(str(recorded), sort=str(recorded)),
            TableCell(""),
        )
    )
    headings = (
        "",
        "driver",
        "score s",
        "mean s",
        "median abs s",
        "90 % abs s",
        "order right",
        "contacts",
        "not told apart from",
    )
    caption = "Pass time, simulated less recorded; who passes first"
    return [
        Table("validation", caption, headings, tuple(ranking), sortable=True),
        _further(ordered),
        _left_out(validation),
    ]


def _further(ordered: Sequence[tuple[Any, DriverFigures]]) -> Table:
    names = [name for name in FIGURES if "rmse" in name or "distance" in name]
    rows = [
        (
            TableCell(figures.driver),
            *(_cell(figures, name) for name in names),
            TableCell(number(figures.values["order_brier"], 3) if figures.random else "–"),
            count_cell(round(figures.values["timed_out"] or 0.0)),
        )
        for _, figures in ordered
    ]
    headings = (
        "driver",
        "position 1 s m",
        "2 s m",
        "4 s m",
        "least speed m/s",
        "PET s",
        "time advantage s",
        "Brier",
        "timed out",
    )
    caption = "Root mean square errors of position; Wasserstein distances of distributions"
    return Table("validation-further", caption, headings, tuple(rows), sortable=True)


def _left_out(validation: Validation) -> Table:
    rows = [
        (TableCell(reason), count_cell(count), TableCell(LEFT_OUT[reason]))
        for reason, count in validation.passages.left_out.items()
    ]
    return Table("validation-left-out", "Left out", ("reason", "number", "rule"), tuple(rows))


def print_validation(validation: Validation) -> None:
    """The tables on the terminal."""
    console, passages = make_console(), validation.passages
    console.print(
        f"{len(passages.used)} passages of {passages.vehicles} recorded vehicles, "
        f"{passages.encounters} encounters ({', '.join(validation.sources)}).",
        soft_wrap=True,
    )
    for table in validation_tables(validation):
        print_table(console, table)
    console.print(
        "Ranked by the mean score of the pass time (without randomness its mean absolute error); "
        "intervals are 95 % of a bootstrap over vehicles. Recorded pedestrians do not react: "
        "contacts count against every driver; in brackets those that only this explains.",
        soft_wrap=True,
    )
    for remark in validation.remarks:
        console.print(one_line(remark), soft_wrap=True)


def _fitted(validation: Validation, driver: str) -> str:
    if validation.folds.get(driver):
        return f"fitted again without each of {validation.folds[driver]} folds"
    return "fitted on these data" if driver in validation.in_sample else ""


def _interval(figures: DriverFigures, name: str) -> Interval:
    low, high = figures.intervals[name] or (None, None)
    return Interval(figures.values[name], low, high)


def _cell(figures: DriverFigures, name: str) -> TableCell:
    return interval_cell(_interval(figures, name), _DIGITS)


def _contacts(figures: DriverFigures) -> TableCell:
    contacts = figures.values["contacts"] or 0.0
    explained = figures.values["contacts_explained"] or 0.0
    digits = 1 if figures.random else 0
    return TableCell(f"{contacts:.{digits}f} ({explained:.{digits}f})", sort=repr(contacts))
