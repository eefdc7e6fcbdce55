"""A small SUMO scenario as a user would have it: a road with a crosswalk, cars, trucks, people."""

import shutil
from pathlib import Path

from harness.scenario import read_scenario_file, study_of
from harness.scenario.study import Study
from harness.site import Place, read_site

NET = Path(__file__).resolve().parents[1] / "networks" / "cctc" / "cctc.net.xml"
CROSSING = ":crosswalk_c0"

_TYPES = """<vType id="car" vClass="passenger" length="5" width="1.8" accel="3" decel="4.5"/>
<vType id="lorry" vClass="truck" length="9" width="2.4" accel="1.5" decel="4"/>
<vType id="walker" vClass="pedestrian"/>"""


def write_scenario(folder: Path, duration_s: float = 70.0) -> Path:
    """Write the files of a scenario into a folder; returns its scenario file for ``harness``.

    A vehicle departs every 4 s, each fifth is a lorry; from either side somebody comes every 5 s.
    """
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(NET, folder / "net.net.xml")
    site = read_site(Place(NET))
    departure = site.ego.departure(80.0)
    near, far = site.footpaths
    edges = " ".join(departure.edges)
    vehicles = [
        f'<vehicle id="v{number}" type="{"lorry" if number % 5 == 4 else "car"}" '
        f'depart="{4 * number}" departPos="{departure.position_m!r}" '
        f'departLane="{departure.lane}" departSpeed="8"><route edges="{edges}"/></vehicle>'
        for number in range(12)
    ]
    people = [
        f'<person id="p{number}" type="walker" depart="{2.5 * number}" '
        f'departPos="{begin.end_m!r}"><walk edges="{begin.edge} {end.edge}" '
        f'arrivalPos="{end.inside_m!r}"/></person>'
        for number, (begin, end) in enumerate([(near, far), (far, near)] * 8)
    ]
    for name, content in (("cars", [_TYPES, *vehicles]), ("people", people)):
        text = "\n".join(["<routes>", *content, "</routes>"])
        (folder / f"{name}.rou.xml").write_text(text, encoding="utf-8")
    (folder / "town.sumocfg").write_text(
        '<configuration><net-file value="net.net.xml"/>'
        '<route-files value="cars.rou.xml,people.rou.xml"/>'
        f'<end value="{duration_s:g}"/><step-length value="0.1"/></configuration>',
        encoding="utf-8",
    )
    path = folder / "town.toml"
    path.write_text(
        f'[simulation]\nconfig = "town.sumocfg"\ncrossings = ["{CROSSING}"]\n'
        '[arms]\nav = "gap_yield"\nhuman = "sumo_driver"\n[experiment]\npairs = 2\n',
        encoding="utf-8",
    )
    return path


def own_study(folder: Path, **settings: object) -> Study:
    """A study of that scenario, its files in ``folder``; ``simulation__av_share`` sets a key."""
    path = write_scenario(folder)
    from harness.scenario import Setting

    changes = [Setting(key.replace("__", "."), value) for key, value in settings.items()]
    return study_of(read_scenario_file(str(path), changes))
