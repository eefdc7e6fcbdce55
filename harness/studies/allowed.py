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
from harness.results.result import Column, Shown, Style, Table

if TYPE_CHECKING:
    from harness.studies.compare import Candidate

RELIABLE_FROM = 2_000
"""Informative pairs from which on the bound of μ is reliable; an unreliable one decides nothing."""

Verdict = Literal["allowed", "denied", "undecided"]


@dataclass(frozen=True)
class Allowed:
    """The verdicts on the ascending ``values`` of a parameter of one strategy.

    ``mu`` and ``kappa`` have the bounds that hold over all values together.
    """

    strategy: str
    key: str
    values: tuple[float, ...]
    mu: tuple[Finding, ...]
    kappa: tuple[Finding, ...]
    verdicts: tuple[Verdict, ...]
    mu0: float
    kappa0: float


def allowed_of(
    group: "Sequence[Candidate]", mu0: float | None, kappa0: float | None, confidence: float
) -> list[Allowed]:
    """The verdicts on each parameter of a strategy that a group sweeps alone; none without limits.

    Raises:
        InputError: a limit is out of range, or only one is given.
    """
    if mu0 is not None and not 0 < mu0 < math.inf:
        raise InputError("--mu0", f"{mu0:g} is not accepted", "above 0")
    if kappa0 is not None and not 0 < kappa0 <= 1:
        raise InputError("--kappa0", f"{kappa0:g} is not accepted", "above 0, at most 1")
    if mu0 is None and kappa0 is None:
        return []
    if mu0 is None or kappa0 is None:
        missing = "--mu0" if mu0 is None else "--kappa0"
        raise InputError(missing, "is missing", "both limits")
    sweeps: dict[tuple[str, str], list[tuple[float, Candidate]]] = {}
    for each in group:
        strategy = each.cell.scenario.arms.av
        if len(each.own) != 1 or not each.own[0].startswith(f"strategies.{strategy}."):
            continue
        if isinstance(value := each.cell.varied[each.own[0]], int | float):
            sweeps.setdefault((strategy, each.own[0]), []).append((float(value), each))
    return [
        _judged(strategy, key, sorted(swept, key=lambda each: each[0]), mu0, kappa0, confidence)
        for (strategy, key), swept in sweeps.items()
        if len(swept) > 1
    ]


def _judged(
    strategy: str,
    key: str,
    swept: "list[tuple[float, Candidate]]",
    mu0: float,
    kappa0: float,
    confidence: float,
) -> Allowed:
    level = 1 - (1 - confidence) / len(swept)
    mus, kappas, verdicts = [], [], list[Verdict]()
    for _, each in swept:
        sample = each.sample(each.cell["pairs"].count)
        rng = resampling(each.cell.scenario.experiment.seed, "comparison")
        mu = estimators.mean(sample.pairs("tau_all"), Sampling(rng, level))
        kappa = estimators.share(
            sample.arms("missed")[AV], sample.arms("tried")[AV], level, repeated=sample.repeated[AV]
        )
        known = mu.low is not None and (mu.n or 0) >= RELIABLE_FROM
        if known and _below(mu.high, mu0) and _below(kappa.high, kappa0):
            verdicts.append("allowed")
        elif (known and _reaches(mu.low, mu0)) or _reaches(kappa.low, kappa0):
            verdicts.append("denied")
        else:
            verdicts.append("undecided")
        if mu.low is not None and not known:
            few = f"unreliable below {RELIABLE_FROM:,} informative pairs (has {mu.n:,})"
            mu = replace(mu, reliable=False, reason=few)
        mus.append(mu)
        kappas.append(kappa)
    values = tuple(value for value, _ in swept)
    return Allowed(strategy, key, values, tuple(mus), tuple(kappas), tuple(verdicts), mu0, kappa0)


def _below(end: float | None, limit: float) -> bool:
    return end is not None and end < limit


def _reaches(end: float | None, limit: float) -> bool:
    return end is not None and end >= limit


def allowed_tables(
    groups: "Sequence[Sequence[Candidate]]",
    mu0: float | None,
    kappa0: float | None,
    confidence: float,
) -> list[Table]:
    """A table for each sweep of ``allowed_of``."""
    found = [each for group in groups for each in allowed_of(group, mu0, kappa0, confidence)]
    columns = ("value", "μ, all values together", "κ, all values together", "verdict")
    return [
        Table(
            f"{each.key} with μ < {each.mu0:g} and κ < {each.kappa0:g}",
            tuple(Column(name.partition(",")[0], name) for name in columns),
            tuple(
                (value, Shown(mu, Style(digits=3)), Shown(kappa, Style(Form.SHARE, 2)), verdict)
                for value, mu, kappa, verdict in zip(
                    each.values, each.mu, each.kappa, each.verdicts, strict=True
                )
            ),
        )
        for each in found
    ]
