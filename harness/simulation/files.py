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
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from harness.core.errors import InputError, one_line
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
class Folder:
    """The folder of an arm.

    Attributes:
        path: the folder.
        home: the folder of the configuration that is run.
        keeps: whether the outputs of that configuration are written, into the arm's folder.
    """

    path: Path
    home: Path
    keeps: bool

    def output(self, written: Path) -> str:
        """The path that replaces the path ``written`` of an output.

        It is relative to the arm's folder, so that this may be moved: SUMO resolves it from the
        configuration or the copied file that names it, which lie in that folder.
        """
        return self.name(written) if self.keeps else NOWHERE

    def name(self, file: Path) -> str:
        """A file's path from the configuration's folder, joined by underscores.

        Example:
            >>> Folder(Path("arm"), Path("town"), True).name(Path("town/out/fcd.xml"))
            'out_fcd.xml'
            >>> Folder(Path("arm"), Path("town"), True).name(Path("fcd.xml"))
            'up_fcd.xml'
        """
        parts = Path(os.path.relpath(file, self.home)).parts
        return "_".join("up" if part == ".." else part for part in parts)


def _writes(option: str) -> bool:
    """Whether an option makes SUMO write a file."""
    if "input-file" in option or option.endswith(".prefix"):
        return False
    kind = option_kinds().get(option)
    named = option.endswith(("-output", ".output")) or option in _PARAMETERS
    return named or kind in (("output", "FILE"), ("report", "FILE"))


def _options(config: SumoConfig, folder: Folder) -> dict[str, str]:
    """A configuration's options, with other outputs and with copies of files that name some."""
    options = {_SSM_FILE: folder.output(folder.home / "ssm.xml")}
    for name, value in config.options.items():
        if _writes(name):
            path = folder.output(folder.home / value) if value else NOWHERE
            if path != NOWHERE:
                options[name] = path
        elif name in _FILES and value:
            options[name] = ",".join(_copied(file, folder) for file in config.files(name))
        elif not _is_dropped(name):
            options[name] = value
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


def _copied(file: Path, folder: Folder) -> str:
    """The path of a file of the scenario, or the name of its copy if it names an output.

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
    if not sum(_redirect(element, file.parent, folder) for element in tree.iter()):
        return str(file)
    folder.path.mkdir(parents=True, exist_ok=True)
    name = folder.name(file).removesuffix(".gz")
    tree.write(folder.path / name, encoding="utf-8", xml_declaration=True)
    return name


def _redirect(element: ET.Element, beside: Path, folder: Folder) -> bool:
    """Replace the paths of an element; whether SUMO would have written to one of them."""
    tag, key = element.tag, element.get("key", "")
    writes, changed = _WRITES.get(tag, ""), False
    if tag == "param" and key in _PARAMETERS:
        writes = "value"
    for attribute in filter(element.get, (writes, _READS.get(tag, ""))):
        path = Path(os.path.normpath(beside / element.get(attribute, "")))
        new = str(path)
        if attribute == writes:
            from_working_folder = attribute == "output" or key == "device.toc.file"
            new = NOWHERE if from_working_folder else folder.output(path)
        elif tag == "include":
            new = _copied(path, folder)
        changed |= attribute == writes or new != str(path)
        element.set(attribute, new)
    return changed


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
        keeps: whether the configuration's own outputs are written, into the folder.

    Returns:
        The path of the file.

    Raises:
        InputError: a file of the configuration cannot be read.
    """
    arm.mkdir(parents=True, exist_ok=True)
    ours = {**_ALWAYS, "seed": str(seed), "tripinfo-output": TRIPS_FILE}
    options = _options(config, Folder(arm, config.path.absolute().parent, keeps))
    files = filter(None, [each.get("additional-files") for each in (options, more)])
    if together := ",".join(files):
        ours["additional-files"] = together
    return write_options(arm.absolute() / CONFIG_FILE, {**options, **more, **ours})


def write_options(path: Path, options: Mapping[str, str]) -> Path:
    """Write a configuration with these options; its path."""
    root = ET.Element("configuration")
    for name, value in sorted(options.items()):
        # In paths SUMO decodes "%20".
        is_path = option_kinds().get(name, ("", ""))[1] == "FILE"
        ET.SubElement(root, name, value=value.replace("%", "%25") if is_path else value)
    write_xml(path, root)
    return path


def write_xml(path: Path, root: ET.Element) -> None:
    """Write an element with its content into a file, indented."""
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
