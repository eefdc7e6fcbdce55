"""The shipped sites, whichever they are: every network below ``networks/``, and its crosswalk."""

from pathlib import Path

from harness.core.files import shipped_directory
from harness.engine.sources import plain_sources
from harness.scenario import Scenario, load_scenario
from harness.scenario.sections import CrossingSection
from harness.site.road_frame import RoadFrame

NETWORKS = shipped_directory("networks")


def frame_of(crossing: CrossingSection) -> RoadFrame:
    """The road frame of a crosswalk."""
    return RoadFrame.of(crossing.bearing_deg, crossing.length_m)


def to_road(crossing: CrossingSection, x_m: float, y_m: float) -> tuple[float, float]:
    """A point of the network in a crosswalk's road frame: turned back about the frame's origin."""
    frame = frame_of(crossing)
    ahead = complex(x_m - frame.origin_x_m, y_m - frame.origin_y_m)
    ahead /= complex(frame.along_x, frame.along_y)
    return ahead.real, ahead.imag


def shipped_nets() -> dict[str, Path]:
    """Every shipped network, by the stem of its files' names."""
    return {net.name.removesuffix(".net.xml"): net for net in sorted(NETWORKS.glob("*/*.net.xml"))}


def shipped_scenarios() -> dict[str, Scenario]:
    """Every shipped scenario, by name; of a study, what its cells start from."""
    names = sorted(file.stem for file in shipped_directory("scenarios").glob("*.toml"))
    return {name: load_scenario(name) for name in names}


def geometries() -> dict[str, CrossingSection]:
    """The crosswalk of each shipped network at which a shipped scenario takes place."""
    crosswalks = [scenario.crossing for scenario in shipped_scenarios().values()]
    return {
        name: geometry
        for name, net in shipped_nets().items()
        for geometry in crosswalks
        if all(
            net.with_name(file).is_file() and net.with_name(file).read_text("utf-8") == text
            for file, text in plain_sources(geometry, name).items()
        )
    }
