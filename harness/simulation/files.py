"""What a configuration writes: each output gets a path in the arm's folder, or none.

Paths to which SUMO writes stand in its options, in detectors and other elements of additional
files, and in device parameters of vehicle types.  A file with such a path is copied and the path
replaced; SUMO reads all other files where they are.  Outputs of calibrators and of ToC devices,
which SUMO writes to its working folder, are not kept.
"""

import gzip
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from harness.core.errors import InputError, one_line, unknown_name
from harness.engine.configuration import SumoConfig, option_kinds

CONFIG_FILE = "simulation.sumocfg"
TRIPS_FILE = "tripinfo.xml"

_ALWAYS = {
    "random": "false",
    "no-step-log": "true",
    "no-warnings": "true",
    "duration-log.disable": "true",
    "tripinfo-output.write-unfinished": "true",
    "tripinfo-output.write-undeparted": "true",
}
"""Options of every arm: a fixed seed, few messages, and output of unfinished trips too."""

NOWHERE = "/dev/null"

_WRITES: Mapping[str, str] = {
    **dict.fromkeys(("inductionLoop", "e1Detector", "instantInductionLoop"), "file"),
    **dict.fromkeys(("laneAreaDetector", "e2Detector", "entryExitDetector", "e3Detector"), "file"),
    **dict.fromkeys(("edgeData", "laneData", "routeProbe", "vTypeProbe"), "file"),
    "timedEvent": "dest",
    **dict.fromkeys(("calibrator", "laneCalibrator"), "output"),
}
"""Elements of additional files that write, each with the attribute that has the path."""

_READS: Mapping[str, str] = {
    "include": "href",
    **dict.fromkeys(("variableSpeedSign", "rerouter"), "file"),
    **dict.fromkeys(("poly", "poi", "vType"), "imgFile"),
    **dict.fromkeys(("edgeData", "laneData"), "edgesFile"),
}
"""Elements that read a file; their copies need its absolute path."""

_FILES = ("net-file", "route-files", "additional-files")
"""Options that list the scenario's files."""

_PARAMETERS = ("device.ssm.file", "device.toc.file", "file")
"""Parameters of vehicles, vehicle types and traffic lights that name a file to write."""

_NAMES_A_FILE = re.compile(
    rb"""(?:file|dest|output|\bhref)\s*=\s*["']|["'](?:device\.\w+\.)?file["']"""
)

_SSM_FILE = "device.ssm.file"
"""Without this option SSM devices write a file for each vehicle."""


@dataclass(frozen=True)
class Kept:
    """The outputs of a scenario that are written, and their folder.

    Attributes:
        folder: the arm's own folder.
        names: the outputs that are kept: names of SUMO's options without ``-output`` (``fcd``,
            ``tripinfo`` …), ``detectors`` for outputs of additional files, ``devices`` for device
            parameters; ``all`` for all outputs.
    """

    folder: Path
    names: frozenset[str]

    def path(self, name: str, written: Path, home: Path) -> str:
        """The path that replaces the path ``written`` of an output.

        It is relative to the arm's folder, so that this may be moved: SUMO resolves it from the
        configuration or the copied file that names it, which lie in that folder.

        Args:
            name: name of the output.
            written: an absolute path.
            home: the configuration's folder.
        """
        return inside(written, home) if self.names & {"all", name} else NOWHERE


def inside(written: Path, home: Path) -> str:
    """A file name for a path: the path relative to ``home``, joined by underscores.

    Example:
        >>> inside(Path("town/out/fcd.xml"), Path("town"))
        'out_fcd.xml'
        >>> inside(Path("fcd.xml"), Path("town"))
        'up_fcd.xml'
    """
    parts = Path(os.path.relpath(written, home)).parts
    return "_".join("up" if part == ".." else part for part in parts)


def output_options(config: SumoConfig) -> dict[str, str]:
    """The options of a configuration that make SUMO write a file, each with the file's path."""
    kinds, named = option_kinds(), {}
    for name, value in config.options.items():
        writes = kinds.get(name) in (("output", "FILE"), ("report", "FILE"))
        writes |= name.endswith(("-output", ".output")) or name in _PARAMETERS
        if writes and "input-file" not in name and not name.endswith(".prefix") and value:
            named[name] = value
    return named


def short_name(option: str) -> str:
    """The name by which ``simulation.outputs`` keeps the output of an option."""
    if option.startswith("device."):
        return "devices"
    return option.removesuffix("-output").removesuffix("-dump")


def _options(config: SumoConfig, kept: Kept) -> dict[str, str]:
    """A configuration's options, with other outputs and with copies of files that name some."""
    written, home = output_options(config), config.path.absolute().parent
    options = {}
    for name, value in config.options.items():
        if name in written:
            path = kept.path(short_name(name), home / value, home)
            if path != NOWHERE:
                options[name] = path
        elif name in _FILES and value:
            options[name] = ",".join(copied(file, kept, home) for file in config.files(name))
        elif not _is_dropped(name):
            options[name] = value
    options.setdefault(_SSM_FILE, kept.path("devices", home / "ssm.xml", home))
    return options


def _is_dropped(option: str) -> bool:
    """Whether an option is dropped.

    These options save states, belong to the window, wait for a client, or leave out trips.
    """
    prefixes = (
        *("save-", "output-prefix", "output-suffix", "num-clients", "remote-port"),
        "device.tripinfo.",
    )
    return option.startswith(prefixes) or option_kinds().get(option, ("",))[0] == "gui_only"


def copied(file: Path, kept: Kept, home: Path) -> str:
    """The path of a file of the scenario, or the name of its copy if it names an output.

    Args:
        file: the file.
        kept: where the copy lies, and which of its outputs are written.
        home: the configuration's folder.

    Raises:
        InputError: the file cannot be read as XML.
    """
    try:
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
            content = stream.read()
        if not _NAMES_A_FILE.search(content):
            return str(file)
        tree = ET.ElementTree(ET.fromstring(content))
    except (OSError, EOFError, ET.ParseError) as error:
        raise InputError(str(file), f"cannot be read as XML ({one_line(str(error))})") from None
    if not sum(_redirect(element, file.parent, kept, home) for element in tree.iter()):
        return str(file)
    kept.folder.mkdir(parents=True, exist_ok=True)
    name = inside(file, home).removesuffix(".gz")
    tree.write(kept.folder / name, encoding="utf-8", xml_declaration=True)
    return name


def _redirect(element: ET.Element, folder: Path, kept: Kept, home: Path) -> bool:
    """Replace the paths of an element; whether SUMO would have written to one of them."""
    tag, key, kind = element.tag, element.get("key", ""), "detectors"
    writes, changed = _WRITES.get(tag, ""), False
    if tag == "param" and key in _PARAMETERS:
        writes, kind = "value", "devices" if key.startswith("device.") else kind
    for attribute in filter(element.get, (writes, _READS.get(tag, ""))):
        path = Path(os.path.normpath(folder / element.get(attribute, "")))
        new = str(path)
        if attribute == writes:
            from_working_folder = attribute == "output" or key == "device.toc.file"
            new = NOWHERE if from_working_folder else kept.path(kind, path, home)
        elif tag == "include":
            new = copied(path, kept, home)
        changed |= attribute == writes or new != str(path)
        element.set(attribute, new)
    return changed


def check_outputs(config: SumoConfig, names: Iterable[str], where: str) -> None:
    """Refuse names of outputs that a configuration does not write.

    Raises:
        InputError: an output is unknown; the message lists the configuration's outputs.
    """
    known = {"all", "detectors", "devices", "tripinfo", *map(short_name, output_options(config))}
    for name in names:
        if name not in known:
            raise unknown_name(where, f"output of {config.path}", name, known)


def write_config(
    config: SumoConfig,
    kept: Kept,
    seed: int,
    step_s: float | None,
    more: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Write the configuration of one arm into its folder.

    ``sumo -c`` with this file simulates the arm with nobody driven by the harness.

    Args:
        config: the configuration that is run.
        kept: the arm's folder, and the outputs that are written there.
        seed: seed of SUMO's random numbers.
        step_s: length of a step; None keeps the configuration's.
        more: further options.

    Returns:
        The path of the file.

    Raises:
        InputError: a file of the configuration cannot be read.
    """
    kept.folder.mkdir(parents=True, exist_ok=True)
    step = {} if step_s is None else {"step-length": f"{step_s:.3f}"}
    ours = {**_ALWAYS, "seed": str(seed), "tripinfo-output": TRIPS_FILE, **step}
    root = ET.Element("configuration")
    for name, value in sorted((_options(config, kept) | ours | dict(more)).items()):
        # In paths SUMO decodes "%20".
        is_path = option_kinds().get(name, ("", ""))[1] == "FILE"
        ET.SubElement(root, name, value=value.replace("%", "%25") if is_path else value)
    ET.indent(root)
    path = kept.folder.absolute() / CONFIG_FILE
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path
