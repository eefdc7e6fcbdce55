"""A crosswalk's geometry in; its SUMO network out, shipped or built by netconvert."""

import hashlib
import os
import re
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from harness.core.errors import EngineError, InputError
from harness.core.files import shipped_directory
from harness.engine.network.sources import APPROACH_M, plain_sources
from harness.scenario import Scenario
from harness.scenario.sections import CrossingSection
from harness.site import Place, read_site
from harness.site.site import TOLERANCE_M

CACHE_VARIABLE = "CROSSWALK_HARNESS_CACHE"

_TOLERANCE_DEG = 1e-5
_NETCONVERT_LIMIT_S = 600.0
_LAST_LINES = 3
"""Number of lines of netconvert's errors that a message repeats."""


@dataclass(frozen=True)
class NetworkFiles:
    """The files of a built network: SUMO's network and its plain-XML sources."""

    net: Path
    sources: tuple[Path, ...]


def build_network(crossing: CrossingSection, directory: Path, name: str) -> NetworkFiles:
    """Write a site's sources into a folder and build its network there with netconvert.

    The same arguments give the same bytes, because netconvert's header with the date and the
    machine's paths is removed.  Files appear complete or not at all, and the network appears last.

    Args:
        crossing: the crosswalk.
        directory: the folder; made if missing.
        name: stem of the files' names.

    Raises:
        InputError: a bad name, or a folder that cannot be written.
        EngineError: netconvert is missing or failed, or its network has another geometry.
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
            run_netconvert(["-c", f"{name}.netccfg"], folder)
            (folder / net_name).write_bytes(_without_comments(folder / net_name).encode())
            _check(folder / net_name, crossing)
            for file_name in (*sources, net_name):
                (folder / file_name).replace(directory / file_name)
    except OSError as error:
        raise InputError(str(directory), f"cannot be written ({error.strerror})") from error
    return NetworkFiles(directory / net_name, tuple(directory / file for file in sources))


def network_of(scenario: Scenario) -> Path:
    """The SUMO network of a scenario: a shipped one, one built earlier, or one built now.

    A shipped network is used if its sources equal those of this geometry, character for character.
    Any other network is cached in ``$CROSSWALK_HARNESS_CACHE``, else in
    ``$XDG_CACHE_HOME/crosswalk-harness/networks``, else in
    ``~/.cache/crosswalk-harness/networks``.  Its folder is named by a hash of its sources and of
    netconvert's version.  Several processes may build at the same time.

    Raises:
        InputError: the cache folder cannot be written.
        EngineError: see `build_network`.
    """
    crossing = scenario.crossing
    for net in sorted(shipped_directory("networks").glob("*/*.net.xml")):
        sources = plain_sources(crossing, net.name.removesuffix(".net.xml"))
        if all(_text(net.with_name(file)) == text for file, text in sources.items()):
            return net
    digest = hashlib.sha256(_netconvert_version().encode())
    for file_name, text in sorted(plain_sources(crossing, "site").items()):
        digest.update(f"\0{file_name}\0{text}".encode())
    directory = _cache_dir() / digest.hexdigest()[:24]
    net = directory / "site.net.xml"
    if net.is_file():  # the network is the last file, so the folder is complete
        return net
    return build_network(crossing, directory, "site").net


def place_of(scenario: Scenario) -> Place:
    """The crosswalk of a scenario in its SUMO network."""
    return Place(network_of(scenario), scenario.ego.lane)


def run_netconvert(arguments: Sequence[str], directory: Path) -> None:
    """Run netconvert in a process of its own, with a folder as its working directory.

    Raises:
        EngineError: netconvert is missing, failed or crashed; repeats its last lines.
    """
    try:
        import sumo
    except ImportError as error:
        raise EngineError("netconvert: not found; install eclipse-sumo") from error
    home = Path(sumo.SUMO_HOME)
    program = home / "bin" / f"netconvert{'.exe' if os.name == 'nt' else ''}"
    # Without PROJ_DATA the binary looks for proj.db at its path on the machine that built it.
    places = {"SUMO_HOME": str(home), "PROJ_DATA": str(home / "data" / "proj")}
    try:
        done = subprocess.run(
            [str(program), *arguments],
            cwd=directory,
            env={**os.environ, **places},
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_NETCONVERT_LIMIT_S,
            check=False,
        )
    except FileNotFoundError:
        again = "pip install --force-reinstall eclipse-sumo"
        raise EngineError(f"netconvert: there is no {program}; {again}") from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EngineError(f"netconvert: {' '.join(str(error).split())}") from error
    if done.returncode != 0:
        words = [line for line in done.stderr.splitlines() if line.strip()][-_LAST_LINES:]
        how = f"exit code {done.returncode}" if done.returncode > 0 else "it crashed"
        raise EngineError(f"netconvert: {' '.join('; '.join(words).split()) or how}")


def opendrive(net: Path) -> bytes:
    """A network as OpenDRIVE, in the network's own coordinates.

    The same network gives the same bytes, because netconvert's comment and its date are removed.

    Raises:
        EngineError: netconvert is missing or failed.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as temporary:
        path = Path(temporary) / "road.xodr"
        # The default precision of 1 cm would shift and turn the lanes.
        arguments = ["--sumo-net-file", str(net.absolute()), "--opendrive-output", path.name]
        run_netconvert([*arguments, "--precision", "9"], path.parent)
        text = _without_comments(path)
    return re.sub(r'(<header\b[^>]*?) date="[^"]*"', r"\1", text, count=1).encode()


def _without_comments(file: Path) -> str:
    """The text of a file of netconvert, without its header."""
    return re.sub(r"<!--.*?-->\s*", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)


def _netconvert_version() -> str:
    try:
        return metadata.version("eclipse-sumo")
    except metadata.PackageNotFoundError as error:
        raise EngineError("netconvert: not found; install eclipse-sumo") from error


def _check(net: Path, crossing: CrossingSection) -> None:
    """Raise unless the network has the crosswalk's geometry."""
    try:
        sites = [read_site(Place(net, lane)) for lane in range(crossing.lanes)]
    except InputError as error:  # not the user's fault, because netconvert wrote this file
        raise EngineError(f"netconvert: {error.problem} for {crossing!r}") from error
    site = sites[0]
    turn = (site.bearing_deg - crossing.bearing_deg + 180.0) % 360.0 - 180.0
    errors = {
        "length_m": abs(site.length_m - crossing.length_m) / TOLERANCE_M,
        "width_m": abs(site.width_m - crossing.width_m) / TOLERANCE_M,
        "lane centre": max(
            abs(each.ego.centre_m - crossing.lane_centre_m(lane)) / TOLERANCE_M
            for lane, each in enumerate(sites)
        ),
        "bearing_deg": abs(turn) / _TOLERANCE_DEG,
        "max_range_m": abs(site.ego.start_m + APPROACH_M) / TOLERANCE_M,
    }
    wrong = [what for what, error in errors.items() if not error <= 1.0]
    if wrong:
        raise EngineError(
            f"netconvert: the network differs in {', '.join(wrong)} from {crossing!r}"
        )


def _cache_dir() -> Path:
    """The folder of built networks; empty environment variables are ignored."""
    folder = os.environ.get(CACHE_VARIABLE)
    if folder:
        return Path(folder).expanduser()
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "crosswalk-harness" / "networks"


def _text(path: Path) -> str | None:
    """A file's text; None if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
