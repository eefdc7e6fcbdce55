"""The form of a fitted model's card, held against a model file before it is shown."""

from pydantic import BaseModel, ConfigDict

from harness.documents import check_form
from harness.interaction import InteractionModel


class _Form(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Score(_Form):
    mean: float | None
    standard_error: float | None


class _Candidate(_Form):
    components: int
    converged: bool
    log_likelihood: float
    bic: float
    bic_gain_share: float | None
    gradient_norm: float = 0.0
    held_out: _Score | None
    held_out_less_chosen: _Score | None
    held_out_driver: _Score | None


class _Near(_Form):
    range_m: float
    vehicle_speed_mps: float
    within_m: float
    within_mps: float
    rows: int
    effective_rows: float | None
    encounters: int | None
    vehicles: int | None
    effective_vehicles: float | None


class _Rule(_Form):
    components: int | None


class _Card(_Form):
    source: list[str]
    commands: list[str]
    rows_sha256: str
    rows_read: int
    rows_outside_box: dict[str, int]
    rows: int
    effective_rows: float | None
    encounters: int | None
    vehicles: int | None
    effective_vehicles: float | None
    near_state: _Near
    weigh: str
    components: int
    chosen_by: str
    weight_sum: float
    candidates: list[_Candidate]
    rule: _Rule
    folds_of_vehicles: int
    warnings: list[str]


def check_card(model: InteractionModel, file: str) -> None:
    """Refuse to show a model whose card is not as ``harness fit`` writes it.

    A file of other origin, whose provenance is free, has no table of candidates.

    Args:
        model: as read.
        file: it was read from, for messages.

    Raises:
        InputError: a key is missing, or of another type.
    """
    if "candidates" in model.provenance:
        check_form(_Card, model.provenance, f"{file}: provenance")
