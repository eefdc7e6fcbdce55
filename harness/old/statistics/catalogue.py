"""Every number that a run of encounters reports, each defined once.

To report another number, add an entry. The run's tables, JSON, terminal, page and the reference in
the documentation are made from the entries.
"""

from harness.old.statistics.bootstrap import Resampled
from harness.old.statistics.comfort import comfort_entries
from harness.old.statistics.conflicts import ALL_FAILED, CONFLICTS, MET, NOBODY, conflict_entries
from harness.old.statistics.counts import COUNTS
from harness.old.statistics.encounter_columns import EncounterColumns, largest, mean_of
from harness.old.statistics.entries import Entry, Findings, Form
from harness.old.statistics.intervals import Proportion

_REFERENCE_CRASHED = "A reference driver who crashed counts as if they had driven on."
_WORST = "An AV that crashed, failed or timed out counts with `timeout_s`."
_NO_TAU = "there is no pair in which both vehicles crossed"
_NOT_CROSSED = "no episode crossed"
_NOT_COUNTED = "in every pair an episode failed or the AV crashed"
_NO_PASSAGE = "there is no pair in which the AV crossed and the reference passed"


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
        undefined=ALL_FAILED,
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
        for conflict in (CONFLICTS[2], *CONFLICTS[:2], *CONFLICTS[3:])
        for entry in conflict_entries(conflict)
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
        f"μ. {MET}",
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
        of_arm=lambda c, arm: c.share(c.pairs.av_missed, c.pairs.av_tried, arm),
        interval=Proportion,
        keys=("kappa_all", "", ""),
        undefined=ALL_FAILED,
    ),
    Entry(
        "kappa_front",
        "crashes with the vehicle's front",
        "Share of the episodes that did not fail in which the front of the vehicle hit someone.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.rate(c.pairs.front, arm),
        interval=Proportion,
        keys=("kappa_front", "", ""),
        undefined=ALL_FAILED,
    ),
    Entry(
        "kappa_avoidable",
        "crashes avoidable by full braking",
        "Share of the episodes that did not fail with a crash that full braking would have "
        "prevented.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.rate(c.pairs.avoidable, arm),
        interval=Proportion,
        undefined=ALL_FAILED,
    ),
    Entry(
        "kappa_avoidable_attentive",
        "crashes avoidable by an attentive driver",
        "Share of the episodes that did not fail with a crash that an attentive human driver (UN "
        "Regulation 157) in the vehicle's place would have avoided.",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.rate(c.pairs.avoidable_attentive, arm),
        interval=Proportion,
        undefined=ALL_FAILED,
    ),
    Entry(
        "kappa_met_someone",
        "crashes, pairs that met someone",
        f"κ. {MET}",
        form=Form.SHARE,
        of_arm=lambda c, arm: c.met.rate(c.met.pairs.crashed, arm),
        interval=Proportion,
        keys=("kappa_met_someone", "kappa_human_met_someone", ""),
        undefined=NOBODY,
    ),
    Entry(
        "delay_met_someone_s",
        "delay, pairs that met someone",
        f"Mean delay of the episodes that crossed. {MET}",
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
        undefined=ALL_FAILED,
    ),
    Entry(
        "stopped_s",
        "time stopped per episode",
        "Time stopped per episode that did not fail.",
        unit="s",
        of_arm=lambda c, arm: mean_of(c.pairs.stopped_s[arm][c.ran(arm)]),
        keys=("stopped_s", "stopped_human_s", ""),
        undefined=ALL_FAILED,
    ),
    Entry(
        "max_speed_mps",
        "largest speed",
        "Largest speed of the vehicle in any episode.",
        unit="m/s",
        of_arm=lambda c, arm: largest(c.pairs.max_speed_mps[arm]),
        keys=("max_speed_mps", "max_speed_human_mps", ""),
        undefined=ALL_FAILED,
    ),
    *comfort_entries(),
    *COUNTS,
)
"""The catalogue of encounters, in the order in which it is shown."""

ENTRIES = {name: entry for entry in ENCOUNTERS for name in filter(None, entry.names)}
"""The entries by the names of their numbers."""


def anything_left_out(findings: Findings) -> bool:
    """Whether the ratio of times leaves out a pair, or counts a pair with a time-out."""
    counted, pairs = findings["time_ratio_pairs"].count, findings["pairs"].count
    return findings["timed_out"].count > 0 or counted < pairs
