"""The page in a real browser, from disk: Debian's Chromium without a window.

Skipped where there is none; `.ci/run` installs it.
"""

import shutil
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import harness.old.report.pages.encounter_parts as parts_module
import pytest

import harness.old.report.pages.simulation_parts as simulation_parts
from harness.old.report.pages.risk_page import write_risk_page
from harness.old.report.pages.validation_page import write_validation
from harness.old.studies.risk.asking import Settings
from harness.old.studies.risk.folder import estimate_risk
from harness.old.studies.runs.opening import load_run
from harness.old.studies.runs.run_data import RunData
from harness.scenario import Scenario, parse_variation, read_scenario_file, study_of
from harness.strategies.hard_yield import HardYield
from tests import towns
from tests.batches import Inline, one_cell, printed, run_inline
from tests.own_scenario import write_scenario
from tests.recordings import held, write_set
from tests.report.conftest import HOSTILE, report

sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")

FLAGS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
NARROW, WIDE = {"width": 400, "height": 800}, {"width": 1280, "height": 900}


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


def written(run: Path, folder: Path, pictures: int) -> Path:
    """The page of a run with so many of its figures: theirs is most of the time."""
    draw = parts_module.pictures_of
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts_module, "pictures_of", lambda *given: islice(draw(*given), pictures))
        return report(run, folder / f"{pictures}.html").page


@pytest.fixture(scope="module")
def opened(browser: Any, single: Path, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    """The paper's experiment, every figure."""
    return Opened(browser, written(single, tmp_path_factory.mktemp("single"), 99))


@pytest.fixture(scope="module")
def opened_sweep(browser: Any, swept: Path, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    return Opened(browser, written(swept, tmp_path_factory.mktemp("swept"), 1))


@pytest.fixture(scope="module")
def own(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    """A sweep over the share of AVs in a user's own simulation."""
    folder = tmp_path_factory.mktemp("own")
    varied = [parse_variation("simulation.av_share=0.3,1")]
    study = study_of(read_scenario_file(str(write_scenario(folder))), varied)
    run = run_inline(study, folder / "run", traces=True).path
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation_parts, "simulation_pictures", lambda _run: iter(()))
        return Opened(browser, report(run, folder / "own.html").page)


@pytest.fixture(scope="module")
def conflicts(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    """The conflicts of SUMO's own output."""
    folder = tmp_path_factory.mktemp("conflicts")
    write_scenario(folder)
    towns.call(folder, "sumo", "-c", "town.sumocfg", "--fcd-output", "fcd.csv")
    printed(
        *("conflicts", folder / "fcd.csv", "--net", folder / "net.net.xml"),
        *("--types", folder / "cars.rou.xml", "--out", folder / "out"),
    )
    return Opened(browser, folder / "out" / "report.html")


@pytest.fixture
def all_opened(
    opened: Opened, opened_sweep: Opened, own: Opened, conflicts: Opened
) -> tuple[Opened, ...]:
    return opened, opened_sweep, own, conflicts


@pytest.fixture
def page(opened: Opened) -> Any:
    """The single run's page as it is after opening."""
    opened.page.set_viewport_size(WIDE)
    opened.page.emulate_media(color_scheme="light", media="screen", reduced_motion="no-preference")
    opened.page.locator("[data-episode='0']").first.click()
    return opened.page


@pytest.fixture(scope="module")
def run(single: Path) -> RunData:
    return load_run(single)


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


def test_a_hostile_run_stays_text(
    browser: Any, hostile: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    one = Opened(browser, written(hostile, tmp_path_factory.mktemp("hostile"), 0))
    one.page.locator("#player-next").click()
    assert one.asked == [one.address]
    assert one.page.title() != "owned"
    assert one.page.locator("h1").inner_text() == f"{HOSTILE}: {HOSTILE} against human_gmm"
    assert one.page.evaluate("document.images.length + document.querySelectorAll('b').length") == 0
    assert f"</script>{HOSTILE}" in one.page.locator(".view h4").first.inner_text()
    one.page.close()


def of_encounters(request: Any, folder: Path) -> Path:
    return written(request.getfixturevalue("single"), folder, 1)


def of_hours(_request: Any, folder: Path) -> Path:
    traffic = {"traffic.flow_per_hour": 600, "traffic.duration_s": 60.0, "traffic.warm_up_s": 0.0}
    arms = {"arms.av": "hard_yield", "arms.human": "human_yield"}
    study = one_cell("cctc_flow", {"experiment.pairs": 1, **traffic, **arms})
    return written(run_inline(study, folder / "hours", traces=True).path, folder, 1)


def of_risk(_request: Any, folder: Path) -> Path:
    scenario = Scenario.model_validate({"arms": {"av": "constant_speed"}})
    asked = Settings("cctc", scenario, event="min_gap_m<1000", most_episodes=60)
    out = estimate_risk(asked, out=folder / "risk", make_executor=Inline)
    return write_risk_page(out)


def of_validation(_request: Any, folder: Path) -> Path:
    recordings = write_set(folder / "set", HardYield)
    page, _ = write_validation(held(recordings, ("hard_yield", "gap_yield")), folder)
    return page


MAKERS = [of_encounters, of_hours, of_risk, of_validation]


def test_every_button_of_own_simulations_and_conflicts_works(
    own: Opened, conflicts: Opened
) -> None:
    for one in (own, conflicts):
        for button in one.page.locator("button:visible").all():
            button.click()
        assert one.page.locator("svg rect.ego").count() > 0


def test_headings_of_a_wide_table_wrap_and_its_first_column_stays(own: Opened) -> None:
    page = own.page
    page.set_viewport_size(WIDE)
    widest = page.evaluate("Math.max(...[...cells.tHead.rows[0].cells].map(c => c.offsetWidth))")
    assert widest < 200
    first = "document.querySelector('#cells tbody tr > *').getBoundingClientRect().left"
    before = page.evaluate(first)
    page.evaluate("document.getElementById('cells').parentElement.scrollLeft = 500")
    assert page.evaluate("document.getElementById('cells').parentElement.scrollLeft") > 100
    assert page.evaluate(first) == pytest.approx(before, abs=1)


@pytest.mark.parametrize("make", MAKERS)
def test_every_button_of_every_page_works_without_a_word(
    make: Callable[[Any, Path], Path], browser: Any, request: Any, tmp_path: Path
) -> None:
    page = Opened(browser, make(request, tmp_path)).page
    for button in page.locator("button:visible").all():
        button.click()
    assert (page.locator("svg rect.ego").count() > 0) == (make is not of_risk)
    page.close()


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


def test_positions_on_the_screen_are_the_trace(page: Any, run: RunData) -> None:
    for entry in (0, 3):
        page.locator(f"[data-episode='{entry}']").first.click()
        rows = run.traces[run.traces["pair"] == shown_pair(page)]
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


def test_keys_step_jump_and_change_the_episode(page: Any) -> None:
    page.locator("#player-play").focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert shown_time(page) == pytest.approx(0.2)
    page.keyboard.press("Shift+ArrowRight")
    assert shown_time(page) == pytest.approx(1.2)
    page.keyboard.press("ArrowLeft")
    assert shown_time(page) == pytest.approx(1.1)
    page.keyboard.press("End")
    assert shown_time(page) == float(page.locator("#player-time").get_attribute("max"))
    page.keyboard.press("Home")
    assert shown_time(page) == 0
    before = shown_pair(page)
    page.keyboard.press("n")
    assert page.locator("#player").get_attribute("data-shown") == "1"
    assert shown_pair(page) != before
    page.keyboard.press("p")
    assert shown_pair(page) == before
    page.keyboard.press(" ")
    wait_until(page, lambda: shown_time(page) > 0)
    page.keyboard.press(" ")
    assert page.locator("#player").get_attribute("data-playing") == "false"
    page.keyboard.press("-")
    assert page.locator("#player-speed").input_value() != "1"


def test_the_list_switches_episodes_and_the_focus_is_seen(page: Any) -> None:
    """Motion is reduced on request."""
    entry = page.locator(".list [data-episode]").nth(4)
    entry.click()
    assert entry.get_attribute("aria-current") == "true"
    assert shown_pair(page) == int(entry.inner_text().split()[1])
    assert shown_time(page) == 0
    assert page.locator(".view").count() == 2
    page.locator("#theme").focus()
    page.keyboard.press("Tab")
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"
    scrolling = "getComputedStyle(document.documentElement).scrollBehavior"
    for motion, behaviour in (("reduce", "auto"), ("no-preference", "smooth")):
        page.emulate_media(reduced_motion=motion)
        assert page.evaluate(scrolling) == behaviour
    assert page.locator("#player").get_attribute("data-playing") == "false"


def test_the_curves_are_the_trace_and_a_click_moves_the_cursor(page: Any, run: RunData) -> None:
    rows = run.traces[run.traces["pair"] == shown_pair(page)]
    ego = rows[(rows["object"] == "ego") & (rows["arm"] == "human")]
    assert page.locator("#player-charts svg").count() == 3
    path = page.locator("#player-charts svg").first.locator("path.human").get_attribute("d")
    assert path.count("L") == len(ego) - 1
    # ``click`` waits until the chart no longer moves; its box may change while the page loads.
    chart = page.locator("#player-charts svg").nth(1)
    box = chart.bounding_box()
    chart.click(position={"x": box["width"] / 2, "y": box["height"] / 2})
    half = float(page.locator("#player-time").get_attribute("max")) / 2
    assert shown_time(page) == pytest.approx(half, rel=0.05)
    cursor = page.locator("#player-charts .cursor").first.get_attribute("x1")
    assert float(cursor) == pytest.approx(box["width"] / 2, abs=2)


def column(page: Any, heading: str) -> list[float]:
    found: list[str] = page.evaluate(
        """heading => { const table = document.getElementById("cells");
        const heads = [...table.tHead.rows[0].cells].map((head) => head.textContent);
        const place = heads.indexOf(heading);
        return [...table.tBodies[0].rows].map((row) => row.cells[place].dataset.value); }""",
        heading,
    )
    return [float(value) for value in found]


def test_the_table_sorts_by_mouse_and_by_key(opened_sweep: Opened, swept: Path) -> None:
    page = opened_sweep.page
    expected = sorted(load_run(swept).summary["mu"])
    head = page.locator("#cells th", has_text="μ, mean ratio of times")
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert column(page, "μ, mean ratio of times") == pytest.approx(expected)
    head.locator("button").press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    assert column(page, "μ, mean ratio of times") == pytest.approx(expected[::-1])
    other = page.locator("#cells").get_by_role("button", name="av", exact=False).first
    other.click()
    assert head.get_attribute("aria-sort") is None
    names = page.locator("#cells tbody tr td:nth-child(3)").all_inner_texts()
    assert names == sorted(names)


CONTRAST = """() => {
  const parse = (text) => {
    const numbers = text.match(/[\\d.]+/g).map(Number);
    return { rgb: numbers.slice(0, 3), alpha: numbers.length > 3 ? numbers[3] : 1 };
  };
  const channel = (value) => { value /= 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4; };
  const light = ([r, g, b]) => 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
  const ground = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const colour = parse(getComputedStyle(e).backgroundColor);
      if (colour.alpha === 1) return colour.rgb;
    }
    return [255, 255, 255];
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    const words = walker.currentNode.textContent.trim();
    if (!words || element.closest("script, style, noscript, title, desc")) continue;
    if (!element.getClientRects().length) continue;
    const style = getComputedStyle(element);
    const inside = element instanceof SVGElement;
    const [a, b] = [light(parse(inside ? style.fill : style.color).rgb), light(ground(element))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    found.push([ratio, words.slice(0, 40)]);
  }
  return found;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_has_contrast_and_lines_of_figures_stand_out(
    all_opened: tuple[Opened, ...], opened: Opened, scheme: str
) -> None:
    """3 : 1 against the ground for every colour a figure's lines may have."""
    for one in all_opened:
        one.page.emulate_media(color_scheme=scheme)
        found = one.page.evaluate(CONTRAST)
        assert len(found) > 150
        assert [entry for entry in found if entry[0] < 4.5] == []
    names = ["--blue", "--vermillion", "--green", "--purple", "--orange", "--ink", "--muted"]
    value = "getComputedStyle(document.documentElement).getPropertyValue(name)"
    colours = opened.page.evaluate(f"names => names.map((name) => {value})", ["--card", *names])
    card, *lines = (luminance(colour.strip()) for colour in colours)
    for name, line in zip(names, lines, strict=True):
        bright, dark = max(card, line), min(card, line)
        assert (bright + 0.05) / (dark + 0.05) >= 3, name


def luminance(colour: str) -> float:
    """Relative luminance of #rrggbb (WCAG 2)."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("size", [NARROW, WIDE], ids=["narrow", "wide"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_overflows(
    all_opened: tuple[Opened, ...], size: dict[str, int], scheme: str
) -> None:
    for one in all_opened:
        one.page.set_viewport_size(size)
        one.page.emulate_media(color_scheme=scheme)
        wide = one.page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert wide[0] <= wide[1]


def test_the_toggle_overrides_the_system(page: Any) -> None:
    ground = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(ground)
    toggle = page.locator("#theme")
    toggle.click()
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(ground) == light
    toggle.click()
    page.emulate_media(color_scheme="light")
    assert page.evaluate(ground) != light
    assert toggle.inner_text() == "Colours: dark"
    toggle.click()
    assert page.evaluate(ground) == light


def test_on_paper_it_is_dark_on_white_and_nothing_is_cut_off(
    all_opened: tuple[Opened, ...], page: Any
) -> None:
    page.emulate_media(color_scheme="dark", media="print")
    words = page.evaluate("getComputedStyle(document.querySelector('h1')).color")
    assert words == "rgb(27, 31, 36)"
    assert not page.locator(".controls").is_visible()
    right = """Math.max(...[...document.querySelectorAll("td, th, figure, p, .view")].map(
        (element) => element.getBoundingClientRect().right))"""
    for one in all_opened:
        # A4 less two margins of 12 mm, at 96 pixels an inch.
        one.page.set_viewport_size({"width": 703, "height": 1030})
        one.page.emulate_media(media="print")
        assert one.page.evaluate(right) <= 703.5
        one.page.emulate_media(media="screen")
