"""The public names, the help of the commands and the examples in docstrings."""

import ast
import doctest
import importlib
import inspect
import re
import tomllib
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
from typer.main import get_command

import harness
from harness.cli import options
from harness.cli.app import application
from harness.core.vocabulary import Arm
from harness.measures import MEASURES, EpisodeRecord
from harness.model.sample import WEIGHINGS, make_sample
from harness.scenario import EngineName
from tests.scenes import refuses

ROOT = Path(harness.__file__).parents[1]
PUBLIC: Any = harness


def test_type_checkers_see_every_name_and_another_is_refused() -> None:
    stub = Path(harness.__file__).with_suffix(".pyi")
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        assert isinstance(node, ast.ImportFrom)
        assert all(alias.asname == alias.name for alias in node.names), "or it is not exported"
    assert sorted(PUBLIC.__all__) == dir(harness)
    with pytest.raises(AttributeError, match="attribute nothing"):
        _ = PUBLIC.nothing
    assert (Path(harness.__file__).parent / "py.typed").is_file()


@pytest.mark.parametrize("name", PUBLIC.__all__)
def test_every_public_name_is_there_and_says_what_it_is(name: str) -> None:
    found = getattr(harness, name)
    assert found.__doc__
    assert getattr(found, "__module__", found.__name__).startswith("harness.")
    if inspect.isfunction(found):
        assert inspect.signature(found).parameters.keys() <= {*re.findall(r"\w+", found.__doc__)}
        assert "Returns:" in found.__doc__ or found.__doc__.startswith(("The ", "A ", "An "))


CALLED = {"CrosswalkEnv", *(n for n in PUBLIC.__all__ if inspect.isfunction(getattr(PUBLIC, n)))}
NEEDED: dict[str, tuple[Any, ...]] = {
    "compare": (),
    "evaluate": ("cctc", [{}], 1),
    "study_of": (harness.read_scenario_file("cctc"),),
    "worst": (object.__new__(harness.Run),),
}
"""Arguments without a default, of the right type; those of other functions are a text."""


@pytest.mark.parametrize("name", sorted(CALLED - {"acceleration_of", "observation_vector"}))
def test_an_argument_of_a_wrong_type_is_refused_in_one_line(name: str) -> None:
    names = inspect.signature(getattr(harness, name)).parameters
    known = dict(zip(names, NEEDED.get(name, ("cctc",)), strict=False))
    for wrong in names.keys() - {"runs"}:
        line = rf"\A{wrong}: <object.* is not accepted; allowed: .*\Z"
        refuses(line, partial(getattr(harness, name), **{**known, wrong: object()}))


def test_a_wrong_name_or_part_is_refused_with_the_nearest() -> None:
    (run,), (file,) = NEEDED["worst"], NEEDED["study_of"]
    refuses("arm: unknown .* did you mean 'human'", lambda: PUBLIC.worst(run, arm="huma"))
    refuses("driver: unknown .* mean 'reference'", lambda: PUBLIC.worst(run, driver="refer"))
    refuses("engine: unknown .* mean 'plain'", lambda: PUBLIC.run_pair("cctc", engine="plian"))
    refuses("settings 3: unknown", lambda: PUBLIC.load_scenario("cctc", {3: 1}))
    refuses(r"variations\[1\]: 3 is", lambda: PUBLIC.study_of(file, [("a", []), 3]))
    refuses("runs: 'x' .* allowed: Run", lambda: PUBLIC.compare("x"))


def test_citation_and_changelog_name_the_version() -> None:
    told = {name: (ROOT / name).read_text("utf-8") for name in ("CITATION.cff", "CHANGELOG.md")}
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in told["CITATION.cff"]
    assert f"\n## {version}\n" in told["CHANGELOG.md"]


def test_the_type_of_a_measure_says_whether_it_may_be_undefined() -> None:
    hints = get_type_hints(EpisodeRecord)
    for entry in MEASURES:
        undefined = entry.undefined_when != "never"
        assert hints[entry.column] == (entry.kind | None if undefined else entry.kind)


ALL = get_command(application()).commands  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ALL)
def test_every_command_and_option_says_what_it_does(name: str) -> None:
    assert (ALL[name].help or "").strip().endswith(".")
    assert [p.name for p in ALL[name].params if not getattr(p, "help", None)] == []


def test_an_option_has_the_choices_of_what_it_is_for() -> None:
    chosen = (options.EngineOption, options.WeighOption, options.ArmOption)
    words = [get_args(get_args(each)[0]) for each in chosen]
    assert words == [get_args(EngineName), WEIGHINGS, tuple(Arm)]
    (weigh,) = (param for param in ALL["fit"].params if param.name == "weigh")
    assert weigh.default == inspect.signature(make_sample).parameters["weigh"].default


MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "harness").rglob("*.py"))
    if ">>>" in path.read_text("utf-8")
]


@pytest.mark.parametrize("module", MODULES)
def test_examples(module: str) -> None:
    found = doctest.testmod(importlib.import_module(module), optionflags=doctest.ELLIPSIS)
    assert found.attempted > 0
    assert found.failed == 0
