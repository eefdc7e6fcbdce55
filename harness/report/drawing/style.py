"""The one style of every figure: colours, dashes, markers, hatches, and quiet axes.

The colours are those of Okabe and Ito (2008), which colour-blind readers can tell apart; the two
pale ones are darkened.  Dash, marker or hatch repeat what a colour says, so figures can be read in
greyscale.  The page replaces these colours in its dark scheme, so figures use no others.
"""

import textwrap
import unicodedata
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from harness.core.encounter import Arm

INK = "#1b1f24"
MUTED = "#57606a"
GRID = "#d8dee4"
ROAD = "#c4cad1"
PATH = "#e4e7eb"
BLUE = "#0072b2"
VERMILLION = "#d55e00"
GREEN = "#009e73"
PURPLE = "#b0578d"
ORANGE = "#b77f00"

WIDTH_INCH = 5.8
HEIGHT_INCH = 3.7
_LEGEND_DROP_INCH = -0.46
_CAPTION_SIGNS_PER_INCH = 15


@dataclass(frozen=True, slots=True)
class Look:
    """How one series is drawn."""

    colour: str
    dash: Any
    marker: str


AV = Look(BLUE, "-", "o")
HUMAN = Look(VERMILLION, "--", "s")
ARM_LOOKS = {Arm.AV: AV, Arm.HUMAN: HUMAN}
SERIES = (
    AV,
    HUMAN,
    Look(GREEN, "-.", "^"),
    Look(PURPLE, ":", "D"),
    Look(INK, (0, (7, 2)), "v"),
    Look(ORANGE, (0, (5, 1, 1, 1, 1, 1)), "P"),
)
"""Looks of the lines of a figure, in order; more lines could not be told apart."""

_SETTINGS: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "sans-serif"],
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.labelsize": 10,
    "legend.fontsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "hatch.linewidth": 0.6,
    # Text stays text: it is small, selectable, searchable and can be read aloud.
    "svg.fonttype": "none",
    "svg.hashsalt": "crosswalk",
    "pdf.fonttype": 42,
}


@dataclass(frozen=True)
class Picture:
    """A figure with its name (of files), title and caption."""

    name: str
    title: str
    caption: str
    figure: Figure


@contextmanager
def styled() -> Iterator[None]:
    """Give the figures that are made and saved inside the style's sizes and fonts."""
    with mpl.rc_context(_SETTINGS), without_glyph_warnings():
        yield


@contextmanager
def without_glyph_warnings() -> Iterator[None]:
    """Silence the warning about letters that the font lacks, which are drawn as boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        yield


def new_figure(
    down: int = 1, across: int = 1, *, height: float = HEIGHT_INCH, width: float = WIDTH_INCH
) -> tuple[Figure, list[Axes]]:
    """A figure without a window, its axes in reading order; the page's are made in ``styled``."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(down, across, squeeze=False)
    return figure, list(axes.ravel())


def finish(axes: Axes, across: str, up: str, count: str | None = None) -> None:
    """Add labels with units, a light grid, and the sample size above the right corner."""
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if count is not None:
        axes.set_title(figure_text(count), loc="right", fontsize=9, color=MUTED)


def legend_below(axes: Axes) -> None:
    """Add a legend below the axes, where it covers nothing."""
    if axes.get_legend_handles_labels()[1]:
        drop = ScaledTranslation(0, _LEGEND_DROP_INCH, axes.figure.dpi_scale_trans)
        axes.legend(
            frameon=False,
            loc="upper center",
            bbox_to_anchor=(0.5, 0.0),
            bbox_transform=axes.transAxes + drop,
            ncols=2,
            columnspacing=1.6,
        )


def caption(figure: Figure, words: str) -> None:
    """Add a caption below a figure, wrapped to its width."""
    width = int(figure.get_figwidth() * _CAPTION_SIGNS_PER_INCH)
    figure.supxlabel("\n".join(textwrap.wrap(figure_text(words), width)), fontsize=8.5, color=MUTED)


def figure_text(text: object) -> str:
    """Text from a file made safe for a figure: no control characters, no mathematics."""
    kept = (
        c if unicodedata.category(c)[0] != "C" else "\N{REPLACEMENT CHARACTER}" for c in str(text)
    )
    return "".join(kept).replace("$", r"\$")
