"""The page and its player in a real browser, from disk: Debian's Chromium without a window.

Skipped where there is none; `.ci/run` installs it.
"""

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest

from harness.report.page import write_report
from harness.results.loaded_run import Run
from harness.studies.running.run import run
from tests.report.test_pages import HOSTILE, Failing

sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")

FLAGS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
WIDE = {"width": 1280, "height": 900}


class Opened:
    """A page in the browser, with what it said and asked for since it was opened."""

    said: ClassVar[list[str]] = []
    """By all pages: a test in which one of them says anything fails, see ``_nothing_is_said``."""

    def __init__(self, browser: Any, path: Path) -> None:
        self.asked: list[str] = []
        self.page = browser.new_page(viewport=WIDE)
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.address = path.as_uri()
        self.page.goto(self.address)


@pytest.fixture(autouse=True)
def _nothing_is_said() -> Iterator[None]:
    yield
    said = Opened.said.copy()
    Opened.said.clear()
    assert said == []


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


QUICK: dict[str, Any] = {"engine": "plain", "workers": 0}


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The paper's experiment with traces."""
    return run("cctc", pairs=12, traces=True, out=tmp_path_factory.mktemp("single"), **QUICK)


@pytest.fixture(scope="module")
def opened(browser: Any, single: Run) -> Opened:
    return Opened(browser, write_report(single.path).page)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Two flows and two strategies, one of which fails in every episode; no traces."""
    vary: Any = {"pedestrians.flow_per_hour": [300, 900], "arms.av": [Failing, "constant_speed"]}
    out = tmp_path_factory.mktemp("swept")
    return run("cctc_flow", pairs=4, vary=vary, out=out, **QUICK)


@pytest.fixture(scope="module")
def opened_sweep(browser: Any, swept: Run) -> Opened:
    return Opened(browser, write_report(swept.path).page)


@pytest.fixture
def all_opened(opened: Opened, opened_sweep: Opened) -> tuple[Opened, ...]:
    return opened, opened_sweep


@pytest.fixture
def page(opened: Opened) -> Any:
    """The single run's page as it is after opening."""
    opened.page.set_viewport_size(WIDE)
    opened.page.emulate_media(color_scheme="light", media="screen", reduced_motion="no-preference")
    opened.page.locator("[data-episode='0']").first.click()
    return opened.page


def shown_time(page: Any) -> float:
    return float(page.locator("#player").get_attribute("data-time"))


def shown_pair(page: Any) -> int:
    """Which pair the player shows."""
    title: str = page.locator("#player-title").inner_text()
    return int(title.removeprefix("pair ").split(":")[0])


def wait_until(page: Any, condition: Callable[[], bool]) -> None:
    """The page's own policy lets nobody evaluate text, so the waiting is done here."""
    end = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end
        page.wait_for_timeout(15)


def scrub(page: Any, time_s: float) -> None:
    """As a finger on the slider."""
    page.evaluate(
        """time => { const slider = document.getElementById("player-time");
        slider.value = time; slider.dispatchEvent(new Event("input")); }""",
        time_s,
    )


def test_opens_from_disk_without_a_request(all_opened: tuple[Opened, ...]) -> None:
    for one in all_opened:
        assert one.address.startswith("file://")
        assert one.asked == [one.address]
        assert one.page.locator("#player").is_visible()


def test_what_a_strategy_raises_is_text_and_every_button_works(opened_sweep: Opened) -> None:
    page = opened_sweep.page
    for button in page.locator("button:visible").all():
        button.click()
    assert page.title() != "owned"
    assert page.evaluate("document.images.length + document.querySelectorAll('b').length") == 0
    assert HOSTILE[:30] in page.locator("#results").inner_text()
    assert opened_sweep.asked == [opened_sweep.address]


def test_plays_pauses_and_stops_at_the_end(page: Any) -> None:
    assert shown_time(page) == 0
    page.locator("#player-speed").select_option("1")
    page.locator("#player-play").click()
    wait_until(page, lambda: shown_time(page) > 0.15)
    assert page.locator("#player-play").inner_text() == "Pause"
    page.locator("#player-play").click()
    stopped = shown_time(page)
    page.wait_for_timeout(120)
    assert shown_time(page) == stopped
    scrub(page, 1e6)
    end = shown_time(page)
    scrub(page, end - 0.3)
    page.locator("#player-speed").select_option("10")
    page.locator("#player-play").click()
    wait_until(page, lambda: page.locator("#player").get_attribute("data-playing") == "false")
    assert shown_time(page) == end


def drawn(page: Any, arm: str) -> dict[str, float]:
    """Where the ego's front and the pedestrian are on the screen, in metres of the road."""
    found: dict[str, float] = page.evaluate(
        """arm => {
            const svg = document.querySelector(`.view[data-arm="${arm}"] svg`);
            const box = svg.getBoundingClientRect(), view = svg.viewBox.baseVal;
            const scale = box.width / view.width;
            const across = (px) => (px - box.left) / scale + view.x;
            const up = (px) => -((px - box.top) / scale + view.y);
            const ego = svg.querySelector(".ego").getBoundingClientRect();
            const walker = svg.querySelector("[data-pedestrian] .walker").getBoundingClientRect();
            return { x: across(ego.right), lane: up((ego.top + ego.bottom) / 2),
                     length: ego.width / scale, across: across((walker.left + walker.right) / 2),
                     y: walker.width ? up((walker.top + walker.bottom) / 2) : null };
        }""",
        arm,
    )
    return found


def test_positions_on_the_screen_are_the_trace(page: Any, single: Run) -> None:
    for entry in (0, 3):
        page.locator(f"[data-episode='{entry}']").first.click()
        rows = single.rows("traces", 0).to_pandas().query(f"pair == {shown_pair(page)}")
        for arm in ("av", "human"):
            own = rows[rows["arm"] == arm]
            ego = own[own["object"] == "ego"].set_index("time_s")
            walker = own[own["object"] == "pedestrian-0"].set_index("time_s")
            for step in (0, 17, 41, len(walker) - 2):
                at = float(ego.index[step])
                scrub(page, at)
                places = {"x": ego.loc[at, "x_m"], "y": walker.loc[at, "y_m"], "across": 0.0}
                # A pixel is about a tenth of a metre here.
                expected = {"lane": 2.25, "length": 5.0, **places}
                assert drawn(page, arm) == pytest.approx(expected, abs=0.06)
                speed = float(page.locator(f".view[data-arm='{arm}']").get_attribute("data-v"))
                assert speed == pytest.approx(ego.loc[at, "speed_mps"], abs=6e-4)
