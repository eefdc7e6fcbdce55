"""Takes a calibration and returns the model's card: its data, its method and its warnings."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.core.encounter import FloatArray
from harness.core.errors import InputError
from harness.core.versions import versions_of_fits
from harness.model.interaction import INVERSE_RANGE, VARIABLES, VEHICLE_SPEED
from harness.old.studies.calibration.calibrate import Calibration, Candidate
from harness.old.studies.calibration.choice import RULE_SHARE, by_rule, relative_gain
from harness.old.studies.calibration.jobs import Settings
from harness.old.studies.calibration.sample import RowFile, Sample, effective_number
from harness.old.studies.calibration.scores import HeldOut

NEAR_RANGE_M = 5.0
NEAR_SPEED_MPS = 1.0
"""A row is near a state (R, v) if R and v both differ by at most this."""

FEW = 10
"""The card warns if fewer vehicles or effective rows than this are near the scenario's state."""


def card(
    sample: Sample,
    settings: Settings,
    calibration: Calibration,
    file: RowFile,
    command: str,
    state: tuple[float, float],
) -> dict[str, Any]:
    """Return the card as plain data, for the model file's ``provenance``.

    Args:
        sample: the fitted rows.
        settings: the settings of the fits.
        calibration: the result of the fits.
        file: the file of the rows, with the command of the extraction.
        command: the exact command of the fit.
        state: (R in m, v in m/s) at the trigger of the scenario that will use the model.
    """
    near = near_state(sample, state)
    chosen = calibration.chosen
    return {
        "source": list(sample.sources),
        "commands": [*_extraction_command(file), command],
        "rows_sha256": file.sha256,
        "rows_read": sample.rows_read,
        "rows_outside_box": {**sample.outside, "any": sample.rows_read - len(sample.data)},
        "rows": len(sample.data),
        "copied_rows": sample.copies,
        "effective_rows": _effective(sample.row, sample.weights),
        "encounters": sample.encounters,
        "vehicles": sample.vehicles,
        "effective_vehicles": _effective(sample.vehicle, sample.weights),
        "tracks": list(sample.tracks),
        "near_state": near,
        "weigh": sample.weigh + (", times the rows' own weight" if sample.factor else ""),
        "weight_sum": float(sample.weights.sum()),
        "bounds": {
            name: [float(sample.lower[i]), float(sample.upper[i])]
            for i, name in enumerate(VARIABLES)
        },
        "components": chosen.components,
        "chosen_by": calibration.criterion,
        "log_likelihood": chosen.log_likelihood,
        "bic": chosen.bic,
        "held_out": _scored(chosen),
        "candidates": _table(calibration),
        "rule": _rule(calibration),
        "folds_of_vehicles": calibration.folds,
        "starts": settings.starts,
        "seed": settings.seed,
        "tol": settings.tol,
        "extraction": file.extraction.get("counts"),
        "warnings": [*_copy_warnings(sample), *_near_warnings(near), *calibration.warnings],
        "versions": versions_of_fits(),
        **({"folds_wanted": settings.folds} if calibration.folds < settings.folds else {}),
    }


def near_state(sample: Sample, state: tuple[float, float]) -> dict[str, Any]:
    """Return the numbers of rows, encounters and vehicles near a state.

    Near means |R − R0| ≤ 5 m and |v − v0| ≤ 1 m/s.  ``effective_rows`` and ``effective_vehicles``
    are (Σw)²/Σw², where w is the total weight of a distinct row or of a vehicle.  If one of 7
    vehicles has nearly all the weight, the effective number is close to 1.
    """
    range_m = 1.0 / sample.data[:, INVERSE_RANGE]
    near = np.abs(range_m - state[0]) <= NEAR_RANGE_M
    near &= np.abs(sample.data[:, VEHICLE_SPEED] - state[1]) <= NEAR_SPEED_MPS
    vehicle = None if sample.vehicle is None else sample.vehicle[near]
    return {
        "range_m": state[0],
        "vehicle_speed_mps": state[1],
        "within_m": NEAR_RANGE_M,
        "within_mps": NEAR_SPEED_MPS,
        "rows": int(near.sum()),
        "effective_rows": _effective(sample.row[near], sample.weights[near]),
        "encounters": None if sample.encounter is None else len(np.unique(sample.encounter[near])),
        "vehicles": None if vehicle is None else len(np.unique(vehicle)),
        "effective_vehicles": _effective(vehicle, sample.weights[near]),
    }


def _effective(item: np.ndarray | None, weights: FloatArray) -> float | None:
    """Return the effective number of items; None if rows do not identify their item."""
    return None if item is None else effective_number(np.bincount(item, weights).astype(float))


def _copy_warnings(sample: Sample) -> list[str]:
    """Return warnings about rows and vehicles that occur more than once in the data."""
    warnings = []
    if sample.copies:
        warnings.append(
            f"{sample.copies} of {len(sample.data)} rows are copies of another row. A row in m "
            f"encounters has weight 1/m in each, and BIC's n is {sample.weights.sum():.4g}."
        )
    if sample.vehicles and sample.named_vehicles and sample.vehicles < sample.named_vehicles:
        warnings.append(
            f"The {sample.named_vehicles} vehicle names count as {sample.vehicles} vehicles, "
            "because some share rows or tracks; each vehicle is in one fold."
        )
    return warnings


def _near_warnings(near: dict[str, Any]) -> list[str]:
    place = f"({near['range_m']:g} m, {near['vehicle_speed_mps']:g} m/s)"
    return [
        f"Near {place} the model has only {near[key]:.3g} {words}, fewer than {FEW}."
        for key, words in (("vehicles", "vehicles"), ("effective_rows", "effective rows"))
        if near[key] is not None and near[key] < FEW
    ]


def _scored(candidate: Candidate) -> dict[str, Any]:
    """Return the mean held-out log scores in nats per encounter."""
    return {
        "log f(v_p | 1/R, v)": _mean_and_error(candidate.held_out),
        "log f(v | 1/R, v_p, 1/T_adv)": _mean_and_error(candidate.held_out_driver),
    }


def _mean_and_error(scores: HeldOut | None) -> dict[str, float | None] | None:
    if scores is None:
        return None
    return {"mean": scores.mean, "standard_error": scores.standard_error}


def _table(calibration: Calibration) -> list[dict[str, Any]]:
    """Return one entry per K."""
    gain = relative_gain({c.components: c.bic for c in calibration.candidates})
    chosen = calibration.chosen.held_out
    rows = []
    for candidate in calibration.candidates:
        held_out = candidate.held_out
        less = held_out.less(chosen) if held_out is not None and chosen is not None else None
        rows.append(
            {
                "components": candidate.components,
                "parameters": candidate.parameters,
                "log_likelihood": candidate.log_likelihood,
                "bic": candidate.bic,
                "bic_gain_share": gain.get(candidate.components),
                "converged": candidate.converged,
                "gradient_norm": candidate.gradient_norm,
                "steps": candidate.steps,
                "held_out": _mean_and_error(held_out),
                "held_out_less_chosen": _mean_and_error(less),
                "held_out_driver": _mean_and_error(candidate.held_out_driver),
            }
        )
    return rows


def _rule(calibration: Calibration) -> dict[str, Any]:
    """Return the K by the paper's rule; null if the rule cannot be applied."""
    try:
        components = by_rule({c.components: c.bic for c in calibration.candidates})
    except InputError:
        components = None
    return {
        "words": f"smallest K with BIC_K - BIC_K+1 < {RULE_SHARE:g} (BIC_1 - BIC_2)",
        "components": components,
    }


def _extraction_command(file: RowFile) -> Sequence[str]:
    command = file.extraction.get("command")
    return [command] if isinstance(command, str) else []
