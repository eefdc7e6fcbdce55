"""A SUMO that is missing, broken or of another version, and disks that cannot be written: one line.

What is broken lies in a folder that comes first on the module path.
"""

import os
import subprocess
from importlib import metadata
from pathlib import Path

import pytest

from harness.core.errors import InputError
from harness.engine import installation
from harness.studies.running.run import run
from tests.batches import CHECKOUT, QUICK, options_of, shell

RUN = ["run", "cctc", "--pairs", 2, "--workers", 1, "-q", *options_of(QUICK)]


def broken(folder: Path, module: str, source: str) -> dict[str, str]:
    """An environment in which a module is another one."""
    place = folder / "broken" / module
    place.mkdir(parents=True)
    (place / "__init__.py").write_text(source)
    return {"PYTHONPATH": os.pathsep.join([str(place.parent), str(CHECKOUT)])}


def one_line(done: "subprocess.CompletedProcess[str]", code: int, *parts: str) -> None:
    assert (done.returncode, done.stderr.count("\n")) == (code, 1), done.stderr
    assert done.stderr.startswith("harness: ")
    assert [part for part in parts if part not in done.stderr] == []


NO_LIBRARY = "libxerces-c-3.2.so: cannot open shared object file: No such file or directory"
OTHER_VERSION = "def getVersion(): return 21, 'SUMO 1.20.0'"


@pytest.mark.parametrize(
    ("source", "reason"),
    [(f"raise ImportError({NO_LIBRARY!r})", NO_LIBRARY),
     pytest.param(OTHER_VERSION, "is SUMO 1.20.0, not", marks=pytest.mark.slow)],
    ids=["does not load", "other version"],
)  # fmt: skip
def test_a_library_that_is_of_no_use(tmp_path: Path, source: str, reason: str) -> None:
    env = broken(tmp_path, "libsumo", source)
    one_line(shell(*RUN, "--out", tmp_path / "out", env=env), 1, "worker", reason)


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("raise ImportError", "netconvert: not found; install eclipse-sumo"),
        pytest.param(
            "SUMO_HOME = '/nowhere'",
            "there is no /nowhere/bin/netconvert; pip install",
            marks=pytest.mark.slow,
        ),
    ],
    ids=["no package", "no program"],
)
def test_no_netconvert(tmp_path: Path, source: str, reason: str) -> None:
    env = broken(tmp_path, "sumo", source)
    one_line(shell("network", "cctc", "--out", tmp_path / "net", env=env), 1, reason)


@pytest.mark.parametrize(
    ("installed", "reason"),
    [("1.27.0", "version 1.27.0 is installed; allowed: 1.28.0"), (None, "is not installed")],
)
def test_packages_of_another_version_are_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, installed: str | None, reason: str
) -> None:
    version = metadata.version

    def found(name: str) -> str:
        if name != "eclipse-sumo":
            return version(name)
        if installed is None:
            raise metadata.PackageNotFoundError(name)
        return installed

    installation.check_packages()
    monkeypatch.setattr(metadata, "version", found)
    with pytest.raises(InputError, match=f"eclipse-sumo: {reason}") as caught:
        installation.check_packages()
    assert "pip install eclipse-sumo==1.28.0" in str(caught.value)
    assert run("cctc", pairs=1, engine="plain", workers=0, out=tmp_path / "plain").finished
