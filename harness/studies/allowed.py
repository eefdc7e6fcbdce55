"""The paper's allowed interval: which values of a parameter keep μ below μ0 and κ below κ0.

μ is over all pairs in which the AV crossed; κ counts time-outs and failures of the strategy as
crashes, because an AV that does not arrive is not allowed.  The m values of a sweep have 2 m upper
bounds that hold together, each one-sided at 1 − level / 2m (Bonferroni), and as many lower bounds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from harness.core.errors import InputError
from harness.core.seeding import resampling
from harness.results import estimators
from harness.results.columns import AV
from harness.results.estimators import Sampling
from harness.results.finding import Finding, Form
from harness.results.notes import name_of
from harness.results.result import Column, Shown, Style, Table

if TYPE_CHECKING:
    from harness.studies.compare import Candidate

RELIABLE_FROM = 2_000
"""Informative pairs from which on the bound of μ is reliable; an unreliable one decides nothing."""

Verdict = Literal["allowed", "denied", "undecided"]


@dataclass(frozen=True)
class Allowed:
    """The verdicts on the ascending ``values`` of a parameter ``key`` of a strategy.

    ``where`` has the other swept keys and the run, if there are several.  ``mu`` and ``kappa`` have
    the bounds that hold over all values together.
    """

    where: str
    key: str
    values: tuple[float, ...]
    mu: tuple[Finding, ...]
    kappa: tuple[Finding, ...]
    verdicts: tuple[Verdict, ...]
    mu0: float
    kappa0: float


def allowed_in(
    groups: "Sequence[Sequence[Candidate]]",
    mu0: float | None,
    kappa0: float | None,
    confidence: float,
) -> list[Allowed]:
    """The verdicts on each parameter of a strategy that a group sweeps alone; none without limits.

    Raises:
        InputError: a limit is out of range, or only one is given.
    """
    if mu0 is None and kappa0 is None:
        return []
    for option, limit, top in (("--mu0", mu0, math.inf), ("--kappa0", kappa0, 1.0)):
        if limit is None:
            raise InputError(option, "is missing", "both limits")
        if not 0 < limit <= top or limit == math.inf:
            least = "above 0, at most 1" if top == 1 else "above 0"
            raise InputError(option, f"{limit:g} is not accepted", least)
    sweeps: dict[tuple[str, str], list[tuple[float, Candidate]]] = {}
    for each in (each for group in groups for each in group):
        keys = [
            key for key in each.own if key.startswith(f"strategies.{each.cell.scenario.arms.av}.")
        ]
        if (
            len(each.own) == 1
            and keys
            and isinstance(value := each.cell.varied[keys[0]], int | float)
        ):
            where = ", ".join(filter(None, [name_of(each.shared), each.origin]))
            sweeps.setdefault((where, keys[0]), []).append((float(value), each))
    return [
        _judged(
            where, key, sorted(swept, key=lambda each: each[0]), mu0 or 0, kappa0 or 0, confidence
        )
        for (where, key), swept in sweeps.items()
        if len(swept) > 1
    ]


def _judged(
    where: str,
    key: str,
    swept: "Sequence[tuple[float, Candidate]]",
    mu0: float,
    kappa0: float,
    confidence: float,
) -> Allowed:
    level, found = 1 - (1 - confidence) / len(swept), []
    for value, each in swept:
        sample = each.sample(each.cell["pairs"].count)
        rng = resampling(each.cell.scenario.experiment.seed, "comparison")
        mu = estimators.mean(sample.pairs("tau_all"), Sampling(rng, level))
        missed, tried = sample.arms("missed")[AV], sample.arms("tried")[AV]
        kappa = estimators.share(missed, tried, level, repeated=sample.repeated[AV])
        if mu.low is not None and (mu.n or 0) < RELIABLE_FROM:
            few = f"unreliable below {RELIABLE_FROM:,} informative pairs (has {mu.n:,})"
            mu = replace(mu, reliable=False, reason=few)
        found.append((value, mu, kappa, _verdict([(mu, mu0), (kappa, kappa0)])))
    values, mus, kappas, verdicts = zip(*found, strict=True)
    return Allowed(where, key, values, mus, kappas, verdicts, mu0, kappa0)


def _verdict(bounded: Sequence[tuple[Finding, float]]) -> Verdict:
    """Allowed if all upper bounds are below their limits, denied if a lower bound is not."""
    known = [
        (of, limit) for of, limit in bounded if of.low is not None and of.reliable is not False
    ]
    if any((of.low or 0.0) >= limit for of, limit in known):
        return "denied"
    below = [of.high is not None and of.high < limit for of, limit in known]
    return "allowed" if len(known) == len(bounded) and all(below) else "undecided"


def allowed_table(of: Allowed) -> Table:
    """The values of a parameter with their bounds and verdicts."""
    columns = ("value", "μ, all values together", "κ, all values together", "verdict")
    rows = zip(of.values, of.mu, of.kappa, of.verdicts, strict=True)
    return Table(
        f"{of.key} with μ < {of.mu0:g} and κ < {of.kappa0:g}{of.where and f' ({of.where})'}",
        tuple(Column(name.partition(",")[0], name) for name in columns),
        tuple(
            (value, Shown(mu, Style(digits=3)), Shown(kappa, Style(Form.SHARE, 2)), verdict)
            for value, mu, kappa, verdict in rows
        ),
    )
