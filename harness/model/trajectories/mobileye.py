"""Takes csv files of the paper's sensor and returns candidate rows: MobilEye and GPS on buses.

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
from collections.abc import Iterator, Mapping, Sequence
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
    once_each,
    read_records,
)
from harness.model.trajectories.encounters import (
    CANDIDATE_COLUMNS,
    Columns,
    angle_deg,
    rows_of_pair,
    sampling_instants,
    spans_gap,
)
from harness.model.trajectories.extraction_rules import (
    ExtractionRules,
    NotNegative,
    Options,
    Positive,
    with_times,
)
from harness.model.trajectories.tracks import Track, fingerprint

COLUMNS: Mapping[str, tuple[str, float]] = {
    "device": ("Device", 1.0), "trip": ("Trip", 1.0), "obstacle": ("ObstacleId", 1.0),
    "time_s": ("Time", 100.0), "range_m": ("Range", 1.0), "aside_m": ("Transversal", 1.0),
    "vehicle_speed_mps": ("Speed", 1.0), "heading_deg": ("GpsHeading", 1.0),
    "longitude_deg": ("Longitude", 1.0), "latitude_deg": ("Latitude", 1.0),
}  # fmt: skip
"""The columns of a file, and by what their numbers are divided."""

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


def read_rows(
    paths: Sequence[Path], options: MobileyeOptions, rules: ExtractionRules, tally: Tally
) -> pd.DataFrame:
    """The candidate rows of csv files, or of folders of them: a clip per Device and Trip.

    Pedestrians are ``<ObstacleId>-<sequence>``; time is Time / 100.

    Raises:
        InputError: there is no file, or a file is unreadable or lacks a needed column.
    """

    def read(_: str, file: Path) -> list[pd.DataFrame]:
        trips = _records(file, options, tally).groupby(["device", "trip"])
        source = options.source or file.stem
        return [_trip(source, trip, options, rules, tally) for _, trip in trips]

    files = [(file.name, file) for path in paths for file in files_in(path, "*.csv")]
    frames: list[pd.DataFrame] = list(contents_of(files, read, tally, "trip"))
    return with_times(pd.concat(frames, ignore_index=True))


def _records(path: Path, options: MobileyeOptions, tally: Tally) -> pd.DataFrame:
    """The usable records of a file with positions in the turned axes."""
    table = read_records(path, COLUMNS, tally)
    heading = table["heading_deg"]
    ours = (heading > options.heading_above_deg) & (heading <= options.heading_below_deg)
    tally.drop("records", "bus_heading_other_way", (~ours).sum())
    table = table.loc[ours].copy()
    bus, forward = _bus(table, options)
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    walker = bus + table[["range_m"]].to_numpy() * forward + table[["aside_m"]].to_numpy() * left
    for name, points in (("bus", bus), ("forward", forward), ("walker", walker)):
        table[[f"{name}_x", f"{name}_y"]] = points
    return table


def _bus(table: pd.DataFrame, options: MobileyeOptions) -> tuple[FloatArray, FloatArray]:
    """(n, 2) positions and (n, 2) forward unit vectors of the bus in the turned axes."""
    radians = np.radians(table[["longitude_deg", "latitude_deg", "heading_deg"]].to_numpy())
    parallel = math.cos(math.radians(options.latitude_deg))
    east = (radians[:, 0] - math.radians(options.longitude_deg)) * parallel * EARTH_RADIUS_M
    north = (radians[:, 1] - math.radians(options.latitude_deg)) * EARTH_RADIUS_M
    turn = math.radians(options.axes_turn_deg)
    # If the axes turn by an angle, the coordinates of a point turn by the opposite angle.
    to_turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    position = np.column_stack([east, north]) @ to_turned
    forward = np.column_stack([np.sin(radians[:, 2]), np.cos(radians[:, 2])]) @ to_turned
    return position, forward


def _trip(
    source: str,
    trip: pd.DataFrame,
    options: MobileyeOptions,
    rules: ExtractionRules,
    tally: Tally,
) -> pd.DataFrame:
    """The candidate rows of one trip: those of every sequence."""
    moments = trip.sort_values("time_s", kind="stable").drop_duplicates("time_s")
    bus = Track(moments["time_s"].to_numpy(), moments[["bus_x", "bus_y"]].to_numpy())
    vehicle, number = (str(identifiers(trip[name]).iloc[0]) for name in ("device", "trip"))
    names = {"source": source, "clip": f"{vehicle}-{number}", "vehicle": vehicle}
    # Without sequences there are no rows, but the columns are the same.
    frames = [pd.DataFrame(columns=CANDIDATE_COLUMNS)]
    tally.clips += 1
    groups = {str(key): group for key, group in trip.groupby(identifiers(trip["obstacle"]))}
    for obstacle in in_order(groups):
        for place, records in enumerate(_sequences(groups[obstacle], options, tally), start=1):
            columns = _sequence_rows(records, options.vehicle_length_m, rules, tally)
            if columns is not None:
                names |= {"pedestrian": f"{obstacle}-{place}", "track": fingerprint(bus)}
                frames.append(pd.DataFrame(names | columns))
    return pd.concat(frames[1:] or frames, ignore_index=True)


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


def _sequence_rows(
    records: pd.DataFrame, length_m: float, rules: ExtractionRules, tally: Tally
) -> Columns | None:
    """The candidate rows of one sequence; None if it is no encounter."""
    time_s, range_m = records["time_s"].to_numpy(), records["range_m"].to_numpy()
    walker = records[["walker_x", "walker_y"]].to_numpy()
    walked = walker[-1] - walker[0]
    if walked[1] == 0.0:  # not across the road
        tally.drop("tracks", "standing_pedestrian")
        return None
    forward = records[["forward_x", "forward_y"]].to_numpy().sum(axis=0)
    angle = angle_deg(walked / np.hypot(*walked), forward / np.hypot(*forward))
    times = sampling_instants(time_s, time_s, rules.sample_s)
    if len(times) == 0:
        tally.drop("pairs", "no_common_time")
        return None
    if not rules.min_angle_deg <= angle <= rules.max_angle_deg:
        tally.drop("pairs", "crossing_angle")
        return None
    lateral_m = math.copysign(1.0, walked[1]) * (records["bus_y"].to_numpy() - walker[:, 1])
    speed = np.interp(times, time_s, records["vehicle_speed_mps"].to_numpy())
    speed[spans_gap(time_s, times, times, rules.max_gap_s)] = np.nan
    return {
        **rows_of_pair(times, length_m, time_s, range_m, time_s, lateral_m),
        "vehicle_speed_mps": speed,
        "pedestrian_speed_mps": float(abs(walked[1]) / (time_s[-1] - time_s[0])),
        "crossing_angle_deg": angle,
    }
