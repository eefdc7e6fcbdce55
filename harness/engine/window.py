"""An encounter in sumo-gui, in a process of its own."""

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from harness.core.encounter import Arm
from harness.engine.control import SumoEngine
from harness.engine.starting import session_of
from harness.scenario import Scenario

PEDESTRIAN_EXAGGERATION = 4
"""Factor by which pedestrians are drawn larger than they are."""

_BY_SPEED = 8
_UNIFORM = 1
"""Indices of sumo-gui's colouring schemes of vehicles and of persons."""

_PIXELS = (1280, 860)
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
        files = {"gui-settings-file": _view_settings(scenario.ego.initial_speed_mps)}
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


def _view_settings(v0_mps: float) -> str:
    """A settings file for ``--gui-settings-file``: at v0 the ego is blue, at standstill red."""
    colours = (("215,48,39", 0.0), ("254,224,144", 0.5), ("69,117,180", 1.0))
    speeds = "".join(
        f'<entry color="{colour}" threshold={quoteattr(f"{share * v0_mps:.6g}")}/>'
        for colour, share in colours
    )
    return f"""<viewsettings>
    <scheme name="crosswalk">
        <background backgroundColor="236,236,230" showGrid="0"/>
        <edges laneEdgeMode="0" laneShowBorders="1" showLinkDecals="1">
            <colorScheme name="uniform">
                <entry color="110,110,110" name="road"/>
                <entry color="180,180,180" name="sidewalk"/>
            </colorScheme>
        </edges>
        <vehicles vehicleMode="{_BY_SPEED}" vehicleQuality="2" vehicle_exaggeration="1">
            <colorScheme name="by speed" interpolated="1">{speeds}</colorScheme>
        </vehicles>
        <persons personMode="{_UNIFORM}" personQuality="2"
                 person_exaggeration="{PEDESTRIAN_EXAGGERATION}">
            <colorScheme name="uniform"><entry color="197,27,125"/></colorScheme>
        </persons>
        <junctions junctionMode="0" drawCrossingsAndWalkingareas="1">
            <colorScheme name="uniform"><entry color="110,110,110"/></colorScheme>
        </junctions>
    </scheme>
    <viewport x="0" y="0" zoom="1200"/>
</viewsettings>
"""
