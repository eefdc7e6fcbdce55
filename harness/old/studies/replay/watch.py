"""Shows a stored episode or hour in sumo-gui.  The same loop drives it, through TraCI."""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.encounter import Arm
from harness.core.errors import EngineError, InputError
from harness.engine.installation import check_packages
from harness.engine.shared import close_engine
from harness.old.studies.kinds.table import simulation_of
from harness.old.studies.replay.moment import moments_of
from harness.old.studies.replay.rerun import refuse_in_use
from harness.old.studies.runs.stored import StoredCell


@dataclass(frozen=True)
class Watched:
    """A shown episode or hour, and how its record differs from the stored record."""

    arm: Arm
    differences: tuple[str, ...]


def watch(
    run: Path,
    pair: int,
    arms: Sequence[Arm],
    cell: int = 0,
    *,
    pace: float = 1.0,
    screenshots: Path | None = None,
    every_s: float = 0.5,
    vehicle: str | None = None,
    crosswalk: str | None = None,
) -> list[Watched]:
    """Run the arms of a pair again in sumo-gui, one after the other.

    Args:
        run: a finished run folder.
        pair: index of the pair.
        arms: the arms.
        cell: number of the cell.
        pace: speed of the display; 1 is real time, and infinite means no pauses.
        screenshots: a new or empty folder for PNG files; with two arms, each gets a folder in it.
        every_s: simulated time between two screenshots.
        vehicle, crosswalk: ids in a user's own simulation.  It is shown around the most striking
            passage of this vehicle over this crosswalk; None means any.

    Raises:
        InputError: the run, cell or pair does not exist, there is no display, or the folder is not
            empty.
        EngineError: sumo-gui did not start, or its window was closed.
    """
    check_packages()
    from harness.engine.traci import Gui

    if not pace > 0:
        raise InputError("--pace", f"{pace:g}", "above 0, e.g. 0.5 or 4")
    if not every_s > 0:
        raise InputError("--every", f"{every_s:g} s", "above 0")
    if screenshots is not None:
        refuse_in_use(screenshots, "--screenshots")
    stored = StoredCell(run, cell, pair)
    _require_display()
    scenario = stored.cell.scenario
    moments = moments_of(stored, pair, arms, vehicle, crosswalk)
    shown = []
    for arm in arms:
        folder = screenshots
        if screenshots is not None:
            folder = screenshots / arm.value if len(arms) > 1 else screenshots
            folder.mkdir(parents=True, exist_ok=True)
        gui = Gui(1000 * scenario.experiment.step_s / pace, folder, every_s, moments.get(arm))
        watched = stored.arm(pair, arm)
        try:
            rows = simulation_of(scenario).in_gui(watched, gui)
        finally:
            close_engine()
        if rows.failure is not None:
            raise EngineError(f"sumo-gui: {rows.failure}")
        shown.append(Watched(arm, stored.differences(watched, rows)))
    return shown


def _require_display() -> None:
    """Raise if there is no X server on Linux; other systems need none."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise InputError(
            "--gui",
            "there is no display (DISPLAY is not set)",
            "a desktop session, or a virtual one: install Xvfb and run `xvfb-run -a harness …`",
        )
