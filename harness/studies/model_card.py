"""The card of a fitted model, and what ``harness extract``, ``fit`` and ``model`` show."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from harness.core.encounter import FloatArray
from harness.core.errors import InputError
from harness.core.versions import versions_of_fits
from harness.model.interaction import INVERSE_RANGE, VARIABLES, VEHICLE_SPEED, InteractionModel
from harness.model.sample import RowFile, Sample, effective_number
from harness.model.trajectories import REASONS
from harness.results.finding import Finding, Plain
from harness.results.notes import Note
from harness.results.result import Column, Entered, Result, Shown, Style, Table
from harness.studies.fitting import RULE_SHARE, Fitted, HeldOut, Settings, by_rule, relative_gain

NEAR_RANGE_M, NEAR_SPEED_MPS = 5.0, 1.0
"""A row is near a state (R, v) if R and v both differ by at most this."""

FEW = 10
"""The card warns if fewer vehicles or effective rows than this are near the scenario's state."""


def card(
    sample: Sample,
    settings: Settings,
    fitted: Fitted,
    file: RowFile,
    command: str,
    state: tuple[float, float],
) -> dict[str, Any]:
    """The model's card, as plain data for the model file's ``provenance``.

    Args:
        sample: the fitted rows.
        settings: the settings of the fits.
        fitted: the result of the fits.
        file: the file of the rows, with the command of the extraction.
        command: the exact command of the fit.
        state: (R in m, v in m/s) at the trigger of the scenario that will use the model.
    """
    near, chosen = near_state(sample, state), fitted.chosen
    bic = {each.components: each.fit.bic for each in fitted.candidates}
    rule = None
    with suppress(InputError):  # there are not enough K
        rule = by_rule(bic)
    extracted = file.extraction.get("command")
    return {
        "source": list(sample.sources),
        "commands": [*[extracted] * isinstance(extracted, str), command],
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
            name: [float(low), float(high)]
            for name, low, high in zip(VARIABLES, sample.lower, sample.upper, strict=True)
        },
        "components": chosen.components,
        "chosen_by": fitted.criterion,
        "candidates": _table(fitted, relative_gain(bic)),
        "rule": {
            "words": f"smallest K with BIC_K - BIC_K+1 < {RULE_SHARE:g} (BIC_1 - BIC_2)",
            "components": rule,
        },
        "folds_of_vehicles": fitted.folds,
        "folds_wanted": settings.folds,
        "starts": settings.starts,
        "seed": settings.seed,
        "tol": settings.tol,
        "extraction": file.extraction.get("counts"),
        "warnings": [*_data_warnings(sample, near), *fitted.warnings],
        "versions": versions_of_fits(),
    }


def near_state(sample: Sample, state: tuple[float, float]) -> dict[str, Any]:
    """The numbers of rows, encounters and vehicles near a state: |R − R0| ≤ 5 m, |v − v0| ≤ 1 m/s.

    ``effective_rows`` and ``effective_vehicles`` are (Σw)²/Σw², where w is the total weight of a
    distinct row or of a vehicle.
    """
    near = np.abs(1.0 / sample.data[:, INVERSE_RANGE] - state[0]) <= NEAR_RANGE_M
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
    """The effective number of items; None if rows do not identify their item."""
    return None if item is None else effective_number(np.bincount(item, weights).astype(float))


def _data_warnings(sample: Sample, near: Mapping[str, Any]) -> list[str]:
    """Warnings about copies of rows and vehicles, and about few of them near the state."""
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
    place = f"({near['range_m']:g} m, {near['vehicle_speed_mps']:g} m/s)"
    return warnings + [
        f"Near {place} the model has only {near[key]:.3g} {words}, fewer than {FEW}."
        for key, words in (("vehicles", "vehicles"), ("effective_rows", "effective rows"))
        if near[key] is not None and near[key] < FEW
    ]


def _table(fitted: Fitted, gain: Mapping[int, float]) -> list[dict[str, Any]]:
    """One entry per K, for the card."""
    rows, best = [], fitted.chosen.held_out
    for k, found, held_out, driver in fitted.candidates:
        less = None
        if held_out is not None and best is not None:
            less = HeldOut(held_out.totals - best.totals, held_out.weights)
        rows.append(
            {
                "components": k,
                "parameters": 15 * k - 1,  # K − 1 weights, 4 K locations, 10 K scales
                "log_likelihood": found.log_likelihood,
                "bic": found.bic,
                "bic_gain_share": gain.get(k),
                "converged": found.converged,
                "gradient_norm": found.gradient_norm,
                "steps": found.n_iter,
                "held_out": held_out and held_out.as_plain(),
                "held_out_less_chosen": less and less.as_plain(),
                "held_out_driver": driver and driver.as_plain(),
            }
        )
    return rows


_K = (
    Column("components", "K"),
    Column("log_likelihood", "log L"),
    Column("bic", "BIC"),
    Column("bic_gain_share", "gain, %"),
    Column("held_out", "held-out v_p, nats"),
    Column("held_out_less_chosen", "less the chosen's"),
    Column("held_out_driver", "held-out v, nats"),
)
_LEGEND = (
    "Gain: gain in BIC, as a share of the gain by the second component. Held-out: mean log "
    "f(v_p | 1/R, v) and log f(v | 1/R, v_p, 1/T_adv) per encounter, on vehicles that the fit has "
    "not seen, with 95 % intervals over vehicles."
)
_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def model_result(
    command: str, model: InteractionModel, file: str, closing: Sequence[str] = ()
) -> Result:
    """What ``fit`` and ``model`` show of a model: the table over K, its data, and its marginals.

    Raises:
        InputError: the model's card has another form than those of ``harness fit``.
    """
    try:
        return _model_result(command, model, closing)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        problem = f"its provenance is no card of `harness fit` ({type(error).__name__}: {error})"
        raise InputError(file, problem, "a model as `harness fit` writes it") from None


def _model_result(command: str, model: InteractionModel, closing: Sequence[str]) -> Result:
    marginals, of = _marginals(model), model.provenance
    title = f"{model.name}: K = {model.mixture.weights.size}, sha256 {model.sha256[:16]}"
    facts: dict[str, Plain] = {"name": model.name, "sha256": model.sha256}
    if "candidates" not in of:  # another program wrote it
        said = tuple(f"{key}: {value}" for key, value in of.items())
        screen, rest = marginals, ()
        return Result(command, title, "", "", screen, rest, (), tuple(closing), said, facts)
    near, outside = of["near_state"], of["rows_outside_box"]
    by_column = ", ".join(f"{name} {n}" for name, n in outside.items() if n and name != "any")
    scope = (
        f"{of['rows']:,} of {of['rows_read']:,} rows in the box{by_column and f' ({by_column})'}, "
        f"{_known(of['encounters'])} encounters, {_known(of['vehicles'])} vehicles (effective "
        f"{_known(of['effective_vehicles'])}); weighed by {of['weigh']}"
    )
    rule = of["rule"]["components"]
    about = (
        f"K = {of['components']} ({of['chosen_by']}); the paper's 10 % rule "
        f"{'is not reached' if rule is None else f'gives K = {rule}'}. Within {near['within_m']:g} "
        f"m and {near['within_mps']:g} m/s of ({near['range_m']:g} m, "
        f"{near['vehicle_speed_mps']:g} m/s): {near['rows']:,} rows, {_known(near['vehicles'])} "
        f"vehicles (effective {_known(near['effective_vehicles'])})."
    )
    rows = tuple(_row(each) for each in of["candidates"])
    notes = tuple(Note("warning", n, "warning", text) for n, text in enumerate(of["warnings"]))
    remarks = [*(f"$ {each}" for each in of["commands"]), f"rows sha256 {of['rows_sha256']}"]
    return Result(
        command=command,
        title=title,
        scope=scope,
        about=about,
        screen=Table("", _K, rows, legend=_LEGEND),
        full=(marginals,),
        notes=notes,
        closing=tuple(closing),
        remarks=tuple(remarks),
        facts=facts | {"chosen_by": of["chosen_by"], "components": of["components"]},
        records=[
            dict(zip((column.key for column in _K), _plain(row), strict=True)) for row in rows
        ],
    )


def extraction_result(summary: Mapping[str, Any], closing: Sequence[str]) -> Result:
    """What ``extract`` shows: quartiles of the columns, and the rows that each rule left out."""
    counts = summary["counts"]
    names = list(next(iter(summary["quartiles"].values())))
    quartiles: tuple[tuple[Entered, ...], ...] = tuple(
        (
            name,
            *(Shown(Finding(of[key]), Style(digits=3)) if key != "n" else of[key] for key in names),
        )
        for name, of in summary["quartiles"].items()
    )
    left_out = tuple(
        (words, level, counts["dropped"][level][reason])
        for level, reasons in REASONS.items()
        for reason, words in reasons.items()
        if counts["dropped"][level][reason]
    )
    skipped = (f"Clip {clip} was not used: {why}" for clip, why in counts["skipped"].items())
    columns = Column("column", "column"), *(Column(name, name) for name in names)
    rules = Column("rule", "rule"), Column("what", "of"), Column("number", "number")
    return Result(
        command="extract",
        title=f"{summary['rows']:,} rows of {_known(summary['encounters'])} encounters with "
        f"{_known(summary['vehicles'])} vehicles",
        scope=f"{_known(counts['clips'])} clips, {counts['candidates']:,} candidate rows",
        about="",
        screen=Table("", columns, quartiles),
        full=(Table("Left out", rules, left_out),) if left_out else (),
        notes=(),
        closing=tuple(closing),
        remarks=(*skipped, *counts["notes"]),
        records=[{"column": name, **of} for name, of in summary["quartiles"].items()],
    )


def _row(candidate: Mapping[str, Any]) -> tuple[Entered, ...]:
    gain = candidate["bic_gain_share"]
    scores = (candidate[key] for key in ("held_out", "held_out_less_chosen", "held_out_driver"))
    star = "" if candidate["converged"] else " (did not converge)"
    return (
        f"{candidate['components']}{star}",
        Shown(Finding(candidate["log_likelihood"]), Style(digits=1)),
        Shown(Finding(candidate["bic"]), Style(digits=1)),
        None if gain is None else Shown(Finding(100 * gain), Style(digits=0)),
        *(
            None if score is None else Shown(_interval(**score), Style(digits=3))
            for score in scores
        ),
    )


def _interval(mean: float | None, standard_error: float | None) -> Finding:
    if mean is None or standard_error is None:
        return Finding(mean)
    return Finding(mean, mean - 1.96 * standard_error, mean + 1.96 * standard_error)


def _plain(row: Sequence[Entered]) -> list[Plain | Finding]:
    return [each.finding if isinstance(each, Shown) else each for each in row]  # type: ignore[misc]


def _marginals(model: InteractionModel) -> Table:
    """Mean, standard deviation and quantiles of each variable within its bounds."""
    mixture = model.mixture
    mean, covariance = mixture.mean(), mixture.covariance()
    # The moments of a component that lies almost entirely outside the box are meaningless.
    with np.errstate(all="ignore"):
        spread = np.sqrt(np.diag(covariance))
    rows: list[tuple[Entered, ...]] = []
    for i, name in enumerate(VARIABLES):
        quantiles = mixture.conditional(i, ()).ppf(np.array(_QUANTILES), np.empty((1, 0)))
        numbers = (mixture.lower[i], mixture.upper[i], mean[i], spread[i], *quantiles)
        shown = (
            Shown(Finding(float(of) if np.isfinite(of) else None), Style(digits=3))
            for of in numbers
        )
        rows.append((name, *shown))
    headings = ("variable", "low", "high", "mean", "sd", *(f"{100 * q:g} %" for q in _QUANTILES))
    columns = tuple(Column(heading, heading) for heading in headings)
    return Table("Marginals of the truncated mixture", columns, tuple(rows))


def _known(value: float | None) -> str:
    return "unknown" if value is None else f"{value:,.4g}" if value < 10_000 else f"{value:,.0f}"
