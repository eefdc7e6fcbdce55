"""Reads back what ``harness export`` wrote, as another tool would, and asks ASAM's checker."""

import cmath
import math
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest


@dataclass(frozen=True)
class Read:
    """An ``.xosc`` file: (time, x, y, heading) of each entity, and when it comes and goes."""

    root: ElementTree.Element
    states: dict[str, np.ndarray]
    appears: dict[str, float]
    leaves: dict[str, float]


def places(element: ElementTree.Element) -> list[list[float]]:
    found = element.iter("WorldPosition")
    return [[float(place.get(key, "nan")) for key in "xyh"] for place in found]


def read(path: Path) -> Read:
    """What a simulator would do: every entity's places by the time since the act began."""
    root = ElementTree.parse(path).getroot()
    states: dict[str, np.ndarray] = {}
    appears, leaves = dict[str, float](), dict[str, float]()
    for private in root.iter("Private"):
        name = private.get("entityRef", "")
        states[name] = np.array([[0.0, *places(private)[0]]])
        appears[name] = 0.0
    for group in root.iter("ManeuverGroup"):
        (actor,) = (each.get("entityRef", "") for each in group.iter("EntityRef"))
        for event in group.iter("Event"):
            (condition,) = event.iter("Condition")
            (state,) = condition.iter("StoryboardElementStateCondition")
            assert (state.get("storyboardElementRef"), state.get("state")) == (
                "passage",
                "runningState",
            )
            after_s = float(condition.get("delay", "nan"))
            if event.find(".//AddEntityAction") is not None:
                appears[actor] = after_s
                states[actor] = np.array([[after_s, *places(event)[0]]])
            elif event.find(".//DeleteEntityAction") is not None:
                leaves[actor] = after_s
            else:
                (timing,) = event.iter("Timing")
                assert timing.get("domainAbsoluteRelative") == "relative"
                times = [after_s + float(v.get("time", "nan")) for v in event.iter("Vertex")]
                moved = np.column_stack([times, places(event)])
                assert moved[0, 1:] == pytest.approx(states[actor][0, 1:], abs=1e-6)
                states[actor] = moved
    return Read(root, states, appears, leaves)


def entity_of(read_back: Read, name: str) -> ElementTree.Element:
    (entity,) = (e for e in read_back.root.iter("ScenarioObject") if e.get("name") == name)
    return entity


def front(read_back: Read, name: str = "ego") -> np.ndarray:
    """Time, x and y of the middle of a vehicle's front bumper, from its bounding box."""
    entity = entity_of(read_back, name)
    centre, size = entity.find(".//Center"), entity.find(".//Dimensions")
    assert centre is not None
    assert size is not None
    ahead = float(centre.get("x", "nan")) + float(size.get("length", "nan")) / 2
    t, x, y, h = read_back.states[name].T
    return np.column_stack([t, x + ahead * np.cos(h), y + ahead * np.sin(h)])


def checked(path: Path) -> str:
    """The summary of ASAM's checker on a file, which must have no issue."""
    pytest.importorskip("qc_openscenario")
    folder = path.parent
    (folder / "checks.xml").write_text(
        f'<Config><Param name="InputFile" value="{path}"/><CheckerBundle application="xoscBundle">'
        '<Param name="resultFile" value="checked.xqar"/></CheckerBundle></Config>'
    )
    command = [sys.executable, "-m", "qc_openscenario", "-c", "checks.xml"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    bundle = ElementTree.parse(folder / "checked.xqar").getroot().find("CheckerBundle")
    assert bundle is not None
    assert bundle.findall(".//Issue") == []
    return bundle.get("summary", "")


@dataclass(frozen=True)
class LaneOf:
    """A driving lane of an OpenDRIVE road's straight piece: its right-hand borders t from s = 0."""

    begin: complex
    along: complex
    length_m: float
    right_m: float
    left_m: float


def lanes_in(path: Path) -> list[LaneOf]:
    lanes = []
    for road in ElementTree.parse(path).getroot().iter("road"):
        widths = sorted(
            (-int(lane.get("id", "0")), lane.get("type"), float(width.get("a", "nan")))
            for lane in road.iter("lane")
            if (width := lane.find("width")) is not None
        )
        for piece in road.iter("geometry"):
            curve = piece.find("paramPoly3")
            if curve is not None and any(
                abs(float(curve.get(k, "nan"))) > 1e-3 for k in ("aV", "bV", "cV", "dV")
            ):
                continue  # a turn; the way over the crosswalk is straight within 1 mm
            x, y, hdg, length = (float(piece.get(k, "nan")) for k in ("x", "y", "hdg", "length"))
            t = 0.0
            for _, kind, width in widths:
                if kind == "driving":
                    lanes.append(LaneOf(complex(x, y), cmath.rect(1, hdg), length, t - width, t))
                t -= width
    return lanes


def off_centre_m(lanes: list[LaneOf], point: complex, heading: float) -> float:
    """Distance of a point from the nearest centre of a lane that it is on, in its direction.

    It is infinite on no lane and on a lane of a bent road.
    """
    found = []
    for lane in lanes:
        there = (point - lane.begin) / lane.along
        if abs(cmath.phase(cmath.rect(1, heading) / lane.along)) > 0.1:
            continue
        if (
            -0.01 <= there.real <= lane.length_m + 0.01
            and lane.right_m <= there.imag <= lane.left_m
        ):
            found.append(abs(there.imag - (lane.right_m + lane.left_m) / 2))
    return min(found, default=math.inf)
