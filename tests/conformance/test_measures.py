"""What every measure of ``MEASURES`` must be, whichever they are."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.vocabulary import Arrival, Contact, Ending, Side, Trace, Walk
from harness.measures import MEASURES, Measure, measure
from tests.scenes import Walker, drive

DOCS = Path(__file__).parents[2] / "docs" / "measures.md"
FAR, NEAR = Side.FAR, Side.NEAR
CRUISE = [0.0] * 76
STOP_AND_GO = [-1.0] * 49 + [0.0] * 30 + [1.0] * 70


def scenes(parts: int = 1) -> dict[str, Trace]:
    """Every kind of episode, each step of 0.1 s cut into ``parts``; nothing moves otherwise."""

    def scene(plan: Sequence[float], *walkers: Walker, ending: Ending = Ending.CROSSED) -> Trace:
        finer = [acceleration for acceleration in plan for _ in range(parts)]
        return drive(finer, walkers, step=0.1 / parts, ending=ending)

    out = Ending.TIMED_OUT
    waiting = Walk(Arrival(0, 1.0, NEAR, 0.5))
    failed = replace(scene(CRUISE, (0.0, FAR, 1.0)), ending=Ending.FAILED, reason="lost")
    return {
        "nobody": scene(CRUISE),
        "one who leaves in time": scene(CRUISE, (0.0, NEAR, 1.5)),
        "one who comes after": scene(CRUISE, (6.9, NEAR, 1.0)),
        "one who starts inside a step": scene(CRUISE, (1.234, FAR, 2.3)),
        "many": scene(
            STOP_AND_GO, (0.0, FAR, 1.0), (0.7, NEAR, 1.4), (2.5, FAR, 2.2), (3.3, NEAR, 0.8)
        ),
        "struck with the front": scene(CRUISE, (0.0, FAR, 1.0)),
        "struck with the side": scene(CRUISE, (5.4, NEAR, 1.0)),
        "struck with a corner": scene(CRUISE, (2.62, NEAR, 1.0)),
        "two who are struck": scene(CRUISE, (0.0, FAR, 1.0), (5.4, NEAR, 1.0)),
        "struck while braking": scene([-0.4] * 100, (0.0, NEAR, 0.25), ending=out),
        "timed out, standing": scene([-1.0] * 50 + [0.0] * 20, (0.0, FAR, 1.0), ending=out),
        "one who never goes": replace(scene(CRUISE), walks=(waiting,)),
        "one who goes after the end": scene(CRUISE, (7.5, NEAR, 1.0)),
        "failed on its way": failed,
        "failed at once": replace(failed, x_m=np.empty(0), speed_mps=np.empty(0), walks=()),
    }


SCENES = scenes()
RECORDS = dict(zip(SCENES, measure(list(SCENES.values())), strict=True))
FINER = dict(zip(SCENES, measure(list(scenes(4).values())), strict=True))
every_measure = pytest.mark.parametrize("entry", MEASURES, ids=lambda entry: entry.column)


def row_of(entry: Measure) -> str:
    """The line of docs/measures.md that an entry asks for."""
    cells = (entry.unit, entry.formula, entry.undefined_when, entry.on_step, entry.source)
    return f"| `{entry.column}` | " + " | ".join(cells) + " |"


def test_the_scenes_are_what_they_are_called() -> None:
    assert {record.ending for record in RECORDS.values()} == set(Ending)
    contacts = {name: record.contact for name, record in RECORDS.items() if record.contact}
    assert [name for name in contacts if "struck" not in name] == []
    assert set(contacts.values()) == set(Contact)
    assert len(contacts) == 5
    assert measure([]) == []


@every_measure
def test_is_documented(entry: Measure) -> None:
    row = row_of(entry)
    documented = row in DOCS.read_text(encoding="utf-8").splitlines()
    assert documented, f"docs/measures.md has to have this line in its table:\n{row}"


@every_measure
def test_is_finite_of_its_type_or_none_and_empty_without_states(entry) -> None:
    values = {name: getattr(record, entry.column) for name, record in RECORDS.items()}
    for name, value in values.items():
        assert value is None or (type(value) is entry.kind and math.isfinite(value)), name
    assert any(value is not None for value in values.values())
    assert values["failed at once"] is None


def of(traces: Sequence[Trace], column: str) -> list[object]:
    return [getattr(record, column) for record in measure(traces)]


@every_measure
def test_depends_on_its_episode_alone(entry: Measure) -> None:
    traces, together = list(SCENES.values()), [getattr(r, entry.column) for r in RECORDS.values()]
    assert [of([trace], entry.column)[0] for trace in traces] == together
    assert of(traces[::-1], entry.column)[::-1] == together
    for size in (2, 7):
        chunks = [traces[begin : begin + size] for begin in range(0, len(traces), size)]
        assert [value for chunk in chunks for value in of(chunk, entry.column)] == together


@every_measure
def test_on_a_shorter_step(entry: Measure) -> None:
    for name in SCENES:
        coarse, fine = (getattr(records[name], entry.column) for records in (RECORDS, FINER))
        if entry.on_step == "steps" or (coarse is None and entry.on_step == "states"):
            continue
        if entry.on_step == "states" and entry.column.startswith("min_"):
            assert fine <= coarse + 1e-9, name
        elif entry.on_step == "states" and entry.column.startswith("max_"):
            assert fine >= coarse - 1e-9, name
        else:
            assert fine == (None if coarse is None else pytest.approx(coarse, abs=1e-9)), name
