"""SUMO through libsumo: one simulation per process, kept open over all episodes.

The only module that imports libsumo.
"""

import os
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory

import libsumo
from libsumo import _libsumo

from harness.core.encounter import Crossing, Vehicle
from harness.core.errors import EngineError
from harness.engine.control import Calls, SumoEngine
from harness.engine.road import SumoRoad
from harness.engine.starting import (
    Following,
    e2_detectors,
    scratch_prefix,
    site_and_types,
    start_command,
    write_additional,
)
from harness.site import Place, streams_of

_COMPILED = Calls(
    _libsumo.simulation_step,
    _libsumo.person_moveToXY,
    _libsumo.vehicle_setSpeed,
    _libsumo.vehicle_getDistance,
)
"""libsumo's functions without its wrappers in Python, which take 1.4 of a step's 10 µs."""

_running: list[SumoEngine | SumoRoad] = []


def _refuse_another_sumo() -> None:
    """A SUMO elsewhere on the module path, that of SUMO_HOME's tools say, may be of any version."""
    _, version = libsumo.getVersion()
    wanted = f"SUMO {metadata.version('libsumo')}"
    if version != wanted:
        raise EngineError(f"{libsumo.__file__} is {version}, not {wanted}: see PYTHONPATH")


_refuse_another_sumo()


def libsumo_engine(
    place: Place,
    vehicle: Vehicle,
    crossing: Crossing,
    step_s: float,
    sumo_seed: int = 1,
    outputs: Mapping[str, str] | None = None,
) -> SumoEngine:
    """Start SUMO in this process.

    Args:
        place: the crosswalk, in its network.
        vehicle: the ego.
        crossing: the crosswalk's constants.
        step_s: length of a step, whole milliseconds.
        sumo_seed: seed of SUMO's own generators, which nothing here uses.
        outputs: options that switch SUMO's output files on.

    Raises:
        EngineError: SUMO does not start, or one is already running in this process (libsumo
            itself gives no error then).
    """
    site, _, types = site_and_types(place, vehicle, crossing)
    _start(place.net, types, step_s, sumo_seed, outputs)
    engine = SumoEngine(libsumo, _close, site, vehicle, crossing, step_s, _COMPILED)
    _running.append(engine)
    return engine


def libsumo_road(
    place: Place,
    vehicle: Vehicle,
    crossing: Crossing,
    step_s: float,
    following: Following,
    outputs: Mapping[str, str] | None = None,
    detectors: Path | None = None,
) -> SumoRoad:
    """Start SUMO in this process for hours of traffic; see ``libsumo_engine``.

    Args:
        following: how its vehicles keep their distance.
        detectors: SUMO writes what E2 detectors on the approaching lanes saw there.
    """
    site, limit_mps, added = site_and_types(place, vehicle, crossing, following)
    if detectors is not None:
        last = (lane.approach for lane in streams_of(site))
        lanes = (f"{each.edge}_{each.lane}" for each in last)
        # SUMO takes a relative name from the folder of the additional file.
        added += e2_detectors(lanes, detectors.absolute())
    _start(place.net, added, step_s, 1, outputs)
    road = SumoRoad(libsumo, _close, site, crossing, limit_mps, step_s)
    _running.append(road)
    return road


def _start(
    net: Path, added: str, step_s: float, sumo_seed: int, outputs: Mapping[str, str] | None
) -> None:
    if _running:
        raise EngineError("only one SUMO simulation can run in a process; close the first")
    with TemporaryDirectory(prefix=scratch_prefix(os.getpid())) as folder:
        path = write_additional(folder, added)
        try:
            libsumo.start(start_command(net, path, step_s, sumo_seed, outputs))
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise EngineError(f"SUMO did not start: {error}") from None


def _close() -> None:
    """Close SUMO; its output files are complete only then."""
    _running.clear()
    libsumo.close()
