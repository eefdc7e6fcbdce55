"""Entries of how bad the contacts are, in hours of traffic and in own simulations."""

from harness.statistics import Entry, Form, Interval
from harness.statistics.severity import (
    NO_FRONT,
    SEVERITIES,
    below_meaning,
    crossings_meaning,
    passages_meaning,
)
from harness.store.arm_columns import ArmColumns


def severity_entries(passages: str) -> tuple[Entry[ArmColumns], ...]:
    """The entries of both severities, and the contacts that they leave out.

    Args:
        passages: what the passages are counted by, in words.
    """
    return (
        Entry(
            "side_contacts",
            "contacts with a vehicle's side, left out below",
            "Contacts in which the vehicle's side touched someone. No expected injury counts them.",
            form=Form.COUNT,
            of_arm=lambda c, arm: c.total("side_contacts", arm),
        ),
        *(entry for severity in SEVERITIES for entry in _entries(*severity, passages)),
    )


def _entries(
    key: str, risk: str, heading: str, what: str, passages: str
) -> tuple[Entry[ArmColumns], ...]:
    return (
        _per_million(
            f"{key}_per_million_passages",
            f"{heading} per million passages",
            passages_meaning(what, passages),
            risk,
            "reached",
        ),
        _per_million(
            f"{key}_per_million_crossings",
            f"{heading} per million crossings",
            crossings_meaning(what),
            risk,
            "crossed",
        ),
        Entry(
            f"{key}_below_curve",
            f"{heading}, share below the published curve",
            below_meaning(what),
            form=Form.SHARE,
            digits=0,
            of_arm=lambda c, arm: c.below_curve(risk, arm),
            undefined=NO_FRONT,
        ),
    )


def _per_million(key: str, heading: str, meaning: str, risk: str, trials: str) -> Entry[ArmColumns]:
    return Entry(
        key,
        heading,
        meaning,
        digits=1,
        of_arm=lambda c, arm: c.expected(risk, trials, arm),
        paired=lambda c: c.expected_difference(risk, trials),
        interval=Interval,
        undefined=NO_FRONT,
    )
