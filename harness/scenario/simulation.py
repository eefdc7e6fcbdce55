"""Every key of ``[simulation]``, with its meaning and default."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from harness.scenario.sections import NonNegative, Positive, Section, Share


class ReadSimulationSection(Section):
    """``[simulation.read]``: facts read from the configuration; the harness writes them.

    They are valid only for these ``config``, ``named``, ``range_m`` and ``step_s``.
    """

    config: str
    """The configuration's file."""
    named: Annotated[tuple[str, ...], Field(strict=False)]
    """The crosswalks that the scenario file names."""
    range_m: float
    """R0."""
    step_s: float | None
    """Step of both arms, if it is not the configuration's."""
    sha256: str
    """Hash of the configuration's network, route files and additional files."""
    crossings: Annotated[tuple[str, ...], Field(strict=False)]
    """The chosen crosswalks, and those that vehicles meet within R0 of them."""
    bent: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Those of them where no strategy may drive a car, since every way bends."""
    options: Mapping[str, str]
    """The configuration's options by SUMO's names, with absolute paths."""


class SimulationSection(Section):
    """``[simulation]``: a SUMO scenario of your own, which each pair simulates twice.

    Its vehicles, people, traffic lights and options are SUMO's; strategies drive at the chosen
    crosswalks.
    """

    config: str
    """The SUMO configuration (.sumocfg); it and its files are read where they are."""
    crossings: Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
    """Ids of the crosswalks, as ``harness crossings`` lists them."""
    av_share: Share = 1.0
    """Share of the vehicles of ``av_types`` that ``arms.av`` drives in the AV's arm."""
    av_types: Annotated[tuple[str, ...], Field(strict=False, min_length=1)] = ("passenger",)
    """Vehicle types or vehicle classes that may be AVs."""
    begin: NonNegative | None = None
    """Time in s from which trips and passages count; if not given, the simulation's begin."""
    end: Positive | None = None
    """Time in s until which trips and passages count; if not given, the simulation's end."""
    outputs: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Outputs of the scenario to keep in the run folder, for example ``tripinfo``, ``fcd``,
    ``detectors``, or ``all``."""
    step_s: Annotated[float, Field(ge=0.001, le=0.2)] | None = None
    """Step of both arms; if not given, the configuration's, which is then at most 0.2 s."""
    read: ReadSimulationSection | None = None
    """Facts that the harness read from the configuration; it writes them itself."""
