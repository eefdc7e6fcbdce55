"""Sentences and names about a result, for the page and the terminal alike.

The lines that come before any number are in ``caveats``.
"""

from collections.abc import Iterable, Sequence

from harness.comparison import (
    CONFIDENCE,
    CONFLICTS,
    Interval,
    Summary,
    zero_bound,
)
from harness.encounter import Arm
from harness.measures import MEASURES
from harness.report.caveats import NOTHING_TESTED, sentence, whole_percent
from harness.report.reference_words import keeps_its_defaults, known_disagreement
from harness.report.tables import (
    counted,
    level,
    limits,
    number,
    per_cent,
    percentage,
    share_limits,
)
from harness.results.measure_tables import ConflictRate
from harness.runs.model_use import given_the_model
from harness.runs.run_data import CellResult, RunData
from harness.scenario import Scenario
from harness.strategies.registry import fallback_of
from harness.workers.tasks import Failure

PAPER = {"mu": "0.7044", "cv": "4.54 %", "kappa": "0"}
"""Chen, Zhao, Peng 2017, section III-E; N = 50."""

PAPER_REMARK = (
    "The paper's column is a reference, not a target: its 2,973 events and fitted parameters were "
    "never published, so the model here is fitted on other trajectories, and Soft-Yield has no "
    "answer for walkers under 0.976 m/s at (30 m, 5 m/s), where Hard-Yield takes over here."
)

_NAMED = 8
"""Records named in a line."""


def pair_name(run: RunData, cell: int, pair: int) -> str:
    """``cell 2, pair 7``, or ``pair 7`` where the run has one cell."""
    return f"cell {cell}, pair {pair}" if run.varied_keys else f"pair {pair}"


def is_the_papers(scenario: Scenario) -> bool:
    """Whether the paper's Table II, arms and pedestrian run here (any N, seed and model)."""
    ego, pedestrians = scenario.ego, scenario.pedestrians
    arms = (scenario.arms.av, scenario.arms.human)
    return (
        (ego.trigger_range_m, scenario.crossing.length_m, ego.initial_speed_mps) == (30, 9, 5)
        and scenario.crosswalk().lane_centre_m == scenario.crossing.length_m / 4
        and arms == ("soft_yield", "human_gmm")
        and all(keeps_its_defaults(scenario, name) for name in arms)
        and (pedestrians.behaviour, pedestrians.timed) == ("constant", ())
        and pedestrians.first_at_trigger
        and pedestrians.max_count == 1
    )


def knowledge_lines(run: RunData) -> list[str]:
    """Which strategies of a run were given the model that their pedestrians are drawn from."""
    if not any(cell.scenario.walks_by_model for cell in run.study.cells):
        return []
    return [
        f"{name} knows the pedestrians' distribution: it is given the very interaction model that "
        "they are drawn from."
        for name in given_the_model(run)
    ]


def walker_lines(scenarios: Iterable[Scenario]) -> list[str]:
    """A warning of the card of the model ``dut``, where a run draws walking speeds from it."""
    drawn = any(
        (of.model.name, of.model.path) == ("dut", None)
        and of.model.pedestrian_reading != "unconditional"
        and of.walks_by_model
        for of in scenarios
    )
    said = (
        "The model dut draws walking speeds given the car, but in its data they hardly depend on "
        "it: on held-out vehicles one normal distribution is not told apart (docs/model.md). "
        'pedestrian_reading = "unconditional" draws them without the car.'
    )
    return [said] if drawn else []


def audit_lines(run: RunData) -> list[str]:
    """How many records of the plain engine agree with SUMO's; nothing of a run in SUMO."""
    if run.engine == "sumo":
        return []
    records, differ, ties = len(run.audited), run.disagreements, run.ties
    line = f"Plain engine, without SUMO's verdict: {records - len(differ) - len(ties):,} of "
    line += f"{counted(records, 'record')} repeated in SUMO agree"
    if ties:
        line += (
            f", {len(ties):,} differ by a tie of the strategy, which asked for something else "
            "though all that it had been shown until then agreed within 1e-9"
        )
    return [f"{line}.", *_named(differ), *_named(ties)]


def _named(records: Sequence[Failure]) -> list[str]:
    """The first of the records that differ, and how many more there are."""
    named = [
        f"Cell {cell} pair {pair} {arm}: {what} (plain engine and SUMO)."
        for cell, pair, arm, what in records[:_NAMED]
    ]
    more = len(records) - _NAMED
    return [*named, f"{more} more in audit.parquet."] if more > 0 else named


def time_lines(summary: Summary, scenario: Scenario) -> list[str]:
    """Sentences on the ratio of times, and on μ and c_v, of the AV against the reference.

    Args:
        summary: of a cell.
        scenario: of that cell.
    """
    ratio, mu, cv = summary.time_ratio, summary.mu, summary.cv
    if summary.met_nobody == summary.pairs:
        return [sentence(NOTHING_TESTED)]
    if ratio.value is None:
        return ["Every pair failed, or the AV crashed in it: nothing is known of its time."]
    much = (
        f"{per_cent(abs(1 - ratio.value), 1)} % {'less' if ratio.value < 1 else 'more'} time than"
    )
    much = "as much time as" if ratio.value == 1 else much
    said = f"Over {counted(summary.time_ratio_pairs, 'pair')} the AV took {much} "
    said += f"{scenario.arms.human}, the reference: ratio of times {ratio.value:.4f} "
    said += f"({level(summary.confidence)} interval {limits(ratio, 4) or 'undefined'}, "
    said += f"{left_out(summary)})"
    words = [unreliable_words(summary, "time_ratio")]
    if (
        ratio.low is not None
        and ratio.high is not None
        and ratio.low <= 1 <= ratio.high > ratio.low
    ):
        words.append("the interval holds 1: who takes less time is not told")
    words.append(known_disagreement(scenario, ratio.value))
    lines = ["; ".join([said, *(word for word in words if word)]) + "."]
    if mu.value is None:
        return [*lines, "τ is defined in no pair: neither μ nor c_v can be told."]
    said = f"τ, AV time / human time, has the mean μ = {mu.value:.4f} ({limits(mu, 4)}) and "
    said += f"c_v = {percentage(cv.value)} ({share_limits(cv, 2) or 'undefined'}) in the "
    said += f"{counted(summary.defined_pairs, 'pair')} in which both crossed"
    note = unreliable_words(summary, "mu")
    if not note and (few := unreliable_words(summary, "cv")):
        note = f"c_v: {few}"
    return [*lines, f"{said}; {note}." if note else f"{said}."]


def left_out(summary: Summary) -> str:
    """How many pairs the ratio of times leaves out and why, with its worst case."""
    count = summary.pairs - summary.time_ratio_pairs
    if not count:
        return "no pair left out"
    worst = number(summary.time_ratio_worst.value, 4)
    why = "as the AV crashed or an arm failed"
    return f"{counted(count, 'pair')} left out, {why}: worst case {worst}"


def has_worst_case(summary: Summary) -> bool:
    """Whether a pair is left out of the ratio of times, or counts in it with the time-out."""
    return bool(summary.timed_out or summary.time_ratio_pairs < summary.pairs)


def sweep_lines(results: Sequence[CellResult]) -> list[str]:
    """A sentence on the pairs that all cells of a sweep leave out."""
    summaries = [result.summary for result in results]
    pairs = sum(of.pairs for of in summaries)
    out, nobody, strategy, engine = (
        sum(getattr(of, name) for of in summaries)
        for name in ("timed_out", "met_nobody", "failed_strategy", "failed_engine")
    )
    return [
        f"Of {counted(pairs, 'pair')} {out:,} ({out / pairs:.1%}) timed out, {nobody:,} "
        f"({nobody / pairs:.1%}) met nobody; strategy failed: {strategy:,}, engine failed: "
        f"{engine:,}. Everything else: summary.csv, measures.csv, conflicts.csv."
    ]


def crash_lines(summary: Summary) -> list[str]:
    """Sentences on each arm's crashes; where it has none, on what its N can show."""
    lines = []
    for who, kappa in (("AV", summary.kappa), ("human", summary.kappa_human)):
        if kappa.trials and kappa.successes == 0:
            bound = zero_bound(kappa.trials)
            lines.append(
                f"No crash of the {who} in {counted(kappa.trials, 'episode')}: κ below "
                f"{per_cent(bound, 1)} % with {level(CONFIDENCE)} confidence, one-sided "
                f"({per_cent(kappa.high or 0.0, 1)} % two-sided, {level(summary.confidence)})."
            )
        elif kappa.trials:
            lines.append(
                f"The {who} crashed in {kappa.successes:,} of {counted(kappa.trials, 'episode')}: "
                f"κ = {percentage(kappa.value)} ({share_limits(kappa, 2)}, "
                f"{level(summary.confidence)} interval)."
            )
    return lines


def count_lines(result: CellResult) -> list[str]:
    """How many pairs and episodes say nothing, or something else."""
    summary, av = result.summary, result.cell.scenario.arms.av
    nobody = f"{summary.met_nobody:,} ({summary.met_nobody / summary.pairs:.1%})"
    lines = [
        f"τ = AV time / human time is defined in {summary.defined_pairs:,} of "
        f"{counted(summary.pairs, 'pair')}. Crashed: AV {summary.kappa.successes:,}, human "
        f"{summary.kappa_human.successes:,}; timed out: AV {summary.timed_out_av:,}, human "
        f"{summary.timed_out_human:,}; strategy failed: {summary.failed_strategy:,}, engine "
        f"failed: {summary.failed_engine:,} (AV {summary.failed_av:,}, human "
        f"{summary.failed_human:,}). Met nobody: {nobody}."
    ]
    if summary.fallbacks:
        lines.append(
            f"{av} fell back on {fallback_of(av)} in {counted(summary.fallbacks, 'episode')}: "
            f"{whole_percent(summary.fallback_share)} of those that met someone."
        )
    return lines


def unreliable_words(summary: Summary, key: str) -> str:
    """The words of an interval that covers less than it says; empty where it does not."""
    finding = summary.findings[key]
    return "" if finding.reliable else finding.reason or ""


def unreliable_keys(summary: Summary) -> list[str]:
    """The intervals of a summary that cover less than they say."""
    return [name for name, finding in summary.findings.items() if not finding.reliable]


def both_arms(rates: Sequence[ConflictRate]) -> list[tuple[ConflictRate, ConflictRate]]:
    """The AV's and the human's rate of each kind of conflict."""
    av, human = ([rate for rate in rates if rate.arm is arm] for arm in (Arm.AV, Arm.HUMAN))
    return list(zip(av, human, strict=True))


def conflict_condition(rate: ConflictRate) -> str:
    """Which values of which measure are a conflict, ``TTC < 1.5 s``."""
    conflict = next(entry for entry in CONFLICTS if entry.name == rate.conflict)
    unit = next(measure.unit for measure in MEASURES if measure.column == conflict.column)
    return f"{conflict_name(rate)} {'>' if conflict.above else '<'} {rate.threshold:g} {unit}"


def conflict_name(rate: ConflictRate) -> str:
    """``TTC``, ``time advantage``."""
    name = rate.conflict.replace("_", " ")
    return name if " " in name else name.upper()


def both_shares(av: Interval, human: Interval) -> tuple[str, str]:
    """Two shares, and their intervals, in per cent."""
    both = (av, human)
    values = ["undefined" if of.value is None else per_cent(of.value, 1) for of in both]
    ranges = [share_limits(of).removesuffix(" %") or "undefined" for of in both]
    return f"{' / '.join(values)} %", f"{' / '.join(ranges)} %"
