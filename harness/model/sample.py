"""A sample: rows of encounters inside the model's box, with weights, to which a model is fitted."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from harness.core.documents import parse_json
from harness.core.errors import InputError, Parameter, unknown_name
from harness.core.freezing import Frozen, frozen
from harness.core.vocabulary import FloatArray, IntArray
from harness.model.interaction import INVERSE_RANGE, PEDESTRIAN_SPEED, VARIABLES
from harness.model.mixture.normals import effective
from harness.model.trajectories.extraction import ENCOUNTER_KEY, EXTRACTION_KEY, VEHICLE_KEY
from harness.model.trajectories.rules import TEXT_COLUMNS
from harness.model.trajectories.table import identifiers, read_table, require_columns

MODEL_COLUMNS = ("range_m", "vehicle_speed_mps", "pedestrian_speed_mps", "time_advantage_s")
LABELS = ("range_m (as 1/R)", MODEL_COLUMNS[1], MODEL_COLUMNS[2], "time_advantage_s (as 1/T_adv)")
"""The model's variables in messages: by the columns of the user's file."""

_INVERTED = [at for at, name in enumerate(VARIABLES) if name.startswith("inverse_")]
"""The variables that are the inverse of their column."""

BOX_LOWER, BOX_UPPER = (1 / 60, 0.3, 0.3, 0.0), (0.5, 8.0, 3.0, 2.0)
"""Bounds of the variables.  A sensor resolves R up to 60 m and 1/T_adv up to 2 per s.  The least
speeds are the extraction's; they keep E[1/T_adv] and passing times finite."""


class RowFile(NamedTuple):
    """Rows, the sha256 of their file, and what ``harness extract`` says of them: {} otherwise.

    ``damaged``: what it says cannot be read.  The frame belongs to whoever asked for it.
    """

    rows: pd.DataFrame
    sha256: str
    extraction: Mapping[str, Any]
    damaged: bool = False


@dataclass(frozen=True, eq=False)
class Sample(Frozen):
    """Weighted rows inside a box.

    Attributes:
        data: (n, 4), the model's variables in its order.
        weights: (n,) > 0.  A row that occurs in m encounters has weight 1/m in each.  Without such
            copies the sum is the number of encounters, or n if rows have no identifiers.
        row: (n,) index of the distinct row; copies have the same index.
        vehicle, encounter: (n,) index of the row's vehicle and encounter; None if a row does not
            identify them.  Vehicles that share a row or a recorded track are one vehicle.
        named_vehicles: number of different names of vehicles; None if unknown.
        lower, upper: (4,) the box.
        tracks: fingerprints of the vehicles' recorded tracks; empty if unknown.
        sources: names of the data sets.
        rows_read: number of rows before the box was applied.
        outside: column → number of rows outside the box there; a row may count several times.
        weigh: how the rows were weighted.
    """

    data: FloatArray
    weights: FloatArray
    row: IntArray
    vehicle: IntArray | None
    encounter: IntArray | None
    named_vehicles: int | None
    lower: FloatArray
    upper: FloatArray
    tracks: Sequence[str] = ()
    sources: Sequence[str] = ()
    rows_read: int = 0
    outside: Mapping[str, int] | None = None
    weigh: str = "row"

    @property
    def vehicles(self) -> int | None:
        """Number of vehicles inside the box; None if rows do not identify them."""
        return None if self.vehicle is None else int(self.vehicle.max()) + 1

    @property
    def copies(self) -> int:
        """Number of rows that repeat an earlier row."""
        return len(self.row) - len(np.unique(self.row))


def read_rows(path: Path) -> RowFile:
    """Read the Parquet file of ``harness extract``, or a CSV file with the same columns.

    Raises:
        InputError: the file is missing, unreadable or empty, or lacks a column or has text in it.
    """
    if not path.is_file():
        raise InputError(str(path), "no such file, or no regular one", "rows of `harness extract`")
    rows = read_table(path)
    require_columns(path, rows, MODEL_COLUMNS)
    for name in MODEL_COLUMNS:
        if not pd.api.types.is_numeric_dtype(rows[name]):
            raise InputError(f"{path}: {name}", "contains text", "numbers")
    # Other programs write identifiers of any type.
    given = [name for name in TEXT_COLUMNS if name in rows]
    rows = rows.assign(**{name: identifiers(path, rows[name]) for name in given})
    try:
        metadata = pq.read_schema(path).metadata or {}
    except (OSError, pa.ArrowException):  # it is CSV
        metadata = {}
    try:
        about = parse_json(metadata.get(EXTRACTION_KEY, b"{}"))
    except ValueError:
        about = None
    known = isinstance(about, dict)
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return RowFile(rows, sha256, frozen(about if known else {}), not known)


def box_of(texts: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Lower and upper bounds (4,): the default ones with changes by name.

    >>> box_of(["vehicle_speed_mps=0.3:14", "inverse_range_per_m=1/100:0.5"])[1].tolist()
    [0.5, 14.0, 3.0, 2.0]

    Raises:
        InputError: a variable is unknown, or its bounds are no numbers, not in order or negative.
    """
    box = np.array((BOX_LOWER, BOX_UPPER))
    for text in texts:
        name, _, values = text.partition("=")
        if name not in VARIABLES:
            raise unknown_name(Parameter("bounds", text), "variable", name, VARIABLES)
        variable = VARIABLES.index(name)
        try:
            low, high = (
                float(above) / float(below or 1)
                for above, _, below in (value.partition("/") for value in values.split(":"))
            )
        except (ValueError, ZeroDivisionError):
            low, high = -1.0, -1.0
        # R and passing times are finite.
        if not 0 <= low < high < np.inf or (
            low == 0 and variable in (INVERSE_RANGE, PEDESTRIAN_SPEED)
        ):
            allowed = "LOW:HIGH, e.g. 0.3:8 or 1/60:0.5, lower < upper, above 0"
            raise InputError(Parameter("bounds", text), "is not accepted", allowed)
        box[:, variable] = low, high
    return box[0], box[1]


def make_sample(
    rows: pd.DataFrame,
    weigh: str = "encounter",
    lower: ArrayLike = BOX_LOWER,
    upper: ArrayLike = BOX_UPPER,
) -> Sample:
    """Check the rows, leave out those outside the box, and weight the others.

    Args:
        rows: a table with ``MODEL_COLUMNS``.  Weighting by encounter or vehicle also needs the
            identifiers ``source, clip, vehicle, pedestrian``.
        weigh: ``row``, ``encounter`` or ``vehicle``, see ``row_weights``.
        lower, upper: (4,) the box.

    Raises:
        InputError: a value is not finite, R or T_adv is not above 0, or no row is left.  The
            message has the column and the number of rows.
    """
    lower, upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
    data = _variables(rows)
    outside = (data < lower) | (data > upper)
    inside = ~outside.any(axis=1)
    kept: pd.DataFrame = rows.iloc[np.flatnonzero(inside)].reset_index(drop=True)
    if kept.empty:
        box = zip(VARIABLES, lower, upper, strict=True)
        words = ", ".join(f"{name} {low:.4g} to {high:.4g}" for name, low, high in box)
        raise InputError("rows", f"none of the {len(rows)} rows lies inside the box", words)
    row, encounter = _codes(kept, MODEL_COLUMNS), _codes(kept, ENCOUNTER_KEY)
    assert row is not None  # its columns have numbers
    places = np.arange(row.size) if encounter is None else encounter
    copies = np.bincount(np.unique(np.stack((row, places)), axis=1)[0])
    named = _codes(kept, VEHICLE_KEY)
    texts = kept.reindex(columns=["track", "source"])  # those that are not there are missing
    return Sample(
        data=data[inside],
        weights=row_weights(kept, weigh) / copies[row],
        row=row,
        vehicle=independent_vehicles(kept),
        encounter=encounter,
        named_vehicles=None if named is None else int(named.max()) + 1,
        lower=lower,
        upper=upper,
        tracks=sorted(set(texts["track"].dropna())),
        sources=sorted(set(texts["source"].dropna())),
        rows_read=len(rows),
        outside=dict(zip(MODEL_COLUMNS, outside.sum(axis=0).tolist(), strict=True)),
        weigh=weigh,
    )


WEIGHINGS = ("row", "encounter", "vehicle")
"""What counts the same in a fit; see ``row_weights``."""


def row_weights(rows: pd.DataFrame, weigh: str) -> FloatArray:
    """Weights that sum to the number of encounters, BIC's n.

    Rows of one encounter follow each other within a second and are nearly equal; a few vehicles
    have most of the rows.  With E encounters:

    - ``row``: every row counts the same, E / n.
    - ``encounter``: every encounter counts 1, shared equally by its rows.
    - ``vehicle``: a vehicle counts as its number of encounters, at most the median over the
      vehicles, shared by its encounters and then their rows; all scaled to sum to E.  Small weights
      are not raised, so no single row gets a large weight.

    Args:
        rows: rows as returned by ``extract``.
        weigh: one of ``WEIGHINGS``.

    Returns:
        (n,) weights above 0.  Rows without identifiers count as one encounter each under ``row``.

    Raises:
        InputError: the weighing is unknown, or it is ``encounter`` or ``vehicle`` and the rows do
            not identify their encounters.
    """
    if weigh not in WEIGHINGS:
        raise unknown_name(Parameter("weigh", weigh), "weighing", weigh, WEIGHINGS)
    encounter, vehicle = _codes(rows, ENCOUNTER_KEY), _codes(rows, VEHICLE_KEY)
    if encounter is None or vehicle is None:
        if weigh == "row":
            return np.ones(len(rows))
        allowed = f"no missing value in {', '.join(ENCOUNTER_KEY)}"
        raise InputError("rows", f"cannot be weighed by {weigh}", allowed)
    rows_of = np.bincount(encounter)
    if weigh == "row":
        return np.full(len(rows), len(rows_of) / len(rows))
    per_encounter = 1.0 / rows_of[encounter]
    if weigh == "encounter":
        return np.asarray(per_encounter)
    _, first_row = np.unique(encounter, return_index=True)
    met = np.bincount(vehicle[first_row]).astype(np.float64)
    capped = np.minimum(met, np.median(met))
    return np.asarray(per_encounter * (capped / met)[vehicle] * (met.sum() / capped.sum()))


def independent_vehicles(rows: pd.DataFrame) -> IntArray | None:
    """The index of each row's vehicle, (n,); None if a row does not identify its vehicle.

    Vehicles that share a row or a track's fingerprint are one vehicle.  Otherwise the same vehicle
    could be both in the fitted folds and in the held-out fold.
    """
    named = _codes(rows, VEHICLE_KEY)
    if named is None:
        return None
    count, edges = int(named.max()) + 1, []
    for link in (_codes(rows, MODEL_COLUMNS), _codes(rows, ("track",))):
        if link is not None:
            edges.append(np.stack((named, count + link)))
            count += int(link.max()) + 1
    ends = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(ends.shape[1]), tuple(ends)), shape=(count, count))
    _, group = connected_components(graph, directed=False)
    return np.asarray(pd.factorize(group[named])[0])


def effective_number(item: IntArray | None, weights: FloatArray) -> float | None:
    """Kish's effective number of items, (Σw)² / Σw² over the items' weights; None if unknown.

    Args:
        item: (n,) the item of each row, or None.
        weights: (n,) the rows' weights.
    """
    if item is None:
        return None
    return effective(np.bincount(item, weights).astype(float))


def _variables(rows: pd.DataFrame) -> FloatArray:
    """The model's variables in its order, (n, 4)."""
    values = np.array(rows[list(MODEL_COLUMNS)].to_numpy(dtype=float, na_value=np.nan))
    for i, name in enumerate(MODEL_COLUMNS):
        wrong, allowed = ~np.isfinite(values[:, i]), "finite numbers"
        if i in _INVERTED:
            wrong, allowed = wrong | (values[:, i] <= 0), "finite numbers above 0"
        if count := int(wrong.sum()):
            problem = f"{count} rows have a value that is missing, NaN, infinite or not {allowed}"
            raise InputError(f"rows: {name}", problem, allowed)
    values[:, _INVERTED] = 1.0 / values[:, _INVERTED]
    return values


def _codes(rows: pd.DataFrame, key: Sequence[str]) -> IntArray | None:
    """Each row's group by first appearance, (n,); None if an identifier is missing."""
    if not all(name in rows for name in key) or rows[list(key)].isna().any(axis=None):
        return None
    return np.asarray(rows.groupby(list(key), sort=False).ngroup().to_numpy())
