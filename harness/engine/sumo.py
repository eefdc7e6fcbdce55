"""SUMO through libsumo: one simulation per process, kept open over all episodes.

The only module that imports libsumo.
"""

import os
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory

import libsumo

from harness.encounter import Crossing, Vehicle
from harness.engine.control import SumoEngine
from harness.engine.starting import scratch_prefix, start_command, types_file
from harness.errors import EngineError
from harness.network import read_site

_running: list[SumoEngine] = []


def _refuse_another_sumo() -> None:
    """A SUMO elsewhere on the module path, that of SUMO_HOME's tools say, may be of any version."""
    _, found = libsumo.getVersion()
    wanted = f"SUMO {metadata.version('libsumo')}"
    if found != wanted:
        raise EngineError(f"{libsumo.__file__} is {found}, not {wanted}: see PYTHONPATH")


_refuse_another_sumo()


def libsumo_engine(
    net: Path,
    vehicle: Vehicle,
    crossing: Crossing,
    step_s: float,
    sumo_seed: int = 1,
    outputs: Mapping[str, str] | None = None,
) -> SumoEngine:
    """Start SUMO in this process.

    Args:
        net: the crosswalk's network, as ``network.build_network`` writes it.
        vehicle: the ego.
        crossing: the crosswalk's constants.
        step_s: length of a step, whole milliseconds.
        sumo_seed: seed of SUMO's own generators, which nothing here uses.
        outputs: options that switch SUMO's output files on.

    Raises:
        EngineError: SUMO does not start, or one is already running in this process (libsumo
            itself gives no error then).
    """
    if _running:
        raise EngineError("only one SUMO simulation can run in a process; close the first")
    with TemporaryDirectory(prefix=scratch_prefix(os.getpid())) as folder:
        types = Path(folder) / "types.add.xml"
        types.write_text(types_file(vehicle), encoding="utf-8")
        try:
            libsumo.start(start_command(net, types, step_s, sumo_seed, outputs))
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise EngineError(f"SUMO did not start: {error}") from None
    engine = SumoEngine(libsumo, _close, read_site(net), vehicle, crossing, step_s)
    _running.append(engine)
    return engine


def _close() -> None:
    """Close SUMO; its output files are complete only then."""
    _running.clear()
    libsumo.close()
