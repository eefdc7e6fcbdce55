"""Figures of recorded trajectories: a map of the tracks, and one passing event.

They follow the paper's figures of the data collection.  Each function draws into the given axes
and neither saves nor shows the figure.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from harness.core.encounter import FloatArray
from harness.core.errors import unknown_name
from harness.model.trajectories import Clip, ExtractionRules, Track, conflict_point
from harness.old.report.drawing.style import BLUE, MUTED, VERMILLION, figure_text, finish

# Positions are drawn at this interval, which the model's rows have too.
DRAWN_EVERY_S = 0.2


def draw_map(axes: Axes, clips: Sequence[Clip], title: str | None = None) -> None:
    """Draw the vehicles' routes over the pedestrians' positions.

    Args:
        clips: clips of one site and one frame of reference.
        title: title, above the numbers of vehicles, pedestrians and clips.
    """
    walkers = [track for clip in clips for track in clip.pedestrians.values()]
    vehicles = [track for clip in clips for track in clip.vehicles.values()]
    dots = np.vstack([np.empty((0, 2)), *(_drawn(track)[1] for track in walkers)])
    # More dots are fainter, so that busy places are dark and single walks stay visible.
    alpha = float(np.clip(60 / np.sqrt(max(len(dots), 1)), 0.15, 0.8))
    axes.plot(*dots.T, ".", color=BLUE, ms=3, alpha=alpha, mew=0)
    for track in vehicles:
        _draw_route(axes, track)
    axes.plot([], [], color=VERMILLION, lw=2, label="vehicle route (from dot to arrow)")
    axes.plot([], [], ".", color=BLUE, ms=9, label="pedestrian")
    numbers = f"n = {len(vehicles)} vehicles, {len(walkers):,} pedestrians"
    numbers += f", {len(dots):,} positions, {len(clips)} clip{'s'[: len(clips) != 1]}"
    _finish(axes, clips, title or "Vehicle routes and pedestrian positions", numbers)


def draw_passing_event(axes: Axes, clip: Clip, vehicle: str, pedestrian: str) -> PathCollection:
    """Draw one vehicle and one pedestrian, coloured by time, with a colour bar.

    Time begins at the first instant at which both were recorded.  Whole paths are drawn in grey.
    A cross marks the conflict point if there is one.

    Args:
        axes: the axes, whose figure gets the colour bar.
        clip: the clip with both tracks.
        vehicle, pedestrian: identifiers in the clip.

    Returns:
        The vehicle's coloured marks.  The pedestrian's marks have the same colour scale.

    Raises:
        InputError: the clip has no such vehicle or pedestrian.
    """
    if vehicle not in clip.vehicles:
        raise unknown_name(f"clip {clip.name}", "vehicle", vehicle, clip.vehicles)
    if pedestrian not in clip.pedestrians:
        raise unknown_name(f"clip {clip.name}", "pedestrian", pedestrian, clip.pedestrians)
    car, walker = clip.vehicles[vehicle], clip.pedestrians[pedestrian]
    start = max(car.time_s[0], walker.time_s[0])
    end = max(min(car.time_s[-1], walker.time_s[-1]), start)
    place = "centre" if car.front_offset_m > 0 else "front"
    marks = _draw_timed(axes, car, "s", (start, end), f"vehicle ({place})")
    _draw_timed(axes, walker, "o", (start, end), "pedestrian")
    point = conflict_point(car, walker, ExtractionRules())
    if point is not None:
        label = "conflict point"
        axes.plot(*point, "x", color=VERMILLION, ms=10, mew=2.2, zorder=4, label=label)
    axes.figure.colorbar(marks, ax=axes, label="time since both were in view (s)")
    numbers = f"{end - start:.1f} s in common, one mark every {DRAWN_EVERY_S:g} s"
    _finish(axes, [clip], f"{clip.name}: vehicle {vehicle}, pedestrian {pedestrian}", numbers)
    return marks


def _draw_timed(
    axes: Axes, track: Track, marker: str, span_s: tuple[float, float], name: str
) -> PathCollection:
    """Draw a whole path in grey, and its marks within the time span coloured by time."""
    axes.plot(*track.position_m.T, color=MUTED, lw=1.2, zorder=1)
    times, xy = _drawn(track, *span_s)
    return axes.scatter(
        xy[:, 0], xy[:, 1], 26, times - span_s[0], marker=marker, cmap="viridis", vmin=0,
        vmax=max(span_s[1] - span_s[0], DRAWN_EVERY_S), linewidths=0, zorder=3,
        label=f"{name}, n = {len(times)}",
    )  # fmt: skip


def _drawn(
    track: Track, start: float = -np.inf, end: float = np.inf
) -> tuple[FloatArray, FloatArray]:
    """Return times and (n, 2) positions of a track at the drawing interval in [start, end]."""
    start, end = max(start, track.time_s[0]), min(end, track.time_s[-1])
    times = np.arange(start, end + 1e-9, DRAWN_EVERY_S)
    x, y = (np.interp(times, track.time_s, values) for values in track.position_m.T)
    return times, np.column_stack([x, y])


def _draw_route(axes: Axes, track: Track) -> None:
    """Draw a vehicle's path, with a dot at its first and an arrow head at its last position."""
    axes.plot(*track.position_m.T, color=VERMILLION, lw=1.8, alpha=0.85)
    axes.plot(*track.position_m[0], "o", color=VERMILLION, ms=4)
    away = np.hypot(*(track.position_m - track.position_m[-1]).T)
    if away.max() >= 1.0:
        tail = track.position_m[np.flatnonzero(away >= 1.0)[-1]]
        style = {"arrowstyle": "-|>", "color": VERMILLION, "mutation_scale": 13, "lw": 1.8}
        axes.annotate("", xy=track.position_m[-1], xytext=tail, arrowprops=style)


def _finish(axes: Axes, clips: Sequence[Clip], title: str, numbers: str) -> None:
    """Add units, equal scales, the title with the numbers below it, and the legend."""
    finish(axes, "x (m)", "y (m)")
    # The short side's limits are widened, so that the map stays legible.
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"{figure_text(title)}\n{numbers}", loc="left")
    if any(clip.y_down for clip in clips):
        axes.invert_yaxis()
