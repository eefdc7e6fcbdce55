"""Delays and waits of those whom the end of a simulation finds at a crosswalk."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.core.encounter import Crossing
from harness.episode.simulation.passages import PersonTrack
from harness.episode.simulation.people import waited_s
from harness.site import RoadFrame
from harness.store.simulations.simulation_tables import least_delay_s

WAY: Any = SimpleNamespace(
    frame=RoadFrame(0.0, 0.0, 1.0, 0.0, 0.0, 1.0), crossing=Crossing(9.0, 4.0, 2.25, 4.5)
)


def test_a_passage_that_did_not_end_has_the_delay_until_then() -> None:
    """10 m in 10 s, where 5 m/s takes 2 s."""
    log: Any = SimpleNamespace(
        time_s=[100.0, 110.0],
        x_m=[-30.0, -20.0],
        vehicle=SimpleNamespace(initial_speed_mps=5.0),
    )
    assert least_delay_s(log) == pytest.approx(8.0)


@pytest.mark.parametrize(("steps_off", "expected_s"), [(True, 2.0), (False, 3.0)])
def test_whoever_never_steps_off_waits_until_the_end(steps_off: bool, expected_s: float) -> None:
    """They walk up to 0.5 m before the kerb within 1 s, and stand there from then on."""
    track = PersonTrack(
        "p",
        np.arange(5.0),
        np.zeros(5),
        np.array([-1.5, -0.5, -0.5, -0.5, 0.5 if steps_off else -0.5]),
        np.array([False] * 4 + [steps_off]),
    )
    assert waited_s(track, 1.0, WAY) == pytest.approx(expected_s)
