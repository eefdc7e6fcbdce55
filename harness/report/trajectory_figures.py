"""Figures of raw trajectories: where vehicles and pedestrians were, and one passing event.

After the paper's figures of the data collection (routes of the instrumented vehicles with the
detected pedestrians; a sample passing event coloured by time). Each function draws into an axes
that it is given and neither saves nor shows anything.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from harness.errors import unknown_name
from harness.report.style import BLUE, GRID, MUTED, VERMILLION, figure_text
from harness.trajectories import Clip, ExtractionRules, Track, conflict_point

VEHICLE_COLOUR = VERMILLION
PEDESTRIAN_COLOUR = BLUE
PATH_COLOUR = MUTED
# Positions are drawn at this interval: the model's rows stand as far apart, and dots stay apart.
DRAWN_EVERY_S = 0.2
LEGEND_DROP_INCH = -0.5


def draw_map(axes: Axes, clips: Sequence[Clip], title: str | None = None) -> None:
    """Routes of the vehicles over the positions of the pedestrians.

    Args:
        axes: drawn into; x and y in metres, equal scales.
        clips: of one site and one frame of reference.
        title: what is shown; the numbers of vehicles, pedestrians and clips stand below it.
    """
    walkers = [track for clip in clips for track in clip.pedestrians.values()]
    vehicles = [track for clip in clips for track in clip.vehicles.values()]
    dots = [_drawn(track)[1] for track in walkers]
    if dots:
        x, y = np.vstack(dots).T
        # The more dots, the fainter, so that busy places show as dark and lone walks stay visible.
        alpha = float(np.clip(60 / np.sqrt(len(x)), 0.15, 0.8))
        axes.plot(x, y, ".", color=PEDESTRIAN_COLOUR, markersize=3, alpha=alpha, mew=0, zorder=2)
    for track in vehicles:
        _draw_route(axes, track)
    handles = [
        Line2D([], [], color=VEHICLE_COLOUR, lw=2, label="vehicle route (from dot to arrow)"),
        Line2D([], [], color=PEDESTRIAN_COLOUR, ls="", marker=".", ms=9, label="pedestrian"),
    ]
    counted = f"n = {len(vehicles)} vehicles, {len(walkers):,} pedestrians"
    counted += f", {sum(map(len, dots)):,} positions, {len(clips)} clip{'s'[: len(clips) != 1]}"
    _finish(axes, clips, title or "Vehicle routes and pedestrian positions", counted)
    _legend(axes, handles, columns=2)


def draw_passing_event(axes: Axes, clip: Clip, vehicle: str, pedestrian: str) -> PathCollection:
    """One vehicle and one pedestrian, coloured by time, with a colour bar.

    Time runs from the first instant at which both were recorded; whole paths are drawn in grey,
    and a cross marks their conflict point where they have one.

    Args:
        axes: drawn into; x and y in metres, equal scales. Its figure gets the colour bar.
        clip: holds both tracks.
        vehicle, pedestrian: identifiers in the clip.

    Returns:
        The coloured marks of the vehicle, whose colour scale both share.

    Raises:
        InputError: the clip has no such vehicle or pedestrian.
    """
    car = _named(clip, "vehicle", vehicle, clip.vehicles)
    walker = _named(clip, "pedestrian", pedestrian, clip.pedestrians)
    start = max(car.time_s[0], walker.time_s[0])
    end = max(min(car.time_s[-1], walker.time_s[-1]), start)
    centred = clip.vehicles[vehicle].front_offset_m > 0
    marks, handle = _draw_timed(axes, car, "s", (start, end))
    _, other = _draw_timed(axes, walker, "o", (start, end))
    handle.set_label(f"vehicle ({'centre' if centred else 'front'}), {handle.get_label()}")
    other.set_label(f"pedestrian, {other.get_label()}")
    handles = [handle, other]
    point = conflict_point(car, walker, ExtractionRules())
    if point is not None:
        axes.plot(*point, "x", color=VEHICLE_COLOUR, ms=10, mew=2.2, zorder=4)
        cross = Line2D([], [], ls="", marker="x", color=VEHICLE_COLOUR, ms=8, mew=2.2)
        cross.set_label("conflict point")
        handles.append(cross)
    # An inset keeps the bar as high as the axes, whatever shape equal scales give them.
    bar = axes.figure.colorbar(marks, cax=axes.inset_axes((1.03, 0.0, 0.035, 1.0)))
    bar.set_label("time since both were in view (s)")
    title = f"{clip.name}: vehicle {vehicle}, pedestrian {pedestrian}"
    counted = f"{end - start:.1f} s in common, one mark every {DRAWN_EVERY_S:g} s"
    _finish(axes, [clip], title, counted)
    _legend(axes, handles, columns=len(handles))
    return marks


def _draw_timed(
    axes: Axes, track: Track, marker: str, span_s: tuple[float, float]
) -> tuple[PathCollection, Line2D]:
    """A whole path in grey, its marks within the span coloured by time; marks and legend entry."""
    axes.plot(*track.position_m.T, color=PATH_COLOUR, lw=1.2, zorder=1)
    times, xy = _drawn(track, *span_s)
    dots = axes.scatter(
        xy[:, 0], xy[:, 1], s=26, c=times - span_s[0], marker=marker, linewidths=0, zorder=3
    )
    dots.set_cmap("viridis")
    dots.set_clim(0, max(span_s[1] - span_s[0], DRAWN_EVERY_S))
    label = f"n = {len(times)}"
    return dots, Line2D([], [], ls="", marker=marker, color="#31688e", ms=6, label=label)


def _named(clip: Clip, kind: str, name: str, tracks: Mapping[str, Track]) -> Track:
    """The track of that name, or a refusal with the nearest one."""
    if name not in tracks:
        raise unknown_name(f"clip {clip.name}", kind, name, tracks)
    return tracks[name]


def _drawn(
    track: Track, start: float = -np.inf, end: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Times and (n, 2) positions of a track at the drawing interval, within [start, end]."""
    start, end = max(start, track.time_s[0]), min(end, track.time_s[-1])
    times = np.arange(start, end + 1e-9, DRAWN_EVERY_S)
    x, y = (np.interp(times, track.time_s, values) for values in track.position_m.T)
    return times, np.column_stack([x, y])


def _draw_route(axes: Axes, track: Track) -> None:
    """A vehicle's path: a dot where it was first seen, an arrow head where it was last."""
    axes.plot(*track.position_m.T, color=VEHICLE_COLOUR, lw=1.8, alpha=0.85, zorder=3)
    axes.plot(*track.position_m[0], "o", color=VEHICLE_COLOUR, ms=4, zorder=4)
    away = np.hypot(*(track.position_m - track.position_m[-1]).T)
    if away.max() >= 1.0:
        tail = track.position_m[np.flatnonzero(away >= 1.0)[-1]]
        style = {"arrowstyle": "-|>", "color": VEHICLE_COLOUR, "mutation_scale": 13, "lw": 1.8}
        axes.annotate("", xy=track.position_m[-1], xytext=tail, arrowprops=style, zorder=4)


def _finish(axes: Axes, clips: Sequence[Clip], title: str, counted: str) -> None:
    """Units, equal scales, a quiet grid, and the title with what was counted."""
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_aspect("equal", adjustable="box")
    _set_limits(axes)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.set_title(figure_text(title), fontsize=11, loc="left", pad=20)
    axes.annotate(
        counted,
        xy=(0, 1),
        xycoords="axes fraction",
        xytext=(0, 6),
        textcoords="offset points",
        fontsize=9,
        color=MUTED,
    )
    if any(clip.y_down for clip in clips):
        axes.invert_yaxis()


def _set_limits(axes: Axes) -> None:
    """Room around what was drawn; the short side stays legible beside a long one."""
    box = axes.dataLim
    if not np.isfinite(box.get_points()).all():
        return
    longer = max(box.width, box.height, 1.0)
    for centre, span, set_limits in (
        ((box.x0 + box.x1) / 2, box.width, axes.set_xlim),
        ((box.y0 + box.y1) / 2, box.height, axes.set_ylim),
    ):
        half = max(span, 0.4 * longer) / 2 + 0.04 * longer
        set_limits(centre - half, centre + half)


def _legend(axes: Axes, handles: list[Line2D], columns: int) -> None:
    """The legend below the x label, a fixed distance under the axes whatever their height."""
    drop = ScaledTranslation(0, LEGEND_DROP_INCH, axes.figure.dpi_scale_trans)
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        bbox_transform=axes.transAxes + drop,
        ncols=columns,
        frameon=False,
        fontsize=9,
        handletextpad=0.4,
        columnspacing=1.4,
    )
