"""The pages of hours, own simulations, risks, validations and conflicts in a browser, from disk."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import harness.old.report.pages.hour_parts as hour_parts
import harness.old.report.pages.simulation_parts as simulation_parts
from harness.old.report.pages.page import write_report
from harness.old.report.pages.risk_page import write_risk_page
from harness.old.report.pages.validation_page import write_validation
from harness.old.studies.batch.showing import write_shown_risk
from harness.old.studies.risk.asking import Settings
from harness.old.studies.risk.folder import estimate_risk
from harness.scenario import Scenario, parse_variation, read_scenario_file, study_of
from harness.strategies.hard_yield import HardYield
from tests import towns
from tests.batches import Inline, one_cell, printed, run_inline
from tests.own_scenario import write_scenario
from tests.recordings import held, write_set

pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")

from tests.report import test_players as players
from tests.report.test_players import CONTRAST, WIDE, Opened

browser, _nothing_is_said = players.browser, players._nothing_is_said

pytestmark = pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium")


@pytest.fixture(scope="module")
def own(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    """A sweep over the share of AVs in a user's own simulation."""
    folder = tmp_path_factory.mktemp("own")
    varied = [parse_variation("simulation.av_share=0.3,1")]
    study = study_of(read_scenario_file(str(write_scenario(folder))), varied)
    run = run_inline(study, folder / "run", traces=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation_parts, "simulation_pictures", lambda _run: iter(()))
        return Opened(browser, write_report(run, folder / "own.html").page)


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


def of_hours(folder: Path) -> Path:
    traffic = {"traffic.flow_per_hour": 600, "traffic.duration_s": 60.0, "traffic.warm_up_s": 0.0}
    arms = {"arms.av": "hard_yield", "arms.human": "human_yield"}
    study = one_cell("cctc_flow", {"experiment.pairs": 1, **traffic, **arms})
    run = run_inline(study, folder / "hours", traces=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hour_parts, "hour_pictures", lambda *_: iter(()))
        return write_report(run, folder / "hours.html").page


def of_risk(folder: Path) -> Path:
    scenario = Scenario.model_validate({"arms": {"av": "constant_speed"}})
    asked = Settings("cctc", scenario, event="min_gap_m<1000", most_episodes=60)
    out = estimate_risk(asked, out=folder / "risk", make_executor=Inline)
    assert write_shown_risk(out) == ""
    return write_risk_page(out)


def of_validation(folder: Path) -> Path:
    recordings = write_set(folder / "set", HardYield)
    page, _ = write_validation(held(recordings, ("hard_yield", "gap_yield")), folder)
    return page


MAKERS = [of_hours, of_risk, of_validation]


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
    make: Callable[[Path], Path], browser: Any, tmp_path: Path
) -> None:
    one = Opened(browser, make(tmp_path))
    page = one.page
    assert one.asked == [one.address]
    for button in page.locator("button:visible").all():
        button.click()
    assert page.locator("svg rect.ego").count() > 0
    page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_has_contrast_and_nothing_overflows(
    own: Opened, conflicts: Opened, scheme: str
) -> None:
    for one in (own, conflicts):
        assert one.asked == [one.address]
        one.page.emulate_media(color_scheme=scheme)
        found = one.page.evaluate(CONTRAST)
        assert len(found) > 150
        assert [entry for entry in found if entry[0] < 4.5] == []
        for width in (400, 1_280):
            one.page.set_viewport_size({"width": width, "height": 900})
            wide = one.page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
            assert wide[0] <= wide[1]


def test_on_paper_nothing_is_cut_off(own: Opened, conflicts: Opened) -> None:
    right = """Math.max(...[...document.querySelectorAll("td, th, figure, p, .view")].map(
        (element) => element.getBoundingClientRect().right))"""
    for one in (own, conflicts):
        # A4 less two margins of 12 mm, at 96 pixels an inch.
        one.page.set_viewport_size({"width": 703, "height": 1030})
        one.page.emulate_media(media="print")
        assert one.page.evaluate(right) <= 703.5
        one.page.emulate_media(media="screen")
