"""Takes csv files of the paper's sensor and returns clips: MobilEye and GPS on buses.

A record belongs to a bus, an instant and an obstacle. It has the columns Device, Trip, Time
(1/100 s), ObstacleId, Range, Transversal (m), Speed (m/s), GpsHeading (degrees clockwise from
north), Longitude and Latitude. Other columns are ignored.

A pedestrian's position is the position of the bus plus Range along its heading and Transversal to
its left (left is positive in the authors' scripts). Positions are metres in axes around the
crosswalk, turned by −46.5° from east and north. Buses at the paper's crosswalk drive along −x, and
y is across the road. R is the sensor's Range. L is the distance across the road from the pedestrian
to the bus, in walking direction. v is the bus's Speed. v_p = (last − first position across the
road) / duration, one value per sequence. The two paths need not cross within the record.

At long range (beyond about 15 m in the events published by the authors' lab) the bus's yaw
dominates the sensor's lateral rate; a model's card should mention this.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from harness.core.encounter import FloatArray
from harness.model.trajectories.counting import Tally
from harness.model.trajectories.csv_input import (
    contents_of,
    files_in,
    identifiers,
    in_order,
    numbers,
    once_each,
    read_table,
    require_columns,
)
from harness.model.trajectories.extraction_rules import NotNegative, Options, Positive
from harness.model.trajectories.tracks import Clip, Sighting, Track, VehicleTrack

COLUMNS = (
    "Device", "Trip", "Time", "ObstacleId", "Range", "Transversal", "Speed", "GpsHeading",
    "Longitude", "Latitude",
)  # fmt: skip
EARTH_RADIUS_M = 6_371_000.0


class MobileyeOptions(Options):
    """Site and screening; the defaults are the paper's crossing and the authors' scripts.

    Attributes:
        latitude_deg, longitude_deg: the crossing, origin of the axes.
        axes_turn_deg: turn of the axes, counter-clockwise positive; the turned x axis must lie
            along the road.
        heading_above_deg: buses with this heading or a smaller one drive in the other direction and
            are left out.  0 with ``heading_below_deg`` 360 keeps all buses.
        heading_below_deg: buses with a heading above this are left out for the same reason.
        sequence_gap_s: a longer pause starts a new sequence of the same obstacle.
        min_sequence_s: shorter sequences are left out.
        vehicle_length_m: a 40 ft city bus; only the post-encroachment time uses it.
        source: name of the data set; by default the name of the file.
    """

    latitude_deg: Annotated[float, Field(gt=-90, lt=90)] = 42.278414
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] = -83.735580
    axes_turn_deg: float = -46.5
    heading_above_deg: NotNegative = 180.0
    heading_below_deg: NotNegative = 360.0
    sequence_gap_s: Positive = 2.0
    min_sequence_s: NotNegative = 0.5
    vehicle_length_m: Positive = 12.2
    source: str | None = None


def read_clips(paths: Sequence[Path], options: MobileyeOptions, tally: Tally) -> Iterator[Clip]:
    """The trips in csv files, or in folders of them: a clip per Device and Trip.

    Returns:
        Clips ``<device>-<trip>`` with the bus, the pedestrians (``<ObstacleId>-<sequence>``) and
        their sightings; time is Time / 100.

    Raises:
        InputError: there is no file, or a file is unreadable or lacks a needed column.
    """

    def read(_: str, file: Path) -> list[Clip]:
        source = options.source or file.stem
        trips = _records(file, options, tally).groupby(["Device", "Trip"])
        return [_read_trip(source, trip, options, tally) for _, trip in trips]

    files = [(file.name, file) for path in paths for file in files_in(path, "*.csv")]
    return contents_of(files, read, tally, "trip")


def _records(path: Path, options: MobileyeOptions, tally: Tally) -> pd.DataFrame:
    """The usable records of a file with positions in the turned axes."""
    table = read_table(path)
    require_columns(path, table, COLUMNS)
    table = numbers(path, table, COLUMNS, tally)
    heading = table["GpsHeading"]
    ours = (heading > options.heading_above_deg) & (heading <= options.heading_below_deg)
    tally.drop("records", "bus_heading_other_way", int((~ours).sum()))
    table = table.loc[ours].copy()
    bus, forward = _bus(table, options)
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    ahead, aside = table[["Range"]].to_numpy(), table[["Transversal"]].to_numpy()
    walker = bus + ahead * forward + aside * left
    table["time_s"] = table["Time"] / 100
    for name, points in (("bus", bus), ("forward", forward), ("walker", walker)):
        table[[f"{name}_x", f"{name}_y"]] = points
    return table


def _bus(table: pd.DataFrame, options: MobileyeOptions) -> tuple[FloatArray, FloatArray]:
    """(n, 2) positions and (n, 2) forward unit vectors of the bus in the turned axes."""
    radians = np.radians(table[["Longitude", "Latitude", "GpsHeading"]].to_numpy())
    parallel = math.cos(math.radians(options.latitude_deg))
    east = (radians[:, 0] - math.radians(options.longitude_deg)) * parallel * EARTH_RADIUS_M
    north = (radians[:, 1] - math.radians(options.latitude_deg)) * EARTH_RADIUS_M
    turn = math.radians(options.axes_turn_deg)
    # If the axes turn by an angle, the coordinates of a point turn by the opposite angle.
    to_turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    position = np.column_stack([east, north]) @ to_turned
    forward = np.column_stack([np.sin(radians[:, 2]), np.cos(radians[:, 2])]) @ to_turned
    return position, forward


def _read_trip(source: str, trip: pd.DataFrame, options: MobileyeOptions, tally: Tally) -> Clip:
    """One trip: the bus's track, and a pedestrian and a sighting for every sequence."""
    moments = trip.sort_values("time_s", kind="stable").drop_duplicates("time_s")
    vehicle, number = (str(identifiers(trip[name]).iloc[0]) for name in ("Device", "Trip"))
    where = moments[["bus_x", "bus_y"]].to_numpy()
    bus = VehicleTrack(moments["time_s"].to_numpy(), where, options.vehicle_length_m, 0.0)
    walkers: dict[str, Track] = {}
    sightings = []
    groups = {str(key): group for key, group in trip.groupby(identifiers(trip["ObstacleId"]))}
    for obstacle in in_order(groups):
        for place, records in enumerate(_sequences(groups[obstacle], options, tally), start=1):
            sighting = _sighting(vehicle, f"{obstacle}-{place}", records)
            if sighting is None:
                tally.drop("tracks", "standing_pedestrian")
                continue
            where = records[["walker_x", "walker_y"]].to_numpy()
            walkers[sighting.pedestrian] = Track(sighting.time_s, where)
            sightings.append(sighting)
    tally.clips += 1
    tally.vehicle_tracks += 1
    tally.pedestrian_tracks += len(walkers)
    return Clip(source, f"{vehicle}-{number}", {vehicle: bus}, walkers, tuple(sightings))


def _sequences(
    records: pd.DataFrame, options: MobileyeOptions, tally: Tally
) -> Iterator[pd.DataFrame]:
    """An obstacle's records cut at pauses; too short ones are counted and left out."""
    records = once_each(records, "time_s", tally)
    # Times are hundredths of a second: a pause of exactly the limit does not cut.
    number = (records["time_s"].diff() > options.sequence_gap_s + 1e-9).cumsum()
    for _, sequence in records.groupby(number):
        time_s = sequence["time_s"].to_numpy()
        if len(sequence) < 2:
            tally.drop("tracks", "one_record")
        elif time_s[-1] - time_s[0] < options.min_sequence_s - 1e-9:
            tally.drop("tracks", "sequence_too_short")
        else:
            yield sequence


def _sighting(vehicle: str, pedestrian: str, records: pd.DataFrame) -> Sighting | None:
    """The variables of one sequence; None for a pedestrian who does not move across the road."""
    time_s = records["time_s"].to_numpy()
    walker = records[["walker_x", "walker_y"]].to_numpy()
    walked = walker[-1] - walker[0]
    if walked[1] == 0.0:
        return None
    forward = records[["forward_x", "forward_y"]].to_numpy().sum(axis=0)
    cosine = (walked @ forward) / (np.hypot(*walked) * np.hypot(*forward))
    side = math.copysign(1.0, walked[1])
    return Sighting(
        vehicle=vehicle,
        pedestrian=pedestrian,
        time_s=time_s,
        range_m=records["Range"].to_numpy(),
        lateral_m=side * (records["bus_y"].to_numpy() - walker[:, 1]),
        vehicle_speed_mps=records["Speed"].to_numpy(),
        pedestrian_speed_mps=float(abs(walked[1]) / (time_s[-1] - time_s[0])),
        crossing_angle_deg=math.degrees(math.acos(float(np.clip(cosine, -1.0, 1.0)))),
    )
