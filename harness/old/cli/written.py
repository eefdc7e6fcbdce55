"""A scenario file that a command writes."""

from pathlib import Path

from harness.core.errors import InputError


def seen_from(file: Path, folder: Path) -> Path:
    """Return a file's path, relative to the folder of the scenario file if it lies inside."""
    whole = file.absolute()
    here = folder.absolute()
    return whole.relative_to(here) if whole.is_relative_to(here) else whole


def write_new(path: Path, text: str) -> None:
    """Write a new file.

    Raises:
        InputError: it exists or cannot be written.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError("--write", f"{path} exists", "a new file") from None
    except OSError as error:
        raise InputError("--write", f"{path} cannot be written ({error.strerror})") from None
