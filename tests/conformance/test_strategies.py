"""Every strategy of the table keeps every rule; strategies that break one are found out."""

import math
import sys
import types
from pathlib import Path
from threading import Event
from typing import ClassVar

import pytest

from harness.core.errors import InputError
from harness.strategies.parameters import defaults_of
from harness.strategies.registry import STRATEGIES, aggressiveness_of
from harness.studies.checks import STRATEGY_RULES, check_strategy

DOCS = Path(__file__).parents[2] / "docs" / "strategies.md"


# SUMO drives in [simulation] alone.
IN_ENCOUNTERS = [name for name in STRATEGIES if name != "sumo_driver"]


@pytest.mark.parametrize("strategy", IN_ENCOUNTERS)
def test_keeps_every_rule(strategy: str, model) -> None:
    problems = [each.problem for each in check_strategy(strategy, model)]
    assert problems == [None] * len(STRATEGY_RULES)


@pytest.mark.parametrize("strategy", IN_ENCOUNTERS)
def test_is_documented_with_its_aggressiveness(strategy) -> None:
    page = DOCS.read_text(encoding="utf-8")
    assert f"\n| `{strategy}` |" in page, f"docs/strategies.md lacks a row for {strategy}"
    defaults = defaults_of(STRATEGIES[strategy])
    for name in defaults:
        assert f"`{strategy}.{name}`" in page or f"`{name}`" in page, name
    numbers = {name for name, value in defaults.items() if isinstance(value, float)}
    signs = aggressiveness_of(strategy)
    assert signs.keys() <= numbers
    assert {*signs.values()} <= {-1.0, 1.0}


class Steady:
    """Keeps every rule."""

    def decide(self, _seen):
        return 0.0


class NeedsSomebody(Steady):
    def decide(self, seen):
        return 0.0 * seen.pedestrians[0].lateral_m


class DividesByTheirSpeed(Steady):
    def decide(self, seen):
        return 0.0 * max([1 / p.speed_mps for p in seen.pedestrians], default=0.0)


class NeedsTenths(Steady):
    def decide(self, seen):
        return {0.1: 0.0}[seen.step_s]


class Infinite(Steady):
    def decide(self, seen):
        return math.inf if seen.pedestrians else 0.0


class Nothing(Steady):
    def decide(self, _seen):
        return None


class Text(Steady):
    def decide(self, _seen):
        return "0.0"


class Stops(Steady):
    def decide(self, _seen):
        return -1.0


class Whims(Steady):
    count: ClassVar = [0]

    def decide(self, _seen):
        self.count[0] += 1
        return math.sin(self.count[0]) / 10


class Learns(Steady):
    met = 0

    def decide(self, seen):
        Learns.met = max(Learns.met, len(seen.pedestrians))
        return 0.01 * Learns.met


class Speeds(Steady):
    def decide(self, _seen):
        return 3.0


class Hangs(Steady):
    over = Event()

    def decide(self, _seen):
        self.over.wait(600.0)
        return 0.0


BROKEN = {
    NeedsSomebody: "plays every scene to its end",
    DividesByTheirSpeed: "plays every scene to its end",
    NeedsTenths: "plays every scene to its end",
    Infinite: "answers with a finite number",
    Nothing: "answers with a finite number",
    Text: "answers with a finite number",
    Stops: "crosses an empty road",
    Speeds: "keeps to the road's speed limit, or to v0 without a limit",
    Whims: "gives the same answers in the same scene, whatever it has played before",
    Learns: "gives the same answers in the same scene, whatever it has played before",
}


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> str:
    """The strategies above as a module of a user."""
    name = "made_up_strategies"
    module = types.ModuleType(name)
    for thing in (Steady, Hangs, OnlyWhenWide, *BROKEN):
        setattr(module, thing.__name__, thing)
    monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(Learns, "met", 0)
    monkeypatch.setattr(Whims, "count", [0])
    return name


def test_one_that_keeps_them_all(made_up: str, model) -> None:
    verdicts = check_strategy(f"{made_up}:Steady", model)
    assert [verdict.rule for verdict in verdicts] == [rule.name for rule in STRATEGY_RULES]
    assert [verdict.problem for verdict in verdicts] == [None] * len(STRATEGY_RULES)


@pytest.mark.parametrize("strategy", BROKEN, ids=lambda strategy: strategy.__name__)
def test_one_that_breaks_a_rule_is_found_out(strategy, made_up: str, model) -> None:
    verdicts = check_strategy(f"{made_up}:{strategy.__name__}", model)
    found = {verdict.rule: verdict.problem for verdict in verdicts if verdict.problem}
    assert BROKEN[strategy] in found
    assert all("\n" not in problem for problem in found.values())


def test_one_that_hangs_ends_with_a_line(made_up: str) -> None:
    try:
        verdicts = check_strategy(f"{made_up}:Hangs", limit_s=1.0)
    finally:
        Hangs.over.set()
    found = {v.rule: v.problem for v in verdicts if v.checked}
    late = "no answer to the first observation within 1 s"
    assert found == {BROKEN[NeedsSomebody]: late}


def test_the_observation_that_broke_a_rule_is_shown(made_up: str, model) -> None:
    verdicts = check_strategy(f"{made_up}:DividesByTheirSpeed", model)
    (broken,) = [verdict for verdict in verdicts if verdict.checked and verdict.problem]
    # It divides by the speed of somebody who stands.
    assert 0.0 in [person.speed_mps for person in broken.observation.pedestrians]


class OnlyWhenWide(Steady):
    """Fails where the parameter or the crosswalk is not the usual one."""

    def __init__(self, *, gap_s: float = 3.0) -> None:
        self.gap_s = gap_s

    def decide(self, observation):
        if self.gap_s > 5 or observation.crossing.length_m > 10:
            raise RuntimeError("too wide")
        return super().decide(observation)


def test_parameters_and_the_crosswalk_of_a_scenario(made_up: str, model) -> None:
    name = f"{made_up}:OnlyWhenWide"
    table = f'strategies."{name}".gap_s'
    for settings, problems in (({}, 0), ({table: 6.0}, 1), ({"crossing.length_m": 12.0}, 1)):
        verdicts = check_strategy(name, model, settings=settings)
        assert len([v for v in verdicts if v.checked and v.problem]) == problems, settings
    with pytest.raises(InputError, match=r"gap_s: 'wide' is not accepted"):
        check_strategy(name, model, settings={table: "wide"})
