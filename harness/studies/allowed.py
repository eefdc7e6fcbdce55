"""The paper's allowed interval: which values of a parameter keep μ below μ0 and κ below κ0.

μ is over all pairs in which the AV crossed; κ counts time-outs and failures of the strategy as
crashes, because an AV that does not arrive is not allowed.  The m values of a sweep have 2 m upper
bounds that hold together, each one-sided at 1 − level / 2m (Bonferroni), and as many lower bounds.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

from harness.core.errors import InputError, Parameter
from harness.core.seeding import resampling
from harness.results import estimators
from harness.results.columns import AV
from harness.results.finding import Finding, Form, Plain, Style
from harness.results.place import name_of
from harness.results.result import Column, Shown, Table
from harness.strategies.registry import table_key

if TYPE_CHECKING:
    from harness.studies.candidates import Candidate

RELIABLE_FROM = 2_000
"""Informative pairs from which on the bound of μ is reliable; an unreliable one decides nothing."""

Judgement = Literal["allowed", "denied", "undecided"]


def as_number(value: Plain) -> float | None:
    """A value of a scenario's key if it is a number."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


class Judged(NamedTuple):
    """A value of a parameter with its bounds, which hold over all values together."""

    value: float
    mu: Finding
    kappa: Finding
    verdict: Judgement


class Allowed(NamedTuple):
    """The verdicts on the ascending values of a strategy's parameter.

    ``where`` has the other swept keys, and the run if there are several.
    """

    key: str
    where: str
    mu0: float
    kappa0: float
    rows: tuple[Judged, ...]

    @property
    def title(self) -> str:
        """What is judged, and by which limits."""
        where = f" ({self.where})" if self.where else ""
        return f"{self.key} with μ < {self.mu0:g} and κ < {self.kappa0:g}{where}"

    @property
    def values(self) -> str:
        """Each value with its verdict."""
        return ", ".join(f"{row.value:g} {row.verdict}" for row in self.rows)


def allowed_in(
    groups: "Sequence[Sequence[Candidate]]",
    mu0: float | None,
    kappa0: float | None,
    confidence: float,
) -> list[Allowed]:
    """The verdicts on each parameter of a strategy, at equal other keys; none without limits.

    Raises:
        InputError: a limit is out of range, only one is given, they are not encounters, or no
            numeric parameter of the AV's strategy is swept.
    """
    if mu0 is None and kappa0 is None:
        return []
    limits = _limit("mu0", mu0, "above 0"), _limit("kappa0", kappa0, "above 0, at most 1", 1.0)
    if any(each.run.kind != "encounters" for group in groups for each in group):
        raise InputError(Parameter("mu0"), "is a limit of encounters", "a run of encounters")
    sweeps: dict[tuple[str, str], list[Candidate]] = {}
    for each in (each for group in groups for each in group):
        varied, table = each.cell.varied, f"{table_key(each.cell.scenario.arms.av)}."
        for key in (key for key in each.own if key.startswith(table)):
            others = {**each.shared, **{own: varied[own] for own in each.own if own != key}}
            where = ", ".join(filter(None, [name_of(others), each.origin]))
            sweeps.setdefault((key, where), []).append(each)
    found = []
    for (key, where), swept in sweeps.items():
        known = [value for each in swept if (value := as_number(each.cell.varied[key])) is not None]
        if 1 < len(swept) == len(known):
            found.append(Allowed(key, where, *limits, _judged(swept, known, limits, confidence)))
    if not found:
        allowed = "a finished run that sweeps a numeric parameter of the AV's strategy"
        raise InputError(Parameter("mu0"), "judges nothing here", allowed)
    return found


def _limit(name: str, limit: float | None, allowed: str, most: float = math.inf) -> float:
    if limit is None or not 0 < limit <= most or limit == math.inf:
        problem = "is missing" if limit is None else f"{limit:g} is not accepted"
        raise InputError(Parameter(name), problem, allowed)
    return limit


def _judged(
    swept: "Sequence[Candidate]",
    values: Sequence[float],
    limits: tuple[float, float],
    confidence: float,
) -> tuple[Judged, ...]:
    """The verdict on each value of a swept parameter, in the order of the values."""
    level, rows = 1 - (1 - confidence) / len(swept), []
    for each, value in zip(swept, values, strict=True):
        sample = each.sample(each.cell["pairs"].count)
        rng = resampling(each.cell.scenario.experiment.seed, "comparison")
        sampling = sample.samplings[AV]._replace(rng=rng, confidence=level)
        mu = estimators.mean(sample["tau_all"], sampling)
        mu = mu.reliable_above(RELIABLE_FROM, "informative pairs")
        kappa = estimators.share(sample["missed"][AV], sample["tried"][AV], sampling)
        rows.append(Judged(value, mu, kappa, _verdict((mu, kappa), limits)))
    return tuple(sorted(rows, key=lambda row: row.value))


def _verdict(found: tuple[Finding, Finding], limits: tuple[float, float]) -> Judgement:
    """Allowed if all upper bounds are below their limits, denied if a lower bound is not."""
    known = [
        (bound.low, bound.high, limit)
        for bound, limit in zip(found, limits, strict=True)
        if bound.low is not None and bound.high is not None and bound.reliable is not False
    ]
    if any(low >= limit for low, _, limit in known):
        return "denied"
    below = len(found) == sum(high < limit for _, high, limit in known)
    return "allowed" if below else "undecided"


def allowed_table(of: Allowed) -> Table:
    """The values of a parameter with their bounds and verdicts."""
    columns = ("value", "μ, all values together", "κ, all values together", "verdict")
    return Table(
        of.title,
        tuple(Column(name.partition(",")[0], name) for name in columns),
        tuple((row.value, Shown(row.mu, Style(digits=3)), Shown(row.kappa, Style(Form.SHARE, 2)),
               row.verdict) for row in of.rows),
    )  # fmt: skip
