"""SUMO and sumo-gui in a process of their own, through TraCI.

Tests compare libsumo with it.  It is much slower, because every call crosses a socket.  No other
module imports traci.
"""

import contextlib
import io
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import sumo
import traci

from harness.core.encounter import Crossing, Vehicle
from harness.core.errors import EngineError
from harness.engine.control import SumoEngine
from harness.engine.road import SumoRoad
from harness.engine.starting import (
    Following,
    site_and_types,
    start_command,
    write_additional,
)
from harness.engine.view import view_settings
from harness.site import Place, Site

_VIEW = "View #0"
_PIXELS = (1280, 860)
_AROUND_M = 6.0
"""Length of road shown beyond the trigger and beyond the crosswalk."""
_ROAD_SHOWN_M = 60.0
"""Length of road with traffic shown on each side of the crosswalk."""


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


def traci_engine(place: Place, vehicle: Vehicle, crossing: Crossing, step_s: float) -> SumoEngine:
    """Start a SUMO process and connect to it; arguments as ``sumo.libsumo_engine``.

    Raises:
        EngineError: SUMO does not start or does not answer.
    """
    site, _, types = site_and_types(place, vehicle, crossing)
    close = _connected("sumo", place, types, step_s, "")
    return SumoEngine(traci, close, site, vehicle, crossing, step_s)


def gui_engine(
    place: Place, vehicle: Vehicle, crossing: Crossing, step_s: float, gui: Gui
) -> SumoEngine:
    """Start sumo-gui with its view on the crosswalk, and connect to it.

    Raises:
        EngineError: sumo-gui does not start (it needs a display) or does not answer.
    """
    site, _, types = site_and_types(place, vehicle, crossing)
    settings = view_settings(gui.delay_ms, vehicle.initial_speed_mps)
    close = _connected("sumo-gui", place, types, step_s, settings)
    engine = _ShownEngine(traci, close, site, vehicle, crossing, step_s)
    engine.gui = gui
    _look_at(site, crossing, 0.7 * vehicle.trigger_range_m + _AROUND_M)
    return engine


def gui_road(
    place: Place,
    vehicle: Vehicle,
    crossing: Crossing,
    step_s: float,
    following: Following,
    gui: Gui,
) -> SumoRoad:
    """Start sumo-gui for hours of traffic; see ``gui_engine``."""
    site, limit_mps, types = site_and_types(place, vehicle, crossing, following)
    close = _connected("sumo-gui", place, types, step_s, view_settings(gui.delay_ms))
    road = _ShownRoad(traci, close, site, crossing, limit_mps, step_s)
    road.gui = gui
    _look_at(site, crossing, _ROAD_SHOWN_M)
    return road


class _ShownEngine(SumoEngine):
    """A SUMO engine that takes screenshots of its window."""

    gui: Gui

    def step(
        self, speed_mps: float | None, pedestrians: Sequence[tuple[int, float]]
    ) -> tuple[float, float]:
        """See ``Engine.step``."""
        _take(self.gui, self._steps, self._step_s, "07.3f")
        return super().step(speed_mps, pedestrians)


class _ShownRoad(SumoRoad):
    """A SUMO road that takes screenshots of its window."""

    gui: Gui

    def step(self, places: Sequence[tuple[int, float]]) -> Sequence[str]:
        """See ``SumoRoad.step``."""
        _take(self.gui, self._steps, self._step_s, "09.3f")
        return super().step(places)


def _look_at(site: Site, crossing: Crossing, reach_m: float) -> None:
    x, y = site.frame.to_network(0.0, crossing.length_m / 2)
    traci.gui.setBoundary(_VIEW, x - reach_m, y - reach_m, x + reach_m, y + reach_m)


def _take(gui: Gui, steps: int, step_s: float, form: str) -> None:
    """Order a screenshot of the end of the next step, if one is due."""
    if gui.screenshots is None or steps % max(1, round(gui.every_s / step_s)):
        return
    file = gui.screenshots / f"t-{(steps + 1) * step_s:{form}}-s.png"
    traci.gui.screenshot(_VIEW, str(file.absolute()), *_PIXELS)


def _connected(
    program: str, place: Place, added: str, step_s: float, settings: str
) -> Callable[[], None]:
    """Start SUMO and connect to it; return the function that closes both."""
    folder = TemporaryDirectory(prefix="crosswalk-harness-")
    types = write_additional(folder.name, added)
    _, *options = start_command(place.net, types, step_s, sumo_seed=1)
    if settings:
        view = Path(folder.name) / "view.xml"
        view.write_text(settings, encoding="utf-8")
        options += ["--gui-settings-file", str(view), "--start", "true", "--quit-on-end", "true"]
        options += ["--window-size", f"{_PIXELS[0]},{_PIXELS[1]}"]
    binary = os.path.join(sumo.SUMO_HOME, "bin", program)  # noqa: PTH118
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
