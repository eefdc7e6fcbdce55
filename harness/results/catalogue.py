"""The catalogue of every reported number: from which column it is estimated, and how.

To report another number, add an entry: it names a column and an estimator, and says whether the
first screen has the number (README.md shows that screen).  Screens, page, JSON, CSV and the
reference in the documentation follow.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from harness.core.vocabulary import LIMITED_BY, BoolArray, FloatArray
from harness.results import estimators
from harness.results.columns import AV, REFERENCE, PairSample
from harness.results.estimators import Sampling
from harness.results.finding import Finding, Form, Style
from harness.results.simulated import Of, SimulationSample, averaged, counted, summed
from harness.results.student import mean_of_arms, share_of_arms
from harness.results.tables import ENCOUNTERS, SIMULATIONS, RunKind

AnySample = PairSample | SimulationSample

Estimator = Callable[..., Finding]
"""It computes a number from its column, its weight if it has one, and a ``Sampling``.

The arrays have shape (n,), of an arm or of the pairs; or (2, n), of both arms for their difference.
"""


class Estimate(NamedTuple):
    """How a number is estimated from a sample, and when it can be relied on.

    Attributes:
        column: a column of ``PairSample`` by its name, or of ``SimulationSample``; None of a risk,
            which computes its numbers from its draws.
        by: how the column becomes a number; None of a risk.
        of: "arms", "av", "pair", or "both": each arm and the paired difference.
        weight: a second column: denominators of a ratio, trials of a share, steps.
        met: whether only pairs count in which someone stepped off, in either arm.
        reliable_from: the least number of informative pairs for a reliable bootstrap interval.
        undefined: the reason if the number is undefined.
    """

    column: str | Of | None
    by: Estimator | None
    of: Literal["arms", "av", "pair", "both"] = "arms"
    weight: str | Of = ""
    met: bool = False
    reliable_from: int = 0
    undefined: str = ""

    @property
    def columns(self) -> tuple[Any, ...]:
        """The column, and the weight if it has one."""
        return (self.column, self.weight) if self.weight else (self.column,)

    def of_columns(self, *columns: Any) -> Finding:
        """What its estimator finds of columns and a ``Sampling``; a risk's number has none."""
        assert self.by is not None
        return self.by(*columns)

    def of_sample(self, sample: AnySample, arm: int | None) -> Finding:
        """The finding of a cell for an arm, or for its pairs."""
        values = [sample[name] for name in self.columns]
        if arm is not None:
            values = [np.broadcast_to(each, (2, sample.n))[arm] for each in values]
        if self.met:
            values = [each[..., sample["met_someone"]] for each in values]
        return self.judged(self.of_columns(*values, sample.samplings[arm or AV]))

    def judged(self, finding: Finding) -> Finding:
        """The finding with the reason why it is undefined, or its interval unreliable."""
        if finding.value is None:
            return replace(finding, reason=self.undefined or finding.reason)
        if finding.events is not None:
            return finding
        return finding.reliable_above(self.reliable_from, "informative pairs")


class Entry(NamedTuple):
    """A reported number of a cell: of each arm, of the AV's arm, of its pairs, or of several.

    Attributes:
        key: its name in JSON and CSV, with its unit; the reference's number is ``key_human``.
        heading: its name on screens, without its unit.  It may hold a threshold of ``[conflicts]``
            in braces, see ``title``.
        meaning: for the reference in the documentation.
        estimate: how it is estimated.
        style, unit: how it is written; a share's unit is per cent.
        screen: whether the first screen has it, or only where it is defined and other than the one
            before ("other"): the contacts of AVs where all vehicles are.  ``--full`` has every
            entry.
        sweep: the places in ``keys`` of its numbers on the first screen of several cells.
        worst_of: the number whose worst case it is, if the first screen has it as soon as a pair
            was left out.
        beside: the entry of both arms in whose row a number of pairs stands.
        paper: the value in Chen, Zhao, Peng (2017), section III-E, as it is printed there.
        kinds: the kinds of run that have it.
        network: whether it is of the whole network, so that there is none by crosswalk.
    """

    key: str
    heading: str
    meaning: str
    estimate: Estimate
    style: Style = Style()
    unit: str = ""
    screen: Literal["never", "always", "other"] = "never"
    sweep: tuple[int, ...] = ()
    worst_of: str = ""
    beside: str = ""
    paper: str = ""
    kinds: tuple[RunKind, ...] = ENCOUNTERS
    network: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """The names of its numbers: the AV's, the reference's and the difference if it has them."""
        number = {"arms": 2, "both": 3}.get(self.estimate.of, 1)
        return (self.key, f"{self.key}_human", f"{self.key}_difference")[:number]

    def title(self, thresholds: Mapping[str, float]) -> str:
        """The heading with the thresholds of conflicts, and its unit.

        >>> ENTRY_OF["conflict_pet"].title({"pet_s": 1.5})
        'PET below 1.5 s'
        """
        return self.heading.format(**thresholds) + (self.unit and f", {self.unit}")

    def findings(self, sample: AnySample) -> dict[str, Finding]:
        """The entry's findings of a cell by key."""
        arms = (None,) if self.estimate.of == "pair" else (AV, REFERENCE, None)[: len(self.keys)]
        return {k: self.estimate.of_sample(sample, a) for k, a in zip(self.keys, arms, strict=True)}


def _average(values: FloatArray, weights: FloatArray, _: Sampling) -> Finding:
    """Σ values / Σ weights of the defined values with a weight above 0, without an interval."""
    counting = (weights > 0) & ~np.isnan(values)
    whole = float(np.sum(weights[counting]))
    return Finding(float(np.sum(values[counting])) / whole if whole else None)


def _arms_ratio(times_s: FloatArray, sampling: Sampling) -> Finding:
    return estimators.ratio(times_s[AV], times_s[REFERENCE], sampling)


def _p95(values: FloatArray, ran: BoolArray, sampling: Sampling) -> Finding:
    return estimators.quantile(values[ran], 0.95, sampling.confidence)


def _largest(values: FloatArray, _: Sampling) -> Finding:
    return estimators.quantile(values, 1.0, confidence=0.0)


def _count(values: FloatArray, _: Sampling) -> Finding:
    if np.isnan(values).all():
        return Finding(None, reason="a simulation of every pair failed")
    return Finding(int(np.nansum(values)))


_MEAN = partial(Estimate, by=estimators.mean, reliable_from=1_000)
_SHARE = partial(Estimate, by=estimators.share, weight="ran", undefined="every episode failed")
_COUNT = partial(Estimate, by=_count)
_T_MEAN = partial(Estimate, by=mean_of_arms, of="both", undefined="there is none of these")
_DELAY = partial(_T_MEAN, by=partial(mean_of_arms, least=float("-inf")))
_T_SHARE = partial(_T_MEAN, by=share_of_arms, weight=counted("passages", "reached"))
_OF_DRAWS = partial(Estimate, column=None, by=None, of="pair")
_TENTHS, _THOUSANDTHS = Style(digits=1), Style(digits=3)
_WHOLE, _EVENTS = Style(Form.COUNT, 0), Style(Form.EVENTS, 1)
_PERCENT, _PERMILLE, _FINE = (Style(Form.SHARE, digits) for digits in range(3))
_MET = "Only pairs in which someone stepped off count."
_REACHED = "Only vehicles that reached a crosswalk or touched somebody count."
_HUMAN_CRASHED = "A reference driver who crashed counts as driving on."
_WORST = ("Over all pairs: an AV that crashed, failed or timed out counts with `timeout_s`, a "
          "reference that did not pass with an undisturbed passage.")  # fmt: skip
_NO_TIME = "in every pair an episode failed or the AV crashed"
_NO_TAU = "there is no pair in which both vehicles crossed"
_NO_AV_TAU = "there is no pair in which the AV crossed and the reference passed"
_NOT_CROSSED, _NOBODY = "no episode crossed", "nobody was met"
_NO_EPISODE = "every episode failed"
_NO_EVENT = "no draw of the estimate ended in the event"
_ANY = partial(Entry, kinds=(*ENCOUNTERS, *SIMULATIONS))
_SIMULATED = partial(Entry, kinds=SIMULATIONS)
_RISK = partial(Entry, kinds=("risk",))

# fmt: off
ENTRIES: tuple[Entry, ...] = (
    Entry("time_s", "time to cross", f"Mean over the pairs in which neither episode failed and the "
          f"AV did not crash. A time-out counts as `timeout_s`. {_HUMAN_CRASHED}",
          _MEAN("counted_time_s", undefined=_NO_TIME), _TENTHS, "s", screen="always"),
    Entry("time_ratio", "ratio of times", "Sum of the AV's times over the sum of the reference's, "
          "over the pairs of `time_s`.", Estimate("counted_time_s", _arms_ratio, of="pair",
          reliable_from=1_000, undefined=_NO_TIME), beside="time_s", screen="always", sweep=(0,)),
    Entry("time_ratio_worst", "ratio of times, worst case", _WORST, Estimate("worst_time_s",
          _arms_ratio, "pair", reliable_from=1_000), worst_of="time_ratio", beside="kappa_worst"),
    Entry("mu", "μ, mean ratio of times", "μ, the mean of τ over the pairs in which both vehicles "
          "crossed; τ is the AV's time over the reference's.", _MEAN("tau", of="pair",
          undefined=_NO_TAU), _THOUSANDTHS, screen="always", paper="0.7044"),
    Entry("cv", "c_v, spread of that ratio", "c_v, the coefficient of variation of τ: its "
          "population standard deviation over μ.", Estimate("tau",
          estimators.coefficient_of_variation, of="pair", reliable_from=4_000,
          undefined="fewer than two pairs in which both vehicles crossed"), _PERCENT,
          screen="always", paper="4.54 %"),
    Entry("kappa", "crashes", "κ, the share of the episodes that did not fail in which the "
          "vehicle crashed.", _SHARE("crashed"), _EVENTS, screen="always", sweep=(0,), paper="0"),
    Entry("kappa_worst", "crashes, worst case", "Share of all pairs in which the AV crashed, failed"
          " or timed out.", _SHARE("missing", of="av", weight="every"), _EVENTS, worst_of="kappa"),
    Entry("delay_s", "delay", "Mean over the episodes that crossed.", _MEAN("delay_s",
          reliable_from=200, undefined=_NOT_CROSSED), _TENTHS, "s", screen="always", sweep=(0,)),
    Entry("delay_difference_s", "difference of delays", f"The AV's minus the reference's, over the "
          f"pairs in which the AV crossed. {_HUMAN_CRASHED}", _MEAN("delay_difference_s",
          of="pair", undefined=_NO_AV_TAU), _TENTHS, "s", beside="delay_s", screen="always"),
    Entry("pedestrian_wait_s", "people's wait", "Mean wait at the kerb: the sum of all waits over "
          "the number of people who arrived, up to the record's end.", Estimate("waited_s",
          estimators.ratio, weight="arrivals", reliable_from=200, undefined="nobody arrived"),
          _TENTHS, "s", screen="always", sweep=(0,)),
    Entry("conflict_pet", "PET below {pet_s:g} s", "Share of episodes with a post-encroachment "
          "time below `conflicts.pet_s`. A crash is a conflict of every kind.",
          _SHARE("conflict_pet"), _PERCENT, screen="always", sweep=(0,)),
    Entry("conflict_ttc", "TTC below {ttc_s:g} s", "The same, of the least time to collision.",
          _SHARE("conflict_ttc"), _PERCENT),
    Entry("conflict_time_advantage", "time advantage below {time_advantage_s:g} s", "The same, of "
          "the least time advantage.", _SHARE("conflict_time_advantage"), _PERCENT),
    Entry("conflict_drac", "DRAC above {drac_mps2:g} m/s²", "The same, of the deceleration rate "
          "to avoid a crash.", _SHARE("conflict_drac"), _PERCENT),
    Entry("mu_all", "μ, all pairs in which the AV crossed", f"μ over these pairs. {_HUMAN_CRASHED}",
          _MEAN("tau_all", of="pair", undefined=_NO_AV_TAU), _THOUSANDTHS),
    Entry("mu_worst", "μ, worst case", _WORST, _MEAN("tau_worst", of="pair"), _THOUSANDTHS),
    Entry("mu_met_someone", "μ, pairs that met someone", f"μ. {_MET}",
          _MEAN("tau", of="pair", met=True, undefined=_NO_TAU), _THOUSANDTHS),
    Entry("kappa_met_someone", "crashes, pairs that met someone", f"κ. {_MET}",
          _SHARE("crashed", met=True, undefined=_NOBODY), _FINE),
    Entry("kappa_all", "crashes, time-outs, failures", "κ if time-outs and failures of the AV's "
          "strategy count as crashes. Failures of the engine are left out.",
          _SHARE("missed", of="av", weight="tried"), _FINE),
    Entry("kappa_avoidable", "crashes avoidable by full braking", "Share of the episodes that "
          "did not fail with a crash that full braking would have prevented.",
          _SHARE("crash_avoidable"), _FINE),
    Entry("kappa_avoidable_attentive", "crashes avoidable by an attentive driver", "The same, by "
          "an attentive human (UN Regulation 157).", _SHARE("crash_avoidable_attentive"), _FINE),
    Entry("delay_met_someone_s", "delay, pairs that met someone", f"Delay. {_MET}", _MEAN("delay_s",
          met=True, reliable_from=200, undefined=_NOT_CROSSED), _TENTHS, "s"),
    Entry("delay_worst_s", "delay, worst case", _WORST, _MEAN("worst_delay_s"), _TENTHS, "s"),
    Entry("stops", "stops per episode", "Of the episodes that did not fail.",
          Estimate("stops", _average, weight="ran", undefined=_NO_EPISODE)),
    Entry("max_speed_mps", "largest speed", "Of the vehicle in any episode.",
          Estimate("max_speed_mps", _largest, undefined=_NO_EPISODE), unit="m/s"),
    Entry("max_deceleration_p95_mps2", "hardest braking, 95 % quantile, pairs that met someone",
          f"Of the largest value of each episode that did not fail. {_MET}",
          Estimate("max_deceleration_mps2", _p95, weight="ran", met=True, undefined=_NOBODY),
          unit="m/s²"),
    _ANY("pairs", "pairs", "Number of pairs.", _COUNT("every", of="pair"), _WHOLE),
    Entry("met_someone", "pairs that met someone", "Pairs in which someone stepped off, in "
          "either episode.", _COUNT("met_someone", of="pair"), _WHOLE),
    Entry("met_nobody", "pairs that met nobody", "Pairs in which nobody stepped off and neither "
          "episode failed.", _COUNT("met_nobody", of="pair"), _WHOLE),
    Entry("not_in_time_ratio", "pairs not in the ratio of times", "The pairs of which an episode "
          "failed or the AV crashed.", _COUNT("not_in_time_ratio", of="pair"), _WHOLE),
    Entry("mu_pairs", "pairs in μ", "Pairs that have a τ.", _COUNT("in_mu", of="pair"), _WHOLE),
    Entry("timed_out", "time-outs", "Episodes that timed out.", _COUNT("timed_out"), _WHOLE),
    _ANY("failed", "failures", "Episodes or arms that failed.", _COUNT("failed"), _WHOLE),
    _ANY("failed_strategy", "failures of the strategy", "Those of `failed` in which the strategy "
         "failed; the other failures are the engine's.", _COUNT("failed_strategy"), _WHOLE),
    _ANY("sumo_alone", "contacts that SUMO alone reports", "Episodes or passages in which SUMO "
         "reports a collision and the harness no contact.", _COUNT("sumo_alone"), _WHOLE),
    _ANY("fallbacks", "fallbacks", "Episodes or passages in which the strategy fell back on "
         "another one.", _COUNT("fell_back"), _WHOLE),
    _ANY("fallback_share", "fallbacks, episodes that met someone", "Their share among these.",
         Estimate("fell_back_met", _average, weight="met", undefined=_NOBODY), _FINE),
    _ANY("clamped_share", "uses of the model outside its data", "Uses of the interaction model "
         "for a vehicle that was faster or farther away than its data, among all uses.", Estimate(
         "clamped", _average, weight="conditionings", undefined="the model was not used"), _FINE),
    _SIMULATED("av_delay_s", "AVs' delay", "At the crosswalks, of the vehicles that `arms.av` "
          "drives; in the reference's arm of the same.", _DELAY(averaged("passages", "delay_s",
          "av")), _TENTHS, "s", screen="always", sweep=(0, 2)),
    _SIMULATED("other_delay_s", "other vehicles' delay", "Of all others at crosswalks.", _DELAY(
          averaged("passages", "delay_s", "other")), _TENTHS, "s", screen="other", sweep=(2,)),
    _SIMULATED("people_wait_s", "people's wait", "At the kerb, until stepping off or the end.",
          _T_MEAN(averaged("people", "wait_s")), _TENTHS, "s", screen="always"),
    _SIMULATED("people_delay_s", "people's delay", "Against an undisturbed walk; of SUMO's people "
          "their wait.", _DELAY(averaged("people", "delay_s")), _TENTHS, "s", screen="other",
          sweep=(2,)),
    _SIMULATED("queue_p95", "queue, 95 %, vehicles", "Vehicles below 5 km/h before the crosswalk, "
          "quantile over seconds; of several crosswalks that of the longest queue.",
          _T_MEAN(Of("max", "crosswalks", "queue_p95")), _TENTHS, screen="always", sweep=(0,)),
    _SIMULATED("throughput_per_hour", "throughput", "Vehicles over the crosswalks; with a queue "
          "that grows, the capacity.", _T_MEAN("throughput_per_hour"), Style(digits=0), "1/h",
          screen="always", sweep=(0,)),
    _SIMULATED("conflicts_pet", "PET below {pet_s:g} s", "Share of passages with a conflict or a "
          f"contact. {_REACHED}", _T_SHARE(counted("passages", "pet")), _PERMILLE, screen="always",
          sweep=(0,)),
    _SIMULATED("contacts", "contacts with people", f"By the vehicle's oriented outline. {_REACHED}",
          _T_SHARE(counted("passages", "touched")), _EVENTS, screen="always", sweep=(0,)),
    *(_SIMULATED(f"{who}_{key}", f"{whose}' {words}", "In both arms of the same vehicles.",
          _T_SHARE(counted("passages", who, rows), weight=counted("passages", who, "reached")),
          style, screen="other" if f"{who}_{key}" == "av_contacts" else "never",
          sweep=(0,) if f"{who}_{key}" == "av_contacts" else ())
      for key, words, rows, style in (("contacts", "contacts", "touched", _EVENTS),
                                      ("conflicts_pet", "PET below {pet_s:g} s", "pet", _PERMILLE))
      for who, whose in (("av", "AVs"), ("other", "other vehicles"))),
    *(_SIMULATED(f"share_{name}", f"AVs' steps by {words}", "Share that it decided of the steps in "
          "which a strategy drove AVs, in the reference's arm the same vehicles.",
          _T_SHARE(summed("passages", name, "av", "driven"), weight=summed("passages", "steps",
          "av", "driven")), _PERCENT, screen="other" if name == "strategy" else "never",
          sweep=(0,) if name == "strategy" else ())
      for name, words in LIMITED_BY.items()),
    _SIMULATED("driven", "AVs' passages driven", "By a strategy.", _T_SHARE(counted("passages",
          "av", "driven"), weight=counted("passages", "av")), _PERMILLE),
    _SIMULATED("not_driven", "AVs' passages not driven", "In the AV's arm, with the reasons.",
          _COUNT(counted("passages", "av", "left"), of="av"), _WHOLE),
    *(_SIMULATED(f"conflicts_{key}", words, "As PET.", _T_SHARE(counted("passages", key)),
          _PERMILLE) for key, words in (("ttc", "TTC below {ttc_s:g} s"),
                                        ("drac", "DRAC above {drac_mps2:g} m/s²"))),
    _SIMULATED("people_los", "level of service, people", "Of the HCM (2010, exhibit 19-2), by "
          "`people_wait_s`; JSON has the wait.", _T_MEAN(averaged("people", "wait_s"), of="arms"),
          Style(Form.LEVEL, 1), "s"),
    _SIMULATED("let_go", "people for whom the first driver yielded", "Of those who waited.",
          _T_SHARE(counted("people", "let_go"), weight=counted("people", "waited")), _PERCENT),
    _SIMULATED("vehicles_delay_s", "all vehicles' delay", "Of AVs and others at the crosswalks.",
          _DELAY(averaged("passages", "delay_s")), _TENTHS, "s"),
    *(_SIMULATED(key, heading, meaning, _T_MEAN(averaged("vehicles", *of)), _TENTHS, "s",
          network=True) for key, heading, meaning, *of in (
          ("av_time_loss_s", "time loss of AVs", "Of trips through the whole network with the wait "
           "for departure.", "time_loss_s", "av"),
          ("other_time_loss_s", "time loss of other vehicles", "As that of AVs.", "time_loss_s",
           "other"), ("depart_delay_s", "wait for departure", "Of all trips.", "depart_delay_s"))),
    _SIMULATED("growth", "growth of the vehicles on the network", "From the second third of the "
          "time to the last, as a share of the vehicles due in a third: those not served.",
          Estimate("growth", estimators.mean,
          undefined="trips are longer than a third of the counted time"), _PERMILLE, network=True),
    _SIMULATED("long_trips", "simulations whose growth is not known", "Their mean trip is longer "
          "than a third of the counted time.", _COUNT("long_trips"), _WHOLE, network=True),
    *(_SIMULATED(key, words, f"`{column}`.", _COUNT(column), _WHOLE) for key, words, column in (
          ("passages", "passages", counted("passages")),
          ("met_somebody", "passages that met someone", counted("passages", "met")),
          ("cut_off", "passages that did not end", counted("passages", "cut_off")),
          ("people", "people", Of("count_distinct", "people", "person")),
          ("still_crossing", "people still crossing at the end", counted("people", "no_delay")),
          ("never_went", "people who never went", counted("people", "never_went")))),
    *(_SIMULATED(key, words, f"`{column}`.", _COUNT(column), _WHOLE, network=True)
      for key, words, column in (
          ("vehicles", "trips", counted("vehicles")),
          ("avs", "trips of AVs", counted("vehicles", "av")),
          ("unfinished", "trips that did not end", counted("vehicles", "unfinished")),
          *((name, name.replace("_", " "), summed("arms", name)) for name in (
              "sumo_people", "vehicle_collisions", "person_collisions", "teleports",
              "emergency_stops", "overlaps", "people_left_out")))),
    *(_RISK(key, heading, meaning, _OF_DRAWS(undefined=why), style)
      for key, heading, style, why, meaning in (
          ("probability", "probability of the event", _FINE, _NO_EVENT,
           "That an episode ends in the event, by the ways to it that were found."),
          ("all_ways_high", "upper bound with other ways", _FINE, _NO_EPISODE,
           "One-sided bound on the probability by all ways: the interval's end, and where draws "
           "are weighted `nominal_high` on top."),
          ("probability_worst", "probability if failures were events", _FINE, "no episode failed",
           "The worst case."),
          ("nominal_high", "upper bound by nominal draws alone", _FINE, _NO_EPISODE,
           "One-sided, by Clopper and Pearson, from the nominal draws of all rounds."),
          ("coefficient_of_variation", "coefficient of variation", _THOUSANDTHS, _NO_EVENT,
           "Standard error over probability."),
          ("effective_sample_size", "effective sample size", Style(digits=0), "",
           "Squared sum of the draws' values over the sum of their squares."),
          ("episodes", "episodes", _WHOLE, "", "All that were run."),
          ("brute_force_episodes", "episodes that brute force would need", _WHOLE, _NO_EVENT,
           "For the same coefficient of variation."),
          ("weighted", "weighted draws", _WHOLE, "", "Draws of the estimate; 0: by brute force."),
          ("failures", "failed episodes", _WHOLE, "", "They count as no event."),
          ("timed_out_episodes", "timed-out episodes", _WHOLE, "", "They count as no event."))),
)
"""The catalogue, in the order in which it is shown."""
# fmt: on


def entries_of(kind: RunKind) -> list[Entry]:
    """The entries of a kind of run."""
    return [entry for entry in ENTRIES if kind in entry.kinds]


ENTRY_OF = MappingProxyType({key: entry for entry in ENTRIES for key in entry.keys})
"""The entries by the keys of their numbers."""
