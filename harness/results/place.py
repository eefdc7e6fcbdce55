"""The place, the people and the cars of a run in one line, and the names of its cells."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.scenario.scenario import Scenario
from harness.scenario.sections import ActuationSection, PerceptionSection
from harness.scenario.study import as_written


def place_in_words(scenarios: Sequence[Scenario]) -> str:
    """The road, v0, the people, and what the cars' sensors and actuators get wrong.

    What differs between the scenarios is "varied".

    >>> place_in_words([Scenario()])
    'Road 9 m wide, 1 + 1 lanes; v0 5 m/s; 250 people/h from the trigger on.'
    >>> late = Scenario.model_validate({"actuation": {"dead_time_s": 0.3}})
    >>> place_in_words([late])
    'Road 9 m wide, 1 + 1 lanes; v0 5 m/s; 250 people/h from the trigger on; actuation of AV: \
dead_time_s 0.3.'
    """
    parts = []
    for name, words in _PARTS.items():
        texts = {words(scenario) for scenario in scenarios}
        parts.append(texts.pop() if len(texts) == 1 else f"{name} varied")
    line = "; ".join(filter(None, parts))
    return f"{line[0].upper()}{line[1:]}."


def short_names(keys: Sequence[str]) -> dict[str, str]:
    """The names of swept keys: their last part, or the whole key where several end alike.

    >>> short_names(["ego.length_m", "ego.width_m"])
    {'ego.length_m': 'length_m', 'ego.width_m': 'width_m'}
    >>> short_names(["ego.length_m", "crossing.length_m"])
    {'ego.length_m': 'ego.length_m', 'crossing.length_m': 'crossing.length_m'}
    """
    last = {key: key.rpartition(".")[2] for key in keys}
    ends = [*last.values()]
    return {key: key if ends.count(end) > 1 else end for key, end in last.items()}


def name_of(varied: Mapping[str, Any]) -> str:
    """A cell of a sweep by its varied keys, for example ``flow_per_hour 250, soft_yield``."""
    names, parts = short_names([*varied]), []
    for key, value in varied.items():
        if value is not None:
            name = "" if isinstance(value, str) else f"{names[key]} "
            parts.append(f"{name}{as_written(value)}")
    return ", ".join(parts)


def _road(scenario: Scenario) -> str:
    if scenario.simulation is not None:
        places, name = scenario.simulation.crossings, Path(scenario.simulation.file).name
        more = f" and {len(places) - 3} more" if len(places) > 3 else ""
        return f"{', '.join(places[:3])}{more} of {name}"
    crossing = scenario.crossing
    lanes = f"{crossing.lanes} + {crossing.oncoming_lanes} lanes"
    hiding = len(scenario.obstacles())
    hidden = f", {hiding} {'obstacle' if hiding == 1 else 'obstacles'}" if hiding else ""
    return f"road {as_written(crossing.length_m)} m wide, {lanes}{hidden}"


def _speed(scenario: Scenario) -> str:
    own = scenario.simulation is not None
    return "" if own else f"v0 {as_written(scenario.ego.initial_speed_mps)} m/s"


def _vehicles(scenario: Scenario) -> str:
    if (traffic := scenario.traffic) is not None:
        flows = as_written(traffic.flow_per_hour), as_written(traffic.oncoming_per_hour)
        return f"{' + '.join(flows)} vehicles/h, {100 * traffic.av_share:g} % AVs"
    if (own := scenario.simulation) is not None:
        return f"AVs: {100 * own.av_share:g} % of {' and '.join(own.av_types)}"
    return ""


def _people(scenario: Scenario) -> str:
    """Who walks, and since when."""
    people = scenario.pedestrians
    if scenario.simulation is not None and not people.anyone_comes:
        return "SUMO's people"
    if people.timed or people.drawn:
        return "timed pedestrians" if people.timed else "pedestrians selected by their outcome"
    if people.first_at_trigger and people.max_count == 1:
        return "one pedestrian, at the trigger"
    size = people.mean_group_size
    groups = f" in groups of {size:.3g} on average" if len(people.group_size) > 1 else ""
    before_s = people.warm_up_s
    begin = f"{as_written(before_s)} s before the trigger" if before_s else "the trigger on"
    since = f" from {begin}" if scenario.simulation is None else " and SUMO's people"
    return f"{as_written(people.flow_per_hour)} people/h{groups}{since}"


def _behaviour(scenario: Scenario) -> str:
    behaviour = scenario.pedestrians.behaviour
    return "" if behaviour == "constant" else f"behaviour {behaviour}"


def _of_arms(name: str, section: ActuationSection | PerceptionSection) -> str:
    """The keys of a section that are not at their default; empty if all are."""
    keys = section.changed(key for key in type(section).model_fields if key != "human")
    parts = [f"{key} {as_written(getattr(section, key))}" for key in keys]
    who = "AV and reference" if section.human else "AV"
    return f"{name} of {who}: {', '.join(parts)}" if parts else ""


_PARTS: Mapping[str, Callable[[Scenario], str]] = {
    "road": _road,
    "v0": _speed,
    "share of AVs": _vehicles,
    "people": _people,
    "behaviour": _behaviour,
    "actuation": lambda scenario: _of_arms("actuation", scenario.actuation),
    "perception": lambda scenario: _of_arms("perception", scenario.perception),
}
