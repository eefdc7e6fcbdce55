"""Made-up recordings whose driver is one of ours, so the truth is known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from harness.core.vocabulary import Arrival, Crossing, Leg, Side, Vehicle
from harness.encounter.cell_constants import CellConstants
from harness.encounter.loop import Episode, drive
from harness.engine.plain import PlainEngine
from harness.results.result import Result
from harness.scenario import Setting
from harness.scenario.pedestrians import PedestriansSection
from harness.strategies.emergency_brake import EmergencyBrake
from harness.strategies.gap_yield import GapYield
from harness.strategies.hard_yield import HardYield
from harness.studies.models.validation import validate

RATE_HZ = 10.0
LENGTH_M = 4.5
DRIVERS = {"hard_yield": HardYield, "gap_yield": GapYield, "emergency_brake": EmergencyBrake}


@dataclass(frozen=True)
class Person:
    """Walks straight across at x from t = 0; starts at y, negative on the near footpath."""

    x_m: float
    y_m: float
    y_mps: float

    def at(self, time_s):
        return self.x_m + 0 * time_s, self.y_m + self.y_mps * time_s


def driven(strategy, people, speed_mps):
    """Times, front bumper and speed of a strategy that meets these people, simulated anew."""
    vehicle = Vehicle(speed_mps, 30.0, 30.0, LENGTH_M, 1.8, 3.0, 4.5, 1.0)
    width_m = max(4.0, float(np.ptp([person.x_m for person in people])))
    crossing = Crossing(9.0, width_m, 4.5, 9.0)
    rules = CellConstants(vehicle, crossing, PedestriansSection(kerb_wait_s=0.0), 0.1, 60.0)
    arrivals = []
    for person in people:
        side = Side.NEAR if person.y_mps > 0 else Side.FAR
        path = (Leg(0.0, person.x_m, person.y_m, 0.0, person.y_mps, 0.0),)
        arrivals.append(Arrival(len(arrivals), 0.0, side, None, path=path))
    trace = drive(Episode(PlainEngine(vehicle, 0.1), arrivals, lambda *_: 0.0, rules), strategy)
    return np.arange(len(trace.x_m)) * 0.1, trace.x_m


SCENES = (
    (5.0, [Person(0.0, -1.0, 1.3), Person(0.0, 11.0, -1.1)]),
    (6.5, [Person(-0.5, -0.5, 0.9), Person(0.0, 1.0, 1.4), Person(1.0, 9.0, -1.5)]),
    (5.0, [Person(0.0, 12.0, -0.8)]),
    (7.0, [Person(0.0, -4.0, 1.2), Person(0.2, -5.5, 1.2)]),
)


def write_set(folder, strategy, *, mirrored=False, shift_frames=0, turn=0.0):
    """The scenes as recordings at 10 Hz of one strategy, in the format of DUT."""
    target = folder / "trajectories_filtered"
    target.mkdir(parents=True)
    for number, (speed, people) in enumerate(SCENES):
        time_s, front = driven(strategy(), people, speed)
        tracks = {"veh": [(front - LENGTH_M / 2, 0 * front)], "ped": []}
        for person in people:
            x, y = person.at(time_s)
            tracks["ped"].append((x, y - 4.5))
        for kind, found in tracks.items():
            lines = ["id,frame,label,x_est,y_est"]
            for key, (x, y) in enumerate(found):
                y = -y if mirrored else y
                x, y = x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)
                lines += [
                    f"{key},{frame + shift_frames},{kind},{a!r},{b!r}"
                    for frame, (a, b) in enumerate(zip(x.tolist(), y.tolist(), strict=True))
                ]
            name = f"clip_{number:02d}_traj_{kind}_filtered.csv"
            (target / name).write_text("\n".join(lines) + "\n")
    return folder


def held(folder: Path, drivers=tuple(DRIVERS), **settings) -> Result:
    """The validation of some drivers; settings with a dot are keys of a scenario."""
    options = {"frame_rate_hz": RATE_HZ, "vehicle_length_m": LENGTH_M, **settings}
    return validate([folder], "vci", list(drivers), [Setting(*one) for one in options.items()])


def made_up(count: int = 160) -> pd.DataFrame:
    """Rows of 8 vehicles with 5 encounters of 4 rows each; the last four rows lie outside."""
    rng = np.random.default_rng(5)
    group = np.arange(count) // 4
    rows = pd.DataFrame(
        {
            "clip": "a",
            "vehicle": [f"v{code // 5}" for code in group],
            "pedestrian": [f"p{code}" for code in group],
            "range_m": rng.uniform(4, 40, count),
            "vehicle_speed_mps": rng.uniform(1, 6, count),
            "pedestrian_speed_mps": rng.normal(1.3, 0.2, count),
            "time_advantage_s": rng.uniform(1, 6, count),
        }
    )
    rows.loc[count - 4 :, "vehicle_speed_mps"] = 20.0
    return rows
