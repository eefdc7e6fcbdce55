"""What a reader has to know before any number of a result, on the page and on the terminal."""

from collections.abc import Mapping, Sequence

from harness.comparison import Summary
from harness.encounter import SPEED_ROUNDING
from harness.report.tables import counted, limits, number, percentage
from harness.runs.run_data import RunData
from harness.runs.targets import missed_targets
from harness.scenario import Scenario
from harness.strategies.registry import fallback_of

NOTHING_TESTED = "no pedestrian was met: nothing was tested"

_NAMED = 8
"""Cells named in a line."""

_MOST = 0.5
"""A share from which on something is said before any number."""


def av_label(strategy: str, summary: Summary) -> str:
    """The AV's strategy; with what drove in its place, where it mostly fell back on that.

    Args:
        strategy: its name, or what tells it apart from others.
        summary: of its cell.

    >>> from types import SimpleNamespace
    >>> av_label("soft_yield", SimpleNamespace(fallback_share=1.0))
    'soft_yield (hard_yield in 100 %)'
    """
    share = summary.fallback_share
    if share is None or share < _MOST:
        return strategy
    return f"{strategy} ({fallback_of(strategy.split()[0])} in {100 * share:.0f} %)"


def first_lines(run: RunData) -> list[str]:
    """The lines before any number: caveats of the cells, and targets that were missed."""
    of_cells = {of.cell.number: caveats(of.cell.scenario, of.summary) for of in run.results}
    lines = joined_caveats(of_cells) if run.varied_keys else of_cells[0]
    return [*(sentence(words) for words in lines), *_missed_lines(run)]


def joined_caveats(of_cells: Mapping[int, Sequence[str]]) -> list[str]:
    """The caveats of several cells by number; those that say the same stand together."""
    cells: dict[str, list[int]] = {}
    for cell, lines in of_cells.items():
        for words in lines:
            cells.setdefault(words, []).append(cell)
    return [f"cell{'s' * (len(of) > 1)} {_listed(of)}: {words}" for words, of in cells.items()]


def sentence(words: str) -> str:
    """Words with a capital and a full stop."""
    return f"{words[0].upper()}{words[1:]}."


def caveats(scenario: Scenario, summary: Summary) -> list[str]:
    """What a reader has to know before any number of a cell; often nothing.

    Args:
        scenario: of the cell.
        summary: of the cell.
    """
    av, said = scenario.arms.av, []
    if scenario.pedestrians.drawn:
        said.append(
            "the pairs were chosen for what happens in them (pedestrians.drawn, as harness risk "
            "writes it): no share, mean or interval here says how often anything happens"
        )
    if summary.failed_av == summary.pairs:
        said.append("no episode of the AV ran to its end: nothing was tested")
    elif summary.met_nobody == summary.pairs:
        said.append(NOTHING_TESTED)
    if summary.timed_out:
        said.append(
            f"{summary.timed_out:,} of {counted(summary.pairs, 'pair')} timed out "
            f"(AV {summary.timed_out_av:,}, human {summary.timed_out_human:,}): the ratio of times "
            "counts them with the time-out, μ, c_v and the delays leave them out; in the worst "
            f"case the ratio of times is {number(summary.time_ratio_worst.value, 4)}, "
            f"μ {number(summary.mu_worst.value, 4)} and the AV's delay "
            f"{number(summary.delay_worst_s.value, 2)} s"
        )
    if summary.failed:
        said.append(
            f"{summary.failed:,} of {counted(summary.pairs, 'pair')} failed (strategy failed: "
            f"{summary.failed_strategy:,}, engine failed: {summary.failed_engine:,}): the ratio of "
            f"times, μ and κ leave them out; in the worst case κ is "
            f"{percentage(summary.kappa_worst.value)}, the ratio of times "
            f"{number(summary.time_ratio_worst.value, 4)} and μ {number(summary.mu_worst.value, 4)}"
        )
    said += fallback_words(f"the AV's strategy {av}", av, summary.fallback_share, "episodes")
    said += _speeding(scenario, summary)
    return [*said, *_outside_the_model(summary), *_direction(summary)]


def fallback_words(who: str, strategy: str, share: float | None, of: str) -> list[str]:
    """That a strategy mostly fell back on another one; nothing where it did not.

    Args:
        who: names the strategy and whose it is.
        strategy: its name.
        share: of those of its episodes or passages that met someone.
        of: the noun of these.
    """
    if share is None or share < _MOST:
        return []
    return [
        f"{who} fell back on {fallback_of(strategy)} in {whole_percent(share)} of the {of} that "
        f"met someone: what is measured is mostly {fallback_of(strategy)}"
    ]


def _speeding(scenario: Scenario, summary: Summary) -> list[str]:
    """Who drove above the road's limit, or above v0 where there is none; commands are not cut."""
    limit_mps = scenario.speed_limit_mps
    what = "v0" if scenario.crossing.road_speed_limit_mps is None else "the road's limit"
    return [
        f"the {who} drove at up to {fastest:.3g} m/s, above {what} of {limit_mps:g} m/s: it "
        "saves time by that"
        for who, fastest in (
            ("AV", summary.max_speed_mps),
            ("human", summary.max_speed_human_mps),
        )
        if fastest is not None and fastest > limit_mps * (1 + SPEED_ROUNDING)
    ]


def _outside_the_model(summary: Summary) -> list[str]:
    """How often the interaction model answered for another ego than the one at hand."""
    of_arms = {"AV": summary.clamped_share, "human": summary.clamped_share_human}
    shares = [f"{percentage(share)} ({arm})" for arm, share in of_arms.items() if share]
    if not shares:
        return []
    beyond = [
        f"{value:.3g} {unit}"
        for value, unit in (
            (summary.clamped_speed_excess_mps, "m/s too fast"),
            (summary.clamped_range_excess_m, "m too far"),
        )
        if value is not None and value > 0
    ]
    return [
        f"the interaction model was asked outside its data in {' and '.join(shares)} of the "
        f"cases, by up to {' and '.join(beyond)}: it answers for the fastest or farthest car it "
        "knows"
    ]


def _direction(summary: Summary) -> list[str]:
    """Which way μ errs where it lies outside the interval of ``mu_all``."""
    mu, of_all = summary.mu.value, summary.mu_all
    if mu is None or of_all.low is None or of_all.high is None or of_all.low <= mu <= of_all.high:
        return []
    way = ("above", "slower") if mu > of_all.high else ("below", "faster")
    return [
        f"μ lies {way[0]} the interval of μ over all pairs ({number(mu, 4)}; "
        f"{limits(of_all, 4)}): without the pairs in which the reference crashed the AV looks "
        f"{way[1]} than it is"
    ]


def _missed_lines(run: RunData) -> list[str]:
    """A line for each target of ``--until`` that was missed."""
    return [
        f"The target {of.measure} ± {of.target:g} was missed"
        + (f" in cell {of.cell}" if run.varied_keys else "")
        + f": ± {number(of.half_width, 4)} after all {of.pairs:,} pairs."
        for of in missed_targets(run)
    ]


def _listed(cells: Sequence[int]) -> str:
    shown = ", ".join(str(cell) for cell in cells[:_NAMED])
    return shown + (f" and {len(cells) - _NAMED:,} more" if len(cells) > _NAMED else "")


def whole_percent(share: float | None) -> str:
    """A share in whole per cent."""
    return "undefined" if share is None else f"{100 * share:.0f} %"
