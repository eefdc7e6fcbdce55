"""SUMO and sumo-gui in a process of their own, through TraCI.

Tests compare libsumo with it.  It is much slower, because every call crosses a socket.  No other
module imports traci.
"""

import contextlib
import io
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import sumo
import traci

from harness.core.encounter import Crossing, Vehicle
from harness.core.errors import EngineError
from harness.engine.control import SumoEngine
from harness.engine.road import SumoRoad
from harness.engine.simulation.running import OwnSimulation
from harness.engine.starting import (
    AV_COLOUR,
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
_CROSSWALK_SHOWN_M = 35.0
"""Length of road of a user's scenario shown on each side of the crosswalk."""
_AV_COLOUR = tuple(map(int, AV_COLOUR["color"].split(",")))
_ROAD_SHOWN_M = 60.0
"""Length of road with traffic shown on each side of the crosswalk."""


@dataclass(frozen=True)
class Gui:
    """Settings of the window in which an episode is shown.

    Attributes:
        delay_ms: pause after each step.
        screenshots: folder for PNG files; None for no screenshots.
        every_s: time between two screenshots, a whole number of steps.
        moment: the part of a user's own simulation that is shown.
    """

    delay_ms: float
    screenshots: Path | None = None
    every_s: float = 0.5
    moment: "Moment | None" = None


@dataclass(frozen=True)
class Moment:
    """The part of a user's own simulation that a window shows at its pace.

    Attributes:
        begin_s, end_s: simulated times; before and after them the simulation is not slowed down.
        x_m, y_m: the middle of the window, in the network's coordinates.
    """

    begin_s: float
    end_s: float
    x_m: float
    y_m: float


def gui_engine(
    place: Place, vehicle: Vehicle, crossing: Crossing, step_s: float, gui: Gui
) -> SumoEngine:
    """Start sumo-gui with its view on the crosswalk, and connect to it.

    Raises:
        EngineError: sumo-gui does not start (it needs a display) or does not answer.
    """
    site, _, types = site_and_types(place, vehicle, crossing)
    settings = view_settings(gui.delay_ms, vehicle.initial_speed_mps)
    close = _on_place("sumo-gui", place, types, step_s, settings)
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
    close = _on_place("sumo-gui", place, types, step_s, view_settings(gui.delay_ms))
    road = _ShownRoad(traci, close, site, crossing, limit_mps, step_s, following.endings)
    road.gui = gui
    _look_at(site, crossing, _ROAD_SHOWN_M)
    return road


def gui_simulation(
    config_file: Path, end_s: float | None, gui: Gui, moment: Moment, *, coloured: bool
) -> OwnSimulation:
    """Start sumo-gui with a user's scenario and its view on a crosswalk.

    Args:
        config_file, end_s: see ``OwnSimulation``.
        gui: settings of the window.
        moment: the part that is shown.
        coloured: whether AVs get their colour.
    """
    shown = _ShownSimulation(config_file, end_s, _start_with_settings)
    shown.gui, shown.moment, shown.coloured = gui, moment, coloured
    _look(moment.x_m, moment.y_m, _CROSSWALK_SHOWN_M)
    return shown


def _start_with_settings(command: Sequence[str]) -> tuple[Any, Callable[[], None]]:
    """Start sumo-gui with the options of a command line of ``sumo``."""
    folder = TemporaryDirectory(prefix="crosswalk-harness-")
    return traci, _connected("sumo-gui", command[1:], folder, view_settings(0.0))


class _ShownSimulation(OwnSimulation):
    """A user's simulation in a window."""

    gui: Gui
    moment: Moment
    coloured: bool
    _taken_s: float = -math.inf

    def step(self) -> float:
        """See ``OwnSimulation.step``."""
        slow = self.moment.begin_s <= self.time_s < self.moment.end_s
        if slow and self.gui.screenshots is not None:
            self._take(self.time_s + self.step_s, self.gui.screenshots)
        time_s = super().step()
        if slow:
            # sumo-gui's own delay cannot be changed while it runs.
            time.sleep(self.gui.delay_ms / 1000)
        return time_s

    def _take(self, time_s: float, folder: Path) -> None:
        """Order a screenshot of the end of the next step, if one is due."""
        if time_s - self._taken_s < self.gui.every_s - 1e-6:
            return
        self._taken_s = time_s
        file = folder / f"t-{time_s:09.3f}-s.png"
        traci.gui.screenshot(_VIEW, str(file.absolute()), *_PIXELS)

    def departed(self, name: str, *, automated: bool) -> None:
        """See ``OwnSimulation.departed``."""
        if automated and self.coloured:
            traci.vehicle.setColor(name, _AV_COLOUR)


class _ShownEngine(SumoEngine):
    """A SUMO engine that takes screenshots of its window."""

    gui: Gui

    def step(self, speed_mps: float, pedestrians: Sequence[tuple[int, float]]) -> float:
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
    _look(*site.frame.to_network(0.0, crossing.length_m / 2), reach_m)


def _look(x: float, y: float, reach_m: float) -> None:
    traci.gui.setBoundary(_VIEW, x - reach_m, y - reach_m, x + reach_m, y + reach_m)


def _take(gui: Gui, steps: int, step_s: float, form: str) -> None:
    """Order a screenshot of the end of the next step, if one is due."""
    if gui.screenshots is None or steps % max(1, round(gui.every_s / step_s)):
        return
    file = gui.screenshots / f"t-{(steps + 1) * step_s:{form}}-s.png"
    traci.gui.screenshot(_VIEW, str(file.absolute()), *_PIXELS)


def _on_place(
    program: str, place: Place, added: str, step_s: float, settings: str
) -> Callable[[], None]:
    """Start SUMO with a place's network and connect to it; return the function that closes both."""
    folder = TemporaryDirectory(prefix="crosswalk-harness-")
    types = write_additional(folder.name, added)
    _, *options = start_command(place.net, types, step_s, sumo_seed=1)
    return _connected(program, options, folder, settings)


def _connected(
    program: str, arguments: Sequence[str], folder: "TemporaryDirectory[str]", settings: str
) -> Callable[[], None]:
    """Start SUMO and connect to it; return the function that closes both and the folder."""
    options = [*arguments]
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
