"""Counts of pairs and episodes of a run of encounters, and of uses of fallback and model."""

from harness.old.statistics.conflicts import NOBODY
from harness.old.statistics.encounter_columns import (
    EncounterColumns,
    count,
    count_defined,
    largest,
    mean_of,
)
from harness.old.statistics.entries import Entry, Form

COUNTS: tuple[Entry[EncounterColumns], ...] = (
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
        "Among the episodes of the AV that met someone, the share in which its strategy fell back "
        "on another one.",
        form=Form.SHARE,
        of_arm=lambda c, _: mean_of(c.pairs.av_fallback[c.pairs.met[0] > 0].astype(float)),
        keys=("fallback_share", "", ""),
        undefined=NOBODY,
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
        "Confidence of every interval.",
        form=Form.SHARE,
        paired=lambda c: c.confidence,
    ),
)
"""The last entries of the catalogue of encounters."""
