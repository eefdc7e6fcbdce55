"""A crosswalk's geometry in; its SUMO network out, shipped or built by netconvert."""

import hashlib
import os
import re
import tempfile
from importlib import metadata
from pathlib import Path

from harness.core.errors import EngineError
from harness.core.files import cannot_write, shipped_directory
from harness.engine.installation import run_program, scratch_folder
from harness.engine.sources import NO_LIMIT_MPS, plain_sources
from harness.scenario import Scenario
from harness.scenario.sections import CrossingSection

CACHE_VARIABLE = "CROSSWALK_HARNESS_CACHE"
"""The environment variable with the folder in which built networks are kept."""


def build_network(crossing: CrossingSection, directory: Path, name: str) -> Path:
    """Write a site's sources into a folder and build its network there with netconvert.

    The same arguments give the same bytes, because netconvert's header with the date and the
    machine's paths is removed.  Files appear complete or not at all, and the network appears last.

    Args:
        crossing: the crosswalk.
        directory: the folder; made if missing.
        name: stem of the files' names.

    Returns:
        The network; its sources lie beside it.

    Raises:
        InputError: a bad name, or a folder in which nobody may write.
        HarnessError: the file system refuses (full).
        EngineError: netconvert is missing or failed.
    """
    sources = plain_sources(crossing, name)
    net_name = f"{name}.net.xml"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            prefix=f".{name}-", dir=directory, ignore_cleanup_errors=True
        ) as temporary:
            folder = Path(temporary)
            for file_name, text in sources.items():
                (folder / file_name).write_bytes(text.encode())
            run_program("netconvert", ["-c", f"{name}.netccfg"], folder)
            (folder / net_name).write_bytes(_without_comments(folder / net_name).encode())
            for file_name in (*sources, net_name):
                (folder / file_name).replace(directory / file_name)
    except OSError as error:
        raise cannot_write(directory, error) from error
    return directory / net_name


def network_of(scenario: Scenario) -> Path:
    """The SUMO network of a scenario: a shipped one, one built earlier, or one built now.

    A shipped network is used if its sources equal those of this geometry, character for character.
    Any other network is cached in ``$CROSSWALK_HARNESS_CACHE``, else in
    ``$XDG_CACHE_HOME/crosswalk-harness/networks``, else in
    ``~/.cache/crosswalk-harness/networks``.  Its folder is named by a hash of its sources and of
    netconvert's version.  Several processes may build at the same time.

    Raises:
        HarnessError: see ``build_network``; here the folder is that of the cache.
    """
    crossing = scenario.crossing
    for net in sorted(shipped_directory("networks").glob("*/*.net.xml")):
        sources = plain_sources(crossing, net.name.removesuffix(".net.xml"))
        if all(_text(net.with_name(file)) == text for file, text in sources.items()):
            return net
    digest = hashlib.sha256(metadata.version("eclipse-sumo").encode())
    for file_name, text in sorted(plain_sources(crossing, "site").items()):
        digest.update(f"\0{file_name}\0{text}".encode())
    directory = _cache_dir() / digest.hexdigest()[:24]
    net = directory / "site.net.xml"
    # The network is the last file, so the folder is complete.
    return net if net.is_file() else build_network(crossing, directory, "site")


def network_with_limit(scenario: Scenario) -> str:
    """The text of a scenario's network in which the lanes have the scenario's speed limit.

    Raises:
        HarnessError: see ``network_of``.
        EngineError: netconvert wrote no lane.
    """
    text = network_of(scenario).read_text(encoding="utf-8")
    limit = f'speed="{scenario.speed_limit_mps!r}"'
    text, lanes = re.subn(rf'speed="{NO_LIMIT_MPS}(\.0+)?"', limit, text)
    if not lanes:
        raise EngineError(f"netconvert wrote no lane with a limit of {NO_LIMIT_MPS} m/s")
    return text


def opendrive(net: Path) -> bytes:
    """A network as OpenDRIVE, in the network's own coordinates.

    The same network gives the same bytes, because netconvert's comment and its date are removed.

    Raises:
        EngineError: netconvert is missing or failed.
    """
    with scratch_folder() as folder:
        path = Path(folder) / "road.xodr"
        # The default precision of 1 cm would shift and turn the lanes.
        arguments = ["--sumo-net-file", str(net.absolute()), "--opendrive-output", path.name]
        run_program("netconvert", [*arguments, "--precision", "9"], path.parent)
        text = _without_comments(path)
    return re.sub(r'(<header\b[^>]*?) date="[^"]*"', r"\1", text, count=1).encode()


def _without_comments(file: Path) -> str:
    """The text of a file of netconvert, without its header."""
    return re.sub(r"<!--.*?-->\s*", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)


def _cache_dir() -> Path:
    """The folder of built networks; empty environment variables are ignored."""
    if folder := os.environ.get(CACHE_VARIABLE):
        return Path(folder).expanduser()
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "crosswalk-harness" / "networks"


def _text(path: Path) -> str | None:
    """A file's text; None if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
