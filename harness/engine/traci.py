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

from harness.encounter import Arrival, Crossing, Side, Vehicle
from harness.engine.control import SumoEngine
from harness.engine.protocol import Engine
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
"""Of a road with traffic, from the crosswalk."""


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
    return _start("sumo", place, vehicle, crossing, step_s, "")


def gui_engine(
    place: Place, vehicle: Vehicle, crossing: Crossing, step_s: float, gui: Gui
) -> Engine:
    """Start sumo-gui, its view on the crosswalk, and connect to it.

    Raises:
        EngineError: it does not start (it needs a display) or does not answer.
    """
    settings = view_settings(vehicle.initial_speed_mps, gui.delay_ms)
    engine = _start("sumo-gui", place, vehicle, crossing, step_s, settings)
    return _Shown(engine, vehicle, step_s, gui)


class _Shown:
    """A SUMO engine whose window is looked after: the view at the start, pictures on the way."""

    def __init__(self, engine: SumoEngine, vehicle: Vehicle, step_s: float, gui: Gui) -> None:
        self._engine, self._folder = engine, gui.screenshots
        self._step_s, self._steps = step_s, 0
        self._every = max(1, round(gui.every_s / step_s))
        reach = 0.7 * vehicle.trigger_range_m + _AROUND_M
        _look_at(engine.centre, reach)

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:
        """See ``Engine.begin``."""
        self._steps = 0
        return self._engine.begin(arrivals)

    def step(
        self, speed_mps: float | None, pedestrians: Sequence[tuple[int, float]]
    ) -> tuple[float, float]:
        """See ``Engine.step``."""
        if self._folder is not None and self._steps % self._every == 0:
            time_s = (self._steps + 1) * self._step_s
            _take(self._folder / f"t-{time_s:07.3f}-s.png")
        self._steps += 1
        return self._engine.step(speed_mps, pedestrians)

    def let_walk(self, index: int, side: Side, speed_mps: float) -> None:
        """See ``Engine.let_walk``."""
        self._engine.let_walk(index, side, speed_mps)

    def place_of(self, index: int) -> tuple[float, float]:
        """See ``Engine.place_of``."""
        return self._engine.place_of(index)

    def remove(self, index: int) -> None:
        """See ``Engine.remove``."""
        self._engine.remove(index)

    def end(self) -> bool | None:
        """See ``Engine.end``."""
        return self._engine.end()

    def close(self) -> None:
        """See ``Engine.close``."""
        self._engine.close()


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
    settings = view_settings(vehicle.initial_speed_mps, gui.delay_ms)
    close = _connected("sumo-gui", place, types, step_s, settings)
    return _ShownRoad(close, site, crossing, limit_mps, step_s, gui)


class _ShownRoad(SumoRoad):
    """A road whose window is looked after, as ``_Shown``."""

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
        self._folder, self._shown_steps = gui.screenshots, 0
        self._every = max(1, round(gui.every_s / step_s))
        _look_at(site.frame.to_network(0.0, crossing.length_m / 2), _ROAD_SHOWN_M)

    def step(self, places: Sequence[tuple[int, float]]) -> Sequence[str]:
        """See ``SumoRoad.step``."""
        if self._folder is not None and self._shown_steps % self._every == 0:
            time_s = (self._shown_steps + 1) * self._step_s
            _take(self._folder / f"t-{time_s:09.3f}-s.png")
        self._shown_steps += 1
        return super().step(places)


def _look_at(centre: tuple[float, float], reach_m: float) -> None:
    x, y = centre
    traci.gui.setBoundary(_VIEW, x - reach_m, y - reach_m, x + reach_m, y + reach_m)


def _take(file: Path) -> None:
    """SUMO takes the picture at the end of the step that follows."""
    traci.gui.screenshot(_VIEW, str(file.absolute()), *_PIXELS)


def _start(
    program: str,
    place: Place,
    vehicle: Vehicle,
    crossing: Crossing,
    step_s: float,
    settings: str,
) -> SumoEngine:
    site = read_site(place)
    limit_mps = crossing.speed_limit_mps or site.ego.speed_limit_mps
    close = _connected(program, place, types_file(vehicle, limit_mps), step_s, settings)
    return SumoEngine(traci, close, site, vehicle, crossing, step_s)


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
