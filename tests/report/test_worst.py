"""``harness worst`` on runs made by hand: which episodes, and in which order."""

import json
import shlex
from pathlib import Path
from types import SimpleNamespace

import pytest

from harness.core.encounter import Arm, Ending
from harness.core.errors import InputError
from harness.old.report.screens.worst_tables import worst_tables
from harness.old.store.kinds import HourKind
from harness.old.studies.runs.worst import _episodes, got_worse, worst
from tests.batches import one_cell, printed, refusal, sweep
from tests.made_up import Fate, made_up


def crossed(**measures: float) -> Fate:
    return {"pass_time_s": 9.0, **measures}


def crash(speed_mps: float) -> Fate:
    return {"ending": "crashed", "contact_speed_mps": speed_mps}


BEFORE: list[Fate] = [
    crossed(pet_s=3.0, delay_s=1.0, min_gap_m=2.0),
    crossed(pet_s=0.5, delay_s=2.0, max_deceleration_mps2=1.0),
    crossed(delay_s=9.0, max_deceleration_mps2=4.0),  # nobody came near
    crash(2.0),
    crash(6.0),
    crossed(pet_s=8.0, delay_s=4.0, min_gap_m=1.0),
    {"ending": "timed_out", "max_deceleration_mps2": 3.0},
]
AFTER: list[Fate] = [
    crossed(pet_s=1.0, delay_s=1.5),
    crossed(pet_s=0.6, delay_s=1.0),
    crossed(pet_s=4.5, delay_s=9.0),
    crossed(pet_s=0.2, delay_s=1.0),
    crash(6.5),
    crossed(pet_s=6.0, delay_s=4.0),
    crash(1.0),
]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("runs")
    study = one_cell("cctc", {"experiment.pairs": len(BEFORE)})
    one, other = (
        made_up(folder / name, study, lambda _, pair, fates=fates: fates[pair])  # type: ignore[misc]
        for name, fates in (("before", BEFORE), ("after", AFTER))
    )
    return one, other


@pytest.mark.parametrize(
    ("by", "pairs"),
    [
        # Crashes first, the fastest before the other; beyond 5 s and none are no conflicts.
        ("pet_s", [4, 3, 1, 0]),
        ("contact_speed_mps", [4, 3]),
        # A time-out is the longest delay there is.
        ("delay_s", [6, 2, 5, 1, 0]),
        ("min_ttc_s", [4, 3]),
        # Crashes first, then the smallest value; the hardest braking, whatever the ending.
        ("min_gap_m", [4, 3, 5, 0]),
        ("max_deceleration_mps2", [2, 6, 1]),
    ],
)
def test_the_worst_by_each_measure(runs: tuple[Path, Path], by: str, pairs: list[int]) -> None:
    assert [episode.pair for episode in worst(runs[0], by)] == pairs
    assert [episode.pair for episode in worst(runs[0], by, most=2)] == pairs[:2]


def test_what_got_worse(runs: tuple[Path, Path]) -> None:
    found = got_worse(runs[1], runs[0])
    # A new crash; 3 → 1; 6 → 6.5 m/s at the contact and none → 4.5 s alike, by cell and pair.
    assert [episode.pair for episode in found] == [6, 0, 2, 4]
    assert (found[0].ending_before, found[0].ending) == (Ending.TIMED_OUT, Ending.CRASHED)
    assert (found[1].before, found[1].value) == (3.0, 1.0)
    assert [episode.pair for episode in got_worse(runs[1], runs[0], "delay_s")] == [0]
    # A crash has no delay: whoever crashed in one of them is not ranked by it.
    assert [episode.pair for episode in got_worse(runs[0], runs[1], "delay_s")] == [1]
    # The reference is the same in both.
    assert worst(runs[0], "delay_s", arm="human") == worst(runs[0], "delay_s", arm=Arm.HUMAN)
    assert got_worse(runs[1], runs[0], "delay_s", arm=Arm.HUMAN) == []


def test_one_cell_named_by_its_keys(tmp_path: Path) -> None:
    study = sweep("cctc_flow", {"experiment.pairs": 2}, "arms.av=gap_yield,hard_yield")
    fates: list[list[Fate]] = [[crash(2.0), crash(3.0)], ["engine_failed", "engine_failed"]]
    run = made_up(tmp_path / "run", study, lambda task, pair: fates[task.cell][pair])
    (first, _) = worst(run)
    assert dict(first.varied) == {"arms.av": "gap_yield"}
    assert first.command.endswith("--pair 1 --arm av --gui")
    assert "arms.av" in printed("worst", run)
    assert "gap_yield" in printed("worst", run, "--cell", 0)
    assert json.loads(printed("worst", run, "--json"))["episodes"][0]["varied"] == first.varied
    # Nothing is known of a strategy that always failed: that is not "no episode to look at".
    assert "cell 1: all 2 episodes of av failed, e.g. " in refusal("worst", run, "--cell", 1)


def test_who_drove_and_how_a_contact_was(runs: tuple[Path, Path]) -> None:
    first, second, third, _ = worst(runs[0])
    assert [(each.contact, each.contact_speed_mps) for each in (first, second, third)] == [
        ("front", 6.0),
        ("front", 2.0),
        (None, None),
    ]
    document = json.loads(printed("worst", runs[0], "-n", 1, "--json"))["episodes"][0]
    assert (document["driver"], document["contact"]) == ("soft_yield", "front")
    table = worst_tables([first, third], "pet_s")
    assert table.headings == ("cell", "pair", "driver", "contact", "contact_speed_mps", "pet_s")
    assert [[cell.text for cell in row[2:]] for row in table.rows] == [
        ["soft_yield", "front", "6.00", "none"],
        ["soft_yield", "–", "–", "0.500"],
    ]
    by_speed = worst_tables([first], "contact_speed_mps")
    assert by_speed.headings[2:] == ("driver", "contact", "contact_speed_mps")
    assert len(by_speed.rows[0]) == len(by_speed.headings)


def test_of_hours_it_says_where_to_look() -> None:
    hours = SimpleNamespace(path=Path("hours"), kind=HourKind())
    with pytest.raises(InputError) as refused:
        _episodes(hours, "pet_s", Arm.AV)  # type: ignore[arg-type]
    assert str(refused.value) == (
        "hours: is a run of hours of traffic, which has no episodes to list; "
        "allowed: passages.parquet of the run, or `harness replay RUN --pair 0 --arm av --gui`"
    )


def test_in_the_shell(runs: tuple[Path, Path]) -> None:
    document = json.loads(printed("worst", runs[0], "--diff", runs[1], "-n", 2, "--json"))
    assert [episode["pair"] for episode in document["episodes"]] == [6, 0]
    assert document["episodes"][1]["pet_s"] == 1.0
    words = shlex.split(printed("worst", runs[0], "-n", 1, "--quiet"))
    assert words[1:] == ["replay", str(runs[0]), "--pair", "4", "--arm", "av", "--gui"]
    assert "worst by pet_s" in printed("worst", runs[0])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--by", "pet"], "did you mean 'pet_s'?"),
        (["--by", "arrivals"], "--by: neither small nor large values of arrivals are bad"),
        (["--cell", "1"], "--cell: 1; allowed: 0 to 0"),
        (["-n", "0"], "-n: 0; allowed: 1 or more"),
        (["--arm", "car"], "'--arm': 'car' is not one of 'av', 'human'"),
        (["--diff", "nowhere"], "nowhere: is not a run folder"),
    ],
)
def test_refused(runs: tuple[Path, Path], options: list[str], said: str) -> None:
    assert said in refusal("worst", runs[0], *options)


def test_runs_without_counterparts(runs: tuple[Path, Path], tmp_path: Path) -> None:
    other = one_cell("cctc", {"experiment.pairs": 3, "experiment.seed": 5})
    with pytest.raises(InputError, match=r"experiment\.seed 5 instead of 1"):
        got_worse(made_up(tmp_path / "other", other, lambda *_: 9.0), runs[0])
