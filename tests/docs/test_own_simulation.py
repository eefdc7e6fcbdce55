"""The commands for a user's own SUMO scenario run as they are written, on the shipped example."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from tests.batches import printed
from tests.docs.conftest import ROOT

EXAMPLE = ROOT / "examples" / "own_simulation"
END_S = 240
"""Of the ten minutes that the example has."""
PAGE = (ROOT / "docs" / "simulations.md").read_text("utf-8")


def commands(heading: str) -> list[list[str]]:
    """The words of the commands in the first text block below a heading."""
    block = re.search(rf"^## {heading}\n.*?^```text\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    assert block is not None
    return [shlex.split(line, comments=True) for line in block[1].splitlines()]


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the page's commands have run: one pair for each cell, four minutes."""
    folder = tmp_path_factory.mktemp("town") / "town"
    copy, change, *rest = commands("Your own SUMO scenario")
    assert (copy, change) == (["cp", "-r", "examples/own_simulation", "town"], ["cd", "town"])
    shutil.copytree(EXAMPLE, folder)
    config = folder / "town.sumocfg"
    config.write_text(config.read_text().replace('<end value="600"/>', f'<end value="{END_S}"/>'))
    for words in rest:
        fewer = ["--pairs", "1", "--workers", "1"] if words[1] == "run" else []
        printed(*words[1:], *fewer, cwd=folder)
    return folder


def test_the_commands_of_the_page_run(town: Path) -> None:
    for name in ("town.toml", "runs/town/report.html"):
        assert (town / name).is_file(), name


def test_nothing_is_written_beside_the_scenario(town: Path) -> None:
    new = {path.name for path in town.iterdir()} - {path.name for path in EXAMPLE.iterdir()}
    assert new == {"town.toml", "runs"}
    for path in EXAMPLE.iterdir():
        kept = path.read_text().replace('<end value="600"/>', f'<end value="{END_S}"/>')
        assert (town / path.name).read_text() == kept
