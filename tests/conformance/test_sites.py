"""What every site below ``networks/`` must be, whichever they are.

A site is a folder as ``harness network SCENARIO --out networks/SITE`` writes it, and the shipped
scenario it was written for.  ``tests/sumo/test_network.py`` measures and drives each of them.
"""

import re
from pathlib import Path

import pytest

from harness.engine.network import CACHE_VARIABLE, build_network, network_of
from harness.engine.sources import plain_sources
from tests.sites import NETWORKS, geometries, shipped_nets, shipped_scenarios

NETS = shipped_nets()
CROSSWALKS = geometries()
every_site = pytest.mark.parametrize("name", NETS)


def test_every_folder_is_one_site() -> None:
    folders = sorted(path.name for path in NETWORKS.iterdir() if path.is_dir())
    assert folders == sorted(net.parent.name for net in NETWORKS.glob("*/*.net.xml"))
    assert len(NETS) == len(folders)


@every_site
def test_its_scenario_takes_place_there_and_nothing_is_built(name, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    crosswalk = CROSSWALKS.get(name)
    assert crosswalk is not None, "no shipped scenario's [crossing] gives these sources"
    there = [each for each in shipped_scenarios().values() if each.crossing == crosswalk]
    assert {network_of(scenario) for scenario in there} == {NETS[name]}
    assert not (tmp_path / "cache").exists()


@every_site
def test_is_what_its_sources_give(name: str, tmp_path: Path) -> None:
    net = NETS[name]
    new = build_network(CROSSWALKS[name], tmp_path, name)
    for source in plain_sources(CROSSWALKS[name], name):
        assert net.with_name(source).read_bytes() == new.with_name(source).read_bytes()
    number = re.compile(r"-?\d+\.\d+")
    built, shipped = (path.read_text(encoding="utf-8") for path in (new, net))
    assert number.sub("#", built) == number.sub("#", shipped)
    # Another machine's sine may round the last digit of nine to the other side.
    values = [[float(value) for value in number.findall(text)] for text in (built, shipped)]
    assert values[0] == pytest.approx(values[1], abs=2e-9, rel=0)
    assert {path.name for path in net.parent.iterdir()} == {p.name for p in tmp_path.iterdir()}
