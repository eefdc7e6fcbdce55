"""The catalogue of every reported number: from which column it is estimated, and how.

To report another number, add an entry: it names a column and an estimator, and says whether the
first screen has the number (README.md shows that screen).  Screens, page, JSON, CSV and the
reference in the documentation follow.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from harness.core.vocabulary import LIMITED_BY, BoolArray, FloatArray
from harness.results import estimators, student
from harness.results.columns import AV, REFERENCE, PairSample
from harness.results.estimators import Sampling
from harness.results.finding import Finding, Form
from harness.results.simulated import Of, SimulationSample, averaged, counted, summed
from harness.results.tables import ENCOUNTERS, SIMULATIONS, RunKind

AnySample = PairSample | SimulationSample

OfColumn = Callable[[np.ndarray, Sampling], Finding]
OfWeighted = Callable[[np.ndarray, np.ndarray, Sampling], Finding]
"""These compute an entry from its column, its weight if it has one, and a ``Sampling``.

The arrays have shape (n,), of an arm or of the pairs; or (2, n), of both arms for their difference.
"""


@dataclass(frozen=True, slots=True)
class Entry:
    """A reported number of a cell: of each arm, of the AV's arm, of its pairs, or of several.

    Attributes:
        key: its name in JSON and CSV, with its unit; the reference's number is ``key_human``.
        heading: its name on screens, without its unit.  It may hold a threshold of ``[conflicts]``
            in braces, see ``title``.
        meaning: for the reference in the documentation.
        column: a column of ``PairSample`` by its name, or of ``SimulationSample``; None of a risk,
            which computes its numbers from its draws.
        estimate: how the column becomes a number; None of a risk.
        of: "arms", "av", "pair", or "both": each arm and the paired difference.
        weight: a second column: denominators of a ratio, trials of a share, steps.
        met: whether only pairs count in which someone stepped off, in either arm.
        form, unit, digits: how it is written; a share's unit is per cent.
        reliable_from: the least number of informative pairs for a reliable bootstrap interval.
        undefined: the reason if the number is undefined.
        screen: whether the first screen has it; ``--full`` has every entry.
        beside: the entry of both arms in whose row a number of pairs stands.
        worst_case: whether the first screen has it as soon as a pair was left out.
        paper: the value in Chen, Zhao, Peng (2017), section III-E, as it is printed there.
        kinds: the kinds of run that have it.
        network: whether it is of the whole network, so that there is none by crosswalk.
        optional: whether the first screen has it only where it is defined, and other than the one
            before: the contacts of AVs where all vehicles are.
    """

    key: str
    heading: str
    meaning: str
    column: str | Of | None = None
    estimate: OfColumn | OfWeighted | None = None
    of: Literal["arms", "av", "pair", "both"] = "arms"
    weight: str | Of = ""
    met: bool = False
    form: Form = Form.NUMBER
    unit: str = ""
    digits: int = 2
    reliable_from: int = 0
    undefined: str = ""
    screen: bool = False
    beside: str = ""
    worst_case: bool = False
    paper: str = ""
    kinds: tuple[RunKind, ...] = ENCOUNTERS
    network: bool = False
    optional: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """The names of its numbers: the AV's, the reference's and the difference if it has them."""
        number = {"arms": 2, "both": 3}.get(self.of, 1)
        return (self.key, f"{self.key}_human", f"{self.key}_difference")[:number]

    @property
    def columns(self) -> tuple[Any, ...]:
        """The column, and the weight if it has one."""
        return (self.column, self.weight) if self.weight else (self.column,)

    def title(self, thresholds: Mapping[str, float]) -> str:
        """The heading with the thresholds of conflicts, and its unit.

        >>> ENTRY_OF["conflict_pet"].title({"pet_s": 1.5})
        'PET below 1.5 s'
        """
        return self.heading.format(**thresholds) + (self.unit and f", {self.unit}")

    def findings(self, sample: AnySample) -> dict[str, Finding]:
        """The entry's findings of a cell by key."""
        arms = (None,) if self.of == "pair" else (AV, REFERENCE, None)[: len(self.keys)]
        found = (self.judged(self._estimated(sample, arm)) for arm in arms)
        return dict(zip(self.keys, found, strict=True))

    def _estimated(self, sample: AnySample, arm: int | None) -> Finding:
        values = [sample[name] for name in self.columns]
        if arm is not None:
            values = [np.broadcast_to(each, (2, sample.n))[arm] for each in values]
        if self.met:
            values = [each[..., sample["met_someone"]] for each in values]
        return self.of_columns(*values, sample.samplings[arm or AV])

    def of_columns(self, *columns: Any) -> Finding:
        """What its estimator finds of columns and a ``Sampling``; a risk's entry has none."""
        assert self.estimate is not None
        return self.estimate(*columns)

    def judged(self, finding: Finding) -> Finding:
        """The finding with the reason why it is undefined, or its interval unreliable."""
        if finding.value is None:
            return replace(finding, reason=self.undefined or finding.reason)
        if finding.events is not None:
            return finding
        return finding.reliable_above(self.reliable_from, "informative pairs")


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


def _t_mean(values: FloatArray, sampling: Sampling) -> Finding:
    """The mean of an arm's values, none of which is negative, or of the arms' differences."""
    if values.ndim == 1:
        return student.t_mean(values, sampling.confidence, least=0.0)
    return student.t_mean(np.subtract(*values), sampling.confidence)


def _t_share(events: FloatArray, trials: FloatArray, sampling: Sampling) -> Finding:
    """An arm's share of events among trials, or the difference of the arms' shares."""
    if events.ndim == 1:
        return student.clustered_share(events, trials, sampling.confidence)
    av, human = zip(events, trials, strict=True)
    return student.t_ratio_difference(av, human, sampling.confidence)


_MEANS = partial(Entry, estimate=_t_mean, of="both", unit="s", digits=1, kinds=SIMULATIONS,
                 undefined="there is none of these")  # fmt: skip
_PASSAGES = partial(_MEANS, estimate=_t_share, weight=counted("passages", "reached"), unit="",
                    form=Form.SHARE)  # fmt: skip
_REACHED = "Only vehicles that reached a crosswalk or touched somebody count."
_MEAN = partial(Entry, estimate=estimators.mean, reliable_from=1_000)
_SHARE = partial(Entry, estimate=estimators.share, weight="ran", form=Form.SHARE,
                 undefined="every episode failed")  # fmt: skip
_COUNT = partial(Entry, estimate=_count, form=Form.COUNT, digits=0)
_MET = "Only pairs in which someone stepped off count."
_HUMAN_CRASHED = "A reference driver who crashed counts as driving on."
_WORST = ("Over all pairs: an AV that crashed, failed or timed out counts with `timeout_s`, a "
          "reference that did not pass with an undisturbed passage.")  # fmt: skip
_NO_TIME = "in every pair an episode failed or the AV crashed"
_NO_TAU = "there is no pair in which both vehicles crossed"
_NO_AV_TAU = "there is no pair in which the AV crossed and the reference passed"
_NOT_CROSSED, _NOBODY = "no episode crossed", "nobody was met"
_BOTH = (*ENCOUNTERS, *SIMULATIONS)
_NO_EVENT = "no draw of the estimate ended in the event"
_RISK = partial(Entry, of="pair", kinds=("risk",), digits=0)
_TOTAL = partial(_COUNT, kinds=SIMULATIONS)

# fmt: off
ENTRIES: tuple[Entry, ...] = (
    _MEAN("time_s", "time to cross", f"Mean over the pairs in which neither episode failed and the "
          f"AV did not crash. A time-out counts as `timeout_s`. {_HUMAN_CRASHED}",
          "counted_time_s", unit="s", digits=1, undefined=_NO_TIME, screen=True),
    Entry("time_ratio", "ratio of times", "Sum of the AV's times over the sum of the reference's, "
          "over the pairs of `time_s`.", "counted_time_s", _arms_ratio, of="pair", beside="time_s",
          reliable_from=1_000, undefined=_NO_TIME, screen=True),
    Entry("time_ratio_worst", "ratio of times, worst case", _WORST, "worst_time_s", _arms_ratio,
          of="pair", beside="kappa_worst", reliable_from=1_000, worst_case=True),
    _MEAN("mu", "μ, mean ratio of times", "μ, the mean of τ over the pairs in which both vehicles "
          "crossed; τ is the AV's time over the reference's.", "tau", of="pair", digits=3,
          undefined=_NO_TAU, screen=True, paper="0.7044"),
    Entry("cv", "c_v, spread of that ratio", "c_v, the coefficient of variation of τ: its "
          "population standard deviation over μ.", "tau", estimators.coefficient_of_variation,
          of="pair", form=Form.SHARE, digits=0, reliable_from=4_000, screen=True, paper="4.54 %",
          undefined="fewer than two pairs in which both vehicles crossed"),
    _SHARE("kappa", "crashes", "κ, the share of the episodes that did not fail in which the "
           "vehicle crashed.", "crashed", form=Form.EVENTS, digits=1, screen=True, paper="0"),
    _SHARE("kappa_worst", "crashes, worst case", "Share of all pairs in which the AV crashed, "
           "failed or timed out.", "missing", of="av", weight="every", form=Form.EVENTS, digits=1,
           worst_case=True),
    _MEAN("delay_s", "delay", "Mean over the episodes that crossed.", "delay_s", unit="s",
          digits=1, reliable_from=200, undefined=_NOT_CROSSED, screen=True),
    _MEAN("delay_difference_s", "difference of delays", f"The AV's minus the reference's, over the "
          f"pairs in which the AV crossed. {_HUMAN_CRASHED}", "delay_difference_s", of="pair",
          unit="s", digits=1, beside="delay_s", undefined=_NO_AV_TAU, screen=True),
    Entry("pedestrian_wait_s", "people's wait", "Mean wait at the kerb: the sum of all waits over "
          "the number of people who arrived, up to the record's end.", "waited_s", estimators.ratio,
          unit="s", weight="arrivals", digits=1, reliable_from=200, undefined="nobody arrived",
          screen=True),
    _SHARE("conflict_pet", "PET below {pet_s:g} s", "Share of episodes with a post-encroachment "
           "time below `conflicts.pet_s`. A crash is a conflict of every kind.", "conflict_pet",
           digits=0, screen=True),
    _SHARE("conflict_ttc", "TTC below {ttc_s:g} s", "The same, of the least time to collision.",
           "conflict_ttc", digits=0),
    _SHARE("conflict_time_advantage", "time advantage below {time_advantage_s:g} s",
           "The same, of the least time advantage.", "conflict_time_advantage", digits=0),
    _SHARE("conflict_drac", "DRAC above {drac_mps2:g} m/s²", "The same, of the deceleration rate "
           "to avoid a crash.", "conflict_drac", digits=0),
    _MEAN("mu_all", "μ, all pairs in which the AV crossed", f"μ over these pairs. "
          f"{_HUMAN_CRASHED}", "tau_all", of="pair", digits=3, undefined=_NO_AV_TAU),
    _MEAN("mu_worst", "μ, worst case", _WORST, "tau_worst", of="pair", digits=3),
    _MEAN("mu_met_someone", "μ, pairs that met someone", f"μ. {_MET}", "tau", of="pair", met=True,
          digits=3, undefined=_NO_TAU),
    _SHARE("kappa_met_someone", "crashes, pairs that met someone", f"κ. {_MET}", "crashed",
           met=True, undefined=_NOBODY),
    _SHARE("kappa_all", "crashes, time-outs, failures", "κ if time-outs and failures of the AV's "
           "strategy count as crashes. Failures of the engine are left out.", "missed", of="av",
           weight="tried"),
    _SHARE("kappa_avoidable", "crashes avoidable by full braking", "Share of the episodes that "
           "did not fail with a crash that full braking would have prevented.", "crash_avoidable"),
    _SHARE("kappa_avoidable_attentive", "crashes avoidable by an attentive driver",
           "The same, by an attentive human driver (UN Regulation 157).",
           "crash_avoidable_attentive"),
    _MEAN("delay_met_someone_s", "delay, pairs that met someone", f"Delay. {_MET}", "delay_s",
          met=True, unit="s", digits=1, reliable_from=200, undefined=_NOT_CROSSED),
    _MEAN("delay_worst_s", "delay, worst case", _WORST, "worst_delay_s", unit="s", digits=1),
    Entry("stops", "stops per episode", "Of the episodes that did not fail.", "stops", _average,
          weight="ran", undefined="every episode failed"),
    Entry("max_speed_mps", "largest speed", "Of the vehicle in any episode.", "max_speed_mps",
          _largest, unit="m/s", undefined="every episode failed"),
    Entry("max_deceleration_p95_mps2", "hardest braking, 95 % quantile, pairs that met someone",
          f"Of the largest value of each episode that did not fail. {_MET}",
          "max_deceleration_mps2", _p95, weight="ran", met=True, unit="m/s²", undefined=_NOBODY),
    _COUNT("pairs", "pairs", "Number of pairs.", "every", of="pair", kinds=_BOTH),
    _COUNT("met_someone", "pairs that met someone", "Pairs in which someone stepped off, in "
           "either episode.", "met_someone", of="pair"),
    _COUNT("met_nobody", "pairs that met nobody", "Pairs in which nobody stepped off and neither "
           "episode failed.", "met_nobody", of="pair"),
    _COUNT("not_in_time_ratio", "pairs not in the ratio of times", "The pairs of which an episode "
           "failed or the AV crashed.", "not_in_time_ratio", of="pair"),
    _COUNT("mu_pairs", "pairs in μ", "Pairs that have a τ.", "in_mu", of="pair"),
    _COUNT("timed_out", "time-outs", "Episodes that timed out.", "timed_out"),
    _COUNT("failed", "failures", "Episodes or arms that failed.", "failed", kinds=_BOTH),
    _COUNT("failed_strategy", "failures of the strategy", "Those of `failed` in which the strategy "
           "failed; the other failures are the engine's.", "failed_strategy", kinds=_BOTH),
    _COUNT("sumo_alone", "contacts that SUMO alone reports", "Episodes or passages in which SUMO "
           "reports a collision and the harness no contact.", "sumo_alone", kinds=_BOTH),
    _COUNT("fallbacks", "fallbacks", "Episodes or passages in which the strategy fell back on "
           "another one.", "fell_back", kinds=_BOTH),
    Entry("fallback_share", "fallbacks, episodes that met someone", "Their share among these.",
          "fell_back_met", _average, weight="met", form=Form.SHARE, undefined=_NOBODY, kinds=_BOTH),
    Entry("clamped_share", "uses of the model outside its data", "Uses of the interaction model "
          "for a vehicle that was faster or farther away than its data, among all uses.",
          "clamped", _average, form=Form.SHARE, weight="conditionings", kinds=_BOTH,
          undefined="the model was not used"),
    _MEANS("av_delay_s", "AVs' delay", "At the crosswalks, of the vehicles that `arms.av` drives; "
           "in the reference's arm of the same.", averaged("passages", "delay_s", "av"),
           screen=True),
    _MEANS("other_delay_s", "other vehicles' delay", "Of all others at the crosswalks.",
           averaged("passages", "delay_s", "other"), screen=True, optional=True),
    _MEANS("people_wait_s", "people's wait", "At the kerb, until stepping off or the end.",
           averaged("people", "wait_s"), screen=True),
    _MEANS("people_delay_s", "people's delay", "Against an undisturbed walk; of SUMO's people "
           "their wait.", averaged("people", "delay_s"), screen=True, optional=True),
    _MEANS("queue_p95", "queue, 95 %, vehicles", "Vehicles below 5 km/h before the crosswalk, "
           "quantile over seconds; of several crosswalks that of the longest queue.",
           Of("max", "crosswalks", "queue_p95"), unit="", screen=True),
    _MEANS("throughput_per_hour", "throughput", "Vehicles over the crosswalks; with a queue that "
           "grows, the capacity.", "throughput_per_hour", unit="1/h", digits=0, screen=True),
    _PASSAGES("conflicts_pet", "PET below {pet_s:g} s", "Share of passages with a conflict or a "
              f"contact. {_REACHED}", counted("passages", "pet"), screen=True),
    _PASSAGES("contacts", "contacts with people", f"By the vehicle's oriented outline. {_REACHED}",
              counted("passages", "touched"), form=Form.EVENTS, screen=True),
    *(_PASSAGES(f"{who}_{key}", f"{whose}' {words}", "In both arms of the same vehicles.",
                counted("passages", who, rows), weight=counted("passages", who, "reached"),
                form=form, screen=f"{who}_{key}" == "av_contacts", optional=True)
      for key, words, rows, form in (("contacts", "contacts", "touched", Form.EVENTS),
                                     ("conflicts_pet", "PET below {pet_s:g} s", "pet", Form.SHARE))
      for who, whose in (("av", "AVs"), ("other", "other vehicles"))),
    *(_PASSAGES(f"share_{name}", f"AVs' steps by {words}", "Share that it decided of the steps in "
                "which a strategy drove AVs, in the reference's arm the same vehicles.",
                summed("passages", name, "av", "driven"), digits=0,
                weight=summed("passages", "steps", "av", "driven"),
                screen=name == "strategy", optional=True)
      for name, words in LIMITED_BY.items()),
    _PASSAGES("driven", "AVs' passages driven", "By a strategy.",
              counted("passages", "av", "driven"), weight=counted("passages", "av")),
    _TOTAL("not_driven", "AVs' passages not driven", "In the AV's arm, with the reasons.",
           counted("passages", "av", "left"), of="av"),
    _PASSAGES("conflicts_ttc", "TTC below {ttc_s:g} s", "As PET.", counted("passages", "ttc")),
    _PASSAGES("conflicts_drac", "DRAC above {drac_mps2:g} m/s²", "As PET.",
              counted("passages", "drac")),
    _MEANS("people_los", "level of service, people", "Of the HCM (2010, exhibit 19-2), by "
           "`people_wait_s`; JSON has the wait.", averaged("people", "wait_s"), of="arms",
           form=Form.LEVEL),
    _PASSAGES("let_go", "people for whom the first driver yielded", "Of those who waited.",
              counted("people", "let_go"), weight=counted("people", "waited"), digits=0),
    _MEANS("vehicles_delay_s", "all vehicles' delay", "Of AVs and others at the crosswalks.",
           averaged("passages", "delay_s")),
    _MEANS("av_time_loss_s", "time loss of AVs", "Of trips through the whole network with the wait "
           "for departure.", averaged("vehicles", "time_loss_s", "av"), network=True),
    _MEANS("other_time_loss_s", "time loss of other vehicles", "As that of AVs.",
           averaged("vehicles", "time_loss_s", "other"), network=True),
    _MEANS("depart_delay_s", "wait for departure", "Of all trips.",
           averaged("vehicles", "depart_delay_s"), network=True),
    _TOTAL("growth", "growth of the vehicles on the network", "From the second third of the time "
           "to the last, as a share of the vehicles due in a third: those not served.", "growth",
           estimate=estimators.mean, form=Form.SHARE, digits=1, network=True,
           undefined="trips are longer than a third of the counted time"),
    _TOTAL("long_trips", "simulations whose growth is not known", "Their mean trip is longer than "
           "a third of the counted time.", "long_trips", network=True),
    *(_TOTAL(key, words, f"`{column}`.", column) for key, words, column in (
          ("passages", "passages", counted("passages")),
          ("met_somebody", "passages that met someone", counted("passages", "met")),
          ("cut_off", "passages that did not end", counted("passages", "cut_off")),
          ("people", "people", Of("count_distinct", "people", "person")),
          ("still_crossing", "people still crossing at the end", counted("people", "no_delay")),
          ("never_went", "people who never went", counted("people", "never_went")))),
    *(_TOTAL(key, words, f"`{column}`.", column, network=True) for key, words, column in (
          ("vehicles", "trips", counted("vehicles")),
          ("avs", "trips of AVs", counted("vehicles", "av")),
          ("unfinished", "trips that did not end", counted("vehicles", "unfinished")),
          *((name, name.replace("_", " "), summed("arms", name)) for name in (
              "sumo_people", "vehicle_collisions", "person_collisions", "teleports",
              "emergency_stops", "overlaps", "people_left_out")))),
    _RISK("probability", "probability of the event", "That an episode ends in the event, by the "
          "ways to it that were found.", form=Form.SHARE, digits=2, undefined=_NO_EVENT),
    _RISK("all_ways_high", "upper bound with other ways", "One-sided bound on the probability by "
          "all ways: the interval's end, and where draws are weighted `nominal_high` on top.",
          form=Form.SHARE, digits=2, undefined="every episode failed"),
    _RISK("probability_worst", "probability if failures were events", "The worst case.",
          form=Form.SHARE, digits=2, undefined="no episode failed"),
    _RISK("nominal_high", "upper bound by nominal draws alone", "One-sided, by Clopper and "
          "Pearson, from the nominal draws of all rounds.", form=Form.SHARE, digits=2,
          undefined="every episode failed"),
    _RISK("coefficient_of_variation", "coefficient of variation", "Standard error over "
          "probability.", digits=3, undefined=_NO_EVENT),
    _RISK("effective_sample_size", "effective sample size", "Squared sum of the draws' values over "
          "the sum of their squares."),
    _RISK("episodes", "episodes", "All that were run.", form=Form.COUNT),
    _RISK("brute_force_episodes", "episodes that brute force would need", "For the same "
          "coefficient of variation.", form=Form.COUNT, undefined=_NO_EVENT),
    *(_RISK(key, heading, meaning, form=Form.COUNT) for key, heading, meaning in (
        ("weighted", "weighted draws", "Draws of the estimate; 0: by brute force."),
        ("failures", "failed episodes", "They count as no event."),
        ("timed_out_episodes", "timed-out episodes", "They count as no event."))),
)
"""The catalogue, in the order in which it is shown."""
# fmt: on


def entries_of(kind: RunKind) -> list[Entry]:
    """The entries of a kind of run."""
    return [entry for entry in ENTRIES if kind in entry.kinds]


ENTRY_OF = MappingProxyType({key: entry for entry in ENTRIES for key in entry.keys})
"""The entries by the keys of their numbers."""
