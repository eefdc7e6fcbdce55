"""The form of a model's card, by which a card of ``harness fit`` is told from any other origin."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError


class _Form(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Score(_Form):
    mean: float | None
    standard_error: float | None


class _Candidate(_Form):
    components: Annotated[int, Field(ge=1)]
    converged: bool
    log_likelihood: float
    bic: float
    bic_gain_share: float | None
    held_out: _Score | None
    held_out_less_chosen: _Score | None
    held_out_driver: _Score | None


class _Near(_Form):
    range_m: float
    vehicle_speed_mps: float
    within_m: float
    within_mps: float
    rows: int
    effective_rows: float
    encounters: int | None
    vehicles: int | None
    effective_vehicles: float | None


class _Rule(_Form):
    components: int | None


class _Card(_Form):
    commands: list[str]
    rows_sha256: str
    rows_read: int
    rows_outside_box: dict[str, int]
    rows: int
    effective_rows: float
    encounters: int | None
    vehicles: int | None
    effective_vehicles: float | None
    near_state: _Near
    weigh: str
    weight_sum: float
    components: int
    chosen_by: str
    candidates: Annotated[list[_Candidate], Field(min_length=1)]
    rule: _Rule
    folds_of_vehicles: int
    warnings: list[str]


def is_card(provenance: Mapping[str, Any]) -> bool:
    """Whether a model's provenance, which may be anything, is a card as ``harness fit`` writes."""
    try:
        card = _Card.model_validate(provenance)
    except ValidationError:
        return False
    numbers = [candidate.components for candidate in card.candidates]
    return "any" in card.rows_outside_box and len({*numbers}) == len(numbers)
