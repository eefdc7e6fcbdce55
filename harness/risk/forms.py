"""The form of a risk's two documents, held against them where they are read."""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from harness.encounter import Arm, Side

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]
Number = Annotated[float, Field(ge=-1e18, le=1e18)]


class _Form(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Model(_Form):
    name: str
    sha256: str


class AskedForm(_Form):
    """The form of ``risk.json``; what its scenario means is ``validate``'s business."""

    name: str
    scenario: dict[str, Any]
    arm: Literal["av", "human"]
    event: str
    target_cv: Number
    most_episodes: Count
    in_sumo: bool
    seed: int
    versions: dict[str, str]
    model: _Model


class _Person(_Form):
    side: Annotated[Side, Field(strict=False)]
    arrival_s: Number
    quantile: Share | None
    critical_gap_s: Number | None
    found_at_look: Count | None


class _Way(_Form):
    share: Share
    events: Count
    pedestrians: list[_Person]
    critical_pairs: Annotated[list[Count], Field(min_length=2, max_length=2)]


class ResultForm(_Form):
    """The form of ``result.json``."""

    scenario: str
    arm: Annotated[Arm, Field(strict=False)]
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
    events: Count
    events_in_all: Count
    first_look_draws: Count
    first_look_events: Count
    probability_worst: Share | None
    failed: Count
    timed_out: Count
    compared_with_other_engine: Count
    differing: Count
    differences: list[str]
    differing_by_a_tie: Count
    ties: list[str]
    levels: list[list[Number]]
    ways: list[_Way]
    warnings: list[str]

    @model_validator(mode="after")
    def _whole(self) -> Self:
        """An estimate has its interval; what was saved its sample; what failed its worst case."""
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
