"""Strategies in another process: the form of a line, the examples, and programs that misbehave."""

import hashlib
import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples import driver
from harness.core.vocabulary import Arm, Ending, Trace
from harness.scenario import load_scenario
from harness.strategies import program
from harness.strategies.registry import find_strategy, source_digests
from harness.strategies.vector import observation_vector
from harness.studies.checks import check_strategy
from tests.scenes import on_plain, refusal_of

EXAMPLES = Path(driver.__file__).parent
SCHEMA = Path(program.__file__).with_name("observation.schema.json")

BUSY = {"pedestrians.flow_per_hour": 800, "experiment.timeout_s": 60.0}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working directory with the example; programs end with the test."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(EXAMPLES / "driver.py", tmp_path)
    yield tmp_path
    program.close_programs()


def write(name: str, text: str) -> str:
    path = Path(name)
    path.write_text(f"#!/usr/bin/env python3\nimport sys\n{text}\n", encoding="utf-8")
    path.chmod(0o755)
    return f"exec:./{name}"


def traces(strategy: Any, model: Any, pairs: int = 4, **parameters: float) -> list[Trace]:
    """The AV's episodes of some pairs on the plain engine."""
    settings: dict[str, Any] = {**BUSY, "arms.av": strategy}
    for key, value in parameters.items():
        settings[f'strategies."{strategy}".{key}'] = value
    scenario = load_scenario("cctc_flow", settings)
    runner = on_plain(scenario, model)
    return [runner.run_arm(pair, Arm.AV).trace for pair in range(pairs)]


class Inside:
    """The example's driver without a process; what it saw is kept."""

    seen: list[Any] = []  # noqa: RUF012

    def decide(self, observation: Any) -> float:
        self.seen.append(observation)
        return driver.decide(json.loads(program.line_of(observation)), 2.5)


def fields_of(value: Any) -> Any:
    """The names in a document, without its values."""
    if isinstance(value, dict):
        return {name: fields_of(inner) for name, inner in value.items()}
    return [fields_of(value[0])] if isinstance(value, list) else None


def fields_in(schema: dict[str, Any]) -> Any:
    """The names that a schema requires."""
    if "properties" in schema:
        assert {*schema["properties"]} == {*schema["required"]}
        return {name: fields_in(inner) for name, inner in schema["properties"].items()}
    return [fields_in(schema["items"])] if "items" in schema else None


def test_every_line_has_the_fields_of_the_schema(model) -> None:
    Inside.seen.clear()
    traces(Inside, model)
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    assert max(len(seen.pedestrians) for seen in Inside.seen) > 1
    for seen in Inside.seen:
        line = program.line_of(seen)
        assert line.count(b"\n") == 1
        document = json.loads(line)
        if seen.pedestrians:
            assert fields_of(document) == fields_in(schema)
        # Nothing is lost on the way.
        assert document["ego"]["range_m"] == seen.ego.range_m
        assert len(document["pedestrians"]) == len(seen.pedestrians)
        assert observation_vector(seen, 1)[1] == np.float32(document["ego"]["speed_mps"])


def same(one: list[Trace], other: list[Trace]) -> bool:
    return all(
        a.ending is b.ending
        and len(a.x_m) == len(b.x_m)
        and np.allclose(a.x_m, b.x_m, rtol=0, atol=1e-9)
        for a, b in zip(one, other, strict=True)
    )


def test_the_example_in_python_drives_as_it_does_inside(model) -> None:
    outside = traces("exec:./driver.py --comfortable 2.5", model)
    assert {trace.ending for trace in outside} == {Ending.CROSSED}
    assert same(outside, traces(Inside, model))
    assert not same(outside, traces("exec:./driver.py --comfortable 0.5", model))
    # One process each for all episodes.
    assert program.close_programs() == 2


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_the_example_in_cpp_drives_as_the_one_in_python(here: Path, model) -> None:
    source = EXAMPLES / "driver.cpp"
    command = ["g++", "-std=c++17", "-O1", "-o", str(here / "driver"), str(source)]
    subprocess.run(command, check=True, timeout=60)
    assert same(traces("exec:./driver", model), traces(Inside, model))
    gently = "--comfortable 0.5"
    alike = traces(f"exec:./driver.py {gently}", model)
    assert same(traces(f"exec:./driver {gently}", model), alike)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sys.stdin.readline(); sys.exit(3)", "the program ended (exit code 3)"),
        ("[print('fast', flush=True) for _ in sys.stdin]", "b'fast\\n', which is not one line"),
        ("[print('1\\n2', flush=True) for _ in sys.stdin]", "which is not one line"),
        ("print('1' * 5000, flush=True); sys.stdin.read()", "which is not one line"),
        ("[print('NaN', flush=True) for _ in sys.stdin]", "the strategy returned nan"),
        ("[print('true', flush=True) for _ in sys.stdin]", "the strategy returned True"),
        ("[print('\"1\"', flush=True) for _ in sys.stdin]", "the strategy returned '1'"),
    ],
)
def test_a_program_that_misbehaves_fails_in_its_episode(text: str, said: str, model) -> None:
    for trace in traces(write("bad.py", text), model, pairs=2):
        assert trace.ending is Ending.FAILED
        assert said in str(trace.reason)


def test_a_program_that_ended_is_started_again(model) -> None:
    name = write(
        "once.py",
        "import os\n"
        "if not os.path.exists('seen'):\n"
        "    open('seen', 'w').close()\n"
        "    sys.exit(1)\n"
        "[print(0.0, flush=True) for _ in sys.stdin]",
    )
    endings = [trace.ending for trace in traces(name, model, pairs=2)]
    assert endings == [Ending.FAILED, Ending.CROSSED]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("exec:", "has no program"),
        ("exec:./none", "there is no program './none'"),
        ("exec:/bin/cat", "'/bin/cat' is not below the working directory"),
        ("exec:../../bin/cat", "is not below the working directory"),
        ("exec:cat", "there is no program 'cat'"),
        ("exec:./plain.txt", "cannot be executed; allowed: chmod"),
        (
            "exec:./text.py",
            "'./text.py' does not say what runs it; allowed: a first line such as #!",
        ),
        ("exec:./driver.py 'x", "is not a command (No closing quotation)"),
    ],
)
def test_refused(name: str, said: str) -> None:
    Path("plain.txt").write_text("text", encoding="utf-8")
    Path("text.py").touch(0o755)
    assert refusal_of(lambda: find_strategy(name, "arms.av"), said).where == "arms.av"


def test_a_program_that_is_silent_or_does_not_start_is_told_why(model) -> None:
    first, *_ = check_strategy(write("silent.py", "sys.stdin.read()"), limit_s=1.0)
    assert str(first.problem).endswith("within 1 s: is the program's output flushed?")
    Path(write("none.py", "")[5:]).write_text("#!none", encoding="utf-8")
    assert "cannot be started" in str(traces("exec:./none.py", model, 1)[0].reason)


def test_the_manifest_says_which_program_it_was() -> None:
    name = "exec:./driver.py --comfortable 1"
    digest = hashlib.sha256(Path("driver.py").read_bytes()).hexdigest()
    assert source_digests([name, "soft_yield"]) == {name: digest}
