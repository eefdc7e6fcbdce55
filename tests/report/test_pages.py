"""The page of a run and its figures: its text, without a browser."""

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from harness.core.vocabulary import Observation
from harness.report.page import write_page, write_report
from harness.results.loaded_run import Run, load_run
from harness.studies.comparison import compare
from harness.studies.page_content import page_content
from harness.studies.running.run import run
from harness.studies.worst import worst
from tests.report.test_screens import PAPER, result as made_result
from tests.scenes import refuses

HOSTILE = '</script><script>document.title = "owned"</script><img src=x onerror=alert(1)> & $\\x$'
QUICK = {"engine": "plain", "workers": 0}


class Page(HTMLParser):
    """The elements and the visible text of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.summaries: list[str] = []
        self._inside = ""
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)
        self.text = re.sub(r"\s+", " ", " ".join(self.words).replace("\u200b", ""))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attributes)))
        self._inside = tag

    def handle_data(self, data: str) -> None:
        if self._inside not in ("script", "style"):
            self.words.append(data)
        if self._inside == "summary" and data.strip():
            self.summaries.append(data)

    def figures(self) -> list[str]:
        found = (str(of.get("id")) for tag, of in self.tags if tag == "figure")
        return [name.removeprefix("figure-") for name in found]


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("single")
    return run("cctc", pairs=12, traces=True, out=out, **QUICK)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Run:
    vary = {"strategies.soft_yield.time_margin_s": [0.0, 1.0, 2.0]}
    return run("cctc_flow", pairs=8, vary=vary, out=tmp_path_factory.mktemp("swept"), **QUICK)  # type: ignore[arg-type]


PROFILES = ["speed-place", "speed-time", "place-time"]
OVER = ["time-ratio", "kappa", "delay", "pet"]


def test_every_number_is_on_the_page_and_every_figure_in_the_folder(
    single: Run, tmp_path: Path
) -> None:
    result, figures = single.result(), tmp_path / "figures"
    made = write_report(single.path, tmp_path / "page.html", figures)
    page = Page(made.page)
    assert page.figures() == ["tau-mean", "tau-distribution", *PROFILES]
    suffixes = {f"{name}.{suffix}" for name in page.figures() for suffix in ("png", "pdf")}
    assert {path.name for path in made.figures} == suffixes == {p.name for p in figures.iterdir()}
    for table in (result.screen, *result.full):
        for row in table.rows:
            assert str(row[0]) in page.text
    for words in (result.title, result.scope, result.about, *(n.text for n in result.notes)):
        assert words in page.text
    assert "crossing.length_m" in page.text
    assert re.search(r">μ = 0\.\d+\*<", page.source)  # 12 pairs are few
    assert not [of for _, of in page.tags if {"src", "srcset"} & of.keys()]
    assert not re.findall(r"""(?:href|url\()=?["']?(?!#|data:)[a-z]+:""", page.source)


def test_a_sweep_has_its_numbers_over_its_key_and_under_limits_the_papers_figure(
    swept: Run, tmp_path: Path
) -> None:
    page = Page(write_report(swept.path, tmp_path / "page.html").page)
    assert page.figures() == OVER + PROFILES
    assert page.source.count(">*<") > 3  # 8 pairs are few
    compared = compare(swept, mu0=1.2, kappa0=0.5)
    judged = Page(write_report(swept.path, tmp_path / "judged.html", mu0=1.2, kappa0=0.5).page)
    assert judged.figures() == ["aggressiveness", *OVER, *PROFILES]
    assert [table.title for table in compared.full] == [
        title for title in judged.summaries if title.startswith(("Difference", "strategies."))
    ]
    keys = [note.key for note in (*swept.result().notes, *compared.notes)]
    notes = judged.source.partition('class="notes"')[2].partition("</ul>")[0]
    assert notes.count("<li>") == len({*keys})


class Failing:
    """Fails at once."""

    def decide(self, _observation: Observation, /) -> float:
        raise RuntimeError(HOSTILE)


def test_a_run_in_which_every_episode_of_the_av_failed(tmp_path: Path) -> None:
    """Of more than 50 pairs a page shows those that are bad or typical, and here is none."""
    failed, other = (
        run("cctc", pairs=51, settings={"arms.av": av}, out=tmp_path / f"{number}", **QUICK)  # type: ignore[arg-type]
        for number, av in enumerate((Failing, "hard_yield"))
    )
    line = "Every episode of the AV failed: nothing was tested."
    assert line in [note.text for note in load_run(failed.path).result().notes[:2]]
    assert line in Page(write_report(failed.path).page).text
    refuses("all 51 episodes of av failed", lambda: worst(failed))
    (row,) = compare(failed, other).records
    assert (row["kappa_difference"].value, row["kappa_all_difference"].value) == (None, 1.0)


def test_what_a_run_is_called_and_fails_with_stays_text(tmp_path: Path) -> None:
    """Only our two scripts run, whose hashes the page names; failures and all notes are listed."""
    failed = run("cctc_flow", pairs=2, settings={"arms.av": Failing}, out=tmp_path / "run", **QUICK)  # type: ignore[arg-type]
    hostile = made_result(PAPER, HOSTILE, HOSTILE, full=(PAPER,), title=HOSTILE)
    content = page_content(failed.path)._replace(result=hostile)
    page = Page(write_page(content, tmp_path / "page.html").page)
    scripts = [of for tag, of in page.tags if tag == "script"]
    assert [of.get("type") for of in scripts] == ["application/json", None, None]
    assert {"img", "b"}.isdisjoint(tag for tag, _ in page.tags)
    assert page.text.count('document.title = "owned"') >= 7  # both notes too
    assert f"cell 0, pair 1, av: the strategy raised RuntimeError: {HOSTILE[:40]}" in page.text
