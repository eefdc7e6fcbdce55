"""What a configuration writes: each output gets a path in the arm's folder, or none.

Paths to which SUMO writes stand in its options, in detectors and other elements of additional
files, and in device parameters of vehicle types.  A file with such a path is copied and the path
replaced; SUMO reads all other files where they are.
"""

import gzip
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from harness.core.errors import InputError, nearest_name, one_line
from harness.site.configuration import SumoConfig, option_sections, option_types

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

_OUTPUTS: Mapping[str, str] = {
    **dict.fromkeys(
        (
            *("inductionLoop", "e1Detector", "instantInductionLoop"),
            *("laneAreaDetector", "e2Detector", "entryExitDetector", "e3Detector"),
            *("edgeData", "laneData", "routeProbe", "vTypeProbe"),
        ),
        "file",
    ),
    "timedEvent": "dest",
    "calibrator": "output",
    "laneCalibrator": "output",
}
"""Elements of additional files that write, each with the attribute that has the path."""

_INPUTS: Mapping[str, str] = {
    "include": "href",
    "variableSpeedSign": "file",
    "rerouter": "file",
    "poly": "imgFile",
    "poi": "imgFile",
    "vType": "imgFile",
    "edgeData": "edgesFile",
    "laneData": "edgesFile",
}
"""Elements that read a file; their copies need its absolute path."""

_PARAMETERS = ("device.ssm.file", "device.toc.file", "file")
"""Parameters of vehicles, vehicle types and traffic lights that name a file to write."""

_FROM_WORKING_FOLDER = ("output", "device.toc.file")
"""A calibrator's attribute, and a parameter: SUMO resolves no other output from there."""

_WRITES = re.compile(rb"""(?:file|dest|output|\bhref)\s*=\s*["']|["'](?:device\.\w+\.)?file["']""")

_NO_FILE = re.compile(r"(nul|stdout|stderr|-|[\w.-]+:\d+)", re.IGNORECASE)
"""Names that are no files for SUMO: the null device, the terminal, a socket."""

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

    def keeps(self, name: str) -> bool:
        """Whether an output of this name is written."""
        return "all" in self.names or name in self.names

    def path(self, name: str, written: Path, home: Path, key: str = "") -> str:
        """The path that replaces the path ``written`` of an output.

        It is relative to the arm's folder, so that this may be moved: SUMO resolves it from the
        configuration or the copied file that names it, which lie in that folder.

        Args:
            name: name of the output.
            written: an absolute path.
            home: the configuration's folder.
            key: name of the attribute, parameter or option that has the path.
        """
        if not self.keeps(name) or _NO_FILE.fullmatch(written.name) or str(written) == NOWHERE:
            return NOWHERE
        path = inside(written, home)
        return str(self.folder.absolute() / path) if key in _FROM_WORKING_FOLDER else path


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
    types, sections = option_types(), option_sections()
    named = {}
    for name, value in config.options.items():
        writes = types.get(name) == "FILE" and sections.get(name) in ("output", "report")
        writes |= name.endswith(("-output", ".output")) or name in _PARAMETERS
        if writes and "input-file" not in name and not name.endswith(".prefix") and value:
            named[name] = value
    return named


def short_name(option: str) -> str:
    """The name by which ``simulation.outputs`` keeps the output of an option."""
    if option.startswith("device."):
        return "devices"
    return option.removesuffix("-output").removesuffix("-dump")


def redirected_options(config: SumoConfig, kept: Kept) -> dict[str, str]:
    """The configuration's options with the paths of its outputs replaced."""
    written, home = output_options(config), config.path.absolute().parent
    options = {}
    for name, value in config.options.items():
        if name in written:
            path = kept.path(short_name(name), home / value, home, name)
            if path != NOWHERE:
                options[name] = path
        elif not _is_dropped(name):
            options[name] = value
    options.setdefault(_SSM_FILE, kept.path("devices", home / "ssm.xml", home))
    return options


def final_options(config: SumoConfig, kept: Kept) -> dict[str, str]:
    """``redirected_options`` with copies of the files of the scenario that name an output.

    Raises:
        InputError: a file cannot be read as XML.
    """
    options, home = redirected_options(config, kept), config.path.absolute().parent
    for option in ("net-file", "route-files", "additional-files"):
        files = config.files(option)
        if files:
            options[option] = ",".join(copied(file, kept, home) for file in files)
    return options


def _is_dropped(option: str) -> bool:
    """Whether an option is dropped.

    These options save states, belong to the window, wait for a client, or leave out trips.
    """
    prefixes = (
        *("save-", "output-prefix", "output-suffix", "num-clients", "remote-port"),
        "device.tripinfo.",
    )
    return option.startswith(prefixes) or option_sections().get(option) == "gui_only"


def copied(file: Path, kept: Kept, home: Path) -> str:
    """The path of a file of the scenario, or the name of its copy if it names an output.

    Args:
        file: the file.
        kept: where the copy lies, and which of its outputs are written.
        home: the configuration's folder.

    Raises:
        InputError: the file cannot be read as XML.
    """
    content = _bytes(file)
    if not _WRITES.search(content):
        return str(file)
    try:
        tree = ET.ElementTree(ET.fromstring(content))
    except ET.ParseError as error:
        raise InputError(str(file), f"cannot be read as XML ({one_line(str(error))})") from None
    changed = False
    for element in tree.iter():
        changed |= _redirect(element, file.parent, kept, home)
    if not changed:
        return str(file)
    kept.folder.mkdir(parents=True, exist_ok=True)
    name = inside(file, home).removesuffix(".gz")
    tree.write(kept.folder / name, encoding="utf-8", xml_declaration=True)
    return name


def _redirect(element: ET.Element, folder: Path, kept: Kept, home: Path) -> bool:
    """Replace the paths of an element; return whether SUMO would have written to one of them."""

    def absolute(path: str) -> Path:
        return Path(os.path.normpath(folder / path))

    wrote = False
    tag = element.tag
    output = _OUTPUTS.get(tag)
    if output is not None and element.get(output):
        path = absolute(element.get(output, ""))
        element.set(output, kept.path("detectors", path, home, output))
        wrote = True
    source = _INPUTS.get(tag)
    if source is not None and element.get(source):
        path = absolute(element.get(source, ""))
        read = copied(path, kept, home) if tag == "include" else str(path)
        wrote |= read != str(path)
        element.set(source, read)
    if tag == "param" and element.get("key") in _PARAMETERS and element.get("value"):
        key, path = element.get("key", ""), absolute(element.get("value", ""))
        name = "devices" if key.startswith("device.") else "detectors"
        element.set("value", kept.path(name, path, home, key))
        wrote = True
    return wrote


def _bytes(file: Path) -> bytes:
    try:
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
            return stream.read()
    except (OSError, EOFError) as error:
        raise InputError(str(file), f"cannot be read ({one_line(str(error))})") from None


def check_outputs(config: SumoConfig, names: Iterable[str], where: str) -> None:
    """Refuse names of outputs that a configuration does not write.

    Raises:
        InputError: an output is unknown; the message lists the configuration's outputs.
    """
    known = {"all", "detectors", "devices", "tripinfo", *map(short_name, output_options(config))}
    for name in names:
        if name not in known:
            problem = f"{config.path} writes no output {name!r}"
            allowed = ", ".join(sorted(known))
            raise InputError(where, problem, allowed, nearest_name(name, known))


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
    for name, value in sorted((final_options(config, kept) | ours | dict(more)).items()):
        # In paths SUMO decodes "%20".
        is_path = option_types().get(name) == "FILE"
        ET.SubElement(root, name, value=value.replace("%", "%25") if is_path else value)
    ET.indent(root)
    path = kept.folder.absolute() / CONFIG_FILE
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path
