"""The model file: JSON with a fitted mixture and its card (format: docs/files.md)."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import InputError, unknown_name
from harness.mixture import TruncatedGaussianMixture

SCHEMA = 1
"""Version of the model file's format."""

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
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        # ValueError: a name no file can have.
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(where, f"model file cannot be read ({why})") from None
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        raise InputError(where, "not a JSON file", _WANTED) from None
    if not isinstance(document, dict):
        raise InputError(where, "not a JSON object", _WANTED)
    return document, hashlib.sha256(content).hexdigest()


def write_document(path: Path, document: Mapping[str, Any]) -> None:
    """Write beside, then rename: the file appears complete or not at all.

    Raises:
        InputError: the place cannot be written.
    """
    content = (json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    except OSError as error:
        raise InputError(str(path), f"cannot be written ({error.strerror})") from None
    finally:
        beside.unlink(missing_ok=True)


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
    if not isinstance(document.get("provenance", {}), dict):
        raise InputError(where, "provenance is not an object")
    arrays = {}
    for key in _ARRAYS:
        try:
            arrays[key] = np.array(document[key], dtype=float)
        except (ValueError, TypeError, OverflowError):
            raise InputError(where, f"{key} is no rectangular array of numbers") from None
    if arrays["lower"].shape != (len(variables),):
        raise InputError(where, f"lower has shape {arrays['lower'].shape}", f"({len(variables)},)")
    try:
        return TruncatedGaussianMixture(**arrays)
    except InputError as error:
        raise InputError(where, str(error)) from None
