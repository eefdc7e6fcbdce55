"""The interaction model: a truncated Gaussian mixture and what its four variables mean.

The one place that knows their order: 1/R, v, v_p, 1/T_adv (paper, section II).  It answers two
questions: how fast does a pedestrian walk who sees this vehicle, and how fast would a driver go
who sees this pedestrian.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from harness.encounter import FloatArray
from harness.errors import InputError, unknown_name
from harness.mixture import Conditional, TruncatedGaussianMixture
from harness.resources import shipped_directory

VARIABLES = (
    "inverse_range_per_m",
    "vehicle_speed_mps",
    "pedestrian_speed_mps",
    "inverse_time_advantage_per_s",
)
INVERSE_RANGE, VEHICLE_SPEED, PEDESTRIAN_SPEED, INVERSE_TIME_ADVANTAGE = range(4)

SCHEMA = 1
"""Version of the model file's format."""

_KEYS = {
    "schema",
    "name",
    "variables",
    "lower",
    "upper",
    "weights",
    "locations",
    "scale_matrices",
    "provenance",
}


class InteractionModel:
    """A fitted mixture with its name, provenance and identity.

    Conditions are clamped to the model's support: it says nothing outside the box it was fitted
    in.

    Args:
        mixture: of dimension 4, variables in the order of ``VARIABLES``.
        name: what it is called.
        provenance: where it comes from, free form.
        sha256: of the file it was read from.
    """

    def __init__(
        self,
        mixture: TruncatedGaussianMixture,
        name: str,
        provenance: Mapping[str, Any],
        sha256: str,
    ) -> None:
        self.mixture = mixture
        self.name = name
        self.provenance = dict(provenance)
        self.sha256 = sha256

    def walking_speed(
        self, quantile: FloatArray, range_m: FloatArray, vehicle_speed_mps: FloatArray
    ) -> FloatArray:
        """v_p at a quantile of f(v_p | 1/R, v), 1/T_adv integrated out (reading ``marginal``).

        Args:
            quantile: shape (n,), in [0, 1].
            range_m: R, shape (n,); R ≤ 0 has no condition: see ``walking_speed_unconditional``.
            vehicle_speed_mps: v, shape (n,).

        Returns:
            Walking speeds in m/s, shape (n,), within the model's box.  Each is the same to the
            last bit whatever else is asked in the same call.
        """
        with np.errstate(divide="ignore"):
            given = np.column_stack((1 / np.asarray(range_m, dtype=float), vehicle_speed_mps))
        clamped = self._clamp(given, (INVERSE_RANGE, VEHICLE_SPEED))
        return self._walking.ppf(np.asarray(quantile, dtype=float), clamped)

    def walking_speed_unconditional(self, quantile: float) -> float:
        """v_p at a quantile of its marginal, for someone who meets no vehicle."""
        return float(self._walking_marginal.ppf(np.array([quantile]), np.empty((1, 0)))[0])

    def driver_speed(
        self,
        range_m: float,
        pedestrian_speed_mps: float,
        inverse_time_advantage_per_s: float | None = None,
        *,
        quantile: float | None = None,
    ) -> float:
        """The speed v a driver goes at who sees this pedestrian, in m/s.

        Args:
            range_m: R > 0.
            pedestrian_speed_mps: v_p.
            inverse_time_advantage_per_s: 1/T_adv with the present v (reading
                ``given_time_advantage``); None leaves it out (``marginal``).
            quantile: of the conditional distribution; None takes its mode.
        """
        if inverse_time_advantage_per_s is None:
            conditional = self._driving_marginal
            given: tuple[int, ...] = (INVERSE_RANGE, PEDESTRIAN_SPEED)
            values = [1 / range_m, pedestrian_speed_mps]
        else:
            conditional = self._driving
            given = (INVERSE_RANGE, PEDESTRIAN_SPEED, INVERSE_TIME_ADVANTAGE)
            values = [1 / range_m, pedestrian_speed_mps, inverse_time_advantage_per_s]
        y = self._clamp(np.array([values]), given)
        if quantile is None:
            return float(conditional.mode(y)[0])
        return float(conditional.ppf(np.array([quantile]), y)[0])

    def _clamp(self, values: FloatArray, variables: tuple[int, ...]) -> FloatArray:
        chosen = list(variables)
        return np.clip(values, self.mixture.lower[chosen], self.mixture.upper[chosen])

    @cached_property
    def _walking(self) -> Conditional:
        return self.mixture.conditional(PEDESTRIAN_SPEED, (INVERSE_RANGE, VEHICLE_SPEED))

    @cached_property
    def _walking_marginal(self) -> Conditional:
        return self.mixture.conditional(PEDESTRIAN_SPEED, ())

    @cached_property
    def _driving(self) -> Conditional:
        return self.mixture.conditional(
            VEHICLE_SPEED, (INVERSE_RANGE, PEDESTRIAN_SPEED, INVERSE_TIME_ADVANTAGE)
        )

    @cached_property
    def _driving_marginal(self) -> Conditional:
        return self.mixture.conditional(VEHICLE_SPEED, (INVERSE_RANGE, PEDESTRIAN_SPEED))


def load_model(name: str, path: str | None = None) -> InteractionModel:
    """A shipped model by name, or a model file by path.

    Raises:
        InputError: no such model, or the file is no valid model.
    """
    if path is None:
        folder = shipped_directory("models")
        shipped = {file.stem: file for file in folder.glob("*.json")}
        if name not in shipped:
            raise unknown_name("model.name", "model", name, shipped)
        return read_model(shipped[name])
    return read_model(Path(path))


def read_model(path: Path) -> InteractionModel:
    """Read and check a model file (format: docs/files.md).

    Raises:
        InputError: missing, no JSON, another format version, wrong shapes, weights that do not
            sum to 1, scale matrices that are not positive definite, empty bounds.
    """
    where = str(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(where, f"model file cannot be read ({error.strerror})") from None
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        raise InputError(where, "not a JSON file", "a model file as `harness fit` writes") from None
    if not isinstance(document, dict):
        raise InputError(where, "not a JSON object", "a model file as `harness fit` writes")
    return InteractionModel(
        _mixture(document, where),
        str(document["name"]),
        document.get("provenance") or {},
        hashlib.sha256(content).hexdigest(),
    )


def write_model(
    path: Path, mixture: TruncatedGaussianMixture, name: str, provenance: Mapping[str, Any]
) -> InteractionModel:
    """Write a model file, complete or not at all, and read it back.

    Args:
        path: written beside and renamed; an earlier file of that name is replaced.
        mixture: of dimension 4, variables in the order of ``VARIABLES``.
        name: what to call it.
        provenance: its card, plain data.

    Raises:
        InputError: the place cannot be written, or a model file must not say this (see
            ``read_model``).
    """
    document = {
        "schema": SCHEMA,
        "name": name,
        "variables": list(VARIABLES),
        "lower": mixture.lower.tolist(),
        "upper": mixture.upper.tolist(),
        "weights": mixture.weights.tolist(),
        "locations": mixture.locations.tolist(),
        "scale_matrices": mixture.scale_matrices.tolist(),
        "provenance": dict(provenance),
    }
    _mixture(document, str(path))
    content = (json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    except OSError as error:
        raise InputError(str(path), f"cannot be written ({error.strerror})") from None
    finally:
        beside.unlink(missing_ok=True)
    return read_model(path)


def _mixture(document: dict[str, Any], where: str) -> TruncatedGaussianMixture:
    for key in document:
        if key not in _KEYS:
            raise unknown_name(where, "key", key, _KEYS)
    for key in sorted(_KEYS - {"provenance"}):
        if key not in document:
            raise InputError(where, f"key {key!r} is missing")
    if document["schema"] != SCHEMA:
        raise InputError(where, f"format version {document['schema']!r}", str(SCHEMA))
    if document["variables"] != list(VARIABLES):
        raise InputError(where, f"variables {document['variables']!r}", ", ".join(VARIABLES))
    if not isinstance(document.get("provenance", {}), dict):
        raise InputError(where, "provenance is not an object")
    arrays = {}
    for key in ("weights", "locations", "scale_matrices", "lower", "upper"):
        try:
            arrays[key] = np.array(document[key], dtype=float)
        except (ValueError, TypeError, OverflowError):
            raise InputError(where, f"{key} is no rectangular array of numbers") from None
    if arrays["lower"].shape != (len(VARIABLES),):
        raise InputError(where, f"lower has shape {arrays['lower'].shape}", "(4,)")
    if not (np.isfinite(arrays["lower"]).all() and np.isfinite(arrays["upper"]).all()):
        raise InputError(where, "a bound is not finite", "a bounded box")
    if arrays["lower"][INVERSE_RANGE] <= 0 or arrays["lower"][PEDESTRIAN_SPEED] <= 0:
        raise InputError(where, "lower bounds of 1/R and v_p must be positive")
    try:
        return TruncatedGaussianMixture(**arrays)
    except InputError as error:
        raise InputError(where, str(error)) from None
