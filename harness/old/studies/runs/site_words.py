"""Describes the site and the traffic of a run in one line."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from harness.scenario import Scenario, as_written, by_quarter


def site_words(scenarios: Sequence[Scenario]) -> str:
    """Return the site, the initial speed and the traffic; values that differ are "varied".

    >>> site_words([Scenario()])
    'Site: road 9 m wide, 1 + 1 lanes; v0 5 m/s; 250 people/h.'
    >>> late = Scenario.model_validate({"actuation": {"dead_time_s": 0.3, "lag_s": 0.4}})
    >>> site_words([late])
    'Site: road 9 m wide, 1 + 1 lanes; v0 5 m/s; 250 people/h; AV: dead time 0.3 s, lag 0.4 s.'
    """

    def common(words: Callable[[Scenario], str], name: str) -> str:
        texts = {words(scenario) for scenario in scenarios}
        return texts.pop() if len(texts) == 1 else f"{name} varied"

    words = ((_actuation, "actuation"), (_perception, "perception"), (_hiding, "hiding"))
    cars = [common(*each) for each in words]
    if scenarios[0].kind == "own simulations":
        own = [common(*each) for each in VEHICLE_WORDS["own simulations"]]
        return f"Site: {'; '.join(filter(None, [*own, *cars]))}."
    parts = [common(_road, "road"), common(_speed, "v0"), common(_people, "people")]
    parts[2:2] = [common(*each) for each in VEHICLE_WORDS[scenarios[0].kind]]
    parts += [common(_behaviour, "behaviour"), *cars]
    return f"Site: {'; '.join(filter(None, parts))}."


def _road(scenario: Scenario) -> str:
    crossing = scenario.crossing
    lanes = f"{crossing.lanes} + {crossing.oncoming_lanes} lanes"
    return f"road {as_written(crossing.length_m)} m wide, {lanes}"


def _speed(scenario: Scenario) -> str:
    return f"v0 {as_written(scenario.ego.initial_speed_mps)} m/s"


def _share(scenario: Scenario) -> str:
    return f"{100 * scenario.known_traffic.av_share:.4g} % AVs"


def _vehicles(scenario: Scenario) -> str:
    traffic = scenario.known_traffic
    if traffic.saturated:
        return "vehicles queued"
    flows = (traffic.flow_per_hour, traffic.oncoming_per_hour)
    return f"{' + '.join(map(_flow, flows))} vehicles/h"


def _people(scenario: Scenario) -> str:
    people = scenario.pedestrians
    if people.timed or people.drawn:
        return "timed pedestrians" if people.timed else "selected pedestrians"
    if people.first_at_trigger and people.max_count == 1:
        return "one pedestrian, at the trigger"
    size = people.mean_group_size
    groups = f" in groups of {size:.3g} on average" if len(people.group_size) > 1 else ""
    return f"{_flow(people.flow_per_hour)} people/h{groups}"


def _behaviour(scenario: Scenario) -> str:
    """How people decide, if not by the paper's rule."""
    behaviour = scenario.pedestrians.behaviour
    return "" if behaviour == "constant" else f"behaviour {behaviour}"


def _actuation(scenario: Scenario) -> str:
    """How late the vehicles obey, if they do not obey at once."""
    actuation = scenario.actuation
    if actuation.is_off:
        return ""
    words = {
        "dead time {} s": actuation.dead_time_s,
        "lag {} s": actuation.lag_s,
        "jerk up to {} m/s³": actuation.max_jerk_mps3,
    }
    return f"{'both arms' if actuation.human else 'AV'}: {_set(words)}"


def _perception(scenario: Scenario) -> str:
    """What the vehicles' sensors get wrong, apart from what is hidden from them."""
    perception = scenario.perception
    if perception.is_perfect(scenario.experiment.step_s):
        return ""
    words = {
        "{} s late": perception.latency_s,
        "an update every {} s": perception.update_s,
        "{} % undetected": 100 * (1 - perception.detection_probability),
        "{} % lost": 100 * perception.dropout_probability,
        "errors of {} m": perception.position_sd_m,
        "errors of {} m/s": perception.speed_sd_mps,
    }
    return f"{'sensors of both arms' if perception.human else 'sensor of the AV'}: {_set(words)}"


def _hiding(scenario: Scenario) -> str:
    """Whether vehicles hide people; among encounters there are no other vehicles."""
    hides = scenario.perception.vehicles_hide and scenario.kind != "encounters"
    return "vehicles hide people from both arms" if hides else ""


def _set(words: Mapping[str, float | None]) -> str:
    """The words of values that are set and not 0."""
    return ", ".join(text.format(f"{value:.4g}") for text, value in words.items() if value)


def _flow(flow: float | tuple[float, ...]) -> str:
    """A flow, or the range of flows that change every quarter of an hour."""
    values = by_quarter(flow)
    return " to ".join(map(as_written, sorted({min(values), max(values)})))


def _config(scenario: Scenario) -> str:
    simulation = scenario.known_simulation
    return f"{', '.join(simulation.crossings)} of {Path(simulation.config).name}"


def _own_share(scenario: Scenario) -> str:
    simulation = scenario.known_simulation
    return f"{100 * simulation.av_share:.4g} % of {', '.join(simulation.av_types)} are AVs"


def _added_people(scenario: Scenario) -> str:
    flow = scenario.pedestrians.flow_per_hour
    return f"{as_written(flow)} people per hour added" if flow else "its own people"


VEHICLE_WORDS: Mapping[str, Sequence[tuple[Callable[[Scenario], str], str]]] = {
    "encounters": (),
    "own simulations": (
        (_config, "crosswalks"),
        (_own_share, "share of AVs"),
        (_added_people, "people"),
    ),
    "hours of traffic": ((_share, "share of AVs"), (_vehicles, "vehicles")),
}
"""The line's words about vehicles, and the name of the value that may vary, by kind of run."""
