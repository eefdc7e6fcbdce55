"""Makes the pictures of the docs: first screens with notes, figures, the player, an export.

    python docs/pictures/make.py              # all of them
    python docs/pictures/make.py report sweep # some of them

``report`` and ``own_simulation`` need Chromium.  ``sumo-gui.png`` is a picture of its window.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from PIL import Image
from playwright.sync_api import FloatRect, sync_playwright
from top_view import top_view

from harness import load_run

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
COLOURS = 128
"""Number of colours; it is enough for screenshots and makes their files four times smaller."""


def harness(*words: object) -> None:
    """Run a command of the harness in the working directory."""
    command = [sys.executable, "-m", "harness", *map(str, words)]
    subprocess.run(command, check=True, env=os.environ | {"PYTHONPATH": str(ROOT)})


def save(picture: Path, name: str, box: tuple[int, int, int, int] | None = None) -> None:
    """Save a picture, or a box of it (left, upper, right, lower), in few colours."""
    with Image.open(picture) as image:
        whole = image.convert("RGB").crop(box) if box else image.convert("RGB")
        small = whole.quantize(COLOURS, dither=Image.Dither.NONE)
        small.save(HERE / f"{name}.png", optimize=True)


def figure(run: str, name: str, as_name: str) -> None:
    """Save a figure of a run's report."""
    harness("report", run, "--figures", "figures")
    save(Path("figures") / f"{name}.png", as_name)


def report() -> None:
    """The page of the paper's experiment: its first part, and its player."""
    harness("run", "cctc", "--traces", "--quiet", "--out", "cctc")
    harness("report", "cctc")
    with sync_playwright() as browsers:
        chromium = shutil.which("chromium")
        browser = browsers.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1100, "height": 900}, color_scheme="light")
        page.goto(Path("cctc/report.html").resolve().as_uri())
        page.locator("#player-time").fill("5.3")
        page.locator("#episodes").screenshot(path="player.png")
        page.evaluate("scrollTo({top: 0, behavior: 'instant'})")
        last = page.locator("#results").bounding_box()
        assert last is not None
        upper: FloatRect = {
            "x": 0,
            "y": 0,
            "width": 1100,
            "height": last["y"] + last["height"] + 2,
        }
        page.screenshot(path="report.png", full_page=True, clip=upper)
        browser.close()
    save(Path("report.png"), "report")
    save(Path("player.png"), "player")


def sweep() -> None:
    """μ over the flow of pedestrians, for three strategies."""
    strategies = "arms.av=soft_yield,hard_yield,gap_yield"
    flows = "pedestrians.flow_per_hour=50,100,250,500,1000"
    harness(
        *("sweep", "cctc_flow", "--vary", flows, "--vary", strategies),
        *("--pairs", 1000, "--quiet", "--out", "flows"),
    )
    figure("flows", "time-ratio", "sweep")


def own_simulation() -> None:
    """The page of the run of docs/simulations.md: its first screen and figures."""
    config = ROOT / "examples" / "own_simulation" / "town.sumocfg"
    edges = ("--edge", ":J7_c0", "--edge", ":J9_c1")
    harness("crossings", config, "--write", "town.toml", *edges)
    chosen = ("--set", "arms.av=soft_yield", "--pairs", 5)
    harness("run", "town.toml", *chosen, "--quiet", "--out", "own")
    harness("report", "own")
    with sync_playwright() as browsers:
        chromium = shutil.which("chromium")
        browser = browsers.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1100, "height": 900}, color_scheme="light")
        page.goto(Path("own/report.html").resolve().as_uri())
        last = page.locator("#figures").bounding_box()
        assert last is not None
        upper: FloatRect = {
            "x": 0,
            "y": 0,
            "width": 1100,
            "height": last["y"] + last["height"] + 2,
        }
        page.screenshot(path="own.png", full_page=True, clip=upper)
        browser.close()
    save(Path("own.png"), "own_simulation")


def exported() -> None:
    """An exported crash from above, drawn from its files."""
    settings = ("arms.av=constant_speed", "pedestrians.flow_per_hour=1000")
    chosen = [word for setting in settings for word in ("--set", setting)]
    harness("run", "cctc_flow", "--pairs", 20, *chosen, "--traces", "--quiet", "--out", "flow")
    episodes = load_run("flow").episodes
    crashed = episodes[(episodes["arm"] == "av") & (episodes["ending"] == "crashed")]
    pair = int(crashed["pair"].iloc[0])
    harness("export", "flow", "--pair", pair, "--out", "crash")
    top_view(Path("crash"), Path("exported.png"))
    save(Path("exported.png"), "exported")


PICTURES: dict[str, Callable[[], None]] = {
    "report": report,
    "sweep": sweep,
    "own_simulation": own_simulation,
    "exported": exported,
}
"""Every picture by its name."""


def main(names: list[str]) -> None:
    """Make the pictures with these names, or all of them, in a temporary folder."""
    for name in names or PICTURES:
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            PICTURES[name]()
            os.chdir(HERE)
        print(HERE / f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
