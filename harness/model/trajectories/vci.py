"""Takes vehicle–crowd interaction files in the format of DUT (Yang et al. 2019), returns clips.

A clip is a pair of files from a fixed camera, with one record per object and video frame:
``<clip>_traj_veh_filtered.csv`` (id, frame, label, x_est, y_est, psi_est, vel_est) and
``<clip>_traj_ped_filtered.csv`` (id, frame, label, x_est, y_est, vx_est, vy_est). Positions are in
metres along the image's axes (y down); a vehicle's position is its centre. The columns id, frame,
x_est and y_est are needed. Speeds are derivatives of positions, so that they agree with R and L.

The files ``trajectories/<clip>_traj_veh.csv`` (corner points of the vehicles in pixels) and
``ratios/<clip>_ratio_pixel2meter.txt`` (pixels per metre) beside ``trajectories_filtered`` are
optional. They give each vehicle's length. If only the unfiltered pedestrians of a clip were
published (``trajectories/<clip>_traj_ped.csv``: id, x, y, frame, label, in pixels), they are used
with the same ratio, and the counts mention it.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from harness.core.errors import InputError
from harness.model.trajectories.counting import Tally
from harness.model.trajectories.csv_input import (
    EmptyTableError,
    contents_of,
    files_in,
    identifiers,
    in_order,
    once_each,
    read_records,
)
from harness.model.trajectories.extraction_rules import Options, Positive
from harness.model.trajectories.tracks import Clip, Track, VehicleTrack

VEHICLE_END = "_traj_veh_filtered.csv"
PEDESTRIAN_END = "_traj_ped_filtered.csv"
SMALLEST_RATIO, LARGEST_RATIO = 0.01, 1e5
CORNERS = ("x_fl", "y_fl", "x_fr", "y_fr", "x_rr", "y_rr", "x_rl", "y_rl")


class VciOptions(Options):
    """Facts that are not in the files.

    Attributes:
        frame_rate_hz: video frames per second; DUT's 23.98 is 24000/1001.
        vehicle_length_m: length of a vehicle without corner points.
        source: name of the data set; by default the name of the folder given.
    """

    frame_rate_hz: Positive = 24000 / 1001
    vehicle_length_m: Positive = 4.5
    source: str | None = None


def read_clips(paths: Sequence[Path], options: VciOptions, tally: Tally) -> Iterator[Clip]:
    """The clips of ``*_traj_veh_filtered.csv`` files, or of folders with their subfolders, by name.

    Time is frame / frame rate.

    Raises:
        InputError: there is no clip, no clip is usable, or a file has another format.
    """
    rate, assumed = options.frame_rate_hz, ""
    if rate == VciOptions().frame_rate_hz:
        assumed = " (assumed: the files do not say it)"
    tally.note(f"frame_rate_hz = {rate:.6g} frames per second{assumed}; every speed scales with it")
    sources: dict[Path, str] = {}
    files: list[tuple[str, Path]] = []
    for path in paths:
        clips = _clip_files(path)
        folder = path if path.is_dir() else path.parent
        sources |= dict.fromkeys(dict(clips).values(), options.source or folder.resolve().name)
        files += clips

    def read(name: str, file: Path) -> list[Clip]:
        return [_read_clip(sources[file], name, file, options, tally)]

    return contents_of(files, read, tally, "clip")


def _clip_files(path: Path) -> list[tuple[str, Path]]:
    """Clip names and vehicle files; if names are not unique, they include the subfolder."""
    if path.is_file() and not path.name.endswith(VEHICLE_END):
        raise InputError(str(path), "not a vehicle file of this format", f"*{VEHICLE_END}")
    files = files_in(path, f"**/*{VEHICLE_END}")
    names = [file.name.removesuffix(VEHICLE_END) for file in files]
    if len(set(names)) < len(names):
        names = [
            f"{file.parent.relative_to(path).as_posix()}/{name}"
            for file, name in zip(files, names, strict=True)
        ]
    return sorted(zip(names, files, strict=True))


def _read_clip(
    source: str, name: str, vehicle_file: Path, options: VciOptions, tally: Tally
) -> Clip:
    """One clip with its vehicles' lengths."""
    stem = vehicle_file.name.removesuffix(VEHICLE_END)
    ratio = _pixels_per_metre(vehicle_file, stem)
    pedestrian_file = vehicle_file.with_name(stem + PEDESTRIAN_END)
    pixel_file = _beside(vehicle_file, "trajectories", f"{stem}_traj_ped.csv")
    if pedestrian_file.exists():
        walkers = _tracks(pedestrian_file, ("x_est", "y_est"), 1.0, options, tally)
    elif pixel_file is None or ratio is None:
        raise EmptyTableError(str(pedestrian_file), "is missing")
    else:
        walkers = _tracks(pixel_file, ("x", "y"), ratio, options, tally)
        tally.note(f"{name}: unfiltered pedestrians (pixels) used, filtered ones are missing")
    cars = _tracks(vehicle_file, ("x_est", "y_est"), 1.0, options, tally)
    lengths, assumed = _lengths_m(vehicle_file, stem, ratio), options.vehicle_length_m
    vehicles = {}
    for key, track in cars.items():
        length = lengths.get(key, assumed)
        vehicles[key] = VehicleTrack(track.time_s, track.position_m, length, length / 2)
    if without := len(cars.keys() - lengths.keys()):
        tally.note(f"{name}: vehicle_length_m = {assumed:g} m for {without} without corners")
    tally.clips += 1
    return Clip(source, name, vehicles, walkers, y_down=True)


def _beside(vehicle_file: Path, folder: str, name: str) -> Path | None:
    """A companion file: in the sibling tree of ``trajectories_filtered``, or in the same folder."""
    parts = list(vehicle_file.parent.parts)
    places = [vehicle_file.parent]
    if "trajectories_filtered" in parts:
        at = len(parts) - 1 - parts[::-1].index("trajectories_filtered")
        places.insert(0, Path(*parts[:at], folder, *parts[at + 1 :]))
    return next((place / name for place in places if (place / name).is_file()), None)


def _pixels_per_metre(vehicle_file: Path, stem: str) -> float | None:
    """The clip's scale; None if there is no ratio file."""
    path = _beside(vehicle_file, "ratios", f"{stem}_ratio_pixel2meter.txt")
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


def _lengths_m(vehicle_file: Path, stem: str, ratio: float | None) -> dict[str, float]:
    """Median length of each vehicle: middle of its front corners to middle of its rear corners."""
    path = _beside(vehicle_file, "trajectories", f"{stem}_traj_veh.csv")
    if path is None or ratio is None:
        return {}
    # These records are not positions, so the extraction does not count those that are dropped.
    table = read_records(path, {name: (name, 1.0) for name in CORNERS}, Tally(), ["id"])
    x = (table["x_fl"] + table["x_fr"] - table["x_rr"] - table["x_rl"]) / 2
    y = (table["y_fl"] + table["y_fr"] - table["y_rr"] - table["y_rl"]) / 2
    medians = (
        pd.Series(np.hypot(x, y) / ratio, table.index).groupby(identifiers(table["id"])).median()
    )
    return {str(key): float(value) for key, value in medians.items() if value > 0}


def _tracks(
    path: Path, position: tuple[str, str], ratio: float, options: VciOptions, tally: Tally
) -> dict[str, Track]:
    """The tracks of one file, by identifier; positions have ``ratio`` units per metre."""
    columns = {"time_s": ("frame", options.frame_rate_hz)}
    columns |= {of: (name, ratio) for of, name in zip(("x_m", "y_m"), position, strict=True)}
    table = read_records(path, columns, tally, ["id"])
    keys = identifiers(table["id"])
    tally.drop("records", "missing_value", keys.isna().sum())
    tracks = {}
    groups = {str(key): records for key, records in table.groupby(keys)}
    for key in in_order(groups):
        records = once_each(groups[key], "time_s", tally)
        if len(records) < 2:
            tally.drop("tracks", "one_record")
            continue
        tracks[key] = Track(records["time_s"].to_numpy(), records[["x_m", "y_m"]].to_numpy())
    return tracks
