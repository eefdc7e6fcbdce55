"""Runs single episodes of a stored run again, in a fresh SUMO with SUMO's own outputs on."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.encounter import Arm, Ending
from harness.engine.control import SumoEngine
from harness.engine.plain import PlainEngine
from harness.engine.view import view_settings
from harness.errors import InputError
from harness.manifest import recall_study
from harness.pairing import PairRunner
from harness.place import network_of
from harness.run_folder import read_manifest, write_file
from harness.stored import StoredCell

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

_VIEW_DELAY_MS = 100.0


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
    stored = StoredCell(run, cell)
    stored.check_pair(pair)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"--out {out}", "is not empty", "a new or empty folder")
    return [
        _replay_arm(stored, pair, arm, out / arm.value if len(arms) > 1 else out) for arm in arms
    ]


def replay_into(run: Path, which: str) -> list[Replayed]:
    """SUMO's outputs for ``all`` or for the ``crashed`` episodes of a run, in ``<run>/sumo/``."""
    done = []
    for cell in recall_study(read_manifest(run)).cells:
        stored = StoredCell(run, cell.number)
        for row in stored.episodes:
            if which == "crashed" and row["ending"] != Ending.CRASHED:
                continue
            arm = Arm(row["arm"])
            folder = run / "sumo" / f"{cell.number}-{row['pair']}-{arm.value}"
            done.append(_replay_arm(stored, row["pair"], arm, folder))
    return done


def _replay_arm(stored: StoredCell, pair: int, arm: Arm, folder: Path) -> Replayed:
    from harness.engine.sumo import libsumo_engine

    scenario = stored.cell.scenario
    net = network_of(scenario)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(net, folder / "site.net.xml")
    except OSError as error:
        why = f"cannot be written ({error.strerror})"
        raise InputError(str(folder), why, "a writable folder") from None
    view = view_settings(scenario.ego.initial_speed_mps, _VIEW_DELAY_MS)
    write_file(folder / "view.xml", view.encode())
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
        runner = PairRunner(scenario, stored.model, lambda: start({**outputs, **_FURTHER_OPTIONS}))
        # Pairing by speed takes the walking speeds from the AV's arm: in SUMO too, whose sums
        # differ from another engine's in the last bits.
        speeds_from_av = arm is Arm.HUMAN and scenario.pedestrians.pairing == "speed"
        other = start({}) if speeds_from_av else PlainEngine(scenario.vehicle(), 0.1)
        outcome = runner.run_arm(pair, arm, other)
    finally:
        for engine in opened:
            if not engine.closed:
                engine.close()
    return Replayed(arm, folder, tuple(stored.differences(outcome)))
