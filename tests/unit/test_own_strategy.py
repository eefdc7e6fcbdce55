"""A user's own strategy: found by its name, checked like the built-in ones, faults reported."""

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from harness.core.errors import InputError
from harness.core.vocabulary import Arm, Ending
from harness.encounter.arms import check_arms
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario, load_scenario, read_scenario_file, study_of, validate
from tests.scenes import on_plain, refusal_of

MODULE = '''
class Steady:
    """Drives on."""

    def __init__(self, *, gap_s: float = 3.0, side: str | list[float] | None = None):
        if gap_s < 0:
            from harness.core.errors import InputError
            raise InputError("gap_s", f"{gap_s!r} s", "0 or more")
        if gap_s == 99:
            raise LookupError("no such gap")

    def decide(self, observation):
        return 0.0


class Demanding:
    def __init__(self, model, step_s: float, *, needed: float):
        self.fails = needed

    def decide(self, observation):
        return self.after(observation.time_s)

    def after(self, time_s):
        if time_s > self.fails:
            raise KeyError("two\\nlines")
        return 0.0


class Fickle:
    def __init__(self, rng):
        if rng.random() < 0.5:
            raise OSError("not today")

    def decide(self, observation):
        return 0.0


class Anything:
    def __init__(self, rng, **parameters):
        pass

    def decide(self, observation):
        return 0.0


class NoStrategy:
    pass


def function():
    pass
'''

Write = Callable[[str, str], str]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Write]:
    """Writes a module into the working directory, which is empty before."""
    monkeypatch.chdir(tmp_path)
    path = list(sys.path)

    def put(name: str, text: str) -> str:
        file = tmp_path / f"{name.replace('.', '/')}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        return name

    yield put
    sys.path[:] = path
    for name, module in tuple(sys.modules.items()):
        if str(tmp_path) in str(getattr(module, "__spec__", None)):
            del sys.modules[name]


def scene(name: str, parameters: dict[str, object] | None = None, seed: int = 1) -> Scenario:
    return validate(
        {
            "pedestrians": {"max_count": 1, "first_at_trigger": True, "kerb_wait_s": 0.0},
            "arms": {"av": name},
            "strategies": {} if parameters is None else {name: parameters},
            "experiment": {"pairs": 4, "seed": seed},
        },
        "test",
    )


def test_modules_in_the_working_directory_and_annotations_for_type_checkers(write, model) -> None:
    name = write("mine_a", MODULE)
    check_arms(scene(f"{name}:Steady", {"gap_s": 2}), model)
    write("pack_a.deep.mine", MODULE)
    check_arms(scene("pack_a.deep.mine:Steady"), model)
    write("mine_e", f"from __future__ import annotations\n{MODULE}")
    check_arms(scene("mine_e:Anything", {"one": 1, "two": "x"}), model)
    write("mine_f", MODULE.replace("str | list[float] | None", "'Unheard'"))
    check_arms(scene("mine_f:Steady", {"side": [1]}), model)


BAD_NAMES = {
    "mine_b:Stedy": "arms.av: 'mine_b' has no 'Stedy'; allowed: Anything, Demanding, Fickle, "
    "Steady; did you mean 'Steady'?",
    "mine_c:Steady": "arms.av: there is no module 'mine_c'; | did you mean 'mine_b'?",
    "mine_b": "did you mean 'mine_b:Class'?",
    "pack_b.min:Steady": "there is no module 'pack_b.min' | did you mean 'pack_b.mine'?",
    "mine_b:NoStrategy": "'mine_b:NoStrategy' is not a strategy; allowed: a class",
    "mine_b:function": "is not a strategy",
    "mine_b:": "is not a strategy's name; allowed: package.module:Class",
    "a b:c": "is not a strategy's name",
    "sotf_yield": "or your own as package.module:Class | did you mean 'soft_yield'?",
}
BAD_MODULES = {
    "x = 1\ny = 1 / 0\n": "ZeroDivisionError: division by zero (broken.py:2)",
    "\n\ndef f(:\n": "SyntaxError: invalid syntax (broken.py:3)",
    "import no_such\n": "ModuleNotFoundError: No module named 'no_such' (broken.py:1)",
    "import sys\nsys.exit('done')\n": "SystemExit: done (broken.py:2)",
}
BAD_PARAMETERS: list[tuple[str, dict[str, object] | None, str]] = [
    ("Steady", {"gap": 1.0}, ".gap: unknown key 'gap' | did you mean 'gap_s'?"),
    ("Steady", {"gap_s": "x"}, ".gap_s: 'x' is not accepted; allowed: a number"),
    ("Steady", {"side": 1}, ".side: 1 is not accepted"),
    ("Steady", {"gap_s": -1.0}, ".gap_s: -1.0 s; allowed: 0 or more"),
    ("Steady", {"gap_s": 99.0}, "cannot be made: LookupError: no such gap (mine_b.py:"),
    ("Demanding", None, ".needed: is missing"),
    ("Demanding", {"needed": 1.0, "model": 1}, ".model: unknown key"),
    ("Anything", {"rng": 1}, "multiple values for keyword argument 'rng'"),
]


def test_what_is_no_strategy_of_a_user(write: Write, model: InteractionModel) -> None:
    """Names, modules that cannot be imported, and parameters that the signature does not have."""
    write("mine_b", MODULE)
    write("pack_b.mine", MODULE)
    cases = [(scene(name), said) for name, said in BAD_NAMES.items()]
    for name, parameters, said in BAD_PARAMETERS:
        cases.append((scene(f"mine_b:{name}", parameters), said))
    for of, said in cases:
        refusal_of(lambda of=of: check_arms(of, model), *said.split(" | "))
    for text, said in BAD_MODULES.items():
        write("broken", text)
        importlib.invalidate_caches()
        line = f"arms.av: 'broken' cannot be imported: {said}"
        assert str(refusal_of(lambda: check_arms(scene("broken:Mine"), model))) == line


def test_an_error_ends_its_episode_with_its_own_traceback(write: Write, model) -> None:
    write("mine_h", MODULE)
    outcomes = list(on_plain(scene("mine_h:Demanding", {"needed": 0.35}), model).run(range(2)))
    for outcome in outcomes:
        if outcome.arm is Arm.HUMAN:
            assert (outcome.record.ending, outcome.trace.traceback) == (Ending.CROSSED, None)
            continue
        line = 1 + MODULE[: MODULE.index("raise KeyError")].count("\n")
        assert outcome.record.ending is Ending.FAILED
        expected = rf"the strategy raised KeyError: 'two\nlines' at t = 0.400 s (mine_h.py:{line})"
        assert outcome.record.reason == expected
        traceback = outcome.trace.traceback
        assert traceback is not None
        assert "in decide" in traceback
        assert "in after" in traceback
        assert "harness" not in traceback
        assert traceback.splitlines()[-1] == r"KeyError: 'two\nlines'"


def test_a_class_stands_for_its_name(write: Write) -> None:
    sys.path.insert(0, str(Path.cwd()))
    importlib.invalidate_caches()
    mine = importlib.import_module(write("mine_of_a_class", "class Steady:\n    decide = None\n"))
    file = read_scenario_file("cctc", {"arms.av": mine.Steady})
    assert file.scenario().arms.av == "mine_of_a_class:Steady"
    study = study_of(read_scenario_file("cctc"), [("arms.av", [mine.Steady, "hard_yield"])])
    varied = [cell.varied["arms.av"] for cell in study.cells]
    assert varied == ["mine_of_a_class:Steady", "hard_yield"]
    local = type("Steady", (), {"__module__": "__main__"})
    for nameless in (local, type("Steady", (), {"__module__": "mine_of_a_class"})):
        with pytest.raises(InputError, match=r"^settings arms.av: .* a class of a module"):
            load_scenario("cctc", {"arms.av": nameless})
