"""What is said about a result, on the page and on the terminal alike: rows and sentences."""

import math
from collections.abc import Sequence

from harness.comparison import (
    CONFIDENCE,
    INDICATIVE_BELOW,
    Interval,
    Proportion,
    Summary,
    zero_bound,
)
from harness.encounter import Arm
from harness.measures import MEASURES
from harness.results.measure_tables import CONFLICTS, ConflictRate
from harness.scenario import Scenario
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import STRATEGIES

Row = tuple[str, str, str, str, str]
"""Measure, value, interval, key of the paper's value, remark."""

PAPER = {"mu": "0.7044", "cv": "4.54 %", "kappa": "0"}
"""Chen, Zhao, Peng 2017, section III-E; N = 50."""

PAPER_REMARK = (
    "The paper's column is a reference, not a target: its 2,973 events and fitted parameters were "
    "never published, so the model here is fitted on other trajectories, and Soft-Yield has no "
    "answer for walkers under 0.976 m/s at (30 m, 5 m/s), where Hard-Yield takes over here."
)


def is_the_papers(scenario: Scenario) -> bool:
    """Whether the paper's Table II, arms and pedestrian run here (any N, seed and model)."""
    ego, pedestrians = scenario.ego, scenario.pedestrians
    arms = (scenario.arms.av, scenario.arms.human)
    return (
        (ego.trigger_range_m, scenario.crossing.length_m, ego.initial_speed_mps) == (30, 9, 5)
        and arms == ("soft_yield", "human_gmm")
        and all(_keeps_its_defaults(scenario, name) for name in arms)
        and (pedestrians.behaviour, pedestrians.timed) == ("constant", ())
        and pedestrians.first_at_trigger
        and pedestrians.max_count == 1
    )


def _keeps_its_defaults(scenario: Scenario, strategy: str) -> bool:
    defaults = {of.name: of.default for of in parameters_of(STRATEGIES[strategy])}
    return defaults | scenario.strategies.get(strategy, {}) == defaults


def measure_rows(summary: Summary) -> list[Row]:
    """The measures of a cell, the paper's three and what they have to be read with."""
    n = summary.defined_pairs
    kappa, kappa_human = summary.kappa, summary.kappa_human
    avoidable = both_shares(summary.kappa_avoidable, summary.kappa_avoidable_human)
    mu, cv = _number(summary.mu.value), _percent(summary.cv.value)
    delay, delay_human = summary.delay_s, summary.delay_human_s
    stops = f"{_seconds(summary.stops)} / {_seconds(summary.stops_human)}"
    stopped = f"{_seconds(summary.stopped_s)} / {_seconds(summary.stopped_human_s)}"
    return [
        ("μ   mean of τ", mu, _range(summary.mu), "mu", indicative(n, "mu")),
        ("μ   without fallbacks", _number(summary.mu_without_fallback), "", "", ""),
        ("μ   time-outs counted", _number(summary.mu_timeout), "", "", ""),
        ("c_v spread of τ", cv, _range(summary.cv, True), "cv", indicative(n, "cv")),
        ("κ   crash rate, AV", _percent(kappa.value), _range(kappa, True), "kappa", ""),
        ("κ   with the front", _percent(summary.kappa_front), "", "", ""),
        ("κ   avoidable, AV / human", *avoidable, "", "by full braking at once"),
        ("κ   crash rate, human", _percent(kappa_human.value), _range(kappa_human, True), "", ""),
        ("delay AV, s", _seconds(delay.value), _range(delay), "", indicative(n, "delay_s")),
        (
            "delay human, s",
            _seconds(delay_human.value),
            _range(delay_human),
            "",
            indicative(n, "delay_human_s"),
        ),
        ("stops, AV / human", stops, "", "", "per episode"),
        ("stopped s, AV / human", stopped, "", "", "per episode"),
    ]


def conflict_rows(rates: Sequence[ConflictRate]) -> list[Row]:
    """A row for each kind of conflict."""
    return [
        (f"{_condition(av)}, AV / human", *both_shares(av.rate, human.rate), "", "conflict rate")
        for av, human in both_arms(rates)
    ]


def both_arms(rates: Sequence[ConflictRate]) -> list[tuple[ConflictRate, ConflictRate]]:
    """The AV's and the human's rate of each kind of conflict."""
    av, human = ([rate for rate in rates if rate.arm is arm] for arm in (Arm.AV, Arm.HUMAN))
    return list(zip(av, human, strict=True))


def _condition(rate: ConflictRate) -> str:
    """Which values of which measure are a conflict."""
    conflict = next(entry for entry in CONFLICTS if entry.name == rate.conflict)
    unit = next(measure.unit for measure in MEASURES if measure.column == conflict.column)
    return f"{conflict_name(rate)} {'>' if conflict.above else '<'} {rate.threshold:g} {unit}"


def conflict_name(rate: ConflictRate) -> str:
    """``TTC``, ``time advantage``."""
    name = rate.conflict.replace("_", " ")
    return name if " " in name else name.upper()


def both_shares(av: Proportion, human: Proportion) -> tuple[str, str]:
    """Two shares, and their intervals, in per cent."""
    both = (av, human)
    values = ["undefined" if of.value is None else per_cent(of.value, 1) for of in both]
    ranges = [
        "undefined"
        if of.low is None or of.high is None
        else f"{per_cent(of.low, 1)} … {per_cent(of.high, 1)}"
        for of in both
    ]
    return f"{' / '.join(values)} %", f"{' / '.join(ranges)} %"


def per_cent(share: float, decimals: int) -> str:
    """A share times 100 with so many decimals, or as many as show two digits of a small one.

    A bound of 0.0003 must not become 0.0: no N shows that there is no risk.
    """
    value = 100 * share
    if value != 0 and abs(value) < 10.0 ** (1 - decimals):
        decimals = max(decimals, 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}"


def tau_lines(summary: Summary) -> list[str]:
    """What μ and c_v say, with their intervals."""
    mu, cv, n = summary.mu, summary.cv, summary.defined_pairs
    if mu.value is None:
        return ["τ is defined in no pair: neither μ nor c_v can be told."]
    much = f"{per_cent(abs(1 - mu.value), 1)} % {'less' if mu.value < 1 else 'more'}"
    said = f"In the mean over the pairs the AV took {much} time than the human driver: "
    said += f"μ = {mu.value:.4f} (95 % interval {_range(mu)}), "
    said += f"c_v = {_percent(cv.value)} ({_range(cv, True)})"
    words = [indicative(n, "mu")]
    if not words[0] and indicative(n, "cv"):
        words = [f"c_v {indicative(n, 'cv')}"]
    if mu.low is not None and mu.high is not None and mu.low <= 1 <= mu.high:
        words.append("the interval of μ holds 1: which is faster is not told")
    return ["; ".join([said, *(word for word in words if word)]) + "."]


def sweep_lines(summaries: Sequence[Summary]) -> list[str]:
    """What all cells of a sweep together leave out."""
    pairs = sum(summary.pairs for summary in summaries)
    parts = {
        "timed out": sum(summary.timed_out for summary in summaries),
        "met nobody": sum(summary.met_nobody for summary in summaries),
    }
    shares = ", ".join(f"{n:,} ({n / pairs:.1%}) {what}" for what, n in parts.items())
    failed = sum(summary.failed for summary in summaries)
    return [
        f"Of {pairs:,} pairs {shares}, {failed:,} failed in the engine. Everything else: "
        "summary.csv, measures.csv, conflicts.csv."
    ]


def crash_lines(summary: Summary) -> list[str]:
    """What each arm's crashes say; of none, what its N can show."""
    lines = []
    for who, kappa in (("AV", summary.kappa), ("human", summary.kappa_human)):
        if kappa.trials and kappa.successes == 0:
            bound = zero_bound(kappa.trials)
            lines.append(
                f"No crash of the {who} in {kappa.trials:,} episodes: κ below "
                f"{per_cent(bound, 1)} % with {100 * CONFIDENCE:g} % confidence, one-sided "
                f"({per_cent(kappa.high or 0.0, 1)} % two-sided)."
            )
        elif kappa.trials:
            lines.append(
                f"The {who} crashed in {kappa.successes:,} of {kappa.trials:,} episodes: "
                f"κ = {_percent(kappa.value)} ({_range(kappa, True)})."
            )
    return lines


def count_lines(summary: Summary) -> list[str]:
    """How many pairs and episodes say nothing, or something else."""
    out, nobody = summary.timed_out / summary.pairs, summary.met_nobody / summary.pairs
    return [
        f"τ = AV time / human time is defined in {summary.defined_pairs:,} of {summary.pairs:,} "
        f"pairs; timed out: {summary.timed_out:,} ({out:.1%}); failed in the engine: "
        f"{summary.failed:,}; met nobody: {summary.met_nobody:,} ({nobody:.1%}).",
        f"The AV's strategy fell back on another (Soft-Yield: on Hard-Yield) in "
        f"{summary.fallbacks:,} of {summary.pairs:,} episodes.",
    ]


def indicative(n: int, key: str) -> str:
    """The words of an interval that covers less than it says; empty where N is enough."""
    return "indicative: N too small" if n < INDICATIVE_BELOW[key] else ""


def _number(value: float | None) -> str:
    return "undefined" if value is None else f"{value:.4f}"


def _seconds(value: float | None) -> str:
    return "undefined" if value is None else f"{value:.2f}"


def _percent(value: float | None) -> str:
    return "undefined" if value is None else f"{per_cent(value, 2)} %"


def _range(interval: Interval, percent: bool = False) -> str:
    if interval.low is None or interval.high is None:
        return "undefined"
    if percent:
        return f"{per_cent(interval.low, 2)} … {per_cent(interval.high, 2)} %"
    return f"{interval.low:.4f} … {interval.high:.4f}"
