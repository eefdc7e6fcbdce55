"""The findings of a risk estimate (``result.json``), which every view shows."""

from dataclasses import replace
from operator import attrgetter
from typing import Annotated, Self

from pydantic import Field, computed_field, model_validator
from pydantic_core import PydanticCustomError

from harness.core.encounter import Arm, Side
from harness.old.statistics.entries import Entry, Finding, Form
from harness.old.statistics.findings import Note, Rank
from harness.old.statistics.intervals import Proportion
from harness.old.studies.risk.asking import Document

SCHEMA = 3
"""Version of ``result.json`` and ``--json``.

Version 1 had neither ``findings`` nor ``notes``.  Version 2 had quantiles and numbers of updates in
place of ``walking_speed_mps`` and ``seen_after_s``.
"""

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]
Number = Annotated[float, Field(ge=-1e18, le=1e18)]


class Person(Document):
    """A pedestrian of an episode.

    ``walking_speed_mps`` is None if they do not walk.  ``seen_after_s`` is the time from the first
    update of perception at which they can be seen to the one that detects them; it is None if
    perception detects every pedestrian or no pedestrian.  ``culprit`` says whether the event is due
    to them: whether the ego hit them first or, without a contact, whether the same motion of the
    ego would be in the event with them alone.
    """

    arrival_s: Number
    side: Side
    walking_speed_mps: Number | None
    critical_gap_s: Number | None
    seen_after_s: Number | None
    threshold_s: Number | None = None
    latency_s: Number | None = None
    culprit: bool = False


class Way(Document):
    """One of the likeliest ways to the event.

    Attributes:
        share: share of the probability.
        events: number of draws of the estimate that took this way.
        episode: number of the likeliest episode.
        pedestrians: pedestrians of that episode.
        critical_pairs: first and last pair of ``critical.toml`` that took this way.
    """

    share: Share
    events: Count
    episode: Count
    pedestrians: tuple[Person, ...]
    critical_pairs: tuple[Count, Count]


class RiskFindings(Document):
    """The findings of a finished risk estimate.

    If ``by_brute_force``, all draws of the estimate are nominal.  With a flow a weighted draw takes
    several episodes; ``episodes_to_estimate`` counts them.  ``probability`` is None if no
    draw ended in the event.  ``nominal_high`` is the upper bound from the nominal draws alone.
    ``probability_worst`` counts every failed episode as an event.  It is None if no episode failed
    and ``probability`` is None.
    """

    scenario: str
    arm: Arm
    strategy: str
    event: str
    by_brute_force: bool
    probability: Share | None
    ci_low: Share | None
    ci_high: Share | None
    nominal_high: Share
    nominal_draws: Count
    nominal_events: Count
    confidence: Annotated[float, Field(gt=0, lt=1)]
    coefficient_of_variation: Number | None
    effective_sample_size: Number | None
    episodes: Count
    brute_force_episodes: Count | None
    draws: Count
    episodes_to_estimate: Count
    events: Count
    events_in_all: Count
    first_look_draws: Count
    first_look_events: Count
    probability_worst: Share | None
    failed: Count
    timed_out: Count
    levels: tuple[tuple[Number, ...], ...]
    ways: tuple[Way, ...]
    notes: tuple[Note, ...]

    @model_validator(mode="after")
    def _whole(self) -> Self:
        """Check that a probability comes with its interval, sample size and worst case."""
        together = [
            (self.probability is not None, ("ci_low", "ci_high")),
            (self.brute_force_episodes is not None, ("effective_sample_size",)),
            (self.failed > 0, ("probability_worst",)),
        ]
        for needed, names in together:
            for name in names:
                if needed and getattr(self, name) is None:
                    raise PydanticCustomError("missing_number", f"a number as {name}")
        return self

    @computed_field  # type: ignore[prop-decorator]
    @property
    def warnings(self) -> tuple[str, ...]:
        """The sentences of the notes."""
        return tuple(note.text for note in self.notes)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def findings(self) -> dict[str, Finding]:
        """Every entry of ``ENTRIES`` by its key."""
        doubt = next((note.text for note in self.notes if note.rank is Rank.FEW_PAIRS), None)
        values: dict[str, Finding] = {}
        for entry in ENTRIES:
            values |= entry.findings(self)
        estimate = values["probability"]
        if doubt is not None and estimate.value is not None:
            values["probability"] = replace(estimate, reliable=False, reason=doubt)
        return values


def _number(
    key: str, heading: str, meaning: str, form: Form = Form.NUMBER, undefined: str = ""
) -> Entry[RiskFindings]:
    """Return an entry whose value is the field with the same key."""
    return Entry(key, heading, meaning, form, paired=attrgetter(key), undefined=undefined)


SMALL_SAMPLE = 30
"""An interval is unreliable below this effective sample size."""

_NO_ESTIMATE = "No draw of the estimate ended in the event."

ENTRIES: tuple[Entry[RiskFindings], ...] = (
    Entry(
        "probability",
        "probability of the event",
        "The probability that an episode ends in the event in one of the ways that were found.",
        paired=lambda risk: Proportion(
            risk.probability, risk.ci_low, risk.ci_high, risk.events, risk.draws
        ),
        undefined=_NO_ESTIMATE,
    ),
    Entry(
        "nominal_high",
        "upper bound by nominal draws alone",
        "One-sided Clopper–Pearson bound on the probability of all ways to the event.",
        paired=lambda risk: Proportion(
            risk.nominal_high, None, None, risk.nominal_events, risk.nominal_draws
        ),
    ),
    _number(
        "probability_worst",
        "probability if every failed episode were an event",
        "The worst case, in which every failed episode is an event.",
        undefined="No episode failed.",
    ),
    _number(
        "coefficient_of_variation",
        "coefficient of variation",
        "The standard error of the probability, divided by the probability.",
        undefined=_NO_ESTIMATE,
    ),
    _number(
        "effective_sample_size",
        "effective sample size",
        "The squared sum of the weights, divided by the sum of their squares.",
    ),
    _number("episodes", "episodes run", "All episodes, including the exploration.", Form.COUNT),
    _number(
        "brute_force_episodes",
        "episodes that brute force would need",
        "The number of nominal draws with the same coefficient of variation.",
        Form.COUNT,
        _NO_ESTIMATE,
    ),
)
"""Every number that a risk estimate reports."""
