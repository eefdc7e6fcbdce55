"""Packs the modules of the user's own strategies into one archive."""

import hashlib
import importlib.util
import io
import sysconfig
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from harness.strategies.program import is_program

_WRITTEN = (1980, 1, 1, 0, 0, 0)
"""Time stamp of all files in the archive, so that equal files give equal archives."""


@dataclass(frozen=True)
class Archive:
    """A zip file of modules and packages."""

    content: bytes

    @property
    def name(self) -> str:
        """File name with a digest of the content."""
        return f"strategies-{hashlib.sha256(self.content).hexdigest()[:16]}.zip"


def top_modules(strategies: Iterable[str]) -> frozenset[str]:
    """Return the top-level modules of the user's own strategies (``package.module:Class``).

    Strategies that are programs are excluded, because every machine must have them installed.
    """
    return frozenset(
        name.partition(":")[0].partition(".")[0]
        for name in strategies
        if ":" in name and not is_program(name)
    )


def archive_of(modules: Iterable[str]) -> Archive | None:
    """Zip modules.  A package is zipped with all its files.

    Args:
        modules: top-level modules that can be imported on this machine.

    Returns:
        The archive; None if all modules are installed packages, which every machine must have.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for module in sorted(modules):
            for name, path in _files(module):
                archive.writestr(zipfile.ZipInfo(name, _WRITTEN), path.read_bytes())
        empty = not archive.namelist()
    return None if empty else Archive(buffer.getvalue())


def _files(module: str) -> Iterator[tuple[str, Path]]:
    """Yield each file of a module with its name inside the archive."""
    spec = importlib.util.find_spec(module)
    if spec is None:
        return
    roots = [Path(place) for place in spec.submodule_search_locations or ()]
    if not roots and spec.origin is not None:
        roots = [Path(spec.origin)]
    for root in roots:
        if _is_installed(root):
            continue
        paths = sorted(root.rglob("*")) if root.is_dir() else [root]
        for path in paths:
            name = path.relative_to(root.parent)
            hidden = any(part.startswith(".") or part == "__pycache__" for part in name.parts)
            if path.is_file() and not hidden:
                yield name.as_posix(), path


def _is_installed(path: Path) -> bool:
    places = (Path(sysconfig.get_path(kind)) for kind in ("purelib", "platlib", "stdlib"))
    return any(path.is_relative_to(place) for place in places)
