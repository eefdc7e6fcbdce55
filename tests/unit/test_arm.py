"""An arm of a simulation played from tables, without SUMO: every number is added up by hand.

A car, 5 m long, is on the crosswalk J from x = 102 to 111 m, and on K from x = 150 to 159 m; R0 is
30 m before x = 104 and 152.
"""

import math

import pytest

from harness.core.errors import EngineError
from harness.core.vocabulary import LIMITED_BY, Arm, Observation
from tests.scripted import STEPS, Hit, Scripted, drive, played, rows, walk

STEADY = {"av": drive(3.0, *[10.0] * 40)}
"""x = 3 + 10 (t − 0.5)."""
ONE = {"file": "a", "crossings": [":J_c0"]}


class Brakes:
    """Brakes on the last 30 m before a crosswalk, and keeps what it is shown."""

    def __init__(self, *, brakes_mps2: float = 0.0) -> None:
        SEEN.clear()
        self._brakes_mps2 = brakes_mps2

    def decide(self, observation: Observation) -> float:
        SEEN.append(observation)
        return -self._brakes_mps2 if 0.0 < observation.ego.range_m <= 30.0 else 0.0


SEEN: list[Observation] = []
OWN = f"{__name__}:Brakes"
ARMS = {"av": OWN, "human": "sumo_driver"}


@pytest.mark.parametrize("mps", [10.0, 5.0])
def test_times_of_passages(mps: float, model) -> None:
    """x = 3 + v (t − 0.5); without anybody the 37 m from R0 take 3.7 s at the limit."""
    arm = played(Scripted({"av": drive(3.0, *[mps] * 70)}), model)
    for row, centre_m in zip(rows(arm, "passages"), (104.0, 152.0), strict=True):
        for name, way_m in {"trigger_s": -30.0, "front_s": -2.0, "rear_s": 7.0}.items():
            assert row[name] == pytest.approx(0.5 + (centre_m + way_m - 3.0) / mps), name
        assert row["delay_s"] == pytest.approx(37 / mps - 3.7, abs=1e-3)


@pytest.mark.parametrize(
    ("of", "arm", "crosswalks", "because"),
    # R0 is passed at 7.6 and 12.4 s.
    [({"counted_s": (7.5, 99.0)}, Arm.AV, "JK", None),
     ({"counted_s": (7.7, 99.0)}, Arm.AV, "K", None),
     ({"counted_s": (0.0, 12.3)}, Arm.AV, "J", None),
     ({"simulation": {**ONE, "av_types": ["van"]}}, Arm.AV, "J", "it is no AV"),
     ({"simulation": ONE}, Arm.HUMAN, "J", "SUMO drives in this arm")],
)  # fmt: skip
def test_which_passages_count_and_who_drives(of, arm, crosswalks, because, model) -> None:
    session = Scripted(STEADY, {"p": walk(":J_c0", 30.0)})
    found = rows(played(session, model, arm, **of), "passages")
    assert "".join(row["crosswalk"][1] for row in found) == crosswalks
    who = {(row["driver"], row["not_driven_because"]) for row in found}
    assert who == {("sumo" if because else "constant_speed", because)}
    assert bool(session.said) == (because is None)


def test_a_vehicle_goes_from_one_crosswalk_to_the_next(model) -> None:
    """With R0 = 50 m that of K begins at 102 m, before the rear leaves J; who brakes more decides.

    The vehicle does not obey, so the same is asked again, and said once.
    """
    brakes, ego = {OWN: {"brakes_mps2": 1.0}}, {"trigger_range_m": 50.0}
    session = Scripted(STEADY, {"p": walk(":J_c0", 30.0), "q": walk(":K_c0", 30.0)})
    played(session, model, arms=ARMS, strategies=brakes, ego=ego)
    # States at x = 58 (after R0), 78 (30 m before J), 103 (R0 of K), 108, 123, 153.
    asked = {each[0]: each[3] for each in session.said if each[1] == "set_speed"}
    assert asked == {6.0: 10.0, 8.0: 9.5, 11.0: 10.0, 12.5: 9.5, 15.5: 10.0}
    minded = [(each[0], *each[3]) for each in session.said if each[1] == "ignore"]
    first = {tuple(names): at for at, *names in reversed(minded)}
    assert first == {("p",): 6.0, ("p", "q"): 10.5, ("q",): 11.5}
    assert [each[0] for each in session.said if each[1] == "release"] == [16.5]


@pytest.mark.parametrize(
    ("speeds_mps", "limit_mps", "followers", "expected"),
    # From x = 78.5 m; the rear leaves at 111 m.  A limit of 8 m/s is asked for from the first step.
    [([10.0] * 7, 10.0, (), {"strategy": 7}),
     ([10.0, *[8.0] * 7], 10.0, (), {"strategy": 7, "right_of_way": 1}),
     ([10.0, *[8.0] * 7], 10.0, ("av",), {"strategy": 7, "leader": 1}),
     ([8.0] * 9, 8.0, (), {"strategy": 8, "lane": 1})],
)  # fmt: skip
def test_what_limits_a_step(speeds_mps, limit_mps, followers, expected, model) -> None:
    """The strategy asks for the speed that the vehicle has."""
    session = Scripted({"av": drive(3.5, *[10.0] * 15, *speeds_mps)}, followers=followers)
    row, *_ = rows(played(session, model, limit_mps=limit_mps, arms=ARMS), "passages")
    shares = {name: row[f"share_{name}"] * len(speeds_mps) for name in LIMITED_BY}
    assert {name: n for name, n in shares.items() if n} == pytest.approx(expected)


def test_whom_a_driver_sees(model) -> None:
    """Near is y = −3, 3 m from the lane's middle; beyond the kerb is whom SUMO has there."""
    # Where they are; then the way to the lane and to the far kerb, the speed, and whether on it.
    states = [
        ((":J_w0", (104.0, -5.0), 0.05), (5.0, 10.0, 0.05, False)),
        ((":J_w0", (104.0, -3.5), 0.05), (3.5, 8.5, 0.0, False)),  # they wait
        ((":J_w0", (104.0, -2.6), 1.0), (3.0, 8.0, 1.0, False)),
        ((":J_c0", (104.0, -1.0), 1.0), (1.0, 6.0, 1.0, True)),
        ((":J_c0", (104.0, 5.5), 1.0), (-5.0, 0.0, 1.0, False)),
    ]
    way = {step: states[min(max(step - 16, 0), 4)][0] for step in range(STEPS + 1)}
    played(Scripted(STEADY, {"p": way}), model, arms=ARMS, simulation=ONE)
    for observation, (_, expected) in zip(SEEN, states, strict=False):
        (seen,) = observation.pedestrians
        assert (seen.side, *seen[2:]) == pytest.approx(("near", *expected))


def test_a_contact_by_when_the_front_is_at_the_person(model) -> None:
    """They walk from 7.5 s on; the front is 0.25 m before them at 10.575 s, and they at y = 0.1."""
    hits = {21: [Hit("av", "p", ":J_c0_0")], 22: [Hit("av", "p", ":J_c0_0")]}
    hits |= {24: [Hit("av", "van", ":J_0_0"), Hit("p", "q", ":J_c0_0")]}
    cars = {**STEADY, "van": drive(160.0, *[0.0] * 70)}
    arm = played(Scripted(cars, {"p": walk(":J_c0", 7.5)}, hits), model)
    row, other = rows(arm, "passages")
    assert (row["contact"], row["contact_person"], row["sumo_contact"]) == ("front", "p", True)
    assert (other["contact"], other["sumo_contact"]) == (None, False)
    (person,), (counts,) = rows(arm, "people"), rows(arm, "arms")
    names = ("arrival_s", "start_s", "cleared_s", "speed_mps")
    assert [person[name] for name in names] == pytest.approx([7.5, 7.5, 15.5, 1.0])
    names = ("person_collisions", "vehicle_collisions", "overlaps", "sumo_people")
    assert [counts[name] for name in names] == [1, 1, 1, 1]


def test_a_simulation_that_ends_before_the_counted_time_fails(model) -> None:
    with pytest.raises(EngineError, match="ended at 40 s; counted is from 50 s on"):
        rows(played(Scripted(STEADY), model, counted_s=(50.0, math.inf)), "arms")


def test_uses_of_the_model_outside_its_data_are_counted(model) -> None:
    """They end at 8 m/s.  Of three decisions, at 8, 9 and 10 s, the last one is at 5 m/s."""
    session = Scripted({"av": drive(3.0, *[10.0] * 17, *[5.0] * 3)}, {"p": walk(":J_c0", 7.5)})
    (counts,) = rows(played(session, model, arms=ARMS | {"av": "human_gmm"}), "arms")
    assert (counts["conditionings"], counts["clamped"]) == (3, 2)


@pytest.mark.parametrize(
    ("over_m", "mps", "range_m", "offset_s"),
    [(0.04, 0.0, 29.96, 0.0), (2.0, 1.0, 28.0, 0.0), (2.0, 5.0, 30.0, 0.4)],
)
def test_who_departs_just_behind_r0_begins_there(over_m, mps, range_m, offset_s, model) -> None:
    """A vehicle that was at R0 within the last step has come from there; another has departed."""
    first, *_ = played(Scripted({"av": drive(74.0 + over_m, mps, mps)}), model).passages
    assert first.vehicle.trigger_range_m == pytest.approx(range_m)
    assert first.trace_offset_s == pytest.approx(offset_s)


def test_people_of_the_harness_are_moved_from_kerb_to_kerb(model) -> None:
    """By their speed times a step, but 5 cm inside of the kerbs; when they are over they go."""
    people = {"flow_per_hour": 900.0, "walking_speed": {"mean_mps": 1.3, "std_mps": 0.2}}
    session, arms = Scripted({"av": drive(200.0, 0.0)}), {"av": OWN, "human": "human_yield"}
    found = rows(played(session, model, pedestrians=people, arms=arms), "people")
    assert {row["delay_s"] is None for row in found} == {True, False}
    for row in found:
        (*_, added_m), _, *moves = (each for each in session.said if row["person"] in each)
        near, x = row["side"] == "near", 104.0 if ":J" in row["crosswalk"] else 152.0
        assert added_m == pytest.approx(0.05 if near else 7.95)
        for at_s, what, _, *place in moves:
            way_m = min(max(row["speed_mps"] * (at_s + 0.5 - row["start_s"]), 0.05), 7.95)
            if what == "move":
                assert place == pytest.approx([x, way_m - 3.0 if near else 5.0 - way_m])
        on_the_way = row["start_s"] is not None and row["cleared_s"] is None
        assert (row["delay_s"] is None) == on_the_way
        if row["cleared_s"] is not None:
            assert row["cleared_s"] == pytest.approx(row["start_s"] + 8.0 / row["speed_mps"])
            assert moves[-1][0] == pytest.approx(math.ceil(row["cleared_s"] / 0.5) * 0.5)


def test_people_who_walk_on_faster_are_early_and_who_walks_alone_is_not_late(model) -> None:
    """Delays are signed, so that means are unbiased; the last one comes when the car has passed."""
    people = {"behaviour": "reactive", "flow_per_hour": 900.0, "kerb_wait_s": 0.0}
    session = Scripted({"av": drive(3.0, *[7.0] * 40)})
    arm = played(session, model, pedestrians=people, arms={"av": OWN, "human": "human_yield"})
    known = [row for row in rows(arm, "people") if row["cleared_s"] is not None]
    late_s = [row["cleared_s"] - row["arrival_s"] - 8.0 / row["speed_mps"] for row in known]
    assert [row["delay_s"] for row in known] == pytest.approx(late_s)
    assert min(late_s) < -2.0 < known[-1]["delay_s"] == 0.0
