"""SUMO in a process of its own, through TraCI: what libsumo is measured against.

Slower than libsumo by far (every call crosses a socket).
"""

import os
from pathlib import Path
from tempfile import TemporaryDirectory

import sumo
import traci

from harness.encounter import Crossing, Vehicle
from harness.engine.control import SumoEngine, start_command, types_file
from harness.errors import EngineError
from harness.site import read_site


def traci_engine(
    net: Path, vehicle: Vehicle, crossing: Crossing, step_s: float, sumo_seed: int = 1
) -> SumoEngine:
    """Start a SUMO process and connect to it; arguments as ``sumo.libsumo_engine``.

    Raises:
        EngineError: SUMO does not start or does not answer.
    """
    folder = TemporaryDirectory(prefix="crosswalk-harness-")
    types = Path(folder.name) / "types.add.xml"
    types.write_text(types_file(vehicle), encoding="utf-8")
    _, *options = start_command(net, types, step_s, sumo_seed)
    binary = os.path.join(sumo.SUMO_HOME, "bin", "sumo")  # noqa: PTH118
    try:
        traci.start([binary, *options])
    except (traci.TraCIException, traci.FatalTraCIError, OSError) as error:
        folder.cleanup()
        raise EngineError(f"SUMO did not start: {error}") from None

    def close() -> None:
        traci.close()
        folder.cleanup()

    return SumoEngine(traci, close, read_site(net), vehicle, crossing, step_s)
