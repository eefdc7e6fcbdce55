"""The style of every figure: colours, dashes, markers, hatches and axes.

The colours are by Okabe and Ito (2008), because colour-blind readers can distinguish them; the two
pale colours are darkened.  Every colour has its own dash, marker or hatch, so figures can be read
in greyscale.  The page replaces these colours in its dark scheme, so figures use no others.
"""

import textwrap
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unicodedata import category

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


@dataclass(frozen=True, slots=True)
class Look:
    """The look of one series."""

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
"""Looks of a figure's lines, in order.  More lines could not be distinguished."""

_SETTINGS: dict[Any, Any] = {
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "sans-serif"],
    "font.family": "sans-serif",
    **dict.fromkeys(("font.size", "axes.labelsize"), 10),
    "axes.titlesize": 11,
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 9),
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.labelcolor", "ytick.labelcolor"), INK),
    **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), MUTED),
    "hatch.linewidth": 0.6,
    # Text is not converted to paths, so it is small, searchable and can be read aloud.
    "svg.fonttype": "none",
    "svg.hashsalt": "crosswalk",
    "pdf.fonttype": 42,
}


@dataclass(frozen=True)
class Picture:
    """A figure with its file name, title and caption."""

    name: str
    title: str
    caption: str
    figure: Figure


@contextmanager
def styled() -> Iterator[None]:
    """Apply the style's sizes and fonts to figures that are made and saved in this context."""
    with mpl.rc_context(_SETTINGS), without_glyph_warnings():
        yield


@contextmanager
def without_glyph_warnings() -> Iterator[None]:
    """Silence the warning about letters that the font lacks; they are drawn as boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        yield


def new_figure(
    down: int = 1, across: int = 1, *, height: float = HEIGHT_INCH, width: float = WIDTH_INCH
) -> tuple[Figure, list[Axes]]:
    """Return a figure without a window, and its axes in reading order."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, list(figure.subplots(down, across, squeeze=False).ravel())


def finish(axes: Axes, across: str, up: str, count: str | None = None) -> None:
    """Add labels with units, a grid, the sample size, and a legend below the axes."""
    axes.set(xlabel=across, ylabel=up, axisbelow=True)
    axes.grid(color=GRID, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    if count is not None:
        axes.set_title(figure_text(count), loc="right", fontsize=9, color=MUTED)
    if axes.get_legend_handles_labels()[1]:
        below = axes.transAxes + ScaledTranslation(0, -0.46, axes.figure.dpi_scale_trans)
        axes.legend(
            frameon=False, loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=below,
            ncols=2, columnspacing=1.6,
        )  # fmt: skip


def caption(figure: Figure, words: str) -> None:
    """Add a caption below a figure, wrapped to its width."""
    signs = int(15 * figure.get_figwidth())
    figure.supxlabel(textwrap.fill(figure_text(words), signs), fontsize=8.5, color=MUTED)


def figure_text(text: object) -> str:
    """Make text from a file safe for a figure, without control characters and mathematics."""
    kept = ("\N{REPLACEMENT CHARACTER}" if category(c)[0] == "C" else c for c in str(text))
    return "".join(kept).replace("$", r"\$")
