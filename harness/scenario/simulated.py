"""``[simulation]``: a SUMO configuration of the user's own, which each pair simulates twice.

What its files define is not part of a scenario: they are read when a run opens them.
"""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from harness.scenario.sections import NonNegative, Positive, Section, Share


class SimulatedSection(Section):
    """``[simulation]``: a SUMO configuration, which each pair simulates twice.

    Its vehicles, people, traffic lights and options are SUMO's; strategies drive at the chosen
    crosswalks.  With ``pedestrians.flow_per_hour`` people of the harness come there too.
    """

    file: str
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
    """Outputs of the configuration to keep in the run folder, for example ``tripinfo``, ``fcd``,
    ``detectors``, or ``all``."""
    step_s: Annotated[float, Field(ge=0.001, le=0.2)] | None = None
    """Step of both arms; if not given, the configuration's, which is then at most 0.2 s."""


def with_nobody(tree: Mapping[str, Any]) -> dict[str, Any]:
    """The tree of a scenario with ``[simulation]``, to which nobody comes if no flow is given."""
    return {**tree, "pedestrians": {"flow_per_hour": 0.0, **tree.get("pedestrians", {})}}
