"""Source distribution and wheel carry everything: built, installed apart, run from elsewhere."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]


def run(*command: object, cwd: Path, timeout_s: float = 300.0) -> str:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    result = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout_s,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    # The source distribution is built first, and the wheel from it.
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", out, CHECKOUT, cwd=out)
    (built,) = out.glob("crosswalk_harness-*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bin folder of a fresh environment with the wheel in it.

    Its dependencies come from this environment's packages, put behind its own by a path file; the
    checkout itself, an editable install here, is named in a path file there and so stays out.
    """
    root = tmp_path_factory.mktemp("fresh")
    venv.create(root, with_pip=False)
    python = root / "bin" / "python"
    target = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=root)
    packages = Path(target.strip())
    run(
        *(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index"),
        *("--quiet", "--disable-pip-version-check", wheel),
        cwd=root,
    )
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python.parent


def test_what_the_wheel_holds(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    for folder, pattern in (("networks", "**/*.xml"), ("scenarios", "*.toml")):
        files = [p.relative_to(CHECKOUT).as_posix() for p in (CHECKOUT / folder).glob(pattern)]
        assert files
        assert {f"harness/{name}" for name in files} <= held
    shipped = {p.relative_to(CHECKOUT).as_posix() for p in (CHECKOUT / "harness").rglob("*.json")}
    assert shipped
    assert shipped <= held
    templates = CHECKOUT / "harness" / "report" / "templates"
    pages = {path.relative_to(CHECKOUT).as_posix() for path in templates.iterdir()}
    assert len(pages) >= 4
    assert pages | {"harness/py.typed"} <= held
    assert any(name.endswith("/LICENSE") for name in held)
    assert not any(name.startswith(("tests/", "docs/", "benchmarks/")) for name in held)


def test_it_runs_from_another_folder(installed: Path, tmp_path: Path) -> None:
    where = run(installed / "python", "-c", "import harness; print(harness.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(installed.parent)
    printed = run(installed / "harness", "run", "cctc", "--pairs", 2, "--json", cwd=tmp_path)
    document = json.loads(printed)
    assert (tmp_path / document["facts"]["folder"] / "findings.json").is_file()
    (record,) = document["records"]
    assert (record["pairs"]["value"], record["failed"]["value"]) == (2, 0)
