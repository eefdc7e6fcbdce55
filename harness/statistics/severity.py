"""Entries of how bad the contacts are: injuries and deaths that are to be expected from them."""

from dataclasses import replace

from harness.core.encounter import FloatArray
from harness.statistics.bootstrap import UNKNOWN, Resampled
from harness.statistics.encounter_columns import EncounterColumns, count
from harness.statistics.entries import Entry, Form
from harness.statistics.pair_columns import BothArms

PER_MILLION = 1e6

LOWEST_POINT = 0.10
"""The risk at the lowest published point of each curve (Tefft 2013)."""

WHOM = (
    "The curve (Tefft 2013) is about people of 15 years and more in the USA, struck by the front "
    "of a car or a light truck. Contacts with the side and falls count nothing."
)
NO_FRONT = "no moving vehicle hit anyone with its front; the bound of the crashes holds here too"

SEVERITIES = (
    ("serious", "injury_risk", "serious injuries", "serious injuries (AIS 4 or more)"),
    ("fatal", "fatality_risk", "deaths", "deaths"),
)
"""For each severity: start of the keys, column of the risk, heading and words of its meaning."""


def passages_meaning(what: str, passages: str) -> str:
    """The meaning of an expected number per million passages."""
    return (
        f"κ by severity: expected {what} per million {passages}, the sum of the risks of the "
        f"contacts with the front. {WHOM}"
    )


def crossings_meaning(what: str) -> str:
    """The meaning of an expected number per million crossings of people."""
    return f"Expected {what} per million crossings of people, who stepped off. {WHOM}"


def below_meaning(what: str) -> str:
    """The meaning of the share of an expected number that lies below the published points."""
    return (
        f"Share of the expected {what} from contacts slower than the curve's lowest point, "
        "where the risk is the harness's assumption: linear, down to 0 at 0."
    )


def severity_entries() -> tuple[Entry[EncounterColumns], ...]:
    """The entries of both severities, and the contacts that they leave out."""
    rates = [entry for severity in SEVERITIES for entry in _entries(*severity)]
    return (
        Entry(
            "side_contacts",
            "contacts with the vehicle's side, left out below",
            "Crashes in which the vehicle's side touched someone. No expected injury counts them.",
            form=Form.COUNT,
            of_arm=lambda c, arm: count(c.pairs.crashed[arm] & ~c.pairs.front[arm]),
        ),
        *rates,
    )


def _entries(key: str, column: str, heading: str, what: str) -> tuple[Entry[EncounterColumns], ...]:
    def risk(columns: EncounterColumns) -> BothArms:
        both: BothArms = getattr(columns.pairs, column)
        return both

    return (
        Entry(
            f"{key}_per_million_passages",
            f"{heading} per million passages",
            passages_meaning(what, "episodes that did not fail"),
            digits=1,
            of_arm=lambda c, arm: _expected(c, risk(c)[arm], c.ran(arm), arm),
            paired=lambda c: _difference(c, risk(c)),
            interval=Resampled,
            reliable_from=200,
            undefined=NO_FRONT,
        ),
        Entry(
            f"{key}_per_million_crossings",
            f"{heading} per million crossings",
            crossings_meaning(what),
            digits=1,
            of_arm=lambda c, arm: _expected(c, risk(c)[arm], c.pairs.met[arm], arm),
            interval=Resampled,
            reliable_from=200,
            undefined=NO_FRONT,
        ),
        Entry(
            f"{key}_below_curve",
            f"{heading}, share below the published curve",
            below_meaning(what),
            form=Form.SHARE,
            digits=0,
            of_arm=lambda c, arm: share_below(risk(c)[arm][c.ran(arm)]),
            undefined=NO_FRONT,
        ),
    )


def share_below(risk: FloatArray, weights: FloatArray | float = 1.0) -> float | None:
    """The share of a sum of risks that comes from below the lowest point; None if the sum is 0.

    >>> import numpy as np
    >>> share_below(np.array([0.0, 0.05, 0.2]))
    0.2
    """
    risks = weights * risk
    total = float(risks.sum())
    return float(risks[risk < LOWEST_POINT].sum()) / total if total else None


def _expected(
    columns: EncounterColumns, risk: FloatArray, trials: FloatArray, arm: int
) -> Resampled:
    """The sum of the risks of an arm per million trials, over the episodes that did not fail."""
    ran = columns.ran(arm)
    if not risk[ran].any():
        return UNKNOWN
    rate = columns.ratio(PER_MILLION * risk[ran], trials[ran].astype(float))
    # Only contacts with the front inform about the sum of the risks.
    return replace(rate, informative=count(risk[ran] > 0))


def _difference(columns: EncounterColumns, risk: BothArms) -> Resampled:
    """The AV's expected number per million passages minus the reference's; both must have some."""
    av, human = (each[~columns.pairs.any_failed] for each in risk)
    if not (av.any() and human.any()):
        return UNKNOWN
    return columns.mean(PER_MILLION * (av - human))
