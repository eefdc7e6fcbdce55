"""Maps the name of a data format to its reader and options: one line for each format."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from harness.model.trajectories import mobileye, vci
from harness.model.trajectories.counting import Tally
from harness.model.trajectories.mobileye import MobileyeOptions
from harness.model.trajectories.ready_rows import TableOptions, read_rows
from harness.model.trajectories.tracks import Clip
from harness.model.trajectories.vci import VciOptions


@dataclass(frozen=True)
class Format:
    """The reader of a data format.

    Attributes:
        words: a description in one line.
        options: the class of the reader's options.
        clips: yields the clips (tracks); None for ready-made rows.
        rows: returns ready-made rows; None if rows come from tracks.
    """

    words: str
    options: type[Any]
    clips: Callable[[Sequence[Path], Any, Tally], Iterator[Clip]] | None = None
    rows: Callable[[Sequence[Path], Any, Tally], pd.DataFrame] | None = None


FORMATS: Mapping[str, Format] = {
    "vci": Format("fixed camera, DUT and sets like it", VciOptions, vci.read_clips),
    "mobileye": Format("the paper's bus-mounted sensor", MobileyeOptions, mobileye.read_clips),
    "table": Format("ready-made rows, csv or parquet", TableOptions, rows=read_rows),
}
