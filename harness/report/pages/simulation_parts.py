"""The parts of the page of a user's own simulation."""

from collections.abc import Iterator, Sequence

from harness.core.encounter import Arm
from harness.report.drawing.style import Picture
from harness.report.pages.inputs import strategies_of
from harness.report.pages.parts import PageParts
from harness.report.pages.traces import Encoded
from harness.report.screens.tables import ARM_NAMES, Table, TableCell
from harness.store.tables import Row
from harness.studies.runs.run_data import RunData
from harness.studies.runs.shown import ShownPair


def _opening(run: RunData) -> str:
    av, human = (strategies_of(run, arm) for arm in Arm)
    simulation = run.scenario.known_simulation
    return (
        f"Each pair simulates {simulation.config} twice with one seed: once {av} drives the AVs "
        f"from R0 until they have left the chosen crosswalks, once {human} drives there. SUMO "
        "keeps everything else: vehicles, people, lights and right of way."
    )


def _tables(run: RunData) -> list[Table]:
    return [
        _table(run, "groups", "Trips by group: means over all pairs", "group"),
        _table(run, "crosswalks", "Chosen crosswalks: sums and means over all pairs", "crosswalk"),
    ]


def _table(run: RunData, name: str, caption: str, key: str) -> Table:
    """A table with a row for each value of a key and arm, its numbers averaged over pairs."""
    rows = run.derived(name).to_pylist()
    columns = [each for each in rows[0] if each not in ("cell", "pair", "arm", key)] if rows else []
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row[key], row["arm"]), []).append(row)
    kept = [each for each in columns if any(row[each] is not None for row in rows)]
    cells = tuple(
        (
            TableCell(value),
            TableCell(ARM_NAMES[Arm(arm)]),
            *(_mean([row[column] for row in members]) for column in kept),
        )
        for (value, arm), members in groups.items()
    )
    headings = (key, "arm", *(each.replace("_", " ") for each in kept))
    return Table(name, caption, headings, cells, sortable=True, folded=True)


def _mean(values: Sequence[object]) -> TableCell:
    known = [float(value) for value in values if isinstance(value, int | float)]
    if not known:
        return TableCell("–", sort="")
    mean = sum(known) / len(known)
    return TableCell(f"{mean:,.2f}", sort=repr(mean))


def _pictures(_run: RunData, _shown: Sequence[ShownPair]) -> tuple[Iterator[Picture], list[str]]:
    return iter(()), []


def _player_words(_run: RunData, _shown: Sequence[ShownPair], _episodes: int) -> str:
    return ""


def _scene(_run: RunData, _cell: int) -> Encoded:
    return {}


def _episode(_run: RunData, _pair: ShownPair) -> Encoded:
    return {}


SIMULATION_PARTS = PageParts(
    opening=_opening,
    tables=_tables,
    pictures=_pictures,
    player_words=_player_words,
    scene=_scene,
    episode=_episode,
)
