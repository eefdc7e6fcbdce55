"""Networks and demand that nobody here has seen: it runs, or says in one line why not."""

import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.encounter.arms import check_arms
from harness.model.interaction import InteractionModel
from harness.site import crosswalks_of, read_network
from tests import towns
from tests.batches import here, printed, refusal

pytestmark = pytest.mark.usefixtures("no_simulation")

NETWORKS: Mapping[str, tuple[str, ...]] = {
    "spider": ("--spider", "--spider.arm-number", "6", "--spider.circle-number", "3"),
    "random": ("--rand", "--rand.iterations", "60", "--seed", "4"),
    "left-hand": ("--grid", "--grid.number", "3", "--lefthand"),
    "three lanes": ("--grid", "--grid.number", "3", "--default.lanenumber", "3"),
    "lights": ("--grid", "--grid.number", "4", "--tls.set", "B1,C2"),
}


def usable(net: Path) -> list[str]:
    """Crosswalks without a light over which a lane leads straight for 30 m."""
    return [
        crosswalk.id
        for crosswalk in crosswalks_of(read_network(net))
        if not crosswalk.signalled
        and crosswalk.refused is None
        and any(way.is_straight(5.0) and way.straight_before_m >= 30 for way in crosswalk.ways)
    ]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in ("spider", "three lanes") else ())
        for name in NETWORKS
    ],
)
def test_a_network_of_netgenerate(name: str, model: InteractionModel, tmp_path: Path) -> None:
    arguments = ("--sidewalks.guess", "--crossings.guess", "-o", "net.net.xml")
    towns.call(tmp_path, "netgenerate", *NETWORKS[name], *arguments)
    config = towns.with_demand(tmp_path, 60, 1.0, 1.0)
    crossings = usable(tmp_path / "net.net.xml")
    assert crossings
    scenario = towns.scenario_of(config, [crossings[len(crossings) // 2]], arms__av="gap_yield")
    for arm in Arm:
        outcome = towns.run_arm(scenario, model, tmp_path / arm.value, arm)
        trips = [trip for trip in outcome.trips if not trip.person]
        # --validate drops trips without a route; everybody else is due once.
        text = (tmp_path / "vehicles.trips.xml").read_text()
        assert len(trips) == text.count("<trip ")
        assert {trip.name for trip in trips if trip.departed} == set(outcome.log.vehicles)


@pytest.fixture
def town(tmp_path: Path) -> Path:
    return towns.main_road(tmp_path, 30)


def toml(place: Path, **keys: object) -> Path:
    """A scenario file beside a configuration."""
    path = place.with_suffix(".toml")
    given = {"config": place.name, "crossings": [":b_c0"], **keys}
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in given.items())
    path.write_text(f"[simulation]\n{lines}[arms]\nav = 'soft_yield'\nhuman = 'sumo_driver'\n")
    return path


Change = Callable[[Path], None]


def option(name: str, value: str) -> Change:
    """Adds an option to the configuration, or replaces it."""

    def change(config: Path) -> None:
        lines = config.read_text()
        if f"<{name} " in lines:
            start = lines.index(f"<{name} ")
            lines = lines[:start] + lines[lines.index("/>", start) + 2 :]
        added = f'<{name} value="{value}"/></configuration>'
        config.write_text(lines.replace("</configuration>", added))

    return change


def demand(text: str, file: str = "vehicles.trips.xml") -> Change:
    """Replaces a file of the demand."""

    def change(config: Path) -> None:
        (config.parent / file).write_text(text)

    return change


def without_people(config: Path) -> None:
    demand("<routes/>", "people.trips.xml")(config)


REFUSED: Mapping[str, tuple[Change, tuple[str, ...]]] = {
    "one second": (option("step-length", "1"), ("step-length", "1 s", "simulation.step_s")),
    "meso": (option("mesosim", "true"), ("mesosim", "not supported")),
    "sublane": (option("lateral-resolution", "0.8"), ("lateral-resolution", "not supported")),
    "people without space": (
        option("pedestrian.model", "nonInteracting"),
        ("pedestrian.model", "nonInteracting", "striping"),
    ),
    "JuPedSim": (option("pedestrian.model", "jupedsim"), ("pedestrian.model", "jupedsim")),
    "a state": (option("load-state", "state.xml"), ("town.sumocfg",)),
    "a client": (option("remote-port", "8813"), ("remote-port", "client")),
    "no vehicles": (demand("<routes/>"), ("no vehicle comes",)),
    "no people": (without_people, ("nobody comes on foot", "flow_per_hour")),
    "no network": (option("net-file", "none.net.xml"), ("none.net.xml",)),
    "no routes": (option("route-files", "none.rou.xml"), ("none.rou.xml",)),
    "no such option": (option("step-lenght", "1"), ("step-lenght",)),
    "not XML": (demand("<routes><vehicle"), ("vehicles.trips.xml", "XML")),
    "an unknown edge": (
        demand('<routes><trip id="x" depart="0" from="nowhere" to="a_b"/></routes>'),
        ("nowhere",),
    ),
    "no such type": (
        demand('<routes><trip id="x" type="none" depart="0" from="w_a" to="a_b"/></routes>'),
        ("none",),
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_one_line_says_why_not(
    name: str, town: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    change, parts = REFUSED[name]
    change(town)
    path = toml(town)
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    line = refusal("run", path, "--pairs", 1, "--out", tmp_path / "run")
    for part in parts:
        assert part in line, line
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("keys", "parts"),
    [
        ({"crossings": [":b_c9"]}, (":b_c9", ":b_c")),
        ({"config": "towm.sumocfg"}, ("towm.sumocfg",)),
        ({"av_types": ["pasenger"]}, ("'pasenger'", "'passenger'")),
        ({"av_types": ["passenger", "bus"]}, ("no vehicle of 'bus' comes", "passenger")),
        ({"outputs": ["fdc"]}, ("fdc",)),
        ({"begin": 40.0}, ("simulation.begin", "40 s")),
        ({"step_s": 0.5}, ("step_s",)),
    ],
)
def test_a_wrong_key_of_simulation(
    keys: dict[str, object], parts: tuple[str, ...], town: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = toml(town, **keys)
    monkeypatch.chdir(town.parent)
    line = refusal("run", path, "--pairs", 1, "--out", town.parent / "run")
    for part in parts:
        assert part in line, line
    assert not (town.parent / "run").exists()


def test_no_type_is_listed_twice(town: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A type may have its class's name."""
    come = [("bus", "bus"), ("pkw", "passenger")]
    monkeypatch.setattr("harness.scenario.own_simulation.types_that_come", lambda _config: come)
    path = toml(town, av_types=["lkw"])
    assert "comes: bus, passenger, pkw" in refusal("run", path, "--out", town.parent / "run")


def test_a_crosswalk_with_a_light_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = towns.grid(tmp_path, 10)
    path = toml(config, crossings=[":C2_c0"])
    monkeypatch.chdir(tmp_path)
    line = refusal("run", path, "--pairs", 1, "--out", tmp_path / "run")
    assert "traffic light" in line


def test_demand_in_additional_and_included_files(town: Path, model: InteractionModel) -> None:
    folder = town.parent
    for name in ("vehicles", "people"):
        (folder / f"{name}.trips.xml").rename(folder / f"{name}.xml")
    (folder / "all.add.xml").write_text(
        '<additional><include href="vehicles.xml"/><include href="people.xml"/></additional>'
    )
    text = town.read_text()
    start = text.index("<route-files")
    text = text[:start] + text[text.index("/>", start) + 2 :]
    town.write_text(
        text.replace("</configuration>", '<additional-files value="all.add.xml"/></configuration>')
    )
    scenario = towns.scenario_of(town, [":b_c0"])
    outcome = towns.run_arm(scenario, model, folder / "arm")
    trips = [trip for trip in outcome.trips if not trip.person]
    assert len(trips) == (folder / "vehicles.xml").read_text().count("<trip ")


def test_the_command_runs_a_scenario_with_long_steps(
    town: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    option("step-length", "1")(town)
    path = toml(town, step_s=0.1)
    monkeypatch.chdir(town.parent)
    printed("run", path, "--pairs", 1, "--out", "run")
    assert (town.parent / "run/manifest.json").is_file()


def test_a_folder_may_have_spaces_and_percent_signs(
    town: Path, model: InteractionModel, tmp_path: Path
) -> None:
    """SUMO writes "%20" for a space in a configuration, and reads it as a space."""
    folder = tmp_path / "my %20 town"
    shutil.copytree(town.parent, folder, ignore=lambda *_: [folder.name])
    outcome = towns.run_arm(towns.scenario_of(folder / town.name, [":b_c0"]), model, tmp_path / "a")
    assert outcome.reason is None


def test_a_run_in_which_every_pair_fails_ends_in_words(
    town: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = toml(town)
    path.write_text(path.read_text().replace("soft_yield", "fails_always:Mine"))
    fails = "class Mine:\n    def decide(self, observation):\n        raise RuntimeError\n"
    (town.parent / "fails_always.py").write_text(fails)
    monkeypatch.chdir(town.parent)
    done = here("run", path, "--pairs", 1, "--out", "run")
    assert "Traceback" not in done.stderr
    assert "1 of 1 pair failed" in done.stdout


def test_the_box_of_the_model_is_checked_at_the_limit_of_the_road(
    town: Path, model: InteractionModel
) -> None:
    # The main road's limit, as the test's network has it.
    scenario = towns.scenario_of(town, [":b_c0"], arms__human="human_gmm")
    with pytest.raises(InputError, match=r":b_c0.*13.89 m/s is outside the box"):
        check_arms(scenario, model)
    # SUMO walks the added people, so no model is asked, and R0 may be outside its box.
    people = {"pedestrians__flow_per_hour": 100.0, "ego__trigger_range_m": 80.0}
    check_arms(towns.scenario_of(town, [":b_c0"], **people), model)


def test_a_crosswalk_where_no_strategy_may_drive_is_named(
    town: Path, model: InteractionModel, tmp_path: Path
) -> None:
    # The side streets at c are 150 m long, so from nowhere on them 300 m lead straight to c.
    side = next(
        each.id
        for each in crosswalks_of(read_network(town.parent / "net.net.xml"))
        if {way.from_edge for way in each.straight_ways} == {"cn_c", "cs_c"}
    )
    near = towns.scenario_of(town, [side]).known_simulation.read
    far = towns.scenario_of(town, [side], ego__trigger_range_m=300.0)
    read = far.known_simulation.read
    assert near is not None
    assert read is not None
    assert near.bent == ()
    assert side in read.bent
    outcome = towns.run_arm(far, model, tmp_path / "arm")
    over = [each for each in outcome.log.passages if each.driven_way.way.crosswalk == side]
    assert all(each.not_driven is not None for each in over)


@pytest.mark.slow
def test_several_thousand_vehicles(model: InteractionModel, tmp_path: Path) -> None:
    arguments = ("--grid", "--grid.number", "10", "--default.lanenumber", "2", "-j", "priority")
    more = ("--sidewalks.guess", "--crossings.guess", "-o", "net.net.xml")
    towns.call(tmp_path, "netgenerate", *arguments, *more)
    config = towns.with_demand(tmp_path, 600, 0.2, 1.0)
    crossings = usable(tmp_path / "net.net.xml")
    scenario = towns.scenario_of(config, crossings[:10], arms__av="gap_yield")
    outcome = towns.run_arm(scenario, model, tmp_path / "arm")
    assert len([trip for trip in outcome.trips if not trip.person]) > 2500
