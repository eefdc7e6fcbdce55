"""Every link in the README and the docs leads somewhere: to a file, and to a heading in it."""

import re
from pathlib import Path

import pytest

from docs.hooks.reference import PAGES as GENERATED
from docs.hooks.site import IN_THE_SITE

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
PAGES = sorted((ROOT / "docs").glob("*.md"))
MADE = {ROOT / "docs" / name: make for name, make in GENERATED.items()}
"""Pages that `make docs` makes of the code."""
LINK = re.compile(r"\]\(([^)\s]+)\)")


def text_of(page: Path) -> str:
    """A page without its code blocks, where # is no heading."""
    text = MADE[page]() if page in MADE else page.read_text(encoding="utf-8")
    return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)


def links(page: Path) -> list[str]:
    """Targets of a page's links within the project."""
    return [link for link in LINK.findall(text_of(page)) if "://" not in link]


def anchors(page: Path) -> set[str]:
    """What a link to a heading of a page may say, as GitHub and GitLab form it."""
    headings = re.findall(r"^#+ (.+)$", text_of(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken(page: Path) -> list[str]:
    """The links of a page that lead nowhere."""
    found = []
    for link in links(page):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        missing = not target.exists() and target not in MADE
        if missing or (anchor and anchor not in anchors(target)):
            found.append(link)
    return found


@pytest.mark.parametrize(
    "page", [README, ROOT / "CONTRIBUTING.md", *PAGES], ids=lambda page: page.stem
)
def test_every_link_leads_somewhere(page: Path) -> None:
    assert broken(page) == []


@pytest.mark.parametrize("page", [README, *PAGES], ids=lambda page: page.stem)
def test_pages_lead_to_files_that_are_there_without_the_site(page: Path) -> None:
    """As GitHub shows them: what `make docs` makes is no file of the project."""
    assert [link for link in links(page) if "reference/" in link] == []


def test_the_site_and_the_readme_lead_to_every_page() -> None:
    for file, made in IN_THE_SITE.items():
        assert (ROOT / "docs" / file[2:-1]).resolve().is_file()
        assert made[2:-1] in GENERATED
    named = {(ROOT / link.partition("#")[0]).resolve() for link in links(README)}
    assert {*PAGES} <= named
