"""Runs single episodes of a stored run again, in a fresh SUMO with SUMO's own outputs on."""

import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.encounter import Arm, Ending
from harness.engine.control import SumoEngine
from harness.engine.plain import PlainEngine
from harness.errors import InputError
from harness.experiment import recall_study
from harness.interaction import InteractionModel, load_model
from harness.measures import Outcome
from harness.pairing import PairRunner
from harness.place import network_of
from harness.results import EPISODES, PEDESTRIANS, episode_rows, pedestrian_rows
from harness.run_folder import read_manifest, read_table, write_file
from harness.study import Cell

SUMO_FILES = {
    "--fcd-output": "fcd.xml",
    "--tripinfo-output": "tripinfo.xml",
    "--personinfo-output": "personinfo.xml",
    "--collision-output": "collisions.xml",
    "--statistic-output": "statistics.xml",
}

_FURTHER_OPTIONS = {
    "--fcd-output.acceleration": "true",
    "--tripinfo-output.write-unfinished": "true",
    "--precision": "6",
}

_CONFIGURATION = """<configuration>
    <input>
        <net-file value="site.net.xml"/>
    </input>
    <gui_only>
        <gui-settings-file value="view.xml"/>
    </gui_only>
</configuration>
"""

_VIEW = """<viewsettings>
    <scheme name="real world"/>
    <viewport x="0" y="0" zoom="1200"/>
    <delay value="100"/>
</viewsettings>
"""


@dataclass(frozen=True)
class Replayed:
    """One episode run again: its folder, and how its record differs from the stored one."""

    arm: Arm
    folder: Path
    differences: tuple[str, ...]


def replay(run: Path, pair: int, arms: Sequence[Arm], cell: int, out: Path) -> list[Replayed]:
    """Run one pair's arms again; each gets a folder with SUMO's outputs.

    Times in SUMO's files are the episode's plus one step: SUMO inserts the ego in its second step.

    Args:
        run: a finished run folder.
        pair: index of the pair.
        arms: which arms; with two, each gets a folder named after it inside ``out``.
        cell: number of the cell.
        out: a new or empty folder.

    Raises:
        InputError: no such run, cell or pair, or ``out`` is not empty.
    """
    study = recall_study(read_manifest(run))
    if not 0 <= cell < len(study.cells):
        raise InputError("--cell", f"{cell}", f"0 to {len(study.cells) - 1}")
    pairs = study.cells[cell].scenario.experiment.pairs
    if not 0 <= pair < pairs:
        raise InputError("--pair", f"{pair}", f"0 to {pairs - 1}")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"--out {out}", "is not empty", "a new or empty folder")
    stored = _Stored(run, cell)
    model = load_model(study.cells[cell].scenario.model.name, study.cells[cell].scenario.model.path)
    return [
        _replay_arm(
            study.cells[cell], model, pair, arm, out / arm.value if len(arms) > 1 else out, stored
        )
        for arm in arms
    ]


def replay_into(run: Path, which: str) -> list[Replayed]:
    """SUMO's outputs for ``all`` or for the ``crashed`` episodes of a run, in ``<run>/sumo/``."""
    study = recall_study(read_manifest(run))
    done = []
    for cell in study.cells:
        stored = _Stored(run, cell.number)
        model = load_model(cell.scenario.model.name, cell.scenario.model.path)
        for row in stored.episodes:
            if which == "crashed" and row["ending"] != Ending.CRASHED:
                continue
            arm = Arm(row["arm"])
            folder = run / "sumo" / f"{cell.number}-{row['pair']}-{arm.value}"
            done.append(_replay_arm(cell, model, row["pair"], arm, folder, stored))
    return done


class _Stored:
    """The stored rows of one cell."""

    def __init__(self, run: Path, cell: int) -> None:
        self.episodes = read_table(run, "episodes", cell).to_pylist()
        self.pedestrians = read_table(run, "pedestrians", cell).to_pylist()

    def differences(self, outcome: Outcome, cell: int) -> Iterable[str]:
        """What is not exactly as stored."""
        for name, schema, rows, stored in (
            ("episodes", EPISODES, episode_rows(cell, [outcome]), self.episodes),
            ("pedestrians", PEDESTRIANS, pedestrian_rows(cell, [outcome]), self.pedestrians),
        ):
            before = [
                row
                for row in stored
                if row["pair"] == outcome.pair and row["arm"] == outcome.arm.value
            ]
            now = _as_dicts(rows)
            if len(before) != len(now):
                yield f"{name}: {len(now)} rows instead of {len(before)}"
                continue
            for old, new in zip(before, now, strict=True):
                for column in schema.names:
                    if old[column] != new[column]:
                        yield f"{name}.{column}: {new[column]!r} instead of {old[column]!r}"


def _as_dicts(rows: dict[str, list[Any]]) -> list[dict[str, Any]]:
    names = list(rows)
    return [dict(zip(names, values, strict=True)) for values in zip(*rows.values(), strict=True)]


def _replay_arm(
    cell: Cell, model: InteractionModel, pair: int, arm: Arm, folder: Path, stored: _Stored
) -> Replayed:
    from harness.engine.sumo import libsumo_engine

    scenario = cell.scenario
    net = network_of(scenario)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(net, folder / "site.net.xml")
    except OSError as error:
        why = f"cannot be written ({error.strerror})"
        raise InputError(str(folder), why, "a writable folder") from None
    write_file(folder / "view.xml", _VIEW.encode())
    write_file(folder / "episode.sumocfg", _CONFIGURATION.encode())
    outputs = {option: str(folder / name) for option, name in SUMO_FILES.items()}
    opened: list[SumoEngine] = []

    def start(options: dict[str, str]) -> SumoEngine:
        """A fresh SUMO instead of the one before."""
        for engine in opened:
            if not engine.closed:
                engine.close()
        vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
        step_s = scenario.experiment.step_s
        opened.append(libsumo_engine(net, vehicle, crossing, step_s, outputs=options))
        return opened[-1]

    try:
        runner = PairRunner(scenario, model, lambda: start({**outputs, **_FURTHER_OPTIONS}))
        # Pairing by speed takes the walking speeds from the AV's arm: in SUMO too, whose sums
        # differ from another engine's in the last bits.
        speeds_from_av = arm is Arm.HUMAN and scenario.pedestrians.pairing == "speed"
        other = start({}) if speeds_from_av else PlainEngine(scenario.vehicle(), 0.1)
        outcome = runner.run_arm(pair, arm, other)
    finally:
        for engine in opened:
            if not engine.closed:
                engine.close()
    return Replayed(arm, folder, tuple(stored.differences(outcome, cell.number)))
