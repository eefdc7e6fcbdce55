"""A user's SUMO configuration in; its options, with absolute paths and canonical names, out.

SUMO itself reads the configuration (``--save-configuration``), so abbreviations, synonyms and
errors are as in SUMO.
"""

import gzip
import hashlib
import os
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from urllib.parse import unquote

from harness.core.errors import EngineError, InputError
from harness.core.files import read_file
from harness.core.freezing import Frozen
from harness.core.vocabulary import ROUNDING
from harness.engine.installation import run_program, scratch_folder

_LONGEST_STEP_S = 1.0
"""SUMO's default, and the longest step at which strategies drive."""

DEFAULT_SEED = 23423
"""SUMO's default seed."""

_VEHICLES = ("vehicle", "trip", "flow")
_PEOPLE = ("person", "personFlow")
"""The elements of a route file that bring vehicles, and people."""


def digest_of(file: Path) -> str:
    """The sha256 of a file's content."""
    return hashlib.sha256(read_file(file)).hexdigest()


@dataclass(frozen=True)
class SumoConfig(Frozen):
    """A SUMO configuration.

    Attributes:
        path: the configuration's file.
        options: the values of its options by SUMO's canonical names; paths are absolute.
    """

    path: Path
    options: Mapping[str, str]

    def files(self, option: str) -> list[Path]:
        """The files that an option lists, in its order."""
        return [Path(name.strip()) for name in self.options.get(option, "").split(",") if name]

    @property
    def net(self) -> Path:
        """The network."""
        return self.files("net-file")[0]

    @property
    def demand(self) -> list[Path]:
        """The additional files and the route files, in the order in which SUMO reads them."""
        return [*self.files("additional-files"), *self.files("route-files")]

    @property
    def inputs(self) -> list[Path]:
        """The configuration's file, its network, its additional files and its route files."""
        return [self.path, self.net, *self.demand]

    @property
    def digests(self) -> Mapping[str, str]:
        """The hashes of the ``inputs`` by their paths."""
        return {str(file): digest_of(file) for file in self.inputs}

    @property
    def step_s(self) -> float:
        """The length of a step; SUMO's default is 1 s."""
        return seconds(self.options.get("step-length", "1"))

    @property
    def begin_s(self) -> float:
        """The time at which the simulation begins."""
        return seconds(self.options.get("begin", "0"))

    @property
    def end_s(self) -> float | None:
        """The time at which the simulation ends; None: when everybody has arrived."""
        end_s = seconds(self.options.get("end", "-1"))
        return None if end_s < 0 else end_s

    @property
    def seed(self) -> int:
        """The seed of SUMO's random numbers."""
        return int(self.options.get("seed", DEFAULT_SEED))

    @property
    def ballistic(self) -> bool:
        """Whether vehicles move with constant acceleration within a step (default: Euler)."""
        return is_on(self.options.get("step-method.ballistic", "false"))


def seconds(text: str) -> float:
    """A time of SUMO in s: a number, or ``[days:]hours:minutes:seconds``."""
    parts = text.split(":")
    if len(parts) == 1:
        return float(text)
    days, (hours, minutes, rest) = (parts[:-3] or ["0"])[0], parts[-3:]
    return 86_400 * int(days) + 3600 * int(hours) + 60 * int(minutes) + float(rest)


def is_on(value: str) -> bool:
    """Whether the text of one of SUMO's switches means "on"."""
    return value.strip().lower() in ("1", "yes", "true", "on", "x", "t")


_REFUSED: Mapping[str, tuple[Callable[[str], bool], str, str]] = {
    "mesosim": (is_on, "the mesoscopic model has no positions of vehicles", "false"),
    "device.fcd-replay.enable": (is_on, "replayed vehicles cannot be driven", "false"),
    "lateral-resolution": (lambda text: float(text) > 0, "the sublane model is not supported", "0"),
    "pedestrian.model": (lambda text: text != "striping", "is not supported", "striping"),
    "remote-port": (lambda text: text != "0", "it waits for a client, and there is none", "0"),
    "load-state": (bool, "a loaded state is not supported", "none"),
}
"""Options with a value that is not supported: whether it is one, what is wrong, what is allowed."""


def read_config(path: Path, step_s: float | None = None) -> SumoConfig:
    """Read a configuration, and refuse one that cannot be simulated here.

    Args:
        path: the configuration's file (.sumocfg).
        step_s: another step; None keeps the configuration's.

    Raises:
        InputError: SUMO refuses the configuration, one of its files is missing, no vehicle comes,
            or one of its options is not supported.
    """
    if not path.is_file():
        raise InputError(str(path), "no such configuration", "a SUMO configuration (.sumocfg)")
    step = {} if step_s is None else {"step-length": f"{step_s:.3f}"}
    config = SumoConfig(path, _options_of(path.absolute()) | step)
    for option, (is_refused, problem, allowed) in _REFUSED.items():
        value = config.options.get(option)
        if value and is_refused(value):
            raise InputError(f"{path}: {option} = {value}", problem, allowed)
    if config.step_s > _LONGEST_STEP_S + ROUNDING:
        allowed = f"at most {_LONGEST_STEP_S:g} s, or a shorter simulation.step_s"
        raise InputError(f"{path}: step-length", f"{config.step_s:g} s", allowed)
    if not config.files("net-file"):
        raise InputError(f"{path}: net-file", "is not given", "a SUMO network")
    for file in config.inputs:
        if not file.is_file():
            raise InputError(str(path), f"{file} does not exist", "a file")
    if not any(element.tag in _VEHICLES for element in elements_of(*config.demand)):
        allowed = "vehicles, trips or flows in its route files or additional files"
        raise InputError(str(path), "no vehicle comes", allowed)
    return config


def _options_of(path: Path) -> dict[str, str]:
    """All options of a configuration as SUMO reads them, with absolute paths."""
    with scratch_folder() as folder:
        saved = Path(folder) / "saved.sumocfg"
        arguments = ["-c", str(path), "--save-configuration", str(saved)]
        try:
            run_program("sumo", arguments, Path(folder))
        except EngineError as error:
            raise InputError(str(path), str(error)) from None
        options = {
            element.tag: element.attrib["value"]
            for section in ET.parse(saved).getroot()
            for element in section
        }
    return {name: _absolute(name, value, path.parent) for name, value in options.items()}


def _absolute(option: str, value: str, folder: Path) -> str:
    """The value of an option, with each path absolute; SUMO itself resolves most of them."""
    if option_kinds().get(option, ("", ""))[1] != "FILE":
        return value
    # SUMO writes "%20" for a space in a path.
    paths = (path.strip() for path in unquote(value).split(","))
    return ",".join(path and os.path.normpath(folder / path) for path in paths)


@cache
def option_kinds() -> Mapping[str, tuple[str, str]]:
    """Section (``output``, …) and type (``FILE``, ``BOOL``, …) of every option of ``sumo``."""
    with scratch_folder() as folder:
        template = Path(folder) / "template.xml"
        run_program("sumo", ["--save-template", str(template)], Path(folder))
        root = ET.parse(template).getroot()
    return {each.tag: (section.tag, each.get("type", "")) for section in root for each in section}


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


def people_in(config: SumoConfig) -> Iterator[str]:
    """The ids of people and of their flows in a configuration's demand."""
    people = (each for each in elements_of(*config.demand) if each.tag in _PEOPLE)
    return (each.get("id", "") for each in people)


def elements_of(*files: Path) -> Iterator[ET.Element]:
    """The elements of XML files, plain or gzipped, and of those that they include, in order.

    They come without their content.

    Raises:
        InputError: a file cannot be read as XML.
    """
    for file in files:
        try:
            with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
                parents: list[ET.Element] = []
                for event, element in ET.iterparse(stream, ("start", "end")):
                    if event == "end":
                        parents.pop()
                        if parents:
                            parents[-1].remove(element)
                        continue
                    parents.append(element)
                    yield element
                    if element.tag == "include":
                        included = os.path.normpath(file.parent / element.get("href", ""))
                        yield from elements_of(Path(included))
        except (OSError, ET.ParseError, EOFError, LookupError, ValueError, zlib.error) as error:
            raise InputError(str(file), f"cannot be read as XML ({error})") from None


def defined_types(config: SumoConfig) -> Iterator[str]:
    """The names and classes of vehicle types: SUMO's default, then those that files define.

    Raises:
        InputError: a file cannot be read as XML.
    """
    yield from ("passenger", "DEFAULT_VEHTYPE")
    for element in elements_of(*config.demand):
        if element.tag == "vType":
            yield from (element.get("id", ""), element.get("vClass", "passenger"))
