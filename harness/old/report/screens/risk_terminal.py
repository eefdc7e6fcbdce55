"""The first screen and the tables of a risk estimate."""

import shlex
from collections.abc import Iterator
from pathlib import Path

from harness.old.report.screens.console import make_console, print_table
from harness.old.report.screens.screen import Screen, screen_lines
from harness.old.report.screens.tables import Table, TableCell, counted, level, per_cent
from harness.old.studies.risk.asking import SettingsDocument
from harness.old.studies.risk.findings import ENTRIES, Person, RiskFindings
from harness.old.studies.risk.folder import read_settings

_PEOPLE_SHOWN = 2
"""Maximum number of pedestrians of a way, if the event is not due to one of them."""


def print_risk(findings: RiskFindings, folder: Path, full: bool = False) -> None:
    """Print the first screen, or every note and number with ``full``."""
    console = make_console()
    screen = risk_screen(findings, folder, read_settings(folder), full=full)
    for line in screen_lines(screen, console.width):
        console.print(line)
    for table in risk_tables(findings) if full else ():
        print_table(console, table)


def risk_screen(
    findings: RiskFindings,
    folder: Path,
    settings: SettingsDocument,
    *,
    full: bool = False,
) -> Screen:
    """Return the first screen of a risk estimate; ``full`` removes its limit of lines."""
    footer = f"All numbers: --full. Page: harness report {shlex.quote(str(folder))}"
    if findings.ways:
        footer += f"; its episodes: harness run {shlex.quote(str(folder / 'critical.toml'))}"
    return Screen(
        title=heading(findings),
        scope=f"{counted(findings.episodes, 'episode')}, seed {settings.seed}",
        headings=("", "estimate", f"{level(findings.confidence)} interval"),
        rows=tuple(_rows(findings)),
        notes=findings.notes,
        footer=footer,
        site=f"Scenario: {settings.name}.",
        always=3,
        most_lines=None if full else 16,
    )


def heading(findings: RiskFindings) -> str:
    """Return the heading, which names the event, the scenario and the method."""
    who = f"{findings.strategy} ({findings.arm.value})"
    method = "brute force" if findings.by_brute_force else "weighted draws"
    return f"{findings.scenario}: probability of {findings.event}, {who}, by {method}"


def _rows(findings: RiskFindings) -> Iterator[tuple[str, ...]]:
    values = findings.findings
    probability, bound = values["probability"], values["nominal_high"]
    ways = "all ways" if findings.by_brute_force else "ways that were found"
    limits = f"{number(probability.low)} … {number(probability.high)}"
    yield (
        f"probability per episode, {ways}",
        number(probability.value),
        limits if probability.value is not None else "",
    )
    if not findings.by_brute_force or probability.value is None:
        yield ("upper bound on all ways, one-sided", number(bound.value), nominal_words(findings))
    yield (
        "effective sample size",
        number(findings.effective_sample_size),
        f"{counted(findings.events, 'event')} in {counted(findings.draws, 'draw')}",
    )
    yield (
        "episodes that brute force would need",
        number(findings.brute_force_episodes),
        "for the same standard error",
    )
    estimate = findings.episodes_to_estimate
    other = findings.episodes - estimate
    yield (
        "episodes run",
        f"{other:,} to explore, {estimate:,} to estimate, {findings.timed_out:,} timed out",
    )
    if findings.failed or findings.timed_out:
        worst = number(findings.probability_worst)
        yield ("worst case", f"{worst} (failed episodes count as events)")
    for way in findings.ways:
        culprits = [person for person in way.pedestrians if person.culprit]
        shown = culprits or way.pedestrians[:_PEOPLE_SHOWN]
        people = "; ".join(map(person_words, shown))
        more = len(way.pedestrians) - len(shown)
        yield (
            f"way with {per_cent(way.share, 0)} % of the probability",
            f"{people}; {more} more" if more > 0 else people,
        )


def nominal_words(findings: RiskFindings) -> str:
    """Return the number of draws behind the upper bound, in words."""
    events = counted(findings.nominal_events, "event")
    return f"{events} in {counted(findings.nominal_draws, 'nominal draw')}"


def number(value: float | str | None) -> str:
    """Format a number: whole numbers in full up to a million, others to three digits.

    >>> number(999_999), number(9.2345e-10), number(None)
    ('999,999', '9.23e-10', '–')
    """
    if value is None:
        return "–"
    whole = isinstance(value, int) and value < 1_000_000
    return f"{value:,}" if whole else f"{value:.3g}"


def person_words(person: Person) -> str:
    """Describe a pedestrian: side, arrival time and other sampled values.

    >>> person_words(Person(arrival_s=1.5, side="far", walking_speed_mps=1.3, critical_gap_s=None,
    ...                     seen_after_s=0.2))
    'far at 1.5 s, walks at 1.30 m/s, seen after 0.2 s'
    """
    words = [f"{person.side.value} at {person.arrival_s:.1f} s"]
    speed = person.walking_speed_mps
    words.append("does not walk" if speed is None else f"walks at {speed:.2f} m/s")
    if person.critical_gap_s is not None:
        words.append(f"gap {person.critical_gap_s:.1f} s")
    if person.threshold_s is not None and person.latency_s is not None:
        words.append(f"threshold {person.threshold_s:.1f} s, latency {person.latency_s:.1f} s")
    if person.seen_after_s is not None:
        words.append(f"seen after {person.seen_after_s:.1f} s")
    return ", ".join(words)


def risk_tables(findings: RiskFindings) -> Iterator[Table]:
    """Yield the tables of all numbers, of each way's pedestrians, and of the levels."""
    rows = []
    for entry in ENTRIES:
        finding = findings.findings[entry.key]
        limits = "" if finding.low is None else f"{number(finding.low)} … {number(finding.high)}"
        value = TableCell(
            number(finding.value), limits, "" if finding.value is None else str(finding.value)
        )
        remark = finding.reason or ""
        rows.append((TableCell(entry.heading), value, TableCell(remark)))
    yield Table("estimate", "The estimate", ("number", "value", "remark"), tuple(rows))
    for place, way in enumerate(findings.ways, 1):
        first, last = way.critical_pairs
        people = (
            (
                _cell(person.arrival_s, ".2f"),
                TableCell(person.side.value),
                _cell(person.walking_speed_mps, ".2f"),
                _cell(person.critical_gap_s, ".2f"),
                _cell(person.threshold_s, ".2f"),
                _cell(person.latency_s, ".2f"),
                _cell(person.seen_after_s, ".2f"),
                TableCell("yes" if person.culprit else ""),
            )
            for person in way.pedestrians
        )
        yield Table(
            f"way-{place}",
            f"Way {place}: {per_cent(way.share, 0)} % of the probability, "
            f"{counted(way.events, 'event')}, pairs {first} to {last} of critical.toml; the "
            "pedestrians of its likeliest episode",
            (
                "arrives, s",
                "side",
                "walks at, m/s",
                "critical gap, s",
                "threshold, s",
                "latency, s",
                "seen after, s",
                "event due to",
            ),
            tuple(people),
        )
    levels = [
        (TableCell(str(place)), TableCell(", ".join(f"{score:.3g}" for score in scores) or "none"))
        for place, scores in enumerate(findings.levels, 1)
    ]
    if levels:
        headings = ("exploration", "thresholds of the score")
        yield Table("levels", "The levels of the explorations", headings, tuple(levels))


def _cell(value: float | None, form: str) -> TableCell:
    """Return a pedestrian's number as a cell; empty if it is undefined."""
    return TableCell("") if value is None else TableCell(f"{value:{form}}", sort=str(value))
