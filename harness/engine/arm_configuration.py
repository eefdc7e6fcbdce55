"""The configuration that an arm runs: the user's, with its outputs in the arm's folder."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from harness.core.errors import EngineError, InputError
from harness.engine.configuration import SumoConfig, option_kinds, write_options
from harness.engine.installation import run_program, scratch_folder

CONFIG_FILE, TRIPS_FILE, STATES_FILE = "simulation.sumocfg", "tripinfo.xml", "fcd.xml.gz"

_ALWAYS = {
    "random": "false",
    "no-step-log": "true",
    "no-warnings": "true",
    "duration-log.disable": "true",
    "tripinfo-output": TRIPS_FILE,
    "tripinfo-output.write-unfinished": "true",
    "tripinfo-output.write-undeparted": "true",
}
"""Options of every arm: a fixed seed, few messages, and output of unfinished trips too."""

_DROPPED = ("save-", "output-prefix", "output-suffix", "num-clients", "remote-port",
            "device.tripinfo.")  # fmt: skip
"""How options begin that save states, name outputs, wait for a client, or leave out trips."""

_TO_THE_ROOT = "../" * 40
"""SUMO puts its prefix between an output's folder and its name, in detectors' and devices' too."""


def _is_kept(option: str, keeps: bool) -> bool:
    """Whether an option of the user's configuration stays."""
    section, kind = option_kinds().get(option, ("", ""))
    writes = option.endswith("-output") or (kind == "FILE" and section in ("output", "report"))
    return not option.startswith(_DROPPED) and section != "gui_only" and (keeps or not writes)


def write_config(
    config: SumoConfig,
    arm: Path,
    seed: int,
    more: Mapping[str, str] = MappingProxyType({}),
    *,
    keeps: bool = False,
) -> Path:
    """Write the configuration of one arm into its folder.

    ``sumo -c`` with this file simulates the arm with nobody driven by the harness.

    Args:
        config: the configuration that is run.
        arm: the arm's folder.
        seed: seed of SUMO's random numbers.
        more: further options; an additional file comes after those of the configuration.
        keeps: whether the outputs that the configuration's own options name are written, and
            everybody's states; all outputs come into the folder, by their names without a folder.

    Returns:
        The path of the file.
    """
    arm.mkdir(parents=True, exist_ok=True)
    options = {name: value for name, value in config.options.items() if _is_kept(name, keeps)}
    prefix = f"{_TO_THE_ROOT}{arm.absolute().as_posix()}/"
    ours = {**_ALWAYS, "seed": str(seed), "output-prefix": prefix}
    files = filter(None, [each.get("additional-files") for each in (options, more)])
    if together := ",".join(files):
        ours["additional-files"] = together
    if keeps:
        ours["fcd-output"] = STATES_FILE
    return write_options(arm.absolute() / CONFIG_FILE, {**options, **more, **ours})


def run_untouched(config: SumoConfig, folder: Path, more: Mapping[str, str]) -> None:
    """Simulate a configuration with nobody driven, with further options, in another process.

    Raises:
        InputError: SUMO fails.
    """
    path = write_config(config, folder, config.seed, more)
    try:
        run_program("sumo", ["-c", str(path)])
    except EngineError as error:
        raise InputError(str(config.path), str(error)) from None


def check_routes(config: SumoConfig) -> None:
    """Refuse a configuration with a route that SUMO cannot build.

    Raises:
        InputError: SUMO does not begin with all routes loaded.
    """
    with scratch_folder() as scratch:
        now = {"route-steps": "0", "end": f"{config.begin_s + config.step_s:.3f}"}
        run_untouched(config, Path(scratch), now)
