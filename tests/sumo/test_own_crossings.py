"""``harness crossings`` of a SUMO configuration: its counts, its table, and the file it writes."""

import json
import re
from pathlib import Path

import pytest

from harness.model.interaction import InteractionModel
from harness.old.store.simulations.simulation_catalogue import AVS_NOT_DRIVEN
from harness.old.store.simulations.simulation_tables import simulation_rows
from harness.scenario import load_scenario
from harness.scenario.own_simulation import setting_of
from tests import towns
from tests.batches import here, printed

ROUTES = {
    # Straight on over the crosswalks of the west and the east arm of junction B1.
    **{f"straight{number}": "A1B1 B1C1" for number in range(4)},
    "back": "C1B1 B1A1",
    # Over the west arm's crosswalk, then to the left or to the right.
    "left": "A1B1 B1B2",
    "right": "A1B1 B1B0",
    # It leaves B1 before the counted crosswalks: it departs beyond them.
    "beyond": "B1C1 C1C2",
}
WALKS = {"up0": "B0B1 B1B2", "up1": "B0B1 B1B2", "down": "B2B1 B1B0", "stays": "B0B1"}
"""Whoever goes up walks on the east side and crosses the east arm."""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A grid of 3 × 3 junctions for half an hour, with a step of 1 s."""
    folder = tmp_path_factory.mktemp("grid")
    words = "--grid --grid.number 3 --grid.length 120 --sidewalks.guess --crossings.guess"
    words += " --default.sidewalk-width 2 -o grid.net.xml"
    towns.call(folder, "netgenerate", *words.split())
    vehicles = "".join(
        f'<vehicle id="{name}" depart="{20 * number}"><route edges="{edges}"/></vehicle>'
        for number, (name, edges) in enumerate(ROUTES.items())
    )
    # It stops before the crosswalk until after the end.
    vehicles += (
        '<vehicle id="stops" depart="400"><route edges="A1B1 B1C1"/>'
        '<stop edge="A1B1" endPos="50" duration="9999"/></vehicle>'
    )
    people = "".join(
        f'<person id="{name}" depart="500"><walk edges="{edges}"/></person>'
        for name, edges in WALKS.items()
    )
    (folder / "town.rou.xml").write_text(f"<routes>{vehicles}{people}</routes>")
    (folder / "town.sumocfg").write_text(
        '<configuration><input><net-file value="grid.net.xml"/><route-files value="town.rou.xml"/>'
        '</input><time><end value="1800"/></time></configuration>'
    )
    return folder / "town.sumocfg"


def listed(config: Path) -> dict[str, dict[str, object]]:
    done = printed("crossings", config, "--json")
    return {row["edge"]: row for row in json.loads(done)["crossings"]}


def arm(rows: dict[str, dict[str, object]], road: str) -> dict[str, object]:
    """The crosswalk over a road at junction B1."""
    (row,) = (row for row in rows.values() if road in str(row["streets"]) and ":B1" in row["edge"])  # type: ignore[operator]
    return row


def test_counts_by_hand(scenario: Path) -> None:
    before = {path: path.read_bytes() for path in scenario.parent.iterdir()}
    rows = listed(scenario)
    # In half an hour a vehicle or a person is 2 per hour.  East: four straight on and one back,
    # straight too; nobody turns into the arm.  West: these and two who turn.
    east, west = arm(rows, "B1C1"), arm(rows, "A1B1")
    names = ("vehicles_per_hour", "straight_per_hour", "people_per_hour")
    assert [east[name] for name in names] == pytest.approx([10, 10, 4], rel=1e-3)
    assert [west[name] for name in names] == pytest.approx([14, 10, 2], rel=1e-3)
    assert [arm(rows, "B1B2")["vehicles_per_hour"], arm(rows, "B1B0")["vehicles_per_hour"]] == (
        pytest.approx([2, 2], rel=1e-3)
    )
    assert {path: path.read_bytes() for path in scenario.parent.iterdir()} == before
    usable = [bool(row["usable"]) for row in rows.values()]
    assert usable == sorted(usable, reverse=True)


def test_the_table(scenario: Path) -> None:
    done = printed("crossings", scenario)
    assert re.search(
        r"town\.sumocfg: \d+ crosswalks, \d+ usable, counted for 1,800 s", " ".join(done.split())
    )
    (line,) = (line for line in done.splitlines() if line.strip().startswith(":B1_c1"))
    assert line.rstrip().endswith("yes")


def test_a_written_file_is_a_scenario(scenario: Path, tmp_path: Path) -> None:
    out = tmp_path / "town.toml"
    edges = ("--edge", ":B1_c1", "--edge", ":B1_c3")
    done = here("crossings", scenario, "--write", out, *edges)
    assert (done.returncode, done.stdout.strip()) == (0, str(out)), done.stderr
    written = load_scenario(out)
    simulation = written.known_simulation
    # The configuration's step is SUMO's 1 s.
    assert (simulation.crossings, simulation.step_s) == ((":B1_c1", ":B1_c3"), 0.1)
    assert written.arms.human == "sumo_driver"
    # 13.89² / 4 = 48.2, on the next 5 m.
    assert written.ego.trigger_range_m == 50.0
    again = here("crossings", scenario, "--write", out, *edges)
    assert again.returncode == 2
    assert "exists" in again.stderr


def test_a_fine_step_stays(scenario: Path, tmp_path: Path) -> None:
    config = scenario.parent / "fine.sumocfg"
    text = scenario.read_text().replace("<time>", '<time><step-length value="0.2"/>')
    config.write_text(text)
    out = tmp_path / "town.toml"
    printed("crossings", config, "--write", out, "--edge", ":B1_c1")
    assert load_scenario(out).known_simulation.step_s is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--write {new} --edge :B1_c9", "no crossing ':B1_c9'"),
        ("--write {new}", "--write: needs --edge"),
        ("--edge :B1_c1", "--edge: needs --write"),
        ("--write {new}/deeper.toml --edge :B1_c1", "cannot be written"),
    ],
)
def test_refusals(scenario: Path, tmp_path: Path, arguments: str, words: str) -> None:
    new = tmp_path / "new.toml"
    done = here("crossings", scenario, *arguments.format(new=new).split())
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert not new.exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("grid.net.xml", "none.net.xml", "none.net.xml"),
        ("town.rou.xml", "none.rou.xml", "none.rou.xml"),
        ("<time>", "<unheard-of value='1'/><time>", "unheard-of"),
    ],
)
def test_damaged_configurations(scenario: Path, old: str, new: str, words: str) -> None:
    config = scenario.parent / "damaged.sumocfg"
    config.write_text(scenario.read_text().replace(old, new))
    done = here("crossings", config)
    config.unlink()
    assert (done.returncode, done.stdout) == (2, "")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_light_is_the_reason(scenario: Path) -> None:
    folder = scenario.parent
    words = "-s grid.net.xml --tls.set B1 -o lights.net.xml"
    towns.call(folder, "netconvert", *words.split())
    config = folder / "lights.sumocfg"
    config.write_text(scenario.read_text().replace("grid.net.xml", "lights.net.xml"))
    rows = listed(config)
    assert rows[":B1_c1"]["problem"] == "a traffic light controls it"
    done = here("crossings", config, "--write", folder / "no.toml", "--edge", ":B1_c1")
    assert (done.returncode, "a traffic light controls it" in done.stderr) == (2, True)
    assert not (folder / "no.toml").exists()


def bent(folder: Path, *crossed: str, bend_m: float = 40.0) -> Path:
    """A road with a crosswalk at x = 200 m, whose eastern approach bends so far before it."""
    (folder / "n.nod.xml").write_text(
        '<nodes><node id="w" x="0" y="0"/><node id="x" x="200" y="0" type="priority"/>'
        '<node id="e" x="400" y="30"/></nodes>'
    )
    edge = '<edge id="{}" from="{}" to="{}" numLanes="1" speed="13.89" sidewalkWidth="2" {}/>'
    edges = [("w_x", "w", "x", ""), ("x_w", "x", "w", "")]
    edges += [("x_e", "x", "e", f'shape="200,0 {200 + bend_m},0 400,30"')]
    edges += [("e_x", "e", "x", f'shape="400,30 {200 + bend_m},0 200,0"')]
    text = "".join(edge.format(*each) for each in edges)
    (folder / "e.edg.xml").write_text(f"<edges>{text}</edges>")
    lines = [f'<crossing node="x" edges="{each}" width="4"/>' for each in crossed or ["w_x x_w"]]
    (folder / "c.con.xml").write_text(f"<connections>{''.join(lines)}</connections>")
    files = ("-n", "n.nod.xml", "-e", "e.edg.xml", "-x", "c.con.xml", "-o", "net.net.xml")
    towns.call(folder, "netconvert", *files, "--no-turnarounds")
    vehicles = '<vehicle id="{0}" depart="0"><route edges="{0} {1}"/></vehicle>'
    for name, ways in (("one", [("w_x", "x_e")]), ("both", [("w_x", "x_e"), ("e_x", "x_w")])):
        routes = "".join(vehicles.format(*way) for way in ways)
        (folder / f"{name}.rou.xml").write_text(f"<routes>{routes}</routes>")
        options = {"net-file": "net.net.xml", "route-files": f"{name}.rou.xml", "end": "100"}
        towns.write_config(folder, options, f"{name}.sumocfg")
    return folder


def test_the_shortest_straight_approach_of_those_with_vehicles_is_listed(tmp_path: Path) -> None:
    folder = bent(tmp_path)
    # From the west 200 m up to the node, at whose centre the crosswalk lies; from the east 40 m.
    one, both = (listed(folder / f"{name}.sumocfg")[":x_c0"] for name in ("one", "both"))
    assert one["straight_m"] == pytest.approx(200.0, abs=1.0)
    assert both["straight_m"] == pytest.approx(40.0, abs=1.0)


def test_a_written_file_says_which_approach_bends_within_its_range(tmp_path: Path) -> None:
    config = bent(tmp_path) / "both.sumocfg"
    done = here("crossings", config, "--write", tmp_path / "town.toml", "--edge", ":x_c0")
    assert done.returncode == 0, done.stderr
    found = re.search(r"note: :x_c0: (\S+) is straight for (\S+) m only; .* R0 = 50 m", done.stderr)
    assert found is not None
    assert found[1].startswith("e_x_")
    assert float(found[2]) == pytest.approx(40.0, abs=1.0)


def test_avs_that_are_not_driven_are_counted_by_reason(
    model: InteractionModel, tmp_path: Path
) -> None:
    """The car from the west is driven from 50 m on; the eastern way bends 40 m before."""
    config = bent(tmp_path) / "both.sumocfg"
    keys = {"arms__av": "hard_yield", "simulation__step_s": 0.1, "ego__trigger_range_m": 50.0}
    scenario = towns.scenario_of(config, [":x_c0"], pedestrians__flow_per_hour=1.0, **keys)
    outcome = towns.run_arm(scenario, model, tmp_path / "arm")
    (row,) = simulation_rows(0, [outcome])["simulations"].to_pylist()
    assert (row["av_passages"], row["avs_bend"], row["avs_uncommanded"]) == (2, 1, 0)
    assert sum(row[column] for column in AVS_NOT_DRIVEN) == 1


def test_a_crosswalk_that_ends_on_a_refuge_has_the_footpath_beyond_the_refuge(
    model: InteractionModel, tmp_path: Path
) -> None:
    config = bent(tmp_path, "w_x", "x_w") / "one.sumocfg"
    halves = (":x_c0", ":x_c1")
    rows = listed(config)
    assert [rows[half]["usable"] for half in halves] == [True, True]
    keys = {"simulation__step_s": 0.1, "pedestrians__flow_per_hour": 3600.0}
    scenario = towns.scenario_of(config, halves, **keys)
    setting = setting_of(scenario)
    sides = [{"w_x", "x_e"}, {"x_w", "e_x"}]
    near, far = ({path.edge} for path in setting.footpaths[halves[0]])
    assert (near <= sides[0] and far <= sides[1]) or (near <= sides[1] and far <= sides[0])
    # Whoever is added walks over both halves.
    outcome = towns.run_arm(scenario, model, tmp_path / "arm")
    over = [
        {track.id for track in outcome.log.people[half] if track.on_crossing.any()}
        for half in halves
    ]
    assert len(over[0] & over[1]) > 10


def test_a_way_that_bends_at_once_is_the_reason(tmp_path: Path) -> None:
    """Only e_x leads over x_w; it bends by atan(30 / 195) = 8.7° 5 m before the crosswalk."""
    config = bent(tmp_path, "w_x", "x_w", bend_m=5.0) / "both.sumocfg"
    (problem,) = (
        str(row["problem"]) for row in listed(config).values() if row["streets"] == ["x_w"]
    )
    words = r"no lane leads straight over it: the way from e_x_1 is straight for (\S+) m before it "
    found = re.fullmatch(words + r"and bends by 8\.7° (\S+) m before the crosswalk", problem)
    assert found is not None, problem
    assert [float(each) for each in found.groups()] == pytest.approx([5.0, 5.0], abs=0.6)
