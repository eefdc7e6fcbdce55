"""Files of recorded trajectories in a format of ``FORMATS`` in; clips, or candidate rows, out.

``vci``: vehicle–crowd interaction files like DUT's (Yang et al. 2019).  A clip is a pair of files
from a fixed camera, with one record per object and video frame, ``<clip>_traj_veh_filtered.csv``
and ``<clip>_traj_ped_filtered.csv``.  Positions are in metres along the image's axes (y down); a
vehicle's position is its centre.  The files ``trajectories/<clip>_traj_veh.csv`` (corner points of
the vehicles in pixels) and ``ratios/<clip>_ratio_pixel2meter.txt`` (pixels per metre) beside
``trajectories_filtered`` are optional; they give each vehicle's length.  If only the unfiltered
pedestrians of a clip were published (``trajectories/<clip>_traj_ped.csv``, in pixels), they are
used with the same ratio, and the counts mention it.

``mobileye``: the paper's sensor, MobilEye and GPS on buses.  A record belongs to a bus, an instant
and an obstacle.  A pedestrian's position is the position of the bus plus Range along its heading
and Transversal to its left (left is positive in the authors' scripts).  Positions are metres in
axes around the crosswalk, turned by −46.5° from east and north.  Buses at the paper's crosswalk
drive along −x, and y is across the road.  R is the sensor's Range.  L is the distance across the
road from the pedestrian to the bus, in walking direction.  v is the bus's Speed.  v_p = (last −
first position across the road) / duration, one value per sequence.  The two paths need not cross
within the record.  At long range (beyond about 15 m in the events published by the authors' lab)
the bus's yaw dominates the sensor's lateral rate; a model's card should mention this.

``table``: the user's own rows, one per encounter and instant, in SI units, with the names of
``ROW_COLUMNS``.  R, v, v_p and one of T_adv and L are needed; T_adv follows from L where that is
given.  Rows without identifiers cannot be weighed by encounter or vehicle.  They are not resampled.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from pydantic import Field

from harness.core.errors import InputError
from harness.core.vocabulary import ROUNDING, FloatArray
from harness.model.trajectories.encounters import (
    PairColumns,
    angle_deg,
    rows_of_pair,
    sampling_instants,
    spans_gap,
)
from harness.model.trajectories.rules import ROW_COLUMNS, TEXT_COLUMNS, ExtractionRules, Tally
from harness.model.trajectories.table import (
    Columns,
    EmptyTableError,
    identifiers,
    numbers,
    objects,
    read_records,
    read_table,
)
from harness.model.trajectories.tracks import Clip, Track, VehicleTrack, fingerprint

METRES: Columns = {"time_s": ("frame", 1.0), "x_m": ("x_est", 1.0), "y_m": ("y_est", 1.0)}
PIXELS: Columns = {"time_s": ("frame", 1.0), "x_m": ("x", 1.0), "y_m": ("y", 1.0)}
CORNERS: Columns = {
    name: (name, 1.0) for name in ("x_fl", "y_fl", "x_fr", "y_fr", "x_rr", "y_rr", "x_rl", "y_rl")
}
"""The columns of VCI sets, besides ``id``: frames, metres and pixels."""

MOBILEYE: Columns = {
    "device": ("Device", 1.0), "trip": ("Trip", 1.0), "obstacle": ("ObstacleId", 1.0),
    "time_s": ("Time", 100.0), "range_m": ("Range", 1.0), "aside_m": ("Transversal", 1.0),
    "vehicle_speed_mps": ("Speed", 1.0), "heading_deg": ("GpsHeading", 1.0),
    "longitude_deg": ("Longitude", 1.0), "latitude_deg": ("Latitude", 1.0),
}  # fmt: skip
"""The columns of the paper's sensor; its times are in hundredths of a second."""

OWN_ROWS: Columns = {
    name: (name, 1.0) for name in ("range_m", "vehicle_speed_mps", "pedestrian_speed_mps")
}
"""The columns that a table of rows needs, besides T_adv or L."""

VEHICLE_END = "_traj_veh_filtered.csv"
"""How the name of a clip's file of vehicles ends."""
SMALLEST_RATIO, LARGEST_RATIO = 0.01, 1e5
"""Bounds of a clip's pixels per metre; any other ratio is an error."""
EARTH_RADIUS_M = 6_371_000.0
"""Mean radius of the Earth."""


class File(NamedTuple):
    """A file to read: the path that the user gave, the name without ending, and the file itself."""

    given: Path
    name: str
    path: Path


class VciOptions(ExtractionRules):
    """Facts that are not in the files."""

    frame_rate_hz: Annotated[float, Field(gt=0, le=1_000)] = 24000 / 1001
    """Video frames per second; DUT's 23.98 is 24000/1001."""
    vehicle_length_m: Annotated[float, Field(gt=0, le=100)] = 4.5
    """Length of a vehicle without corner points."""


class MobileyeOptions(ExtractionRules):
    """Site and screening; the defaults are the paper's crossing and the authors' scripts."""

    latitude_deg: Annotated[float, Field(gt=-90, lt=90)] = 42.278414
    """Latitude of the crossing, the origin of the axes."""
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] = -83.735580
    """Its longitude."""
    axes_turn_deg: Annotated[float, Field(ge=-360, le=360)] = -46.5
    """Turn of the axes, counter-clockwise positive; the turned x axis must lie along the road."""
    heading_above_deg: Annotated[float, Field(ge=0, le=360)] = 180.0
    """Buses with this heading or a smaller one drive in the other direction and are left out.  0
    with ``heading_below_deg`` 360 keeps all buses."""
    heading_below_deg: Annotated[float, Field(ge=0, le=360)] = 360.0
    """Buses with a heading above this are left out for the same reason."""
    sequence_gap_s: Annotated[float, Field(gt=0, le=60)] = 2.0
    """A longer pause starts a new sequence of the same obstacle."""
    min_sequence_s: Annotated[float, Field(ge=0, le=60)] = 0.5
    """Shorter sequences are left out."""
    vehicle_length_m: Annotated[float, Field(gt=0, le=100)] = 12.2
    """A 40 ft city bus; only the post-encroachment time uses it."""


def vci_clip(file: File, options: VciOptions, tally: Tally) -> Clip:
    """One clip with its vehicles' lengths; time is frame / frame rate."""
    rate, assumed = options.frame_rate_hz, ""
    if rate == VciOptions().frame_rate_hz:
        assumed = " (assumed: the files do not say it)"
    note = f"frame_rate_hz = {rate:.6g} frames per second{assumed}; every speed scales with it"
    if note not in tally.notes:
        tally.notes.append(note)
    stem = file.path.name.removesuffix(VEHICLE_END)
    ratio = _pixels_per_metre(_beside(file.path, "ratios", f"{stem}_ratio_pixel2meter.txt"))
    filtered = file.path.with_name(f"{stem}_traj_ped_filtered.csv")
    pixels = _beside(file.path, "trajectories", f"{stem}_traj_ped.csv")
    if filtered.exists():
        pedestrians = _tracks(filtered, METRES, 1.0, rate, tally)
    elif pixels is None or ratio is None:
        raise EmptyTableError(str(filtered), "is missing")
    else:
        pedestrians = _tracks(pixels, PIXELS, ratio, rate, tally)
        note = f"{file.name}: unfiltered pedestrians (pixels) used, filtered ones are missing"
        tally.notes.append(note)
    cars = _tracks(file.path, METRES, 1.0, rate, tally)
    corners = _beside(file.path, "trajectories", f"{stem}_traj_veh.csv")
    lengths = {} if corners is None or ratio is None else _lengths_m(corners, ratio)
    default, vehicles = options.vehicle_length_m, {}
    for key, track in cars.items():
        length = lengths.get(key, default)
        vehicles[key] = VehicleTrack(track.time_s, track.position_m, length, length / 2)
    if without := len(cars.keys() - lengths.keys()):
        note = f"{file.name}: vehicle_length_m = {default:g} m for {without} without corners"
        tally.notes.append(note)
    tally.clips += 1
    folder = file.given if file.given.is_dir() else file.given.parent
    source = options.source or folder.resolve().name
    return Clip(source, file.name, vehicles, pedestrians, y_down=True)


def _beside(vehicle_file: Path, folder: str, name: str) -> Path | None:
    """A companion file: in the sibling tree of ``trajectories_filtered``, or in the same folder."""
    parts = list(vehicle_file.parent.parts)
    places = [vehicle_file.parent]
    if "trajectories_filtered" in parts:
        at = len(parts) - 1 - parts[::-1].index("trajectories_filtered")
        places.insert(0, Path(*parts[:at], folder, *parts[at + 1 :]))
    return next((place / name for place in places if (place / name).is_file()), None)


def _pixels_per_metre(path: Path | None) -> float | None:
    """The clip's scale; None if there is no ratio file."""
    if path is None:
        return None
    text = path.read_text(encoding="utf-8", errors="replace").strip()
    try:
        ratio = float(text)
    except ValueError:
        ratio = math.nan
    if not SMALLEST_RATIO <= ratio <= LARGEST_RATIO:
        allowed = f"one number from {SMALLEST_RATIO:g} to {LARGEST_RATIO:g}, pixels per metre"
        raise InputError(str(path), f"contains {text[:40]!r}", allowed)
    return ratio


def _lengths_m(path: Path, ratio: float) -> dict[str, float]:
    """Median length of each vehicle: middle of its front corners to middle of its rear corners."""
    # These records are not positions, so the extraction does not count those that are dropped.
    table = read_records(path, CORNERS, Tally(), "id")
    x = (table["x_fl"] + table["x_fr"] - table["x_rr"] - table["x_rl"]) / 2
    y = (table["y_fl"] + table["y_fr"] - table["y_rr"] - table["y_rl"]) / 2
    medians = pd.Series(np.hypot(x, y) / ratio, table.index).groupby(table["id"]).median()
    return {str(key): float(value) for key, value in medians.items() if value > 0}


def _tracks(
    path: Path, columns: Columns, ratio: float, rate_hz: float, tally: Tally
) -> Mapping[str, Track]:
    """The tracks of one file, by identifier; positions have ``ratio`` units per metre."""
    tracks = {}
    for key, records in objects(read_records(path, columns, tally, "id"), "id", tally):
        if len(records) < 2:
            tally.drop("tracks", "one_record")
            continue
        position = records[["x_m", "y_m"]].to_numpy() / ratio
        tracks[key] = Track(records["time_s"].to_numpy() / rate_hz, position)
    return MappingProxyType(tracks)


def mobileye_rows(file: File, options: MobileyeOptions, tally: Tally) -> pd.DataFrame:
    """Candidate rows: a clip per Device and Trip, a pedestrian ``<ObstacleId>-<sequence>``."""
    table = read_records(file.path, MOBILEYE, tally)
    heading = table["heading_deg"]
    ours = (heading > options.heading_above_deg) & (heading <= options.heading_below_deg)
    tally.drop("records", "bus_heading_other_way", (~ours).sum())
    table = table.assign(obstacle=identifiers(file.path, table["obstacle"])).loc[ours].copy()
    if table.empty:
        raise EmptyTableError(str(file.path), "no record is left")
    bus, forward = _bus(table, options)
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    walker = bus + table[["range_m"]].to_numpy() * forward + table[["aside_m"]].to_numpy() * left
    for name, points in (("bus", bus), ("forward", forward), ("walker", walker)):
        table[[f"{name}_x", f"{name}_y"]] = points
    frames = [pd.DataFrame()]
    for _, trip in table.groupby(["device", "trip"]):
        tally.clips += 1
        own = [identifiers(file.path, trip[name]) for name in ("device", "trip")]
        vehicle, number = (str(names.iloc[0]) for names in own)
        moments = trip.sort_values("time_s", kind="stable").drop_duplicates("time_s")
        track = Track(moments["time_s"].to_numpy(), moments[["bus_x", "bus_y"]].to_numpy())
        names = {
            "source": options.source or file.name,
            "clip": f"{vehicle}-{number}",
            "vehicle": vehicle,
            "track": fingerprint(track),
        }
        for obstacle, records in objects(trip, "obstacle", tally):
            # Times are hundredths of a second: a pause of exactly the limit does not cut.
            cuts = (records["time_s"].diff() > options.sequence_gap_s + ROUNDING).cumsum()
            long = [part for _, part in records.groupby(cuts) if _is_long(part, options, tally)]
            for place, sequence in enumerate(long, start=1):
                rows = _sequence_rows(sequence, options, tally)
                if rows is not None:
                    names["pedestrian"] = f"{obstacle}-{place}"
                    frames.append(pd.DataFrame(names | rows))
    return pd.concat(frames, ignore_index=True)


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


def _is_long(sequence: pd.DataFrame, options: MobileyeOptions, tally: Tally) -> bool:
    """Whether a sequence is long enough; otherwise it is counted."""
    lasted_s = float(np.ptp(sequence["time_s"]))
    if len(sequence) < 2:
        tally.drop("tracks", "one_record")
    elif lasted_s < options.min_sequence_s - ROUNDING:
        tally.drop("tracks", "sequence_too_short")
    else:
        return True
    return False


def _sequence_rows(
    records: pd.DataFrame, options: MobileyeOptions, tally: Tally
) -> PairColumns | None:
    """The candidate rows of one sequence; None if it is no encounter."""
    time_s, range_m = records["time_s"].to_numpy(), records["range_m"].to_numpy()
    walker = records[["walker_x", "walker_y"]].to_numpy()
    walked = walker[-1] - walker[0]
    if walked[1] == 0.0:  # not across the road
        tally.drop("tracks", "standing_pedestrian")
        return None
    forward = records[["forward_x", "forward_y"]].to_numpy().sum(axis=0)
    angle = angle_deg(walked / np.hypot(*walked), forward / np.hypot(*forward))
    times = sampling_instants(time_s, time_s, options.sample_s)
    if len(times) == 0:
        tally.drop("pairs", "no_common_time")
        return None
    if not options.min_angle_deg <= angle <= options.max_angle_deg:
        tally.drop("pairs", "crossing_angle")
        return None
    lateral_m = math.copysign(1.0, walked[1]) * (records["bus_y"].to_numpy() - walker[:, 1])
    speed = np.interp(times, time_s, records["vehicle_speed_mps"].to_numpy())
    speed[spans_gap(time_s, times, times, options.max_gap_s)] = np.nan
    return {
        **rows_of_pair(times, options.vehicle_length_m, time_s, range_m, time_s, lateral_m),
        "vehicle_speed_mps": speed,
        "pedestrian_speed_mps": float(abs(walked[1]) / (time_s[-1] - time_s[0])),
        "crossing_angle_deg": angle,
    }


def own_rows(file: File, options: ExtractionRules, tally: Tally) -> pd.DataFrame:
    """Candidate rows of the user's table, in its order; a missing optional column is null."""
    rows, table = read_records(file.path, OWN_ROWS, tally), read_table(file.path)
    if "lateral_m" not in table and "time_advantage_s" not in table:
        neither = "has neither column 'time_advantage_s' nor 'lateral_m'"
        raise InputError(str(file.path), neither, "at least one of them")
    ignored = [name for name in table.columns if name not in ROW_COLUMNS]
    if ignored:
        tally.notes.append(f"{file.path.name}: columns not used: {', '.join(ignored)}")
    for name in [each for each in ROW_COLUMNS if each in table and each not in OWN_ROWS]:
        read = identifiers if name in TEXT_COLUMNS else numbers
        rows[name] = read(file.path, table[name])[rows.index]
    source = options.source or file.name
    return rows.assign(source=rows["source"].fillna(source) if "source" in rows else source)


class Format(NamedTuple):
    """A data format.

    Attributes:
        endings: how the names of its files end.
        options: its rules and further options.
        read: reads a file: a clip with tracks, or candidate rows.
        clips: whether it has tracks.
    """

    endings: tuple[str, ...]
    options: type[ExtractionRules]
    read: Callable[[File, Any, Tally], Clip | pd.DataFrame]
    clips: bool = False


FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        "vci": Format((VEHICLE_END,), VciOptions, vci_clip, clips=True),
        "mobileye": Format((".csv",), MobileyeOptions, mobileye_rows),
        "table": Format((".csv", ".parquet"), ExtractionRules, own_rows),
    }
)
