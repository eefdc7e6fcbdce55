"""SUMO through libsumo: one simulation per process, kept open over all episodes.

No other module imports libsumo.
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
from harness.engine.starting import (
    scratch_prefix,
    site_and_types,
    start_command,
    write_additional,
)
from harness.site import Place

_COMPILED = Calls(
    _libsumo.simulation_step,
    _libsumo.person_moveToXY,
    _libsumo.vehicle_setSpeed,
    _libsumo.vehicle_getDistance,
)
"""libsumo's functions without their Python wrappers, which take 1.4 µs of the 10 µs of a step."""

_running: list[SumoEngine] = []


def _refuse_another_sumo() -> None:
    """Check the version: the module path may lead to another SUMO, e.g. that of SUMO_HOME/tools."""
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
    outputs: Mapping[str, str] | None = None,
) -> SumoEngine:
    """Start SUMO in this process.

    Args:
        place: the crosswalk in its network.
        vehicle: the ego.
        crossing: the crosswalk's constants.
        step_s: length of a step, whole milliseconds.
        outputs: options that switch SUMO's output files on.

    Raises:
        EngineError: SUMO does not start, or a simulation is already running in this process.
            libsumo itself reports no error for a second simulation.
    """
    site, types = site_and_types(place, vehicle, crossing)
    _start(place.net, types, step_s, outputs)
    engine = SumoEngine(libsumo, _close, site, vehicle, crossing, step_s, _COMPILED)
    _running.append(engine)
    return engine


def _start(net: Path, added: str, step_s: float, outputs: Mapping[str, str] | None) -> None:
    if _running:
        raise EngineError("only one SUMO simulation can run in a process; close the first")
    with TemporaryDirectory(prefix=scratch_prefix(os.getpid())) as folder:
        path = write_additional(folder, added)
        try:
            libsumo.start(start_command(net, path, step_s, outputs))
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise EngineError(f"SUMO did not start: {error}") from None


def _close() -> None:
    """Close SUMO, which also completes its output files."""
    _running.clear()
    libsumo.close()
