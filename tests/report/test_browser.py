"""The page of a validation in a browser, from disk."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from harness.report.page import write_result
from harness.strategies.hard_yield import HardYield
from tests.recordings import held, write_set

pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")

from tests.report import test_players as players
from tests.report.test_players import Opened

browser, _nothing_is_said = players.browser, players._nothing_is_said

pytestmark = pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium")


def test_every_button_of_a_validation_works_without_a_word(browser: Any, tmp_path: Path) -> None:
    recordings = write_set(tmp_path / "set", HardYield)
    path = write_result(held(recordings, ("hard_yield", "gap_yield")), tmp_path / "page.html")
    one = Opened(browser, path)
    assert one.asked == [one.address]
    for button in one.page.locator("button:visible").all():
        button.click()
    assert one.page.locator("svg").count() == 2
