"""SUMO in a process of its own, through TraCI: what libsumo is measured against, and sumo-gui.

Slower than libsumo by far (every call crosses a socket).  The only module that imports traci.
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

from harness.encounter import Crossing, Vehicle
from harness.engine.control import SumoEngine
from harness.engine.road import SumoRoad
from harness.engine.starting import (
    Following,
    additional_file,
    start_command,
    traffic_types,
    types_file,
)
from harness.engine.view import view_settings
from harness.errors import EngineError
from harness.roads import Place, Site, read_site

_VIEW = "View #0"
_PIXELS = (1280, 860)
_AROUND_M = 6.0
"""Shown beyond the trigger and the crosswalk's far side."""
_ROAD_SHOWN_M = 60.0
"""Shown of a road with traffic, either way from the crosswalk."""


@dataclass(frozen=True)
class Gui:
    """How an episode is shown.

    Attributes:
        delay_ms: pause after each step.
        screenshots: PNGs go here; None takes none.
        every_s: time between two of them, a whole number of steps.
    """

    delay_ms: float
    screenshots: Path | None = None
    every_s: float = 0.5


def traci_engine(place: Place, vehicle: Vehicle, crossing: Crossing, step_s: float) -> SumoEngine:
    """Start a SUMO process and connect to it; arguments as ``sumo.libsumo_engine``.

    Raises:
        EngineError: SUMO does not start or does not answer.
    """
    site, types = _prepared(place, vehicle, crossing)
    close = _connected("sumo", place, types, step_s, "")
    return SumoEngine(traci, close, site, vehicle, crossing, step_s)


def gui_engine(
    place: Place, vehicle: Vehicle, crossing: Crossing, step_s: float, gui: Gui
) -> SumoEngine:
    """Start sumo-gui, its view on the crosswalk, and connect to it.

    Raises:
        EngineError: it does not start (it needs a display) or does not answer.
    """
    settings = view_settings(gui.delay_ms, vehicle.initial_speed_mps)
    site, types = _prepared(place, vehicle, crossing)
    close = _connected("sumo-gui", place, types, step_s, settings)
    return _ShownEngine(close, site, vehicle, crossing, step_s, gui)


class _ShownEngine(SumoEngine):
    """A SUMO engine whose window is looked after: the view at the start, pictures on the way."""

    def __init__(
        self,
        close: Callable[[], None],
        site: Site,
        vehicle: Vehicle,
        crossing: Crossing,
        step_s: float,
        gui: Gui,
    ) -> None:
        super().__init__(traci, close, site, vehicle, crossing, step_s)
        self._gui = gui
        _look_at(site, crossing, 0.7 * vehicle.trigger_range_m + _AROUND_M)

    def step(
        self, speed_mps: float | None, pedestrians: Sequence[tuple[int, float]]
    ) -> tuple[float, float]:
        """See ``Engine.step``."""
        _take(self._gui, self._steps, self._step_s, "07.3f")
        return super().step(speed_mps, pedestrians)


def gui_road(
    place: Place,
    vehicle: Vehicle,
    crossing: Crossing,
    step_s: float,
    following: Following,
    gui: Gui,
) -> SumoRoad:
    """The same for hours of traffic."""
    site = read_site(place)
    limit_mps = crossing.speed_limit_mps or site.ego.speed_limit_mps
    types = additional_file(traffic_types(vehicle, limit_mps, following))
    settings = view_settings(gui.delay_ms)
    close = _connected("sumo-gui", place, types, step_s, settings)
    return _ShownRoad(close, site, crossing, limit_mps, step_s, gui)


class _ShownRoad(SumoRoad):
    """A road whose window is looked after, as ``_ShownEngine``'s."""

    def __init__(
        self,
        close: Callable[[], None],
        site: Site,
        crossing: Crossing,
        limit_mps: float,
        step_s: float,
        gui: Gui,
    ) -> None:
        super().__init__(traci, close, site, crossing, limit_mps, step_s)
        self._gui = gui
        _look_at(site, crossing, _ROAD_SHOWN_M)

    def step(self, places: Sequence[tuple[int, float]]) -> Sequence[str]:
        """See ``SumoRoad.step``."""
        _take(self._gui, self._steps, self._step_s, "09.3f")
        return super().step(places)


def _look_at(site: Site, crossing: Crossing, reach_m: float) -> None:
    x, y = site.frame.to_network(0.0, crossing.length_m / 2)
    traci.gui.setBoundary(_VIEW, x - reach_m, y - reach_m, x + reach_m, y + reach_m)


def _take(gui: Gui, steps: int, step_s: float, form: str) -> None:
    """Ask for a picture of the end of the step that follows, if one is due."""
    if gui.screenshots is None or steps % max(1, round(gui.every_s / step_s)):
        return
    file = gui.screenshots / f"t-{(steps + 1) * step_s:{form}}-s.png"
    traci.gui.screenshot(_VIEW, str(file.absolute()), *_PIXELS)


def _prepared(place: Place, vehicle: Vehicle, crossing: Crossing) -> tuple[Site, str]:
    """The site of a place, and the types of its ego and pedestrians."""
    site = read_site(place)
    limit_mps = crossing.speed_limit_mps or site.ego.speed_limit_mps
    return site, types_file(vehicle, limit_mps)


def _connected(
    program: str, place: Place, added: str, step_s: float, settings: str
) -> Callable[[], None]:
    """Start SUMO and connect to it; returns what ends both."""
    folder = TemporaryDirectory(prefix="crosswalk-harness-")
    types = Path(folder.name) / "types.add.xml"
    types.write_text(added, encoding="utf-8")
    _, *options = start_command(place.net, types, step_s, sumo_seed=1)
    if settings:
        view = Path(folder.name) / "view.xml"
        view.write_text(settings, encoding="utf-8")
        options += ["--gui-settings-file", str(view), "--start", "true", "--quit-on-end", "true"]
        options += ["--window-size", f"{_PIXELS[0]},{_PIXELS[1]}"]
    binary = os.path.join(sumo.SUMO_HOME, "bin", program)  # noqa: PTH118
    try:
        # It says on stdout that it retries; results go there, and nothing else.
        with contextlib.redirect_stdout(io.StringIO()):
            traci.start([binary, *options])
    except (traci.TraCIException, traci.FatalTraCIError, OSError) as error:
        folder.cleanup()
        raise EngineError(f"SUMO did not start: {error}") from None

    def close() -> None:
        # Somebody may have closed the window.
        with contextlib.suppress(traci.FatalTraCIError):
            traci.close()
        folder.cleanup()

    return close
