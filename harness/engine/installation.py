"""SUMO's packages and programs: checked, found and run; and folders for what they read."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Literal

from harness.core.errors import EngineError, InputError

Program = Literal["sumo", "sumo-gui", "netconvert"]

_PACKAGES = ("libsumo", "eclipse-sumo", "sumolib", "traci")
_SCRATCH = "crosswalk-harness-{}-"
"""How the names of a process's temporary folders begin, by its id."""


def check_packages() -> None:
    """Refuse a SUMO that is missing or that has another version than this package needs.

    Raises:
        InputError: a package is missing or has the wrong version; says how to install it.
    """
    try:
        needed = metadata.requires("crosswalk-harness") or []
    except metadata.PackageNotFoundError:
        raise InputError("crosswalk-harness", "is not installed", "pip install .") from None
    for requirement in needed:
        name, _, version = requirement.partition("==")
        if name not in _PACKAGES:
            continue
        allowed = f"{version} (pip install {requirement})"
        try:
            installed = metadata.version(name)
        except metadata.PackageNotFoundError:
            raise InputError(name, "is not installed", allowed) from None
        if installed != version:
            raise InputError(name, f"version {installed} is installed", allowed)


def program_path(name: Program) -> str:
    """The path of a program of the package eclipse-sumo, also if the PATH has another one.

    Raises:
        EngineError: there is none.
    """
    try:
        import sumo
    except ImportError:
        raise EngineError(f"{name}: not found; install eclipse-sumo") from None
    folder = Path(sumo.SUMO_HOME, "bin")
    found = shutil.which(name, path=str(folder))
    if found is None:
        again = "pip install --force-reinstall eclipse-sumo"
        raise EngineError(f"{name}: there is no {folder / name}; {again}")
    return found


def scratch_folder() -> TemporaryDirectory[str]:
    """A new temporary folder; its name says which process to remove it after."""
    return TemporaryDirectory(prefix=_SCRATCH.format(os.getpid()))


def remove_scratch(process: int) -> None:
    """Remove the temporary folders of a process that was killed, by its id."""
    for folder in Path(gettempdir()).glob(f"{_SCRATCH.format(process)}*"):
        shutil.rmtree(folder, ignore_errors=True)


def run_program(name: Program, arguments: Sequence[str], folder: Path | None = None) -> None:
    """Run a program to its end in a process of its own, maybe with another working directory.

    Raises:
        EngineError: the program is missing, failed or crashed; repeats its first error.
    """
    command = [program_path(name), *arguments]
    home = Path(command[0]).parents[1]
    # Without PROJ_DATA netconvert looks for proj.db at its path on the machine that built it.
    places = {"SUMO_HOME": str(home), "PROJ_DATA": str(home / "data" / "proj")}
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, **places},
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
    except OSError as error:
        raise EngineError(f"{name}: {error}") from None
    if done.returncode:
        lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        errors = [line.removeprefix("Error:").strip() for line in lines if line[:6] == "Error:"]
        how = f"exit code {done.returncode}" if done.returncode > 0 else "it crashed"
        raise EngineError(f"{name}: {(errors or lines or [how])[0]}")
