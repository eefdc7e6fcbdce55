"""Folders of the shipped files: in the package, or next to it in a checkout."""

from pathlib import Path
from typing import Literal

PACKAGE = Path(__file__).resolve().parents[1]


def shipped_directory(kind: Literal["networks", "scenarios"]) -> Path:
    """The folder of the shipped networks or scenarios."""
    inside = PACKAGE / kind
    return inside if inside.is_dir() else PACKAGE.parent / kind
