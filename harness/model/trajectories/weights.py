"""Takes rows and returns their weights, by encounter or vehicle."""

import numpy as np
import pandas as pd

from harness.core.encounter import FloatArray
from harness.core.errors import InputError, unknown_name
from harness.model.trajectories.extraction import ENCOUNTER_KEY, VEHICLE_KEY

WEIGHINGS = ("row", "encounter", "vehicle")


def row_weights(rows: pd.DataFrame, weigh: str) -> FloatArray:
    """Weights that sum to the number of encounters, BIC's n.

    Rows of one encounter follow each other within a second and are nearly equal; a few vehicles
    have most of the rows. With E encounters:

    - ``row``: every row counts the same, E / n.
    - ``encounter``: every encounter counts 1, shared equally by its rows.
    - ``vehicle``: a vehicle counts as its number of encounters, at most the median over the
      vehicles, shared by its encounters and then their rows; all scaled to sum to E. Small weights
      are not raised, so no single row gets a large weight.

    Args:
        rows: rows as returned by ``extract``.
        weigh: one of ``WEIGHINGS``.

    Returns:
        (n,) weights above 0. Rows without identifiers count as one encounter each under ``row``.

    Raises:
        InputError: the weighing is unknown, or it is ``encounter`` or ``vehicle`` and the rows do
            not identify their encounters.
    """
    if weigh not in WEIGHINGS:
        raise unknown_name("--weigh", "weighing", weigh, WEIGHINGS)
    if len(rows) == 0:
        return np.zeros(0)
    named = all(name in rows for name in ENCOUNTER_KEY)
    if not named or rows[list(ENCOUNTER_KEY)].isna().any(axis=None):
        if weigh == "row":
            return np.ones(len(rows))
        raise InputError(
            "rows",
            f"cannot be weighed by {weigh}",
            f"no missing value in {', '.join(ENCOUNTER_KEY)}",
        )
    encounter = rows.groupby(list(ENCOUNTER_KEY), sort=False).ngroup().to_numpy()
    rows_of = np.bincount(encounter)
    if weigh == "row":
        return np.full(len(rows), len(rows_of) / len(rows))
    per_encounter = 1.0 / rows_of[encounter]
    if weigh == "encounter":
        return np.asarray(per_encounter)
    vehicle = rows.groupby(list(VEHICLE_KEY), sort=False).ngroup().to_numpy()
    _, first_row = np.unique(encounter, return_index=True)
    met = np.bincount(vehicle[first_row]).astype(np.float64)
    capped = np.minimum(met, np.median(met))
    factor: FloatArray = (capped / met)[vehicle] * (met.sum() / capped.sum())
    return per_encounter * factor
