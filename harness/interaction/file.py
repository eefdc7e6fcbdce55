"""The model file: JSON with a fitted mixture and its card (format: docs/files.md)."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.documents import parse_json
from harness.errors import InputError, unknown_name
from harness.files import write_file
from harness.interaction.model import INVERSE_RANGE, PEDESTRIAN_SPEED, VARIABLES, InteractionModel
from harness.mixture import TruncatedGaussianMixture
from harness.resources import shipped_directory

SCHEMA = 1
"""Version of the model file's format."""

LARGEST_NUMBER = 1e9
"""No speed in m/s, and no inverse of a distance or a time, is larger; products would overflow."""

_ARRAYS = ("weights", "locations", "scale_matrices", "lower", "upper")
_KEYS = {"schema", "name", "variables", "provenance", *_ARRAYS}
_WANTED = "a model file as `harness fit` writes"


def read_document(path: Path) -> tuple[dict[str, Any], str]:
    """The JSON object of a file and the file's sha256.

    Raises:
        InputError: missing, or no JSON object.
    """
    where = str(path)
    try:
        if path.exists() and not path.is_file():
            # A pipe or a device may never end.
            raise InputError(where, "model file cannot be read (no regular file)", _WANTED)
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        # ValueError: a name no file can have.
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(where, f"model file cannot be read ({why})") from None
    try:
        document = parse_json(content)
    except ValueError as error:
        raise InputError(where, f"not a JSON file ({error})", _WANTED) from None
    if not isinstance(document, dict):
        raise InputError(where, "not a JSON object", _WANTED)
    return document, hashlib.sha256(content).hexdigest()


def write_document(path: Path, document: Mapping[str, Any]) -> None:
    """Write the file whole.

    Raises:
        InputError: it could not be read again, as with a name that cannot be printed.
        HarnessError: the file system refuses.
    """
    text = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        parse_json(text)
    except ValueError as error:
        raise InputError(str(path), f"could not be read again ({error})") from None
    write_file(path, text.encode())


def as_mixture(
    document: Mapping[str, Any], variables: Sequence[str], where: str
) -> TruncatedGaussianMixture:
    """The mixture a document describes.

    Args:
        document: as ``read_document`` gives it.
        variables: the names it must have, in their order.
        where: what to call it in messages.

    Raises:
        InputError: a key is unknown or missing, another version, other variables, or no valid
            mixture of that dimension.
    """
    for key in document:
        if key not in _KEYS:
            raise unknown_name(where, "key", key, _KEYS)
    for key in sorted(_KEYS - {"provenance"}):
        if key not in document:
            raise InputError(where, f"key {key!r} is missing")
    if document["schema"] != SCHEMA:
        raise InputError(where, f"format version {document['schema']!r}", str(SCHEMA))
    if document["variables"] != list(variables):
        raise InputError(where, f"variables {document['variables']!r}", ", ".join(variables))
    if not isinstance(document["name"], str):
        raise InputError(where, f"name {document['name']!r}", "text")
    if not isinstance(document.get("provenance", {}), dict):
        raise InputError(where, "provenance is not an object")
    arrays = {}
    for key in _ARRAYS:
        try:
            arrays[key] = np.array(document[key], dtype=float)
        except (ValueError, TypeError, OverflowError):
            raise InputError(where, f"{key} is no rectangular array of numbers") from None
        finite = arrays[key][np.isfinite(arrays[key])]
        if (np.abs(finite) > LARGEST_NUMBER).any():
            raise InputError(where, f"{key} holds a number beyond {LARGEST_NUMBER:g}")
    if arrays["lower"].shape != (len(variables),):
        raise InputError(where, f"lower has shape {arrays['lower'].shape}", f"({len(variables)},)")
    try:
        return TruncatedGaussianMixture(**arrays)
    except InputError as error:
        raise InputError(where, str(error)) from None


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
        InputError: missing, no JSON, another format version or other variables, wrong shapes,
            weights that do not sum to 1, scale matrices that are not positive definite, empty or
            infinite bounds.
    """
    document, sha256 = read_document(path)
    return InteractionModel(
        _checked(document, str(path)),
        str(document["name"]),
        document.get("provenance") or {},
        sha256,
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
    _checked(document, str(path))
    write_document(path, document)
    return read_model(path)


def _checked(document: Mapping[str, Any], where: str) -> TruncatedGaussianMixture:
    """The mixture of a document whose variables and bounds mean what they must."""
    mixture = as_mixture(document, VARIABLES, where)
    if not (np.isfinite(mixture.lower).all() and np.isfinite(mixture.upper).all()):
        raise InputError(where, "a bound is not finite", "a bounded box")
    if mixture.lower[INVERSE_RANGE] <= 0 or mixture.lower[PEDESTRIAN_SPEED] <= 0:
        raise InputError(where, "lower bounds of 1/R and v_p must be positive")
    return mixture
