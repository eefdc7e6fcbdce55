"""A finished risk as one page: the estimate, and the ways to the event."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from harness.report.risk_terminal import effort, sentence, ways_table
from harness.report.tables import Table, TableCell, level, per_cent
from harness.report.template import flat, page_in, write_page
from harness.scenario import as_written

_PEOPLE_SHOWN = 12


def write_risk_page(
    folder: Path, asked: dict[str, Any], result: dict[str, Any], out: Path | None = None
) -> Path:
    """Write a risk's page.

    Args:
        folder: of the risk.
        asked: what its ``risk.json`` holds.
        result: what its ``result.json`` holds.
        out: the file; default ``report.html`` in the folder.

    Raises:
        InputError: the place is a folder.
    """
    page = page_in(folder, out)
    write_page(page, _context(folder, asked, result))
    return page


def _context(folder: Path, asked: dict[str, Any], result: dict[str, Any]) -> dict[str, Any]:
    heading = f"{result['scenario']}: how often {result['strategy']} meets {result['event']}"
    critical = shlex.quote(str(folder / "critical.toml"))
    differing = [*result["differences"], *result["ties"]]
    return {
        "kind": "risk",
        "title": f"{heading}, risk",
        "heading": heading,
        "where": "Folder",
        "folder": str(folder),
        "opening": [sentence(result), effort(result)],
        "caveats": result["warnings"],
        "tables": list(_tables(result)),
        "remarks": [
            "The estimate is by brute force: the share of events among independent nominal draws, "
            "which leaves no way to the event out."
            if result["by_brute_force"]
            else "The estimate is the mean weight of independent draws around the events that the "
            "explorations found. It is that of the ways found; of all other ways only the nominal "
            "draws say how much they may add up to."
        ],
        "failures": {
            "words": "Episodes in which two engines differ, the first:",
            "lines": differing,
        }
        if differing
        else None,
        "no_player": f"The likeliest episodes are pairs of a scenario: harness run {critical} "
        "--traces --out CRITICAL, then harness report CRITICAL, whose page plays them."
        if result["ways"]
        else "No episode of the estimate ended in the event.",
        "figure_remarks": ["A risk has no figures."],
        "facts": list(_facts(asked)),
        "scenario": list(flat(asked["scenario"])),
        "maker": "harness report",
        "made_from": "the folder of harness risk alone",
    }


def _tables(result: dict[str, Any]) -> Iterator[Table]:
    of = "" if result["by_brute_force"] else " of the ways found"
    sure = level(result["confidence"])
    rows = [
        (f"probability{of}", result["probability"]),
        (f"{sure} interval, low", result["ci_low"]),
        (f"{sure} interval, high", result["ci_high"]),
        (f"upper bound by nominal draws alone, one-sided {sure}", result["nominal_high"]),
        ("nominal draws", result["nominal_draws"]),
        ("events among the nominal draws", result["nominal_events"]),
        ("probability if all failed episodes were events", result["probability_worst"]),
        ("coefficient of variation", result["coefficient_of_variation"]),
        ("effective sample size", result["effective_sample_size"]),
        ("episodes run", result["episodes"]),
        ("independent draws of the estimate", result["draws"]),
        ("events among them", result["events"]),
        ("brute force would have needed", result["brute_force_episodes"]),
    ]
    yield Table(
        "estimate",
        "The estimate",
        ("what", "value"),
        tuple((TableCell(name), _number(value)) for name, value in rows),
    )
    if result["ways"]:
        yield ways_table(result["ways"])
    for number, way in enumerate(result["ways"], 1):
        yield _people_table(number, way)
    levels = [
        (TableCell(str(number)), TableCell(", ".join(f"{level:.3g}" for level in of) or "none"))
        for number, of in enumerate(result["levels"], 1)
    ]
    if levels:
        headings = ("exploration", "thresholds of the score")
        yield Table("levels", "The levels gone through", headings, tuple(levels), folded=True)


def _people_table(number: int, way: dict[str, Any]) -> Table:
    rows = []
    for person in way["pedestrians"][:_PEOPLE_SHOWN]:
        side = TableCell(person["side"])
        quantile = _given(person["quantile"], ".3f")
        gap, look = _given(person["critical_gap_s"], ".2f"), _given(person["found_at_look"], "d")
        rows.append((_given(person["arrival_s"], ".2f"), side, quantile, gap, look))
    return Table(
        f"way-{number}",
        f"Who comes in the likeliest episode of way {number}: {per_cent(way['share'], 0)} % of the "
        f"probability, {way['events']:,} events",
        (
            *("arrives, s", "from the side", "quantile of the walking speed", "critical gap, s"),
            "found at look",
        ),
        tuple(rows),
        folded=True,
    )


def _given(value: float | None, form: str) -> TableCell:
    """A number of a person; empty where they have none."""
    return TableCell("") if value is None else TableCell(f"{value:{form}}", sort=str(value))


def _number(value: float | None) -> TableCell:
    if value is None:
        return TableCell("undefined", sort="")
    text = f"{value:,}" if isinstance(value, int) else f"{value:.3g}"
    return TableCell(text, sort=str(value))


def _facts(asked: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "scenario", asked["name"]
    yield "arm", asked["arm"]
    yield "event", asked["event"]
    yield "engine", "SUMO" if asked["in_sumo"] else "plain, checked in SUMO"
    yield "wanted coefficient of variation", as_written(asked["target_cv"])
    yield "seed", str(asked["seed"])
    model = asked["model"]
    yield "interaction model", f"{model['name']}, sha256 {model['sha256'][:16]}…"
    yield "versions", ", ".join(f"{name} {of}" for name, of in asked["versions"].items())
