"""Model files in; how fast pedestrians walk and drivers drive out.

The variables are 1/R, v, v_p and 1/T_adv, in this order (paper, section II).  The model answers two
questions: how fast a pedestrian walks in front of a vehicle, and how fast a driver drives towards a
pedestrian.

T_adv = |R/v − L/v_p| depends on v_p, so "v_p given (R, v, T_adv)" has two readings.  T_adv is
integrated out (``marginal``), or given as in the paper's figures (``given_time_advantage``).
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.core.documents import as_plain, check_form, parse_json
from harness.core.errors import InputError, checked, nearest_name
from harness.core.files import read_file, write_file
from harness.core.freezing import Frozen
from harness.core.vocabulary import NO_MODEL_USE, ROUNDING, FloatArray, ModelUse
from harness.model.mixture.conditional import Conditional
from harness.model.mixture.distribution import TruncatedGaussianMixture

SHIPPED = Path(__file__).parent / "shipped"
"""The folder of the shipped models."""

VARIABLES = (
    "inverse_range_per_m",
    "vehicle_speed_mps",
    "pedestrian_speed_mps",
    "inverse_time_advantage_per_s",
)
INVERSE_RANGE, VEHICLE_SPEED, PEDESTRIAN_SPEED, INVERSE_TIME_ADVANTAGE = range(4)
"""The variables in their order in the mixture, and their places in it."""

WALKING_GIVEN = (INVERSE_RANGE, VEHICLE_SPEED)
DRIVING_GIVEN = (INVERSE_RANGE, PEDESTRIAN_SPEED, INVERSE_TIME_ADVANTAGE)
"""What a walking speed is drawn under, and what the human driver sees."""


@dataclass(frozen=True, eq=False)
class InteractionModel(Frozen):
    """A fitted mixture with its name, provenance and hash.

    Conditions are clamped to the box in which the model was fitted.

    Attributes:
        mixture: mixture of dimension 4, with variables in the order of ``VARIABLES``.
        name: name of the model.
        provenance: its origin in free form.
        sha256: hash of its file.
    """

    mixture: TruncatedGaussianMixture
    name: str
    provenance: Mapping[str, Any]
    sha256: str

    @cached_property
    def _limits(self) -> list[tuple[float, float]]:
        lower, upper = self.mixture.lower.tolist(), self.mixture.upper.tolist()
        return list(zip(lower, upper, strict=True))

    def walking_speed(self, quantile: float, range_m: float, vehicle_speed_mps: float) -> float:
        """v_p at a quantile of f(v_p | 1/R, v), 1/T_adv integrated out (reading ``marginal``).

        Args:
            quantile: in [0, 1].
            range_m: R > 0; for R ≤ 0 use ``walking_speed_unconditional``.
            vehicle_speed_mps: v.

        Returns:
            The walking speed in m/s, within the model's box.
        """
        conditional = _conditional(self.mixture, PEDESTRIAN_SPEED, *WALKING_GIVEN)
        given = self._clamped(conditional, (1 / range_m, vehicle_speed_mps))
        return conditional.ppf_at(quantile, given)

    def walking_speed_unconditional(self, quantile: float) -> float:
        """v_p at a quantile of its marginal, for a pedestrian who meets no vehicle."""
        return _conditional(self.mixture, PEDESTRIAN_SPEED).ppf_at(quantile, np.empty(0))

    def driver_speed(
        self,
        range_m: float,
        pedestrian_speed_mps: float,
        inverse_time_advantage_per_s: float | None = None,
        *,
        quantile: float | None = None,
    ) -> float:
        """The speed v of a driver who sees a given pedestrian, in m/s.

        Args:
            range_m: R > 0.
            pedestrian_speed_mps: v_p.
            inverse_time_advantage_per_s: 1/T_adv with the present v (reading
                ``given_time_advantage``); None leaves it out (``marginal``).
            quantile: quantile of the conditional distribution; None: its mode.
        """
        values = [1 / range_m, pedestrian_speed_mps]
        if inverse_time_advantage_per_s is not None:
            values.append(inverse_time_advantage_per_s)
        conditional = _conditional(self.mixture, VEHICLE_SPEED, *DRIVING_GIVEN[: len(values)])
        y = self._clamped(conditional, values)
        return conditional.mode_at(y) if quantile is None else conditional.ppf_at(quantile, y)

    def _clamped(self, conditional: Conditional, values: Sequence[float]) -> FloatArray:
        """The given variables of one pedestrian, clamped to the box; every episode calls it."""
        limits = [self._limits[variable] for variable in conditional.given]
        return np.array(
            [min(max(x, low), high) for x, (low, high) in zip(values, limits, strict=True)]
        )


@lru_cache(maxsize=64)
def _conditional(mixture: TruncatedGaussianMixture, target: int, *given: int) -> Conditional:
    """The conditional distribution of a mixture, which keeps tables of its own."""
    return Conditional(mixture, target, given)


class ModelUseCounter:
    """Counts the uses of the model in an episode by the state of the ego.

    The model's conditions are clamped to its box, so for a farther or faster ego the answer belongs
    to another state.  An ego that stands, or that is nearer than any in the data, is clamped too
    but counted separately, because the answer for the slowest or nearest ego in the data also
    applies to it.
    """

    def __init__(self, model: InteractionModel) -> None:
        lower, upper = model.mixture.lower, model.mixture.upper
        self.ranges_m = 1 / float(upper[INVERSE_RANGE]), 1 / float(lower[INVERSE_RANGE])
        self.speeds_mps = float(lower[VEHICLE_SPEED]), float(upper[VEHICLE_SPEED])
        self.begin()

    def begin(self) -> None:
        """Begin a new episode."""
        self.counts = NO_MODEL_USE

    def note(self, range_m: float, speed_mps: float) -> None:
        """Count a use of the model with the ego in this state."""
        (nearest, farthest), (slowest, fastest) = self.ranges_m, self.speeds_mps
        uses, clamped, near, speed_excess, range_excess = self.counts
        beyond_m, beyond_mps = range_m - farthest, speed_mps - fastest
        if beyond_m > ROUNDING * farthest or beyond_mps > ROUNDING * fastest:
            clamped += 1
            speed_excess = max(speed_excess, beyond_mps)
            range_excess = max(range_excess, beyond_m)
        elif nearest - range_m > ROUNDING * nearest or slowest - speed_mps > ROUNDING * fastest:
            near += 1
        self.counts = ModelUse(uses + 1, clamped, near, speed_excess, range_excess)


def check_support(
    model: InteractionModel,
    range_m: float,
    speed_mps: float,
    speed_key: str = "ego.initial_speed_mps",
) -> None:
    """Raise if the model has no data for the state of the ego at the trigger.

    ``speed_key`` is the key of the scenario that gives the speed.

    Raises:
        InputError: v0 or R0 is outside the model's box.
    """
    support = ModelUseCounter(model)
    for key, value, unit, (low, high) in (
        (speed_key, speed_mps, "m/s", support.speeds_mps),
        ("ego.trigger_range_m", range_m, "m", support.ranges_m),
    ):
        if not low * (1 - ROUNDING) <= value <= high * (1 + ROUNDING):
            raise InputError(
                key,
                f"{value:g} {unit} is outside the box of model {model.name!r}",
                f"{low:g} to {high:g} {unit}; [pedestrians.walking_speed] or "
                'model.pedestrian_reading = "unconditional" and arms that do not use the model; '
                "or model.extrapolate = true, which clamps",
            )


_Number = Annotated[float, Field(ge=-1e9, le=1e9)]
"""A number in a model file; larger numbers are errors, and their products might be infinite."""


class _ModelFile(BaseModel):
    """The form of a model file; the mixture checks its arrays."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    format_version: Literal[1] = Field(alias="schema")
    name: str
    variables: list[str]
    lower: list[_Number]
    upper: list[_Number]
    weights: list[_Number]
    locations: list[list[_Number]]
    scale_matrices: list[list[list[_Number]]]
    provenance: dict[str, Any] = {}


_ARRAYS = ("lower", "upper", "weights", "locations", "scale_matrices")
"""The arrays of a model file, which are those of the mixture."""


@checked
def load_model(name: str, path: str | None = None) -> InteractionModel:
    """A shipped model by name, or a model file by path.

    Args:
        name: name of a shipped model; it is not used with ``path``.
        path: path of a model file.

    Raises:
        InputError: there is no such model, or the file is not a valid model.
    """
    if path is not None:
        return read_model(Path(path))
    shipped = {file.stem: file for file in SHIPPED.glob("*.json")}
    if name not in shipped:
        names = ", ".join(sorted(shipped))
        allowed = f"{names}; a file: model.path, in Python load_model(name, path)"
        nearest = nearest_name(name, shipped)
        raise InputError("model.name", f"unknown model {name!r}", allowed, nearest)
    return read_model(shipped[name])


def model_named(text: str) -> InteractionModel:
    """The model of a file, or a shipped model of that name.

    Raises:
        InputError: see ``load_model``.
    """
    return load_model(text, text if text.endswith(".json") or Path(text).is_file() else None)


def read_model(path: Path) -> InteractionModel:
    """Read and check a model file (format: docs/files.md).

    Raises:
        InputError: the file is missing or is not JSON, its format version or variables differ, its
            arrays have wrong shapes, its weights do not sum to 1, a scale matrix is not positive
            definite, or bounds are empty or infinite.
    """
    return _parsed(read_file(path), str(path))


def write_model(
    path: Path, mixture: TruncatedGaussianMixture, name: str, provenance: Mapping[str, Any]
) -> InteractionModel:
    """Write a model file, complete or not at all.

    Args:
        path: the file; an existing one is replaced.
        mixture: mixture of dimension 4, with variables in the order of ``VARIABLES``.
        name: name of the model.
        provenance: the model's card, as plain data.

    Returns:
        The model, as read from the file.

    Raises:
        InputError: the file cannot be written, or would not be a valid model (see
            ``read_model``).
    """
    document = {"schema": 1, "name": name, "variables": list(VARIABLES)}
    document |= {each: getattr(mixture, each).tolist() for each in _ARRAYS}
    document["provenance"] = as_plain(provenance)
    content = (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode()
    model = _parsed(content, str(path))
    write_file(path, content)
    return model


def _parsed(content: bytes, where: str) -> InteractionModel:
    """The model of a file's content."""
    try:
        document = parse_json(content)
    except ValueError as error:
        allowed = "a model file from `harness fit`"
        raise InputError(where, f"not a JSON file ({error})", allowed) from None
    file = check_form(_ModelFile, document, where)
    if file.variables != list(VARIABLES):
        raise InputError(where, f"variables {file.variables!r}", ", ".join(VARIABLES))
    if len(file.lower) != len(VARIABLES):
        raise InputError(where, f"lower has {len(file.lower)} entries", str(len(VARIABLES)))
    try:
        mixture = TruncatedGaussianMixture(**{name: getattr(file, name) for name in _ARRAYS})
    except InputError as error:
        raise InputError(where, str(error)) from None
    if mixture.lower[INVERSE_RANGE] <= 0 or mixture.lower[PEDESTRIAN_SPEED] <= 0:
        raise InputError(where, "lower bounds of 1/R and v_p must be positive")
    return InteractionModel(
        mixture, file.name, file.provenance, hashlib.sha256(content).hexdigest()
    )
