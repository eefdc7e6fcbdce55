"""Regular files, read safely; files are written under another name, synced and then renamed."""

import csv
import errno
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from harness.core.errors import HarnessError, InputError, Parameter, reason_of

PACKAGE = Path(__file__).resolve().parents[1]
"""The folder of the package."""


def shipped_directory(kind: Literal["networks", "scenarios"]) -> Path:
    """The folder of shipped networks or scenarios: in the package, or beside it in a checkout."""
    inside = PACKAGE / kind
    return inside if inside.is_dir() else PACKAGE.parent / kind


def read_file(path: Path) -> bytes:
    """The content of a file.

    Raises:
        InputError: it does not exist, cannot be read, or is a folder, a pipe or a device (reading
            these might never end).
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(str(path), "cannot be read (not a regular file)")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        # ValueError: a name that no file can have.
        raise InputError(str(path), f"cannot be read ({reason_of(error)})") from None


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder, which is renamed to ``path`` if the block succeeds.

    Raises:
        OSError: the file system refuses (full, read-only); the temporary file is removed.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield beside
        with beside.open("rb+") as file:
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def write_file(path: Path, content: bytes) -> None:
    """Write a file whole.

    Raises:
        HarnessError: the file system refuses.
    """
    try:
        with whole_file(path) as beside:
            beside.write_bytes(content)
    except OSError as error:
        raise cannot_write(path, error) from None


def check_target(path: Path, suffix: str = "") -> None:
    """Refuse a file that cannot be written, before any work begins.

    Raises:
        InputError: it is a folder, or has not the suffix, or its folder is none to write in.
    """
    if not path.name.endswith(suffix) or path.is_dir() or not os.access(path.parent, os.W_OK):
        allowed = f"a {suffix or 'file'} in a writable folder"
        raise InputError(Parameter("out", path), "cannot be written", allowed)


def write_new(path: Path, text: str) -> None:
    """Write a file whole that is not there yet.

    Raises:
        HarnessError: there is one, or the file system refuses.
    """
    if path.exists():
        raise InputError(str(path), "exists", "a new file")
    write_file(path, text.encode())


def seen_from(path: Path, folder: Path) -> Path:
    """A path as a file in a folder names it: relative if it lies inside."""
    whole, here = path.absolute(), folder.absolute()
    return whole.relative_to(here) if whole.is_relative_to(here) else whole


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a CSV file whole, with every key of any row; undefined values are empty."""
    text, names = io.StringIO(), dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(text, fieldnames=list(names), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_file(path, text.getvalue().encode())


_NOT_THERE = (errno.EROFS, errno.EACCES, errno.EPERM, errno.EEXIST, errno.ENOENT, errno.ENOTDIR,
              errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP)  # fmt: skip
"""Errors that only another path avoids.  The user can repair others, such as a full disk."""


def cannot_write(where: Path | Parameter, error: OSError) -> HarnessError:
    """The error for a file or folder that cannot be written."""
    why = f"cannot be written ({reason_of(error)})"
    refused = InputError(where, why, "a writable place")
    return refused if error.errno in _NOT_THERE else HarnessError(f"{refused.where}: {why}")
