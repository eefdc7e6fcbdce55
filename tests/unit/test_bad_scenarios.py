"""What is said of mistakes in a scenario: one line with the place, the value and what is allowed.

A case is a shipped scenario with settings as of ``--set``, and what the line must have.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import harness
from docs.hooks.reference import sections_of
from harness.encounter.arms import check_arms
from harness.model.interaction import InteractionModel
from harness.scenario import Cell, Scenario, Study, load_scenario, read_scenario_file, study_of
from harness.scenario.file import parse_setting
from harness.scenario.pedestrians import ThresholdSection
from harness.scenario.sections import Only
from harness.scenario.variation import parse_variation
from tests.scenes import refusal_of


def table(**values: Any) -> str:
    """An inline table of TOML, without a space."""
    return "{" + ",".join(f"{key}={value!r}" for key, value in values.items()) + "}"


def obstacle(**changes: Any) -> str:
    """A car beside the path of the ego, which drives in y = 1.35 … 3.15 m, with changes."""
    car = {"x_m": -4.0, "y_m": -1.0, "length_m": 4.2, "width_m": 1.8, **changes}
    return f"crossing.obstacles=[{table(**car)}]"


def timed(**changes: Any) -> str:
    """Euro NCAP's CPNA-25 before a car of 10 m/s, with changes."""
    walker = {"side": "near", "start_lateral_m": 4.0, "acceleration_distance_m": 1.0}
    walker |= {"speed_mps": 1.3889, "impact_share": 0.25, **changes}
    ego = "ego.initial_speed_mps=10 ego.trigger_range_m=70"
    return f"cctc_flow {ego} pedestrians.flow_per_hour=0 pedestrians.timed=[{table(**walker)}]"


CLASSES = f"[{table(share=0.5, mean_mps=1.0)},{table(share=0.6, mean_mps=1.2)}]"
PEOPLE = "cctc_flow pedestrians"
FILE = "simulation.file=my.sumocfg simulation.crossings=[':J_c0']"

BAD_SETTINGS = [
    # Keys that are none, and tables that are no tables.
    (f"{PEOPLE}.gap_acceptance.mean=3", "gap_acceptance.mean | 'mean_s'"),
    ("cctc ego=4", "settings ego | 4 | allowed: a table"),
    ("cctc ego.length_m.x=4", "settings ego.length_m.x | not a table"),
    ("cctc ego.length_m", "settings ego.length_m | not of the form key=value"),
    ("cctc ego..length_m=4", "settings ego..length_m | not a dotted key"),
    # Values of another type or outside their range.
    ("cctc ego.length_m=long", "settings ego.length_m | 'long' | number, in m"),
    ("cctc ego.length_m=true", "ego.length_m | True | number"),
    ("cctc ego.length_m=nan", "ego.length_m | nan | finite"),
    ("cctc arms.av=3", "arms.av | 3 | text"),
    (f"{PEOPLE}.timed=4", "pedestrians.timed | 4 | allowed: an array"),
    (f"{PEOPLE}.first_at_trigger=1", "1 | allowed: true or false"),
    (f"{PEOPLE}.max_count=1.5", "pedestrians.max_count | 1.5 | whole number"),
    (f"{PEOPLE}.behaviour=fast", "pedestrians.behaviour | 'fast' | reactive"),
    (f"{PEOPLE}.near_side_share=1.5", "near_side_share | 1.5 | less than or equal to 1"),
    ("cctc ego.initial_speed_mps='50knots'", "ego.initial_speed_mps | m/s, km/h, mph, ft/s"),
    # Values that do not fit others.
    ("cctc ego.trigger_range_m=3.4", "ego.trigger_range_m | 3.4 m | at least | 3.5 m"),
    ("cctc experiment.step_s=0.0333", "experiment.step_s | 0.0333 | multiple of 0.001"),
    ("cctc experiment.timeout_s=0.05", "experiment.timeout_s | 0.05 | 0.1"),
    ("cctc crossing.lanes=2 crossing.lane_width_m=3.5", "crossing.lane_width_m | = 3 m"),
    ("cctc crossing.lanes=3 crossing.oncoming_lanes=3", "ego.width_m | at most 1 m"),
    ("cctc crossing.grade=-0.2 crossing.friction=0.1", "crossing.grade | with -0.2 | not brake"),
    ("fmvss_127 crossing.latitude_deg=5", "crossing.longitude_deg | not given | both or neither"),
    ("cctc crossing.grade=0.4", "crossing.grade | not drive on"),
    # What is seen, and what hides it.
    ("cctc perception.latency_s=0.25", "perception.latency_s"),
    (f"cctc {obstacle(y_m=0.5)}", "settings crossing.obstacles.0.y_m | ego's path"),
    (f"cctc {obstacle(x_m=-2.2)}", "settings crossing.obstacles.0.x_m"),
    (f"cctc {obstacle(case='CPNA')}", "crossing.obstacles.0.case | unknown case 'CPNA'"),
    # People.
    (timed(start_lateral_m=1.15), "timed.0.start_lateral_m | 1.15 m | path"),
    # 3.55 m at 0.4 m/s, 1 m of it from rest, take 11.375 s; the car is there in 6.975 s.
    (timed(speed_mps=0.4), "timed.0.speed_mps | 4.4 s before the trigger | 114 m"),
    (f"{PEOPLE}.group_size=[0.5,0.4]", "the shares sum to 0.9; allowed: shares that sum"),
    (f"{PEOPLE}.group_size=[0,1] pedestrians.drawn=[{table(episode=0)}]", "come one by one"),
    (f"{PEOPLE}.walking_speed.classes={CLASSES}", "walking_speed.mean_mps"),
    (f"{PEOPLE}.walking_speed={{mean_mps=1.4,classes={CLASSES}}}", "the shares sum to 1.1"),
    # Vehicles of a simulation.
    ("traffic experiment.pairs=1000004", "experiment.pairs | 1,000,004 | at most 1,000,003"),
    ("traffic traffic.flow_per_hour=1900", "traffic.flow_per_hour | below 1895"),
    ("traffic crossing.oncoming_lanes=0", "traffic.oncoming_per_hour | on 0 lanes; allowed: 0, "),
    ("traffic traffic.tau_s=0.05", "traffic.tau_s | 0.05 s | at least experiment.step_s"),
    # Strategies and their parameters.
    ("cctc arms.av=soft_yeild", "arms.av | 'soft_yeild' | did you mean 'soft_yield'"),
    ("cctc strategies.human_gmm.decision_interval_s=0.25", "decision_interval_s | 0.25 | whole st"),
    # Sweeps.
    ("cctc --vary=ego.length_m=5 --vary=ego.length_m=6", "ego.length_m | twice"),
    ("cctc --vary=ego.length_m=5,4,5.0", "cells 0 and 2 are the same | ego.length_m=5.0"),
    ("cctc --vary=experiment.pairs=10,20", "experiment.pairs | cannot vary | one number of pairs"),
    (
        "cctc arms.av=gap_yield --vary=strategies.gap_yeild.critical_gap_s=1,2",
        "vary strategies | gap_yeild drives in no cell",
    ),
    ("aggressiveness arms.av=hard_yield", "sweep arms.av | arms.av is also set, to 'hard_yield'"),
    ("cctc --vary=pedestrians.flow_per_hour=9,50", "vary pedestrians.flow_per_hour | no effect"),
    (f"{PEOPLE}.behaviour=gap_acceptance pedestrians.kerb_wait_s=1", "kerb_wait_s | default 2.0"),
]


@pytest.mark.parametrize(("words", "said"), BAD_SETTINGS, ids=lambda text: text[:70])
def test_bad_settings(model: InteractionModel, words: str, said: str) -> None:
    name, *texts = words.split()
    vary = [text.removeprefix("--vary=") for text in texts if text.startswith("--vary=")]

    def use() -> None:
        settings = [parse_setting(text) for text in texts if not text.startswith("--vary=")]
        file = read_scenario_file(name, settings)
        for cell in study_of(file, [parse_variation(text) for text in vary]).cells:
            check_arms(cell.scenario, model)

    refusal_of(use, *said.split(" | "))


TRAFFIC, SUMO = "traffic.tau_s=1", f"{FILE} arms.av=sumo_driver"
THRESHOLDS = " ".join(f"{key}=0.5" for key in ThresholdSection.model_fields)
CONDITIONS = f"""
{FILE} | crossing. | bearing_deg=0 length_m=8 width_m=5 lanes=2 oncoming_lanes=0 lane_width_m=4
{FILE} | crossing. | latitude_deg=1 longitude_deg=1 road_speed_limit_mps=9 grade=0.1 friction=0.7
{FILE} | ego. | width_m=1.7 length_m=4 initial_speed_mps=8 max_deceleration_mps2=5 lane=1
{FILE} | | experiment.step_s=0.05 model.pedestrian_reading=unconditional pedestrians.max_count=3
{TRAFFIC} | | experiment.timeout_s=30 conflicts.time_advantage_s=1 ego.max_acceleration_mps2=2
{TRAFFIC} | | pedestrians.warm_up_s=9 pedestrians.first_at_trigger=true {timed().split()[-1]}
{TRAFFIC} experiment.pairs=1 | | pedestrians.drawn=[{table(episode=0)}] {obstacle()}
{SUMO} | pedestrians. | behaviour=reactive kerb_wait_s=1 near_side_share=1 group_size=[0,1]
{SUMO} | perception. | detection_probability=0 dropout_probability=1 latency_s=1 position_sd_m=1
{SUMO} | | pedestrians.walking_speed.mean_mps=1 perception.update_s=2 perception.speed_sd_mps=1
pedestrians.first_at_trigger=true pedestrians.max_count=1 | | pedestrians.flow_per_hour=9
| pedestrians.gap_acceptance. | mean_s=3 std_s=1 distribution=logistic
| pedestrians.threshold. | {THRESHOLDS}
| | perception.correlation_s=2 perception.human=true perception.occlusion=false actuation.human=true
model.path=mine.json | | model.name=dut-k10
traffic.saturated=true | traffic. | flow_per_hour=9 oncoming_per_hour=9
"""
"""Settings with which keys have no effect, how the keys begin, and the keys with a value."""
CASES = [
    [*base.split(), start.strip() + setting]
    for base, start, keys in (line.split("|") for line in CONDITIONS.strip().splitlines())
    for setting in keys.split()
]


@pytest.mark.parametrize("settings", CASES, ids=lambda settings: settings[-1][:60])
def test_a_key_without_effect_is_refused(tmp_path: Path, settings: list[str]) -> None:
    (tmp_path / "mine.toml").touch()
    said = f"settings {settings[-1].partition('=')[0]}: has no effect; allowed: its default"
    given = [*map(parse_setting, settings)]
    refusal_of(lambda: load_scenario(tmp_path / "mine.toml", given), said, "another value only ")


def test_every_key_with_a_condition_is_tested() -> None:
    assert {settings[-1].partition("=")[0] for settings in CASES} == {
        f"{heading.strip('[]')}.{key}"
        for heading, section in sections_of(Scenario)
        for key, field in section.model_fields.items()
        if any(isinstance(each, Only) for each in field.metadata)
    }


def test_a_key_of_a_sweep_has_an_effect_in_a_cell() -> None:
    file = read_scenario_file("cctc_flow", {"pedestrians.threshold.factor": 0.8})
    assert len(study_of(file, [("pedestrians.behaviour", ["constant", "threshold"])]).cells) == 2


BAD_FILES = [
    ("[ego\n", "not a TOML file"),
    ("[sweep]\narms.av = 'soft_yield'", "arms.av | list"),
    ("[sweep]\narms.av = []", "arms.av | no values"),
    ("[sweep]", "nothing to vary"),
    ("sweep = 3", "sweep | table"),
    ("[sweep]\ntraffic.flow_per_hour = [100, 200]", "different kinds | in the file and every cell"),
    ("[sweep]\ncells = 3", "sweep.cells"),
    ("[sweep]\narms.av = ['hard_yield']\n[[sweep.cells]]\nego.length_m = 5.0", "arms"),
]


@pytest.mark.parametrize(("text", "said"), BAD_FILES)
def test_bad_files(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    refusal_of(lambda: study_of(read_scenario_file(path)), *said.split(" | "))


BAD = Scenario.model_validate({"perception": {"occlusion": False}})
"""Without obstacles; each key alone is accepted."""


@pytest.mark.parametrize(
    "door",
    [
        lambda: harness.run(BAD, pairs=1, engine="plain"),
        lambda: harness.run(Study("mine", BAD, (Cell(0, {}, BAD),)), engine="plain"),
        lambda: harness.evaluate(BAD, [{"arms.av": "hard_yield"}], range(1), engine="plain"),
        lambda: harness.run_pair(BAD, engine="plain"),
        lambda: harness.check_strategy("hard_yield", scenario=BAD),
        lambda: harness.CrosswalkEnv(BAD, engine="plain"),
    ],
)
def test_every_door_refuses_what_a_file_may_not_say(door: Callable[[], object]) -> None:
    refusal_of(door, "perception.occlusion: has no effect; allowed: its default")
    lane = Scenario.model_validate({"ego": {"lane": 5}})
    refusal_of(lambda: Cell(0, {}, lane), "ego.lane: there is no lane 5")


def test_no_door_takes_a_model_key_if_nobody_asks_the_model() -> None:
    people, arms = {"walking_speed": {"mean_mps": 1.4, "std_mps": 0.2}}, {"human": "human_yield"}
    tree = {"model": {"extrapolate": True}, "arms": arms, "pedestrians": people}
    evaluate = partial(harness.evaluate, candidates=[{}], pairs=1)
    for door in (harness.run, harness.run_pair, evaluate):
        alone = partial(door, Scenario.model_validate(tree), engine="plain")
        refusal_of(alone, "model.extrapolate: has no effect: nobody asks the model")


def test_who_comes_in_a_simulation_is_in_the_schema() -> None:
    for people, flow in (({}, 0.0), ({"flow_per_hour": 9.0}, 9.0)):
        tree = {"simulation": {"file": "my.sumocfg", "crossings": [":J_c0"]}, "pedestrians": people}
        assert Scenario.model_validate(tree).pedestrians.flow_per_hour == flow
