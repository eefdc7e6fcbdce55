"""Reads and writes model files: JSON with a fitted mixture and its card (see docs/files.md)."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from harness.core.documents import check_form, parse_json
from harness.core.errors import InputError, nearest_name
from harness.core.files import read_file, write_file
from harness.model.interaction.model import (
    INVERSE_RANGE,
    PEDESTRIAN_SPEED,
    VARIABLES,
    InteractionModel,
)
from harness.model.mixture.distribution import TruncatedGaussianMixture

SHIPPED = Path(__file__).parents[1] / "shipped"
"""The folder of the shipped models."""

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


def load_model(name: str, path: str | None = None) -> InteractionModel:
    """A shipped model by name, or a model file by path.

    Args:
        name: name of a shipped model; it is not used with ``path``.
        path: path of a model file.

    Raises:
        InputError: there is no such model, or the file is not a valid model.
    """
    if path is not None:
        file = Path(path)
    else:
        shipped = {file.stem: file for file in SHIPPED.glob("*.json")}
        if name not in shipped:
            names = ", ".join(sorted(shipped))
            allowed = f"{names}; a file: model.path, in Python load_model(name, path)"
            nearest = nearest_name(name, shipped)
            raise InputError("model.name", f"unknown model {name!r}", allowed, nearest)
        file = shipped[name]
    return read_model(file)


def read_model(path: Path) -> InteractionModel:
    """Read and check a model file (format: docs/files.md).

    Raises:
        InputError: the file is missing or is not JSON, its format version or variables differ, its
            arrays have wrong shapes, its weights do not sum to 1, a scale matrix is not positive
            definite, or bounds are empty or infinite.
    """
    content = read_file(path)
    try:
        document = parse_json(content)
    except ValueError as error:
        allowed = "a model file from `harness fit`"
        raise InputError(str(path), f"not a JSON file ({error})", allowed) from None
    return _model(document, str(path), hashlib.sha256(content).hexdigest())


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
    document = {
        "schema": 1,
        "name": name,
        "variables": list(VARIABLES),
        "lower": mixture.lower.tolist(),
        "upper": mixture.upper.tolist(),
        "weights": mixture.weights.tolist(),
        "locations": mixture.locations.tolist(),
        "scale_matrices": mixture.scale_matrices.tolist(),
        "provenance": dict(provenance),
    }
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    try:
        parse_json(text)
    except ValueError as error:
        raise InputError(str(path), f"would not be readable as a model file ({error})") from None
    model = _model(document, str(path), hashlib.sha256(text.encode()).hexdigest())
    write_file(path, text.encode())
    return model


def _model(document: Any, where: str, sha256: str) -> InteractionModel:
    """Check the variables and bounds of a document and return its model."""
    file = check_form(_ModelFile, document, where)
    if file.variables != list(VARIABLES):
        raise InputError(where, f"variables {file.variables!r}", ", ".join(VARIABLES))
    if len(file.lower) != len(VARIABLES):
        raise InputError(where, f"lower has {len(file.lower)} entries", str(len(VARIABLES)))
    arrays = {"weights", "locations", "scale_matrices", "lower", "upper"}
    try:
        mixture = TruncatedGaussianMixture(**file.model_dump(include=arrays))
    except InputError as error:
        raise InputError(where, str(error)) from None
    if mixture.lower[INVERSE_RANGE] <= 0 or mixture.lower[PEDESTRIAN_SPEED] <= 0:
        raise InputError(where, "lower bounds of 1/R and v_p must be positive")
    return InteractionModel(mixture, file.name, file.provenance, sha256)
