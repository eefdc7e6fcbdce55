"""The card of a fitted model, and what ``harness extract``, ``fit`` and ``model`` show."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.errors import InputError
from harness.core.versions import versions_of_fits
from harness.model.interaction import (
    INVERSE_RANGE,
    VARIABLES,
    VEHICLE_SPEED,
    InteractionModel,
    write_model,
)
from harness.model.mixture.conditional import Conditional
from harness.model.sample import (
    RowFile,
    Sample,
    box_of,
    effective_number,
    make_sample,
    read_rows,
)
from harness.model.trajectories.extraction import Extraction
from harness.model.trajectories.rules import REASONS
from harness.results.finding import Finding, Plain
from harness.results.notes import Note
from harness.results.result import Column, Entered, Result, Shown, Style, Table, listed
from harness.studies.fitting import (
    RULE_SHARE,
    TARGETS,
    FitSettings,
    Fitted,
    HeldOut,
    Progress,
    by_rule,
    fit,
    processes,
    relative_gain,
)

NEAR = {"range_m": 30.0, "vehicle_speed_mps": 5.0, "within_m": 5.0, "within_mps": 1.0}
"""The state at the paper's trigger, and by how much rows near it differ from it at most."""

FEW = 10
"""The card warns if fewer vehicles or effective rows than this are near the scenario's state."""

_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
_NORMAL, _RELIABLE_FROM = 1.96, 100
"""The normal quantile of 95 % intervals, and vehicles from which they are reliable."""

_OVER_K: Mapping[Column, Style] = {
    Column("components", "K"): Style(digits=0),
    Column("log_likelihood", "log L"): Style(digits=1),
    Column("bic", "BIC"): Style(digits=1),
    Column("bic_gain_share", "gain"): Style(digits=2),
    Column("held_out", "held-out v_p, nats"): Style(digits=3),
    Column("held_out_less_chosen", "less the chosen's"): Style(digits=3),
    Column("held_out_driver", "held-out v, nats"): Style(digits=3),
}
_LEGEND = (
    "Gain: gain in BIC, as a share of the gain by the second component. Held-out: mean log "
    "f(v_p | 1/R, v) and log f(v | 1/R, v_p, 1/T_adv) per encounter, on vehicles that the fit has "
    "not seen, with 95 % intervals over vehicles (* fewer than 100)."
)


def card(
    sample: Sample,
    settings: FitSettings,
    fitted: Fitted,
    file: RowFile,
    command: str,
) -> dict[str, Any]:
    """The model's card, as plain data for the model file's ``provenance``.

    Args:
        sample: the fitted rows.
        settings: the settings of the fits.
        fitted: the result of the fits.
        file: the file of the rows, with the command of the extraction.
        command: the exact command of the fit.
    """
    near, rows = near_state(sample), len(sample.data)
    bic = {each.components: each.fit.bic for each in fitted.candidates}
    rule = None
    with suppress(InputError):  # there are not enough K
        rule = by_rule(bic)
    outside, extracted = dict(sample.outside or {}), file.extraction.get("command")
    return {
        "source": sample.sources,
        "commands": [*[extracted] * isinstance(extracted, str), command],
        "rows_sha256": file.sha256,
        "rows_read": sample.rows_read,
        "rows_outside_box": {**outside, "any": sample.rows_read - rows},
        "rows": rows,
        "copied_rows": sample.copies,
        **_counted(sample, np.ones(rows, bool)),
        "tracks": sample.tracks,
        "near_state": near,
        "weigh": sample.weigh,
        "weight_sum": float(sample.weights.sum()),
        "bounds": dict(
            zip(VARIABLES, np.stack((sample.lower, sample.upper), 1).tolist(), strict=True)
        ),
        "components": fitted.chosen.components,
        "chosen_by": fitted.criterion,
        "candidates": list(_candidates(fitted, relative_gain(bic))),
        "rule": {
            "words": f"smallest K with BIC_K - BIC_K+1 < {RULE_SHARE:g} (BIC_1 - BIC_2)",
            "components": rule,
        },
        "folds_of_vehicles": fitted.folds,
        **{name: getattr(settings, name) for name in ("starts", "seed")},
        "extraction": file.extraction.get("counts"),
        "warnings": [*_data_warnings(sample, near), *fitted.warnings],
        "versions": versions_of_fits(),
    }


def near_state(sample: Sample) -> dict[str, Any]:
    """How many rows, encounters and vehicles are near the state of ``NEAR``."""
    range_m, speed_mps, within_m, within_mps = NEAR.values()
    near = np.abs(1.0 / sample.data[:, INVERSE_RANGE] - range_m) <= within_m
    near &= np.abs(sample.data[:, VEHICLE_SPEED] - speed_mps) <= within_mps
    return {**NEAR, "rows": int(near.sum()), **_counted(sample, near)}


def _counted(sample: Sample, of: np.ndarray) -> dict[str, float | int | None]:
    """Encounters, vehicles, and effective rows and vehicles among some rows; None if unknown.

    Effective numbers are (Σw)²/Σw², where w is the weight of a distinct row or of a vehicle.
    """
    items, weights = (
        {"vehicles": sample.vehicle, "encounters": sample.encounter},
        sample.weights[of],
    )
    chosen = {name: None if item is None else item[of] for name, item in items.items()}
    return {
        **{name: None if item is None else len(np.unique(item)) for name, item in chosen.items()},
        "effective_rows": effective_number(sample.row[of], weights),
        "effective_vehicles": effective_number(chosen["vehicles"], weights),
    }


def _data_warnings(sample: Sample, near: Mapping[str, Any]) -> Iterable[str]:
    """Yield warnings about copies of rows and vehicles, and about few of them near the state."""
    if copies := sample.copies:
        yield (
            f"{copies} of {len(sample.row)} rows are copies of another row. A row in m encounters "
            f"has weight 1/m in each, and BIC's n is {sample.weights.sum():.4g}."
        )
    if sample.named_vehicles is not None and sample.vehicles < sample.named_vehicles:
        yield (
            f"The {sample.named_vehicles} vehicle names count as {sample.vehicles} vehicles, "
            "because some share rows or tracks; each vehicle is in one fold."
        )
    place = f"({near['range_m']:g} m, {near['vehicle_speed_mps']:g} m/s)"
    for key, words in (("vehicles", "vehicles"), ("effective_rows", "effective rows")):
        if near[key] is not None and near[key] < FEW:
            yield f"Near {place} the model has only {near[key]:.3g} {words}, fewer than {FEW}."


def _candidates(fitted: Fitted, gain: Mapping[int, float]) -> Iterable[dict[str, Any]]:
    """Yield an entry for each K."""
    best = fitted.chosen.scores.get("held_out")
    for k, found, scores in fitted.candidates:
        own = scores.get("held_out")
        less = HeldOut(own.totals - best.totals, own.weights) if own and best else None
        all_scores = {name: scores.get(name) for name in TARGETS} | {"held_out_less_chosen": less}
        yield {
            "components": k,
            "log_likelihood": found.log_likelihood,
            "bic": found.bic,
            "bic_gain_share": gain.get(k),
            "converged": found.converged,
            "gradient_norm": found.gradient_norm,
            "steps": found.n_iter,
            **{
                name: of and {"mean": of.mean, "standard_error": of.standard_error}
                for name, of in all_scores.items()
            },
        }


def fit_model(
    rows: Path,
    out: Path,
    name: str,
    command: str,
    settings: FitSettings,
    weigh: str,
    bounds: Sequence[str],
    workers: int,
    progress: Progress,
) -> Result:
    """Fit a model to a file of rows and write it.

    Args:
        rows: the file of rows.
        out: the file of the model.
        name: its name.
        command: the exact command, for its card.
        settings: see ``FitSettings``.
        weigh, bounds: see ``make_sample`` and ``box_of``.
        workers: number of processes.
        progress: called with the numbers of finished and planned fits.

    Returns:
        What it shows.
    """
    file = read_rows(rows)
    sample = make_sample(file.rows, weigh, *box_of(bounds))
    with processes(workers) as executor:
        fitted = fit(sample, settings, executor, progress)
        made = fitted.chosen.fit.mixture
        model = write_model(out, made, name, card(sample, settings, fitted, file, command))
    return model_result("fit", model, str(out), [f"Model: {out}"])


def model_result(
    command: str, model: InteractionModel, file: str, closing: Sequence[str] = ()
) -> Result:
    """What ``fit`` and ``model`` show of a model: the table over K, its data, and its marginals.

    Raises:
        InputError: the model's card has another form than those of ``harness fit``.
    """
    title = f"{model.name}: K = {model.mixture.weights.size}, sha256 {model.sha256[:16]}"
    facts: dict[str, Plain] = {"name": model.name, "sha256": model.sha256}
    marginals, of = _marginals(model), model.provenance
    if "candidates" not in of:  # by another program
        said = tuple(f"{key}: {value}" for key, value in of.items())
        return Result(command, title, "", "", marginals, (), (), tuple(closing), said, facts)
    try:
        rule, near, outside = of["rule"]["components"], of["near_state"], of["rows_outside_box"]
        columns = ", ".join(f"{name} {n}" for name, n in outside.items() if n and name != "any")
        records = [
            {column.key: _number(fit, column.key, of["vehicles"]) for column in _OVER_K}
            for fit in of["candidates"]
        ]
        rows = [tuple(map(_entered, record.values(), _OVER_K.values())) for record in records]
        return Result(
            command=command,
            title=title,
            scope=f"{of['rows']:,} of {of['rows_read']:,} rows in the box"
            f"{columns and f' (outside: {columns})'}, {_known(of, 'encounters')}, "
            f"{_known(of, 'vehicles')}; weighed by {of['weigh']}",
            about=f"K = {of['components']} ({of['chosen_by']}); the paper's 10 % rule "
            f"{'is not reached' if rule is None else f'gives K = {rule}'}. Within "
            f"{near['within_m']:g} m and {near['within_mps']:g} m/s of ({near['range_m']:g} m, "
            f"{near['vehicle_speed_mps']:g} m/s): {near['rows']:,} rows, "
            f"{_known(near, 'vehicles')}.",
            screen=Table("", tuple(_OVER_K), tuple(rows), legend=_LEGEND),
            full=(marginals,),
            notes=_notes(map(str, of["warnings"])),
            closing=tuple(closing),
            remarks=(*(f"$ {each}" for each in of["commands"]), f"rows {of['rows_sha256']}"),
            facts=facts | {"chosen_by": of["chosen_by"], "components": _whole(of["components"])},
            records=records,
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        problem = f"its provenance is no card of `harness fit` ({type(error).__name__}: {error})"
        raise InputError(file, problem, "a model as `harness fit` writes it") from None


def extraction_result(extraction: Extraction, closing: Sequence[str]) -> Result:
    """What ``extract`` shows: quartiles of the columns, and the rows that each rule left out."""
    counts, names = (
        extraction.counts,
        {"count": "rows", "25%": "25 %", "50%": "50 %", "75%": "75 %"},
    )
    frame = extraction.rows.drop(columns="time_s").describe().T.drop(columns=["mean", "std"])
    frame = frame.round(3).astype(object).where(frame.notna(), None).rename(columns=names)
    quartiles: Any = frame.reset_index(names="column").to_dict("records")
    dropped: list[dict[str, Plain]] = [
        {"rule": words, "of": level, "number": counts.dropped[level][reason]}
        for level, reasons in REASONS.items()
        for reason, words in reasons.items()
        if counts.dropped[level][reason]
    ]
    known = {"encounters": counts.pairs, "vehicles": counts.vehicles}
    title = ", ".join([f"{counts.rows:,} rows", *(_known(known, name) for name in known)])
    shown = listed("extract", quartiles, title, closing)
    skipped = (f"Clip {clip} was not used: {why}." for clip, why in counts.skipped.items())
    return replace(
        shown,
        scope=f"{counts.candidates:,} candidate rows",
        full=(replace(listed("", dropped).screen, title="Left out"),) if dropped else (),
        notes=_notes((*skipped, *counts.notes)),
    )


def _notes(texts: Iterable[str]) -> tuple[Note, ...]:
    return tuple(Note("warning", rank, "warning", text) for rank, text in enumerate(texts))


def _number(fit: Mapping[str, Any], key: str, vehicles: int | None) -> Plain | Finding:
    """A number of a candidate; scores have 95 % intervals over vehicles."""
    value = fit[key]
    if key == "components":
        return _whole(value)
    if not isinstance(value, Mapping):
        return None if value is None else Finding(value)
    mean, error = value["mean"], value["standard_error"]
    if mean is None or error is None or vehicles is None:
        return Finding(mean)
    few = f"{vehicles} vehicles, reliable from {_RELIABLE_FROM} on"
    ends, enough = (mean - _NORMAL * error, mean + _NORMAL * error), vehicles >= _RELIABLE_FROM
    return Finding(mean, *ends, vehicles, reliable=enough, reason=None if enough else few)


def _whole(value: Any) -> int:
    if type(value) is not int:
        raise TypeError(f"{value!r} is no whole number")
    return value


def _entered(value: Plain | Finding, style: Style) -> Entered:
    return Shown(value, style) if isinstance(value, Finding) else value


def _marginals(model: InteractionModel) -> Table:
    """Mean, standard deviation and quantiles of each variable within its bounds."""
    mixture = model.mixture
    # The moments of a component that lies almost entirely outside the box are meaningless.
    with np.errstate(all="ignore"):
        mean, spread = mixture.mean(), np.sqrt(np.diag(mixture.covariance()))
    rows: list[tuple[Entered, ...]] = []
    for i, name in enumerate(VARIABLES):
        quantiles = Conditional(mixture, i, ()).ppf(np.array(_QUANTILES), np.empty((1, 0)))
        numbers = (mixture.lower[i], mixture.upper[i], mean[i], spread[i], *quantiles)
        rows.append((name, *(Shown(Finding(float(of)), Style(digits=3)) for of in numbers)))
    headings = ("variable", "low", "high", "mean", "sd", *(f"{100 * q:g} %" for q in _QUANTILES))
    columns = tuple(Column(heading, heading) for heading in headings)
    return Table("Marginals of the truncated mixture", columns, tuple(rows))


def _known(of: Mapping[str, Any], name: str) -> str:
    """A count in words, with the effective number if there is one."""
    count, effective = of[name], of.get(f"effective_{name}")
    if count is None:
        return f"an unknown number of {name}"
    return f"{count:,} {name}" + ("" if effective is None else f" (effective {effective:.3g})")
