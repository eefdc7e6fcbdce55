"""Parses and checks the options of the model commands, and writes them back for the card."""

import os
from pathlib import Path
from typing import Any

from harness.core.errors import InputError, unknown_name

MOST_COMPONENTS = 100


def components(text: str) -> tuple[int, ...]:
    """Return ``1..20``, ``10`` or ``2,5,10`` as ascending numbers."""
    numbers: set[int] = set()
    allowed = f"whole numbers from 1 to {MOST_COMPONENTS}: 1..20, 10 or 2,5,10"
    for part in text.split(","):
        first, dots, last = part.partition("..")
        try:
            low, high = int(first), int(last if dots else first)
        except ValueError:
            raise InputError(f"--components {text}", f"{part!r} is not a number", allowed) from None
        if not 1 <= low <= high <= MOST_COMPONENTS:
            raise InputError(f"--components {text}", f"{part!r} is not accepted", allowed)
        numbers.update(range(low, high + 1))
    return tuple(sorted(numbers))


def state(text: str) -> tuple[float, float]:
    """Return ``30,5`` as (R in m, v in m/s), both above 0."""
    try:
        range_m, speed = (float(part) for part in text.split(","))
    except ValueError:
        range_m = speed = float("nan")
    if not (0 < range_m < float("inf") and 0 < speed < float("inf")):
        raise InputError(f"--near {text}", "is not a state", "R,v above 0, e.g. 30,5")
    return range_m, speed


def bounds(texts: list[str] | None) -> tuple[Any, Any]:
    """Return lower and upper bounds, each of shape (4,): the defaults with the named changes."""
    import numpy as np

    from harness.model.interaction import VARIABLES
    from harness.old.studies.calibration import BOX_LOWER, BOX_UPPER

    lower, upper = np.array(BOX_LOWER), np.array(BOX_UPPER)
    for text in texts or []:
        name, equals, values = text.partition("=")
        low, colon, high = values.partition(":")
        if not equals or not colon:
            allowed = "NAME=LOW:HIGH, e.g. vehicle_speed_mps=0.3:8"
            raise InputError(f"--bounds {text}", "is not accepted", allowed)
        if name not in VARIABLES:
            raise unknown_name(f"--bounds {text}", "variable", name, VARIABLES)
        index = VARIABLES.index(name)
        lower[index], upper[index] = _fraction(low, text), _fraction(high, text)
    return lower, upper


def _fraction(text: str, whole: str) -> float:
    """Parse a number, or a ratio such as 1/60."""
    above, slash, below = text.partition("/")
    try:
        return float(above) / float(below) if slash else float(above)
    except (ValueError, ZeroDivisionError):
        problem = f"{text!r} is not a number"
        raise InputError(f"--bounds {whole}", problem, "e.g. 0.3 or 1/60") from None


def number(value: float) -> str:
    """Return text that parses to the same number, as ``1/n`` if that is shorter."""
    text = repr(float(value))
    if value > 0 and 1 / round(max(1 / value, 1)) == value:
        return min(text, f"1/{round(1 / value)}", key=len)
    return text


def as_options(box: tuple[Any, Any]) -> list[str]:
    """Return the ``--bounds`` options that describe a box."""
    from harness.model.interaction import VARIABLES

    return [
        word
        for name, low, high in zip(VARIABLES, *box, strict=True)
        for word in ("--bounds", f"{name}={number(low)}:{number(high)}")
    ]


def check_refits(refits: int, keep_model: bool) -> None:
    """Refuse too few refits, and --keep-model without refits."""
    from harness.model.interaction import FEWEST_REFITS

    if refits and refits < FEWEST_REFITS:
        allowed = f"0 (none), or {FEWEST_REFITS} or more"
        raise InputError(f"--refits {refits}", "is not accepted", allowed)
    if keep_model and not refits:
        raise InputError("--keep-model", "needs --refits", "--refits 20")


def check_target(path: Path, option: str, suffix: str) -> None:
    """Refuse a file that cannot be written, before any work begins."""
    where = f"{option} {path}"
    if path.suffix != suffix or path.is_dir():
        raise InputError(where, f"does not name a {suffix} file", f"a file name ending in {suffix}")
    if not os.access(path.parent, os.W_OK):
        raise InputError(where, "its folder is missing or not writable", "a writable folder")


def check_folder(folder: Path | None, option: str = "--plots") -> None:
    """Refuse a folder that cannot be created or written, before any work begins."""
    if folder is None:
        return
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise InputError(f"{option} {folder}", "cannot be created or written", "a writable folder")
