"""The types of the vehicles that come, read from a user's files."""

from pathlib import Path

from harness.engine.configuration import read_config, types_that_come


def test_types_of_vehicles_flows_distributions_and_peoples_vehicles(tmp_path: Path) -> None:
    (tmp_path / "types.add.xml").write_text(
        """<additional><vType id="lorry" vClass="truck"/><vType id="never" vClass="coach"/>
        <vTypeDistribution id="mix"><vType id="van" vClass="delivery"/><vType id="small"/>
        </vTypeDistribution><vTypeDistribution id="both" vTypes="lorry small"/></additional>"""
    )
    (tmp_path / "more.xml").write_text(
        """<routes><person id="p" depart="0">
        <personTrip from="a" to="b" modes="public bicycle"/></person></routes>"""
    )
    (tmp_path / "d.rou.xml").write_text(
        """<routes><include href="more.xml"/><vType id="line" vClass="bus"/>
        <flow id="f" type="line" begin="0" end="9" period="1" from="a" to="b"/>
        <trip id="t" type="both" depart="0" from="a" to="b"/>
        <trip id="u" depart="0" from="a" to="b"/></routes>"""
    )
    (tmp_path / "net.net.xml").write_text("<net/>")
    (tmp_path / "c.sumocfg").write_text(
        """<configuration><net-file value="net.net.xml"/><route-files value="d.rou.xml"/>
        <additional-files value="types.add.xml"/></configuration>"""
    )
    come = set(types_that_come(read_config(tmp_path / "c.sumocfg", 0.1)))
    assert come == {
        ("DEFAULT_BIKETYPE", "bicycle"),
        ("line", "bus"),
        ("lorry", "truck"),
        ("small", "passenger"),
        ("DEFAULT_VEHTYPE", "passenger"),
    }
