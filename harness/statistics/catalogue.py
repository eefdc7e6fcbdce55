"""Every number that a run of encounters reports, each defined once.

To report another number, add an entry: the run's tables, JSON, terminal, page and the reference
in the documentation are made from it.
"""

from dataclasses import dataclass

from harness.statistics.bootstrap import Resampled
from harness.statistics.encounter_columns import (
    EncounterColumns,
    count,
    count_defined,
    largest,
    mean_of,
)
from harness.statistics.findings import Entry, Findings, Form
from harness.statistics.intervals import Proportion

_REFERENCE_CRASHED = "A reference driver who crashed counts as if they had driven on."
_WORST = "An AV that crashed, failed or timed out counts with `timeout_s`."
_MET = "Only pairs in which someone stepped off count."
_NO_TAU = "there is no pair in which both vehicles crossed"
_NOT_CROSSED = "no episode crossed"
_ALL_FAILED = "every episode failed"
_NOT_COUNTED = "in every pair an episode failed or the AV crashed"
_NO_PASSAGE = "there is no pair in which the AV crossed and the reference passed"
_NOBODY = "nobody was met"


@dataclass(frozen=True, slots=True)
class Conflict:
    """A kind of conflict: a measure beyond a threshold.

    ``threshold`` is a key of ``[conflicts]``.  A value is a conflict above the threshold if
    ``above`` is set, otherwise below it.  ``heading`` holds the threshold's key in braces, see
    ``Entry.title``.
    """

    name: str
    column: str
    threshold: str
    above: bool
    heading: str


CONFLICTS = (
    Conflict("ttc", "min_ttc_s", "ttc_s", above=False, heading="TTC below {ttc_s:g} s"),
    Conflict(
        "time_advantage",
        "min_time_advantage_s",
        "time_advantage_s",
        above=False,
        heading="time advantage below {time_advantage_s:g} s",
    ),
    Conflict("pet", "pet_s", "pet_s", above=False, heading="PET below {pet_s:g} s"),
    Conflict(
        "drac",
        "max_drac_mps2",
        "drac_mps2",
        above=True,
        heading="DRAC above {drac_mps2:g} m/s²",
    ),
)


def _conflicts(conflict: Conflict) -> tuple[Entry[EncounterColumns], Entry[EncounterColumns]]:
    """The rate of a kind of conflict over all pairs, and over those that met someone."""
    name = conflict.name
    return (
        Entry(
            f"conflict_{name}",
            conflict.heading,
            f"Share of episodes with a conflict, by the threshold "
            f"`conflicts.{conflict.threshold}`; a crash counts as a conflict of every kind.",
            form=Form.SHARE,
            digits=0,
            interval=Proportion,
            of_arm=lambda c, arm: c.conflict_rate(name, arm),
            undefined=_ALL_FAILED,
            first_screen=name == "pet",
        ),
        Entry(
            f"conflict_{name}_met_someone",
            f"{conflict.heading}, pairs that met someone",
            f"Share of episodes with such a conflict. {_MET}",
            form=Form.SHARE,
            interval=Proportion,
            of_arm=lambda c, arm: c.met.conflict_rate(name, arm),
            undefined=_NOBODY,
        ),
    )


ENCOUNTERS: tuple[Entry[EncounterColumns], ...] = (
    Entry(
        "time_s",
        "time to cross",
        "Mean time to cross, over the pairs in which no episode failed and the AV did not crash. "
        f"A time-out counts as `timeout_s`. {_REFERENCE_CRASHED}",
        unit="s",
        digits=1,
        of_arm=lambda c, arm: c.mean(c.times[arm]),
        paired=lambda c: c.ratio(*c.times),
        interval=Resampled,
        keys=("time_s", "time_human_s", "time_ratio"),
        reliable_from=1_000,
        undefined=_NOT_COUNTED,
        first_screen=True,
        paired_heading="ratio of times",
        paired_meaning="Ratio of times: the sum of the AV's times over the sum of the reference's.",
        paired_digits=2,
    ),
    Entry(
        "time_ratio_worst",
        "ratio of times, worst case",
        f"Ratio of times over all pairs. {_WORST} A reference that did not pass counts with the "
        "time of an undisturbed passage.",
        digits=2,
        paired=lambda c: c.ratio(*c.worst),
        interval=Resampled,
        reliable_from=1_000,
        worst_case=True,
    ),
    Entry(
        "mu",
        "μ, mean ratio of times",
        "μ, the mean of τ over the pairs in which both vehicles crossed; τ is the AV's time over "
        "the reference's time.",
        digits=3,
        paired=lambda c: c.mu_and_cv[0],
        interval=Resampled,
        reliable_from=1_000,
        undefined=_NO_TAU,
        first_screen=True,
        paper="0.7044",
    ),
    Entry(
        "cv",
        "c_v, spread of that ratio",
        "c_v, the coefficient of variation of τ: its population standard deviation over μ.",
        form=Form.SHARE,
        digits=0,
        paired=lambda c: c.mu_and_cv[1],
        interval=Resampled,
        reliable_from=4_000,
        undefined="there are fewer than two pairs in which both vehicles crossed",
        first_screen=True,
        paper="4.54 %",
    ),
    Entry(
        "kappa",
        "crashes",
        "κ, the share of the episodes that did not fail in which the vehicle crashed.",
        form=Form.EVENTS,
        digits=1,
        of_arm=lambda c, arm: c.rate(c.pairs.crashed, arm),
        interval=Proportion,
        undefined=_ALL_FAILED,
        first_screen=True,
        crashes=True,
        paper="0",
    ),
    Entry(
        "kappa_worst",
        "crashes, worst case",
        "Share of all pairs in which the AV crashed, failed or timed out.",
        form=Form.EVENTS,
        digits=1,
        of_arm=lambda c, arm: c.worst_rate(arm),
        interval=Proportion,
        keys=("kappa_worst", "", ""),
        worst_case=True,
    ),
    Entry(
        "delay_s",
        "delay",
        "Mean delay of the episodes that crossed.",
        unit="s",
        digits=1,
        of_arm=lambda c, arm: c.mean(c.pairs.delay_s[arm]),
        paired=lambda c: c.mean(c.pairs.delay_difference_s),
        interval=Resampled,
        keys=("delay_s", "delay_human_s", "delay_difference_human_s"),
        reliable_from=200,
        undefined=_NOT_CROSSED,
        first_screen=True,
        paired_meaning="Mean of the AV's delay minus the reference's, over the pairs of `mu_all`.",
        paired_from=1_000,
    ),
    Entry(
        "pedestrian_delay_s",
        "people's wait",
        "Mean wait at the kerb: the sum of all waits over the number of people who arrived.",
        unit="s",
        digits=1,
        of_arm=lambda c, arm: c.walking_delay(arm),
        interval=Resampled,
        keys=("pedestrian_delay_s", "pedestrian_delay_human_s", ""),
        reliable_from=200,
        undefined="nobody arrived",
        first_screen=True,
    ),
    *(
        entry
        for conflict in (CONFLICTS[2], *CONFLICTS[:2], CONFLICTS[3])
        for entry in _conflicts(conflict)
    ),
    Entry(
        "mu_all",
        "μ over all pairs in which the AV crossed",
        f"μ over all pairs in which the AV crossed. {_REFERENCE_CRASHED}",
        digits=3,
        paired=lambda c: c.mean(c.pairs.tau_all),
        interval=Resampled,
        reliable_from=1_000,
        undefined=_NO_PASSAGE,
    ),
    Entry(
        "mu_met_someone",
        "μ, pairs that met someone",
        f"μ. {_MET}",
        digits=3,
        paired=lambda c: c.mean(c.met.pairs.tau),
        interval=Resampled,
        reliable_from=1_000,
        undefined=_NO_TAU,
    ),
    Entry(
        "mu_without_fallback",
        "μ, only pairs without fallback: a selected sample",
        "μ of the pairs in which the AV's strategy did not fall back on another one.",
        digits=3,
        paired=lambda c: mean_of(c.pairs.tau[~c.pairs.av_fallback]),
        undefined="there is no pair without fallback in which both vehicles crossed",
    ),
    Entry(
        "mu_worst",
        "μ, worst case",
        f"μ over all pairs. {_WORST} A reference that did not pass counts with the time of an "
        "undisturbed passage.",
        digits=3,
        paired=lambda c: c.mean(c.pairs.tau_worst(c.timeout_s, c.free_pass_s)),
        interval=Resampled,
        reliable_from=1_000,
        worst_case=True,
    ),
    Entry(
        "kappa_all",
        "crashes, time-outs, failures",
        "κ if time-outs and failures of the AV's strategy count as crashes. Failures of the "
        "engine are left out.",
        form=Form.SHARE,
        of_arm=lambda c, _: c.share(c.pairs.av_missed, c.pairs.av_tried),
        interval=Proportion,
        keys=("kappa_all", "", ""),
        undefined=_ALL_FAILED,
    ),
    Entry(
        "kappa_front",
        "crashes with the vehicle's front",
        "Share of the episodes that did not fail in which the front of the vehicle hit someone.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.rate(c.pairs.front, arm),
        interval=Proportion,
        keys=("kappa_front", "", ""),
        undefined=_ALL_FAILED,
    ),
    Entry(
        "kappa_avoidable",
        "crashes avoidable by full braking",
        "Share of the episodes that did not fail with a crash that full braking would have "
        "prevented.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.rate(c.pairs.avoidable, arm),
        interval=Proportion,
        undefined=_ALL_FAILED,
    ),
    Entry(
        "kappa_met_someone",
        "crashes, pairs that met someone",
        f"κ. {_MET}",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.met.rate(c.met.pairs.crashed, arm),
        interval=Proportion,
        keys=("kappa_met_someone", "kappa_human_met_someone", ""),
        undefined=_NOBODY,
    ),
    Entry(
        "delay_met_someone_s",
        "delay, pairs that met someone",
        f"Mean delay of the episodes that crossed. {_MET}",
        unit="s",
        of_arm=lambda c, arm: c.mean(c.met.pairs.delay_s[arm]),
        interval=Resampled,
        keys=("delay_met_someone_s", "delay_human_met_someone_s", ""),
        reliable_from=200,
        undefined=_NOT_CROSSED,
    ),
    Entry(
        "delay_worst_s",
        "delay, worst case",
        f"Mean delay over all pairs. {_WORST} A reference that did not pass counts without delay.",
        unit="s",
        digits=1,
        of_arm=lambda c, arm: c.mean(c.worst[arm] - c.free_pass_s),
        interval=Resampled,
        keys=("delay_worst_s", "delay_human_worst_s", ""),
        reliable_from=1_000,
        worst_case=True,
    ),
    Entry(
        "stops",
        "stops per episode",
        "Stops per episode that did not fail.",
        of_arm=lambda c, arm: mean_of(c.pairs.stops[arm][c.ran(arm)]),
        undefined=_ALL_FAILED,
    ),
    Entry(
        "stopped_s",
        "time stopped per episode",
        "Time stopped per episode that did not fail.",
        unit="s",
        of_arm=lambda c, arm: mean_of(c.pairs.stopped_s[arm][c.ran(arm)]),
        keys=("stopped_s", "stopped_human_s", ""),
        undefined=_ALL_FAILED,
    ),
    Entry(
        "max_speed_mps",
        "largest speed",
        "Largest speed of the vehicle in any episode.",
        unit="m/s",
        of_arm=lambda c, arm: largest(c.pairs.max_speed_mps[arm]),
        keys=("max_speed_mps", "max_speed_human_mps", ""),
        undefined=_ALL_FAILED,
    ),
    Entry(
        "pairs",
        "pairs",
        "Number of pairs.",
        form=Form.COUNT,
        paired=lambda c: len(c.pairs.tau),
    ),
    Entry(
        "met_someone",
        "pairs that met someone",
        "Pairs in which someone stepped off, in either episode.",
        form=Form.COUNT,
        paired=lambda c: count(c.pairs.met_someone),
    ),
    Entry(
        "met_nobody",
        "pairs that met nobody",
        "Pairs in which nobody stepped off and neither episode failed.",
        form=Form.COUNT,
        paired=lambda c: count(~c.pairs.met_someone & ~c.pairs.any_failed),
    ),
    Entry(
        "time_ratio_pairs",
        "pairs in the ratio of times",
        "Pairs that the ratio of times counts: neither episode failed, and the AV did not crash.",
        form=Form.COUNT,
        paired=lambda c: len(c.times[0]),
    ),
    Entry(
        "defined_pairs",
        "pairs in μ",
        "Pairs that have a τ: both vehicles crossed.",
        form=Form.COUNT,
        paired=lambda c: count_defined(c.pairs.tau),
    ),
    Entry(
        "defined_pairs_met_someone",
        "pairs in μ that met someone",
        "Pairs that met someone and have a τ.",
        form=Form.COUNT,
        paired=lambda c: count_defined(c.met.pairs.tau),
    ),
    Entry(
        "pairs_all",
        "pairs in μ over all pairs in which the AV crossed",
        "Pairs that `mu_all` counts.",
        form=Form.COUNT,
        paired=lambda c: count_defined(c.pairs.tau_all),
    ),
    Entry(
        "timed_out",
        "time-outs",
        "Episodes that timed out.",
        form=Form.COUNT,
        of_arm=lambda c, arm: count(c.pairs.timed_out[arm]),
        paired=lambda c: count(c.pairs.any_timed_out),
        keys=("timed_out_av", "timed_out_human", "timed_out"),
        paired_meaning="Pairs in which either episode timed out.",
    ),
    Entry(
        "failed",
        "failures",
        "Episodes that failed.",
        form=Form.COUNT,
        of_arm=lambda c, arm: count(c.pairs.failed[arm]),
        paired=lambda c: count(c.pairs.any_failed),
        keys=("failed_av", "failed_human", "failed"),
        paired_meaning="Pairs in which either episode failed.",
    ),
    Entry(
        "failed_strategy",
        "failures of a strategy",
        "Pairs in which a strategy failed.",
        form=Form.COUNT,
        paired=lambda c: count(c.pairs.failed_strategy[0] | c.pairs.failed_strategy[1]),
    ),
    Entry(
        "failed_engine",
        "failures of the engine",
        "Pairs in which the engine failed.",
        form=Form.COUNT,
        paired=lambda c: c.failures_of_engine(),
    ),
    Entry(
        "fallbacks",
        "episodes with a fallback",
        "Episodes of the AV in which its strategy fell back on another one.",
        form=Form.COUNT,
        of_arm=lambda c, _: count(c.pairs.av_fallback),
        keys=("fallbacks", "", ""),
    ),
    Entry(
        "fallback_share",
        "fallbacks among episodes that met someone",
        "Share of those episodes of the AV that met someone in which its strategy fell back on "
        "another one.",
        form=Form.SHARE,
        of_arm=lambda c, _: mean_of(c.pairs.av_fallback[c.pairs.met[0] > 0].astype(float)),
        keys=("fallback_share", "", ""),
        undefined=_NOBODY,
    ),
    Entry(
        "clamped_share",
        "uses of the model outside its box",
        "How often the interaction model was used for a vehicle that was faster or farther away "
        "than its box, as a share of all its uses in the arm.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.clamped_share(arm),
        undefined="the model was not used",
    ),
    Entry(
        "clamped_speed_excess_mps",
        "largest speed beyond the model's box",
        "Largest amount by which the vehicle was faster than the model's box, over both arms.",
        unit="m/s",
        paired=lambda c: largest(*c.pairs.speed_excess_mps),
        undefined="no vehicle was faster than the model's box",
    ),
    Entry(
        "clamped_range_excess_m",
        "largest distance beyond the model's box",
        "Largest amount by which the vehicle was farther away than the model's box, over both "
        "arms.",
        unit="m",
        paired=lambda c: largest(*c.pairs.range_excess_m),
        undefined="no vehicle was farther away than the model's box",
    ),
    Entry(
        "confidence",
        "confidence of each interval",
        "Confidence of every interval: 0.95, or 1 − 0.05 / looks with `--until`.",
        form=Form.SHARE,
        paired=lambda c: c.confidence,
    ),
)
"""The catalogue of encounters, in the order in which it is shown."""


def anything_left_out(findings: Findings) -> bool:
    """Whether the ratio of times leaves out a pair, or counts a pair with a time-out."""
    counted, pairs = findings["time_ratio_pairs"].count, findings["pairs"].count
    return findings["timed_out"].count > 0 or counted < pairs
