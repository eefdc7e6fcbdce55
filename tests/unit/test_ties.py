"""A tie of a strategy: the same shown within 1e-9, something else asked for."""

import pytest

from harness.core.encounter import PedestrianView, Side
from harness.episode.ties import Decision, tie_s
from tests.scenes import scenario, shown

SCENE = scenario()


def step(time_s: float, command: float | None, range_m=20.0, lateral_m=2.0, v=5.0) -> Decision:
    person = PedestrianView(0, Side.NEAR, lateral_m, 8.0, 1.0, True)
    return Decision(shown(SCENE, range_m, v, person, time_s=time_s), command)


LAST_BIT = 20.0 + 4e-15
STANDS = [step(0.0, -1.0, v=0.0), step(0.1, 0.0, 19.0)]


@pytest.mark.parametrize(
    ("one", "other", "when"),
    [
        ([step(0.0, 0.0)], [step(0.0, 0.0)], None),
        ([step(0.0, 0.0), step(0.1, -1.0)], [step(0.0, 0.0), step(0.1, 0.5, LAST_BIT)], 0.1),
        # Another place of the ego, or of somebody, before: an engine's doing.
        ([step(0.0, 0.0), step(0.1, -1.0)], [step(0.0, 0.0, 20.1), step(0.1, 0.5)], None),
        ([step(0.0, 0.0)], [step(0.0, 1.0, lateral_m=2.0 + 1e-8)], None),
        # Beyond what the car can do, or while it stands, both ask for the same.
        ([step(0.0, -20.0), step(0.1, 0.0)], [step(0.0, -30.0, LAST_BIT), step(0.1, 1.0)], 0.1),
        # Shown the same to the last bit: the strategy is not reproducible.
        ([step(0.0, 0.0), step(0.1, -1.0)], [step(0.0, 0.0), step(0.1, 0.5)], None),
        (STANDS, [step(0.0, -2.0, v=0.0), step(0.1, 1.0)], None),
        # A command that is no number ends the episode on both.
        ([step(0.0, float("nan"))], [step(0.0, float("nan"))], None),
        ([step(0.0, None)], [step(0.0, 1.0, LAST_BIT)], 0.0),
    ],
)
def test_first_step_at_which_the_commands_differ(one, other, when) -> None:
    assert tie_s(one, other) == when
