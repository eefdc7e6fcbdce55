"""An encounter in sumo-gui, in a process of its own."""

from pathlib import Path

from harness.core.vocabulary import Arm
from harness.engine.starting import session_of
from harness.engine.sumo_engine import SumoEngine
from harness.scenario import Scenario

_VIEW = Path(__file__).with_name("view.template.xml")
_PIXELS = (1280, 860)
"""Width and height of the window."""
_AROUND_M = 6.0
"""Length of road shown beyond the trigger and beyond the crosswalk."""


def window_options(delay_s: float = 0.1) -> dict[str, str]:
    """Options of sumo-gui: it begins at once, waits after each step, and closes at the end."""
    return {"start": "true", "quit-on-end": "true", "delay": f"{1000 * delay_s:.6g}"}


class Window(SumoEngine):
    """A SUMO engine that shows the crosswalk in real time.

    Args:
        scenario: the scenario.
        arm: whose ego is shown.

    Raises:
        EngineError: sumo-gui does not start (it needs a display) or does not answer.
    """

    def __init__(self, scenario: Scenario, arm: Arm) -> None:
        step_s = scenario.experiment.step_s
        options = window_options(step_s) | {"window-size": ",".join(map(str, _PIXELS))}
        v0_mps = scenario.ego.initial_speed_mps
        view = _VIEW.read_text("utf-8").format(v0_mps=v0_mps, half_mps=v0_mps / 2)
        files = {"gui-settings-file": view}
        super().__init__(session_of(scenario, options, files, "window"), scenario)
        self.automated = arm is Arm.AV
        reach_m = 0.7 * scenario.ego.trigger_range_m + _AROUND_M
        middle = self._frame.to_network(0.0, scenario.crossing.length_m / 2)
        self._session.look(*middle, reach_m)
