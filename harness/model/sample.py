"""Takes a file of extracted rows and returns the weighted rows inside the model's box."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.core.documents import parse_json
from harness.core.encounter import FloatArray
from harness.core.errors import InputError
from harness.model.interaction import VARIABLES
from harness.model.trajectories import row_weights
from harness.model.trajectories.csv_input import (
    EmptyTableError,
    as_paths,
    identifiers,
    read_table,
    require_columns,
)
from harness.model.trajectories.extraction import ENCOUNTER_KEY, EXTRACTION_KEY, VEHICLE_KEY
from harness.model.trajectories.extraction_rules import TEXT_COLUMNS

# A sensor resolves R up to 60 m and 1/T_adv up to 2 per s. The extraction has the same minimum
# speeds; they keep E[1/T_adv] and passing times finite.
BOX_LOWER = (1 / 60, 0.3, 0.3, 0.0)
BOX_UPPER = (0.5, 8.0, 3.0, 2.0)

COLUMNS = ("range_m", "vehicle_speed_mps", "pedestrian_speed_mps", "time_advantage_s")
# In messages the model's variables are called by the columns of the user's file.
LABELS = ("range_m (as 1/R)", COLUMNS[1], COLUMNS[2], "time_advantage_s (as 1/T_adv)")
FACTOR_COLUMN = "weight"


@dataclass(frozen=True, eq=False)
class RowFile:
    """A file of rows.

    Attributes:
        name: the file's name without its folder.
        rows: all rows of the file.
        sha256: the file's hash.
        extraction: the metadata of ``harness extract``; empty for other files.
    """

    name: str
    rows: pd.DataFrame
    sha256: str
    extraction: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Sample:
    """Weighted rows inside a box.

    Attributes:
        data: (n, 4), the model's variables in its order.
        weights: (n,) ≥ 0.  A row that occurs in m encounters has weight 1/m in each.  Without
            such copies the sum is ``encounters``, or n if rows have no identifiers.
        row: (n,) index of the distinct row; copies have the same index.
        vehicle, encounter: (n,) index of the row's vehicle and encounter; None if a row does not
            identify them.  Vehicles that share a row or a recorded track count as one vehicle,
            even if their names differ.
        vehicles, encounters: number of vehicles and encounters inside the box; None if unknown.
        named_vehicles: number of different vehicle names; None if unknown.
        tracks: fingerprints of the vehicles' recorded tracks; empty if unknown.
        lower, upper: (4,) the box.
        rows_read: number of rows before the box was applied.
        outside: column → number of rows outside the box in this column; a row may count in several
            columns.
        weigh: how the rows were weighted.
        factor: whether a ``weight`` column multiplied the weights.
        sources: names of the data sets.
    """

    data: FloatArray
    weights: FloatArray
    row: np.ndarray
    vehicle: np.ndarray | None
    encounter: np.ndarray | None
    vehicles: int | None
    encounters: int | None
    named_vehicles: int | None
    tracks: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    rows_read: int
    outside: Mapping[str, int]
    weigh: str
    factor: bool
    sources: tuple[str, ...]

    @property
    def copies(self) -> int:
        """Number of rows that repeat an earlier row."""
        return len(self.row) - len(np.unique(self.row))


def read_rows(path: Path) -> RowFile:
    """Read the Parquet file of ``harness extract``, or a CSV file with the same columns.

    Raises:
        InputError: the file is missing, unreadable or empty, or lacks a needed column.
    """
    if not as_paths(path)[0].is_file():
        raise InputError(str(path), "is not a regular file", "a file from `harness extract`")
    try:
        rows = read_table(path)
    except EmptyTableError as error:
        raise InputError(str(path), error.problem, "at least one row") from None
    require_columns(path, rows, COLUMNS)
    for name in COLUMNS:
        if not pd.api.types.is_numeric_dtype(rows[name]):
            raise InputError(f"{path}: {name}", "contains text", "numbers")
    # Other programs write identifiers of any type; here they become text.
    rows = rows.assign(**{name: identifiers(rows[name]) for name in TEXT_COLUMNS if name in rows})
    for source in rows["source"].dropna().unique() if "source" in rows else ():
        if not source.isprintable():
            raise InputError(f"{path}: source", f"{source[:40]!r}", "text that can be printed")
    return RowFile(
        path.name, rows, hashlib.sha256(path.read_bytes()).hexdigest(), _extraction(path)
    )


def _extraction(path: Path) -> Mapping[str, Any]:
    """Return the metadata of the extraction; {} if the file has none."""
    try:
        metadata = pq.read_schema(path).metadata or {}
        extraction = parse_json(metadata.get(EXTRACTION_KEY, b"{}"))
    except (OSError, ValueError, pa.ArrowException):
        return {}
    return extraction if isinstance(extraction, dict) else {}


def make_sample(
    rows: pd.DataFrame,
    *,
    weigh: str = "encounter",
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
    strict: bool = False,
) -> Sample:
    """Check the rows, leave out rows outside the box, and weight the others.

    Args:
        rows: a table with ``COLUMNS``.  Weighting by encounter or vehicle also needs the
            identifiers ``source, clip, vehicle, pedestrian``.  A column ``weight`` (≥ 0) multiplies
            the weights.
        weigh: ``row``, ``encounter`` or ``vehicle``, see
            ``harness.model.trajectories.row_weights``.
        lower, upper: (4,) the box in the model's variables; by default ``BOX_LOWER`` and
            ``BOX_UPPER``.
        strict: raise an error for rows outside the box instead of leaving them out.

    Raises:
        InputError: a value is not finite, R or T_adv is not above 0, a weight is negative, no row
            is left, or, with ``strict``, a row is outside the box.  The message has the column and
            the number of rows.
    """
    lower = np.array(BOX_LOWER if lower is None else lower, dtype=float)
    upper = np.array(BOX_UPPER if upper is None else upper, dtype=float)
    _check_box(lower, upper)
    data = _variables(rows)
    outside = (data < lower) | (data > upper)
    counts = {name: int(outside[:, i].sum()) for i, name in enumerate(COLUMNS)}
    if strict and outside.any():
        columns = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
        raise InputError(
            "rows",
            f"{int(outside.any(axis=1).sum())} of {len(rows)} rows lie outside the box ({columns})",
            "rows inside the box; without --strict the others are left out",
        )
    inside = np.flatnonzero(~outside.any(axis=1))
    kept = rows.iloc[inside].reset_index(drop=True)
    if kept.empty:
        raise InputError(
            "rows", f"none of the {len(rows)} rows lies inside the box", _box(lower, upper)
        )
    factor = _factor(kept)
    weights = row_weights(kept, weigh)
    if factor is not None:
        weights = weights * factor * (weights.sum() / (weights @ factor))
    row, encounter = distinct_rows(kept), _codes(kept, ENCOUNTER_KEY)
    places = np.arange(row.size) if encounter is None else encounter
    weights = weights / np.bincount(np.unique(np.stack((row, places)), axis=1)[0])[row]
    named, vehicle = _codes(kept, VEHICLE_KEY), independent_vehicles(kept)
    return Sample(
        data=data[inside],
        weights=np.asarray(weights, dtype=float),
        row=row,
        vehicle=vehicle,
        encounter=encounter,
        vehicles=None if vehicle is None else int(vehicle.max()) + 1,
        encounters=None if encounter is None else int(encounter.max()) + 1,
        named_vehicles=None if named is None else int(named.max()) + 1,
        tracks=tuple(sorted(set(kept["track"].dropna()))) if "track" in kept else (),
        lower=lower,
        upper=upper,
        rows_read=len(rows),
        outside=counts,
        weigh=weigh,
        factor=factor is not None,
        sources=tuple(sorted(set(kept["source"].dropna()))) if "source" in kept else (),
    )


def distinct_rows(rows: pd.DataFrame) -> np.ndarray:
    """Return each row's index among the distinct rows of ``COLUMNS``, shape (n,)."""
    return np.asarray(rows.groupby(list(COLUMNS), sort=False, dropna=False).ngroup().to_numpy())


def independent_vehicles(rows: pd.DataFrame) -> np.ndarray | None:
    """Return the index of each row's vehicle, (n,); None if a row does not identify its vehicle.

    Vehicles that share a row or a track's fingerprint count as one vehicle.  Otherwise the same
    vehicle could be both in the fitted folds and in the held-out fold.
    """
    named = _codes(rows, VEHICLE_KEY)
    if named is None:
        return None
    # Loading a model does not need this import, so it is here.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    track = _codes(rows, ("track",))
    links = [distinct_rows(rows), *([] if track is None else [track])]
    count, edges = int(named.max()) + 1, []
    for link in links:
        edges.append(np.stack((named, count + link)))
        count += int(link.max()) + 1
    ends = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(ends.shape[1]), tuple(ends)), shape=(count, count))
    _, group = connected_components(graph, directed=False)
    return np.asarray(pd.factorize(group[named])[0])


def effective_number(weights: FloatArray) -> float:
    """Return Kish's effective number of weighted items, (Σw)² / Σw²; 0 if all weights are 0."""
    squares = float(weights @ weights)
    return float(weights.sum() ** 2 / squares) if squares > 0 else 0.0


def _variables(rows: pd.DataFrame) -> FloatArray:
    """Return the model's variables in its order, (n, 4); an error names the column."""
    values = np.array(rows[list(COLUMNS)].to_numpy(dtype=float, na_value=np.nan))
    for i, name in enumerate(COLUMNS):
        invalid = int((~np.isfinite(values[:, i])).sum())
        if invalid:
            raise InputError(
                f"rows: {name}",
                f"{invalid} rows have a value that is missing, NaN or infinite",
                "finite numbers",
            )
        if i in (0, 3):
            wrong = int((values[:, i] <= 0).sum())
            if wrong:
                raise InputError(
                    f"rows: {name}", f"{wrong} rows have a value not above 0", "above 0"
                )
    values[:, [0, 3]] = 1.0 / values[:, [0, 3]]
    return values


def _factor(rows: pd.DataFrame) -> FloatArray | None:
    if FACTOR_COLUMN not in rows:
        return None
    where = f"rows: {FACTOR_COLUMN}"
    if not pd.api.types.is_numeric_dtype(rows[FACTOR_COLUMN]):
        raise InputError(where, "contains text", "numbers of 0 or more")
    factor = np.array(rows[FACTOR_COLUMN].to_numpy(dtype=float, na_value=np.nan))
    wrong = int((~(np.isfinite(factor) & (factor >= 0))).sum())
    if wrong:
        raise InputError(where, f"{wrong} rows are negative, NaN or infinite", "0 or more")
    if not factor.any():
        raise InputError(where, f"all {len(rows)} rows are 0", "at least one above 0")
    return factor


def _codes(rows: pd.DataFrame, key: tuple[str, ...]) -> np.ndarray | None:
    """Return each row's group index by first appearance; None if an identifier is missing."""
    if not all(name in rows for name in key) or rows[list(key)].isna().any(axis=None):
        return None
    return np.asarray(rows.groupby(list(key), sort=False).ngroup().to_numpy())


def _check_box(lower: FloatArray, upper: FloatArray) -> None:
    for i, name in enumerate(VARIABLES):
        where = f"--bounds {name}"
        if not (np.isfinite(lower[i]) and np.isfinite(upper[i]) and lower[i] < upper[i]):
            raise InputError(where, f"{lower[i]:g}:{upper[i]:g}", "finite, lower < upper")
        if lower[i] < 0 or (i in (0, 2) and lower[i] == 0):
            raise InputError(
                where, f"lower bound {lower[i]:g}", "above 0" if i in (0, 2) else "0 or more"
            )


def _box(lower: FloatArray, upper: FloatArray) -> str:
    return ", ".join(
        f"{name} {low:.4g} to {high:.4g}"
        for name, low, high in zip(VARIABLES, lower, upper, strict=True)
    )
