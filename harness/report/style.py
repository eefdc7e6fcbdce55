"""The style of every figure: colours, dashes, markers and axes; and figures as files.

The colours are by Okabe and Ito (2008), because colour-blind readers can distinguish them; the two
pale ones are darkened.  Every colour has its own dash and marker, so figures can be read in
greyscale.  The page replaces these colours in its dark scheme, so figures use no others.
"""

import io
import textwrap
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from harness.core.files import cannot_write, write_file
from harness.core.vocabulary import Arm
from harness.report.words import printable

INK = "#1b1f24"
MUTED = "#57606a"
GRID = "#d8dee4"
BLUE = "#0072b2"
VERMILLION = "#d55e00"
GREEN = "#009e73"
PURPLE = "#b0578d"
ORANGE = "#b77f00"

WIDTH_INCH = 5.8
HEIGHT_INCH = 3.7


class Look(NamedTuple):
    """The look of one series."""

    colour: str
    dash: Any
    marker: str


AV = Look(BLUE, "-", "o")
HUMAN = Look(VERMILLION, "--", "s")
ARM_LOOKS = MappingProxyType({Arm.AV: AV, Arm.HUMAN: HUMAN})
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
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 9),
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.labelcolor", "ytick.labelcolor"), INK),
    **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), MUTED),
    "hatch.linewidth": 0.6,
    # Text is not converted to paths, so it is small, searchable and can be read aloud.
    "svg.fonttype": "none",
    "svg.hashsalt": "crosswalk",
    "pdf.fonttype": 42,
}


@contextmanager
def styled() -> Iterator[None]:
    """Apply sizes and fonts to figures that are made and saved in this context."""
    with mpl.rc_context(_SETTINGS), warnings.catch_warnings():
        # Letters that the font lacks are drawn as boxes.
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        yield


def new_figure(panels: int = 1, height_inch: float = HEIGHT_INCH) -> tuple[Figure, list[Axes]]:
    """A figure without a window, and its axes from top to bottom."""
    figure = Figure(figsize=(WIDTH_INCH, height_inch), layout="constrained")
    return figure, list(figure.subplots(panels, 1, squeeze=False).ravel())


def finish(axes: Axes, across: str, up: str, count: str = "") -> None:
    """Add labels with units, a grid, the number of pairs, and a legend below the axes."""
    axes.set(xlabel=figure_text(across), ylabel=figure_text(up), axisbelow=True)
    axes.grid(color=GRID, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(count, loc="right", fontsize=9, color=MUTED)
    if axes.get_legend_handles_labels()[1]:
        below = axes.transAxes + ScaledTranslation(0, -0.46, axes.figure.dpi_scale_trans)
        axes.legend(
            frameon=False, loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=below,
            ncols=2, columnspacing=1.6,
        )  # fmt: skip


def figure_text(text: object) -> str:
    """A text from a file for a figure, in which ``$`` would begin mathematics."""
    return printable(text).replace("$", r"\$")


def save(figure: Figure, caption: str, folder: Path, name: str) -> list[Path]:
    """Write ``name.png`` and ``name.pdf`` with a caption, without time stamps.

    Raises:
        HarnessError: the folder or a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from None
    words = textwrap.fill(figure_text(caption), int(15 * WIDTH_INCH))
    below = figure.supxlabel(words, fontsize=8.5, color=MUTED)
    written = []
    for suffix, metadata in (("png", {"Software": None}), ("pdf", {"CreationDate": None})):
        buffer = io.BytesIO()
        figure.savefig(buffer, format=suffix, dpi=150, bbox_inches="tight", metadata=metadata)
        written.append(folder / f"{name}.{suffix}")
        write_file(written[-1], buffer.getvalue())
    below.remove()
    return written
