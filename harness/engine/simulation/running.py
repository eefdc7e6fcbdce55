"""A user's SUMO scenario, running in this process step by step."""

import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.core.errors import EngineError, InputError, one_line
from harness.engine.simulation.outputs import Kept, final_options
from harness.site.configuration import SumoConfig, first_error, option_types, sumo_program

NO_OPTIONS: Mapping[str, str] = {}

CONFIG_FILE = "simulation.sumocfg"
TRIPS_FILE = "tripinfo.xml"

ALWAYS = {
    "random": "false",
    "no-step-log": "true",
    "no-warnings": "true",
    "duration-log.disable": "true",
    "tripinfo-output.write-unfinished": "true",
    "tripinfo-output.write-undeparted": "true",
}
"""Options of every simulation: a fixed seed, few messages, and output of unfinished trips too."""


def write_config(
    config: SumoConfig,
    kept: Kept,
    seed: int,
    step_s: float | None,
    people: str | None = None,
    more: Mapping[str, str] = NO_OPTIONS,
) -> Path:
    """Write the configuration of one arm into its folder.

    ``sumo -c`` with this file simulates the arm without the harness's strategies.

    Args:
        config: the user's configuration.
        kept: the arm's folder, and the outputs that are written there.
        seed: seed of SUMO's random numbers.
        step_s: length of a step; None keeps the configuration's.
        people: name of a file there with additional people; None: nobody is added.
        more: further options.

    Returns:
        The path of the file.

    Raises:
        InputError: a file of the scenario cannot be read.
    """
    kept.folder.mkdir(parents=True, exist_ok=True)
    options = final_options(config, kept) | _ours(str(seed), step_s) | dict(more)
    if people is not None:
        options["route-files"] = ",".join(filter(None, [options.get("route-files"), people]))
    root = ET.Element("configuration")
    for name, value in sorted(options.items()):
        # In paths SUMO decodes "%20".
        is_path = option_types().get(name) == "FILE"
        ET.SubElement(root, name, value=value.replace("%", "%25") if is_path else value)
    ET.indent(root)
    path = kept.folder.absolute() / CONFIG_FILE
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path


def _ours(seed: str, step_s: float | None) -> dict[str, str]:
    step = {} if step_s is None else {"step-length": f"{step_s:.3f}"}
    return {**ALWAYS, "seed": seed, "tripinfo-output": TRIPS_FILE, **step}


Start = Callable[[Sequence[str]], tuple[Any, Callable[[], None]]]
"""Starts SUMO with a command line; returns its API and the function that ends it."""

Function = Callable[[str, str], Callable[..., Any]]
"""From a domain and a name, e.g. ``vehicle`` and ``getSpeed``, to SUMO's function."""


class OwnSimulation:
    """A running simulation of a user's scenario.

    Args:
        config_file: a configuration that ``write_config`` wrote.
        end_s: the time at which the simulation ends; None: when everybody has arrived.
        start: starts SUMO with a command line; None: libsumo.

    Attributes:
        function: the function ``api.part.name``, from part and name, for calls at every step; of
            libsumo it is the compiled one, without its wrapper in Python.

    Raises:
        EngineError: SUMO does not start.
    """

    def __init__(self, config_file: Path, end_s: float | None, start: Start | None = None) -> None:
        compiled: Function | None = None
        if start is None:
            from harness.engine.sumo import compiled_function, libsumo_with

            start, compiled = libsumo_with, compiled_function
        self.api, self._close = start(["sumo", "-c", str(config_file)])
        self.function: Function = compiled or self._public
        self._advance = compiled("simulation", "step") if compiled else self.api.simulationStep
        self._now = self.function("simulation", "getTime")
        self._end_s = end_s
        self._lost = (self.api.TraCIException, self.api.FatalTraCIError)
        self.time_s: float = self.api.simulation.getTime()
        self.step_s: float = self.api.simulation.getDeltaT()

    def _public(self, part: str, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(getattr(self.api, part), name)
        return function

    @property
    def goes_on(self) -> bool:
        """Whether there is a further step; libsumo itself ignores the end."""
        if self._end_s is not None:
            return self.time_s < self._end_s - 1e-9
        api = self.api
        if not api.simulation.getMinExpectedNumber():
            return False
        people = () if api.vehicle.getIDCount() else api.person.getIDList()
        if api.simulation.getMinExpectedNumber() > len(people):
            return True
        # As in SUMO, people who wait for a ride do not keep the simulation going.
        return any(api.person.getStage(name).type != api.constants.STAGE_DRIVING for name in people)

    def step(self) -> float:
        """Simulate one step; return the time at its end in s.

        Raises:
            EngineError: SUMO lost the simulation.
        """
        try:
            self._advance()
        except self._lost as error:
            raise EngineError(f"SUMO lost the simulation: {one_line(str(error))}") from None
        self.time_s = self._now()
        return self.time_s

    def departed(self, name: str, *, automated: bool) -> None:
        """Called when a vehicle has departed; a window may colour AVs."""

    def close(self) -> None:
        """End the simulation; only then are its output files complete."""
        self._close()


def check_starts(config_file: Path, where: str) -> None:
    """Refuse a scenario that SUMO refuses: it loads everything and ends at once.

    Raises:
        InputError: SUMO's first error.
    """
    begin_s = ET.parse(config_file).getroot().find("begin")
    begin = "0" if begin_s is None else begin_s.attrib["value"]
    options = ["-c", str(config_file), "--route-steps", "0"]
    done = _run([sumo_program(), *options, "--end", begin])
    if done.returncode:
        # SUMO refuses edgeData if it ends at its begin.  libsumo, slower to start, needs no end.
        script = "import sys, libsumo; libsumo.start(sys.argv[1:])"
        done = _run([sys.executable, "-c", script, "sumo", *options])
    if done.returncode:
        raise InputError(where, f"SUMO refuses it ({first_error(done.stderr)})")


def _run(command: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, capture_output=True, text=True, check=False)
