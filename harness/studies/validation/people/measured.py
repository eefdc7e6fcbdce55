"""Figures of measured people, which the package ships: counts and published numbers only."""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

MPH_MPS, FOOT_M = 0.44704, 0.3048

_FOLDER = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Experiment:
    """A measured experiment: how many people stand behind it, of what kind it is, its source."""

    key: str
    title: str
    people: str
    kind: str
    source: str


_HIKER = (
    "counted from the open table of the HIKER experiment (Lee et al. 2022; data with Markkula et "
    "al., PNAS Nexus 2023, CC BY-NC-SA)"
)
GAPS = Experiment(
    "gaps",
    "gaps accepted",
    "60 people",
    "laboratory",
    f"{_HIKER}; the counts include people who set off before the first car had passed",
)
YIELDING = Experiment(
    "yielding", "quartiles of setting off, car yields", "60 people", "laboratory", _HIKER
)
FIRST = Experiment(
    "first",
    "first at a zebra",
    "32 pairs",
    "laboratory",
    "coupled simulators; the experiment is described in Yang et al. 2024, Transportation Research "
    "Part F, doi:10.1016/j.trf.2024.08.027",
)
FIRST_WITHOUT_ZEBRA = Experiment(
    "first_without_zebra",
    "first without a zebra",
    "none shipped",
    "laboratory",
    FIRST.source,
)
WAITS = Experiment(
    "waits",
    "mean wait",
    "12 periods at 6 crossings, people not counted",
    "road",
    "NCHRP Project 17-87, working paper on uncontrolled crossings, tables B-1 to B-4",
)


@dataclass(frozen=True, slots=True)
class GapCell:
    """Decisions before one car, ``time_gap_s`` behind another; quartiles only if it yields."""

    time_gap_s: float
    speed_mph: float
    yields: bool
    trials: int
    started_before_the_car: int
    quartiles_s: tuple[float, ...]

    @property
    def speed_mps(self) -> float:
        """The car's speed before it brakes."""
        return self.speed_mph * MPH_MPS

    @property
    def share(self) -> float:
        """Share of trials in which they set off before the time gap was over."""
        return self.started_before_the_car / self.trials


@dataclass(frozen=True, slots=True)
class FirstCell:
    """The share of trials in which the pedestrian crossed before a car this time away."""

    time_to_arrival_s: float
    trials: int
    share: float


@dataclass(frozen=True, slots=True)
class SitePeriod:
    """A crossing on a weekday or weekend with its mean measured delay of pedestrians."""

    site: str
    day: str
    two_way: bool
    lanes: int
    length_m: float
    speed_mps: float
    vehicles_per_hour: float
    yield_rate: float
    pedestrians_per_hour: float
    crossing_time_s: float
    delay_s: float


@cache
def gap_cells() -> tuple[GapCell, ...]:
    """The 24 cells of the gap experiment."""
    return tuple(
        GapCell(
            time_gap_s=float(row["time_gap_s"]),
            speed_mph=float(row["speed_mph"]),
            yields=row["yields"] == "yes",
            trials=int(row["trials"]),
            started_before_the_car=int(row["started_before_the_car"]),
            quartiles_s=tuple(
                float(row[key]) for key in ("start_q25_s", "start_q50_s", "start_q75_s") if row[key]
            ),
        )
        for row in _rows("gap_decisions")
    )


@cache
def first_cells() -> tuple[FirstCell, ...]:
    """The five cells of the zebra crossing."""
    return tuple(
        FirstCell(
            float(row["time_to_arrival_s"]),
            int(row["trials"]),
            float(row["pedestrian_first_share"]),
        )
        for row in _rows("who_goes_first")
    )


@cache
def site_periods() -> tuple[SitePeriod, ...]:
    """The twelve site-periods."""
    return tuple(
        SitePeriod(
            site=row["site"],
            day=row["day"],
            two_way=row["two_way"] == "yes",
            lanes=int(row["through_lanes"]),
            length_m=float(row["crossing_length_ft"]) * FOOT_M,
            speed_mps=float(row["speed_limit_mph"]) * MPH_MPS,
            vehicles_per_hour=float(row["vehicles_per_hour"]),
            yield_rate=float(row["yield_rate"]),
            pedestrians_per_hour=float(row["pedestrians_per_hour"]),
            crossing_time_s=float(row["crossing_time_s"]),
            delay_s=float(row["pedestrian_delay_s"]),
        )
        for row in _rows("field_sites")
    )


def _rows(name: str) -> list[dict[str, str]]:
    with (_FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
