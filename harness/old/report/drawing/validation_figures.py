"""Figures of a validation: errors of the pass time, and speeds along the road.

Each function draws into the given axes and neither saves nor shows the figure.
"""

from collections.abc import Sequence

from matplotlib.axes import Axes

from harness.old.report.drawing import style
from harness.old.studies.validation import DriverOutcome, Validation


def draw_errors(axes: Axes, validation: Validation) -> None:
    """Draw, for each driver, the share of drives whose pass time has an error of at most x."""
    recorded = validation.recorded
    for driver, look in zip(validation.findings.drivers, style.SERIES, strict=False):
        errors_s = [
            abs(drive.pass_time_s - truth.pass_time_s)
            for drives, truth in zip(validation.outcomes[driver.driver], recorded, strict=True)
            for drive in drives
        ]
        name = style.figure_text(driver.driver)
        axes.ecdf(errors_s, color=look.colour, ls=look.dash, lw=1.7, label=name)
    axes.set_xlim(0, None)
    axes.set_ylim(0, 1.02)
    count = f"n = {len(recorded):,} passages"
    style.finish(axes, "absolute error of the pass time (s)", "share of drives at most x", count)


def draw_speeds(
    axes: Axes, outcomes: Sequence[DriverOutcome], look: style.Look, name: str, highest_mps: float
) -> None:
    """Draw the speed along the road for one drive of every passage."""
    for drive in outcomes:
        axes.plot(drive.trace.x_m, drive.trace.speed_mps, color=look.colour, lw=0.8, alpha=0.6)
    axes.axvline(0.0, color=style.MUTED, lw=0.8, ls=":")
    axes.set_xlim(-30, 15)
    axes.set_ylim(0, highest_mps)
    axes.set_title(style.figure_text(name), loc="left")
    style.finish(axes, "front bumper from x = 0 (m)", "speed (m/s)")


def pictures_of(validation: Validation) -> list[style.Picture]:
    """Return the page's figures.  Call this inside ``style.styled``."""
    errors, (axes,) = style.new_figure()
    draw_errors(axes, validation)
    shown = [driver.driver for driver in validation.findings.drivers[:3]]
    figure, panels = style.new_figure(2, 2, height=5.6)
    series = [("recorded drivers", validation.recorded)] + [
        (name, [drives[0] for drives in validation.outcomes[name]]) for name in shown
    ]
    highest = 1.05 * max(drive.trace.speed_mps.max() for _, drives in series for drive in drives)
    for panel, (name, drives), look in zip(panels, series, style.SERIES, strict=False):
        draw_speeds(panel, drives, look, name, highest)
    for panel in panels[len(series) :]:
        panel.set_visible(False)
    return [
        style.Picture(
            "errors",
            "Errors of the pass times",
            "The recorded drivers would be a step at 0. If a driver is random, each of its drives "
            "of a passage counts.",
            errors,
        ),
        style.Picture(
            "speeds",
            "Speeds along the road, recorded and simulated",
            "Every passage, recorded and as driven by the nearest drivers; x = 0 is the group's "
            "median conflict point. Of a random driver the first drive is shown.",
            figure,
        ),
    ]
