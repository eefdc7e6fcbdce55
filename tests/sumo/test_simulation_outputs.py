"""Nothing is written outside the run folder, whatever a configuration names."""

import gzip
from pathlib import Path

import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.engine.simulation.outputs import Kept, check_outputs, copied
from harness.model.interaction import InteractionModel
from harness.site.configuration import read_config
from tests import towns
from tests.batches import printed

pytestmark = pytest.mark.usefixtures("no_simulation")

LANE = "A1B1_1"
COPIES = {"in_a.add.xml", "in_b.add.xml", "in_included.add.xml", "ssm.rou.xml"}


def additional(sub: str, absolute: Path) -> str:
    """Additional elements of every kind that writes."""
    return f"""
    <inductionLoop id="e1" lane="{LANE}" pos="20" period="10" file="{sub}e1.xml"/>
    <instantInductionLoop id="i" lane="{LANE}" pos="30" file="{absolute}/instant.xml"/>
    <laneAreaDetector id="e2" lane="{LANE}" pos="10" endPos="60" period="10" file="../e2.xml"/>
    <entryExitDetector id="e3" period="10" file="NUL"><detEntry lane="{LANE}" pos="10"/>
      <detExit lane="{LANE}" pos="60"/></entryExitDetector>
    <entryExitDetector id="e3b" period="10" file="{sub}../e3.xml">
      <detEntry lane="{LANE}" pos="10"/><detExit lane="{LANE}" pos="60"/></entryExitDetector>
    <edgeData id="ed" file="{sub}edges.xml" period="10"/>
    <laneData id="ld" file="lanes.xml.gz" period="10"/>
    <routeProbe id="rp" edge="A1B1" period="10" file="{sub}probe.xml"/>
    <vTypeProbe id="vp" period="5" file="{sub}types.xml"/>
    <timedEvent type="SaveTLSStates" source="C2" dest="{sub}tls.xml"/>
    <calibrator id="ca" lane="{LANE}" pos="0" period="10" output="{sub}calibrator.xml"/>
    """


LIGHT = """<tlLogic id="C2" type="actuated" programID="mine" offset="0">
    <param key="file" value="{sub}loops.xml"/><param key="freq" value="10"/>
    {phases}</tlLogic>"""


def town(folder: Path) -> Path:
    """A grid whose configuration writes wherever SUMO can write."""
    towns.grid(folder, 30)
    for name in ("out", "in"):
        (folder / name).mkdir()
    included = folder / "in/included.add.xml"
    included.write_text(
        f'<additional><e1Detector id="e1b" lane="{LANE}" pos="40" period="10" file="e1b.xml"/>'
        "</additional>"
    )
    # A detector writes beside its own file, so its folders differ from the configuration's.
    (folder / "in/a.add.xml").write_text(
        "<additional>"
        + additional("../out/", folder / "out")
        + f"{_light(folder)}<include href='included.add.xml'/></additional>"
    )
    with gzip.open(folder / "in/b.add.xml.gz", "wt") as file:
        file.write('<additional><edgeData id="z" file="z.xml" period="10"/></additional>')
    _devices(folder)
    options = {
        "net-file": "net.net.xml",
        "route-files": "ssm.rou.xml,vehicles.trips.xml,people.trips.xml",
        "additional-files": "in/a.add.xml,in/b.add.xml.gz",
        "end": "30",
        "step-length": "0.1",
        "output-prefix": "pre_",
        "fcd-output": "out/fcd.xml",
        "tripinfo-output": "../trips.xml",
        "queue-output": f"{folder}/out/queue.xml",
        "vehroute-output": "routes.out.xml.gz",
        "log": "log.txt",
        "save-state.times": "10",
        "save-state.prefix": "out/state",
        "device.ssm.probability": "0.5",
        "device.ssm.file": "out/ssm_all.xml",
        "device.rerouting.probability": "1",
        "device.rerouting.output": "out/weights.xml",
    }
    return towns.write_config(folder, options)


def _light(folder: Path) -> str:
    """The network's light C2 as an actuated one that writes its loops."""
    text = (folder / "net.net.xml").read_text()
    logic = text[text.index('<tlLogic id="C2"') :]
    phases = logic[logic.index(">") + 1 : logic.index("</tlLogic>")]
    return LIGHT.format(sub="../out/", phases=phases)


def _devices(folder: Path) -> None:
    """A route file whose type and vehicle name files of their devices."""
    (folder / "ssm.rou.xml").write_text(
        """<routes><vType id="t"><param key="has.ssm.device" value="true"/>
        <param key="device.ssm.file" value="out/type_ssm.xml"/></vType>
        <vehicle id="typed" type="t" depart="0"><route edges="A1B1 B1C1"/></vehicle>
        <vehicle id="own" depart="0"><route edges="C1B1 B1A1"/>
        <param key="has.ssm.device" value="true"/>
        <param key="device.ssm.file" value="../own_ssm.xml"/></vehicle>
        <vehicle id="toc" type="t" depart="0"><route edges="C1B1 B1A1"/>
        <param key="has.toc.device" value="true"/>
        <param key="device.toc.manualType" value="t"/>
        <param key="device.toc.automatedType" value="t"/>
        <param key="device.toc.file" value="out/toc.xml"/></vehicle></routes>"""
    )


def tree(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_nothing_is_written_outside_the_arms_folder(
    model: InteractionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outside, elsewhere = tmp_path / "user", tmp_path / "elsewhere"
    (outside / "town").mkdir(parents=True)
    elsewhere.mkdir()
    config = town(outside / "town")
    scenario = towns.scenario_of(config, [":B1_c0"])
    before = tree(outside)
    monkeypatch.chdir(elsewhere)
    towns.run_arm(scenario, model, tmp_path / "arm")
    assert tree(outside) == before
    assert not tree(elsewhere)
    # Copies of what names a path, the configuration, and the trips: no output was asked for.
    assert {path.name for path in tree(tmp_path / "arm")} == {
        "simulation.sumocfg",
        "tripinfo.xml",
        *COPIES,
    }


def test_outputs_are_kept_in_the_folder_of_each_arm(
    model: InteractionModel, tmp_path: Path
) -> None:
    folder = tmp_path / "user/town"
    folder.mkdir(parents=True)
    config = town(folder)
    scenario = towns.scenario_of(config, [":B1_c0"], simulation__outputs=["all"])
    before = tree(tmp_path / "user")
    for arm in Arm:
        towns.run_arm(scenario, model, tmp_path / arm.value, arm)
        written = {path.name for path in tree(tmp_path / arm.value)}
        assert written >= {
            *("out_e1.xml", "out_instant.xml", "e2.xml", "out_edges.xml"),
            *("in_lanes.xml.gz", "out_probe.xml", "out_types.xml", "out_tls.xml"),
            *("out_calibrator.xml", "in_e1b.xml", "in_z.xml", "e3.xml"),
            *("out_fcd.xml", "out_queue.xml", "routes.out.xml.gz", "log.txt"),
            *("out_type_ssm.xml", "up_own_ssm.xml", "out_ssm_all.xml", "out_weights.xml"),
            "out_toc.xml",
        }
        # SUMO writes an actuated light's loops only under some of its programs.
        copy = (tmp_path / arm.value / "in_a.add.xml").read_text()
        assert 'key="file" value="out_loops.xml"' in copy
    assert tree(tmp_path / "user") == before


def test_one_output_is_kept_alone(model: InteractionModel, tmp_path: Path) -> None:
    folder = tmp_path / "town"
    folder.mkdir()
    scenario = towns.scenario_of(town(folder), [":B1_c0"], simulation__outputs=["fcd"])
    towns.run_arm(scenario, model, tmp_path / "arm")
    names = {path.name for path in tree(tmp_path / "arm")}
    assert "out_fcd.xml" in names
    assert "out_e1.xml" not in names
    assert "out_queue.xml" not in names


def test_an_element_that_names_no_output_gets_none(tmp_path: Path) -> None:
    # A calibrator's "output" is optional for SUMO, and a rerouter only reads its "file".
    file = tmp_path / "quiet.add.xml"
    file.write_text(
        f"""<additional><calibrator id="ca" lane="{LANE}" pos="0" period="10"/>
        <rerouter id="re" edges="A1B1" file="{tmp_path}/re.xml"/></additional>"""
    )
    kept = Kept(tmp_path / "arm", frozenset({"all"}))
    assert copied(file, kept, tmp_path) == str(file)
    assert not kept.folder.exists()


def test_an_output_that_the_configuration_does_not_write_is_refused(tmp_path: Path) -> None:
    config = read_config(towns.grid(tmp_path, 10))
    with pytest.raises(InputError, match="netstate"):
        check_outputs(config, ["netstate"], "simulation.outputs")


def test_an_arms_folder_may_be_named_from_the_working_folder(
    model: InteractionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "town"
    folder.mkdir()
    scenario = towns.scenario_of(towns.grid(folder, 20), [":B1_c0"])
    monkeypatch.chdir(tmp_path)
    towns.run_arm(scenario, model, Path("runs/arm"))
    assert (tmp_path / "runs/arm/tripinfo.xml").is_file()


def test_sumo_repeats_the_reference_arm_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the configuration that a run stored, after the run folder got another name."""
    (tmp_path / "town").mkdir()
    config = town(tmp_path / "town")
    # SUMO resolves the files of calibrators and of ToC devices from the working folder.
    config.write_text(config.read_text().replace("in/a.add.xml,", ""))
    routes = tmp_path / "town/ssm.rou.xml"
    routes.write_text(routes.read_text().replace("has.toc", "no.toc"))
    towns.scenario_of(config, [":B1_c0"])
    monkeypatch.chdir(tmp_path)
    more = ["--set", 'simulation.outputs=["all"]']
    # At the limit of the roads here the model of human_gmm is outside its box.
    arms = ("--set", "arms.av=soft_yield", "--set", "arms.human=sumo_driver")
    setting = (*arms, "--pairs", "1", "--workers", "1", "--out", "run")
    printed("run", "town/town.toml", *setting, *more)
    (tmp_path / "run").rename(tmp_path / "moved")
    arm = tmp_path / "moved/sumo/0-0-human"
    # FCD has more decimals, so it is from a simulation of its own.
    before = {path.name for path in tree(arm)} - {"site.net.xml", "fcd.xml"}
    trips = _below_the_header(arm / "tripinfo.xml")
    assert "<tripinfo " in trips
    for path in arm.iterdir():
        if path.name not in ("simulation.sumocfg", "in_b.add.xml", "ssm.rou.xml"):
            path.unlink()
    (tmp_path / "elsewhere").mkdir()
    towns.call(tmp_path / "elsewhere", "sumo", "-c", str(arm / "simulation.sumocfg"))
    assert _below_the_header(arm / "tripinfo.xml") == trips
    assert {path.name for path in tree(arm)} == before
    assert not tree(tmp_path / "elsewhere")


def _below_the_header(file: Path) -> str:
    return file.read_text().partition("-->")[2]
