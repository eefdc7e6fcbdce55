"""An encounter in sumo-gui, in a process of its own."""

from collections.abc import Sequence
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

_EVERY_S = 0.5
"""Simulated time between two screenshots."""


class Window(SumoEngine):
    """A SUMO engine that shows the crosswalk in real time and takes screenshots.

    Args:
        scenario: the scenario.
        arm: whose ego is shown.
        screenshots: folder for PNG files; None for no screenshots.

    Raises:
        EngineError: sumo-gui does not start (it needs a display) or does not answer.
    """

    def __init__(self, scenario: Scenario, arm: Arm, screenshots: Path | None) -> None:
        self._screenshots, step_s = screenshots, scenario.experiment.step_s
        options = {"start": "true", "quit-on-end": "true", "delay": f"{1000 * step_s:.6g}"}
        options["window-size"] = ",".join(map(str, _PIXELS))
        v0_mps = scenario.ego.initial_speed_mps
        view = _VIEW.read_text("utf-8").format(v0_mps=v0_mps, half_mps=v0_mps / 2)
        files = {"gui-settings-file": view}
        super().__init__(session_of(scenario, options, files, "gui"), scenario)
        self.automated = arm is Arm.AV
        reach_m = 0.7 * scenario.ego.trigger_range_m + _AROUND_M
        middle = self._frame.to_network(0.0, scenario.crossing.length_m / 2)
        self._session.look(*middle, reach_m)

    def step(self, speed_mps: float, pedestrians: Sequence[tuple[int, float]]) -> float:
        """See ``Engine.step``."""
        if self._screenshots and not self._steps % max(1, round(_EVERY_S / self._step_s)):
            # Of the end of this step.
            file = self._screenshots / f"t-{(self._steps + 1) * self._step_s:07.3f}-s.png"
            self._session.screenshot(file, *_PIXELS)
        return super().step(speed_mps, pedestrians)
