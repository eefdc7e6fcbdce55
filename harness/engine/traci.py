"""sumo-gui in a process of its own, through TraCI.  No other module imports traci."""

import contextlib
import io
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.sax.saxutils import quoteattr

import sumo
import traci

from harness.core.encounter import Crossing, Vehicle
from harness.core.errors import EngineError
from harness.engine.control import SumoEngine
from harness.engine.starting import (
    site_and_types,
    start_command,
    write_additional,
)
from harness.site import Place

PEDESTRIAN_EXAGGERATION = 4
"""Factor by which pedestrians are drawn larger than they are."""

_BY_SPEED = 8
_UNIFORM = 1
"""Indices of sumo-gui's colouring schemes of vehicles and of persons."""


def _view_settings(delay_ms: float, initial_speed_mps: float) -> str:
    """A settings file for ``--gui-settings-file``.

    Args:
        delay_ms: pause after each step.
        initial_speed_mps: v0; the ego is blue at this speed and red at standstill.
    """
    colours = (("215,48,39", 0.0), ("254,224,144", 0.5), ("69,117,180", 1.0))
    speeds = "".join(
        f'<entry color="{colour}" threshold={quoteattr(f"{share * initial_speed_mps:.6g}")}/>'
        for colour, share in colours
    )
    return f"""<viewsettings>
    <scheme name="crosswalk">
        <background backgroundColor="236,236,230" showGrid="0"/>
        <edges laneEdgeMode="0" laneShowBorders="1" showLinkDecals="1">
            <colorScheme name="uniform">
                <entry color="110,110,110" name="road"/>
                <entry color="180,180,180" name="sidewalk"/>
            </colorScheme>
        </edges>
        <vehicles vehicleMode="{_BY_SPEED}" vehicleQuality="2" vehicle_exaggeration="1">
            <colorScheme name="by speed" interpolated="1">{speeds}</colorScheme>
        </vehicles>
        <persons personMode="{_UNIFORM}" personQuality="2"
                 person_exaggeration="{PEDESTRIAN_EXAGGERATION}">
            <colorScheme name="uniform"><entry color="197,27,125"/></colorScheme>
        </persons>
        <junctions junctionMode="0" drawCrossingsAndWalkingareas="1">
            <colorScheme name="uniform"><entry color="110,110,110"/></colorScheme>
        </junctions>
    </scheme>
    <viewport x="0" y="0" zoom="1200"/>
    <delay value="{delay_ms:.6g}"/>
</viewsettings>
"""


_VIEW = "View #0"
_PIXELS = (1280, 860)
_AROUND_M = 6.0
"""Length of road shown beyond the trigger and beyond the crosswalk."""


@dataclass(frozen=True)
class Gui:
    """Settings of the window in which an episode is shown.

    Attributes:
        delay_ms: pause after each step.
        screenshots: folder for PNG files; None for no screenshots.
        every_s: time between two screenshots, a whole number of steps.
    """

    delay_ms: float
    screenshots: Path | None = None
    every_s: float = 0.5


def gui_engine(
    place: Place, vehicle: Vehicle, crossing: Crossing, step_s: float, gui: Gui
) -> SumoEngine:
    """Start sumo-gui with its view on the crosswalk, and connect to it.

    Raises:
        EngineError: sumo-gui does not start (it needs a display) or does not answer.
    """
    site, types = site_and_types(place, vehicle, crossing)
    folder = TemporaryDirectory(prefix="crosswalk-harness-")
    _, *options = start_command(place.net, write_additional(folder.name, types), step_s)
    settings = _view_settings(gui.delay_ms, vehicle.initial_speed_mps)
    close = _connected(options, folder, settings)
    engine = _ShownEngine(traci, close, site, vehicle, crossing, step_s)
    engine.gui = gui
    reach_m = 0.7 * vehicle.trigger_range_m + _AROUND_M
    x, y = site.frame.to_network(0.0, crossing.length_m / 2)
    traci.gui.setBoundary(_VIEW, x - reach_m, y - reach_m, x + reach_m, y + reach_m)
    return engine


class _ShownEngine(SumoEngine):
    """A SUMO engine that takes screenshots of its window."""

    gui: Gui

    def step(self, speed_mps: float, pedestrians: Sequence[tuple[int, float]]) -> float:
        """See ``Engine.step``."""
        gui = self.gui
        if gui.screenshots and not self._steps % max(1, round(gui.every_s / self._step_s)):
            # Of the end of this step.
            file = gui.screenshots / f"t-{(self._steps + 1) * self._step_s:07.3f}-s.png"
            traci.gui.screenshot(_VIEW, str(file.absolute()), *_PIXELS)
        return super().step(speed_mps, pedestrians)


def _connected(
    options: Sequence[str], folder: "TemporaryDirectory[str]", settings: str
) -> Callable[[], None]:
    """Start sumo-gui and connect to it; return the function that closes both and the folder."""
    view = Path(folder.name) / "view.xml"
    view.write_text(settings, encoding="utf-8")
    options = [*options, "--gui-settings-file", str(view), "--start", "true"]
    options += ["--quit-on-end", "true", "--window-size", f"{_PIXELS[0]},{_PIXELS[1]}"]
    binary = os.path.join(sumo.SUMO_HOME, "bin", "sumo-gui")  # noqa: PTH118
    try:
        # traci prints its retries on stdout, which is for results only.
        with contextlib.redirect_stdout(io.StringIO()):
            traci.start([binary, *options])
    except (traci.TraCIException, traci.FatalTraCIError, OSError) as error:
        folder.cleanup()
        raise EngineError(f"SUMO did not start: {error}") from None

    def close() -> None:
        # The user may have closed the window.
        with contextlib.suppress(traci.FatalTraCIError):
            traci.close()
        folder.cleanup()

    return close
