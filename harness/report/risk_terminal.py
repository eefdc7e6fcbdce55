"""The result of ``harness risk`` on the terminal."""

from pathlib import Path
from typing import Any

from harness.report.console import make_console, print_table
from harness.report.tables import Table, TableCell, counted, level, per_cent

_PEOPLE_SHOWN = 4


def print_risk(result: dict[str, Any], folder: Path) -> None:
    """Print the sentence, the ways to the event, and what warns."""
    console = make_console()
    console.print(sentence(result))
    console.print(effort(result))
    if result["ways"]:
        print_table(console, ways_table(result["ways"]))
    for warning in result["warnings"]:
        console.print(f"warning: {warning}")
    for difference in (*result["differences"], *result["ties"]):
        console.print(f"  {difference}")
    console.print(
        f"written to {folder}; the likeliest of them again: harness run {folder}/critical.toml"
        if result["ways"]
        else f"written to {folder}"
    )


def sentence(result: dict[str, Any]) -> str:
    """The probability and what it leaves out, or that no way to the event was found."""
    who = f"{result['strategy']} ({result['arm']}) in {result['scenario']}"
    asked, sure = f"P({result['event']})", level(result["confidence"])
    if result["failed"] == result["episodes"]:
        return (
            f"{who}: all {counted(result['episodes'], 'episode')} failed; nothing is known of "
            f"{asked}."
        )
    bound = f"{result['nominal_high']:.2g} (one-sided {sure}; {nominal_words(result)})"
    if result["probability"] is None and result["events_in_all"]:
        seen = result["events_in_all"] - result["first_look_events"]
        return (
            f"{who}: no estimate of {asked}, as none of its {counted(result['draws'], 'draw')} "
            f"ended in the event. {result['first_look_events']:,} of the "
            f"{result['first_look_draws']:,} episodes of the first look did, and {seen:,} of the "
            f"exploration. {asked} is at most {bound}."
        )
    if result["probability"] is None:
        event = "to crash" if result["event"] == "crashed" else f"to {result['event']}"
        return (
            f"{who}: no way {event} was found in {counted(result['episodes'], 'episode')}. "
            f"{asked} is at most {bound}."
        )
    found = "" if result["by_brute_force"] else "the ways to the event that were found add up to "
    estimate = (
        f"{who}: {found}{asked} = {result['probability']:.3g} "
        f"[{result['ci_low']:.3g}, {result['ci_high']:.3g}] per episode"
    )
    if result["by_brute_force"]:
        return f"{estimate} ({sure} interval, by brute force, which leaves no way out)."
    return (
        f"{estimate} ({sure} interval). Ways that the exploration did not find may add up to "
        f"{bound}."
    )


def nominal_words(result: dict[str, Any]) -> str:
    """What the bound on ways that were not found rests on."""
    events = counted(result["nominal_events"], "event")
    return f"{events} in {counted(result['nominal_draws'], 'nominal draw')}"


def effort(result: dict[str, Any]) -> str:
    """How many episodes it took, and what was left out."""
    words = counted(result["episodes"], "episode")
    if result["brute_force_episodes"] is not None:
        words += f"; brute force would have needed {result['brute_force_episodes']:,}"
        words += f"; effective sample size {result['effective_sample_size']:.0f}"
    words += f"; {result['compared_with_other_engine']:,} run in both engines, "
    ties = result["differing_by_a_tie"]
    words += f"{result['differing']:,} differ" if result["differing"] else "all equal"
    words += f" but for {ties:,} that differ by a tie of the strategy" if ties else ""
    if result["timed_out"]:
        words += f"; {result['timed_out']:,} timed out and count as no event"
    if result["failed"]:
        worst = result["probability_worst"]
        words += f"; {result['failed']:,} failed and count as no event; "
        words += f"if all of them were events, P({result['event']}) would be {worst:.3g}"
    return words + "."


def ways_table(ways: list[dict[str, Any]]) -> Table:
    """The likeliest ways to the event, each with the people of its likeliest episode."""
    rows = []
    for way in ways:
        people = "; ".join(person_words(person) for person in way["pedestrians"][:_PEOPLE_SHOWN])
        first, last = way["critical_pairs"]
        share = TableCell(f"{per_cent(way['share'], 0)} %", sort=str(way["share"]))
        rows.append((share, TableCell(people), TableCell(f"{first} to {last}")))
    headings = ("share", "the first pedestrians of the likeliest episode", "pairs of critical.toml")
    return Table("ways", "The likeliest ways to the event", headings, tuple(rows))


def person_words(person: dict[str, Any]) -> str:
    """Who comes, when, and how."""
    words = [f"{person['arrival_s']:.1f} s {person['side']}"]
    if person["quantile"] is None:
        words.append("timed")
    else:
        words.append(f"walks at quantile {person['quantile']:.3f}")
    if person["critical_gap_s"] is not None:
        words.append(f"gap {person['critical_gap_s']:.1f} s")
    if person["found_at_look"] is not None:
        words.append(f"found at look {person['found_at_look']}")
    return ", ".join(words)
