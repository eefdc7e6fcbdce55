"""Prints the results of ``extract``, ``fit`` and ``model show``."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from pydantic import BaseModel, ConfigDict
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from harness.core.documents import check_form
from harness.core.encounter import FloatArray
from harness.core.errors import one_line
from harness.model.interaction import VARIABLES, InteractionModel
from harness.model.trajectories import REASONS
from harness.old.report.screens.console import make_console
from harness.old.report.screens.tables import counted

_SYMBOLS = ("1/R (1/m)", "v (m/s)", "v_p (m/s)", "1/T_adv (1/s)")
_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
_SHOWN = (0.05, 0.5, 0.95)


class _Form(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Score(_Form):
    mean: float | None
    standard_error: float | None


class _Candidate(_Form):
    components: int
    converged: bool
    log_likelihood: float
    bic: float
    bic_gain_share: float | None
    gradient_norm: float | None = None
    held_out: _Score | None
    held_out_less_chosen: _Score | None
    held_out_driver: _Score | None


class _Near(_Form):
    range_m: float
    vehicle_speed_mps: float
    within_m: float
    within_mps: float
    rows: int
    effective_rows: float | None
    encounters: int | None
    vehicles: int | None
    effective_vehicles: float | None


class _Card(_Form):
    source: list[str]
    commands: list[str]
    rows_sha256: str
    rows_read: int
    rows_outside_box: dict[str, int]
    rows: int
    effective_rows: float | None
    encounters: int | None
    vehicles: int | None
    effective_vehicles: float | None
    near_state: _Near
    weigh: str
    components: int
    chosen_by: str
    weight_sum: float
    candidates: list[_Candidate]
    rule: dict[str, int | str | None]
    folds_of_vehicles: int
    warnings: list[str]


def check_card(model: InteractionModel, file: str) -> None:
    """Refuse a model whose card differs in form from the cards of ``harness fit``.

    A file from another source has no table of candidates, and its provenance may have any form.

    Args:
        model: the model.
        file: the model's file, for messages.

    Raises:
        InputError: a key is missing or has the wrong type.
    """
    if "candidates" in model.provenance:
        check_form(_Card, model.provenance, f"{file}: provenance")


def print_extraction(summary: Mapping[str, Any], out: Path, figures: Sequence[Path]) -> None:
    """Print counts, quartiles, and the number of rows that each rule excluded."""
    console, counts = make_console(), summary["counts"]
    console.print(
        f"{counted(summary['rows'], 'row')} of {_some(summary['encounters'], 'encounter')} with "
        f"{_some(summary['vehicles'], 'vehicle')}, from {_some(counts['clips'], 'clip')} "
        f"({counted(counts['candidates'], 'candidate row')})."
    )
    headings = {"n": "rows", "min": "min", "q25": "25 %", "median": "median", "q75": "75 %"}
    headings["max"] = "max"
    quartiles = [
        (name, *(_short(values[key]) for key in headings))
        for name, values in summary["quartiles"].items()
    ]
    _print_table(console, "Quartiles", ("column", *headings.values()), quartiles)
    dropped = [
        (words, level, str(counts["dropped"][level][reason]))
        for level, reasons in REASONS.items()
        for reason, words in reasons.items()
        if counts["dropped"][level][reason]
    ]
    _print_table(console, "Left out", ("rule", "what", "number"), dropped)
    for clip, why in counts["skipped"].items():
        console.print(one_line(f"Clip {clip} not used: {why}"), soft_wrap=True)
    for note in counts["notes"]:
        console.print(one_line(note), soft_wrap=True)
    _print_files(console, "Rows", [out])
    _print_files(console, "Figures", figures)


def print_fit(model: InteractionModel, out: Path, refits: Path | None = None) -> None:
    """Print the table over K, the card's main lines and the written files."""
    console = make_console()
    _print_card(console, model)
    _print_files(console, "Model", [out])
    if refits is not None:
        _print_files(console, "Refits", [refits])


def print_model(model: InteractionModel, figures: Sequence[Path]) -> None:
    """Print the card, moments and marginals."""
    console, document = make_console(), model_document(model)
    console.print(f"{model.name}: K = {model.mixture.weights.size}, sha256 {model.sha256}")
    if "candidates" in model.provenance:  # `harness fit` wrote it
        _print_card(console, model)
    else:
        for key, value in model.provenance.items():
            console.print(f"{key}: {value}", soft_wrap=True)
    marginals = [
        (
            symbol,
            *(_short(bound, 3) for bound in values["bounds"]),
            *(_short(values[key], 3) for key in ("mean", "standard_deviation")),
            *(_short(values["quantiles"][str(q)], 3) for q in _SHOWN),
        )
        for symbol, values in zip(_SYMBOLS, document["marginals"].values(), strict=True)
    ]
    headings = ("variable", "low", "high", "mean", "sd", *(f"{q:.0%}" for q in _SHOWN))
    _print_table(console, "Marginals of the truncated mixture", headings, marginals)
    correlations = [
        (symbol, *("" if value is None else f"{value:.2f}" for value in row))
        for symbol, row in zip(_SYMBOLS, document["correlations"], strict=True)
    ]
    _print_table(console, "Correlations", ("", *_SYMBOLS), correlations)
    _print_files(console, "Figures", figures)


class Marginal(TypedDict):
    """The distribution of one variable within its bounds; None replaces non-finite numbers."""

    bounds: list[float]
    mean: float | None
    standard_deviation: float | None
    quantiles: dict[str, float | None]


class ModelDocument(TypedDict):
    """The document of ``harness model --json``, without the figures."""

    name: str
    sha256: str
    components: int
    marginals: dict[str, Marginal]
    correlations: list[list[float | None]]
    card: Mapping[str, object]


def model_document(model: InteractionModel) -> ModelDocument:
    """Return a model as plain data: card, moments, marginals."""
    mixture = model.mixture
    mean, covariance = mixture.mean(), mixture.covariance()
    # The moments of a component that lies almost entirely outside the box are meaningless.
    with np.errstate(all="ignore"):
        spread = np.sqrt(np.diag(covariance))
        correlations = covariance / np.outer(spread, spread)
    marginals: dict[str, Marginal] = {}
    for i, name in enumerate(VARIABLES):
        values = mixture.conditional(i, ()).ppf(np.array(_QUANTILES), np.empty((1, 0)))
        marginals[name] = {
            "bounds": [float(mixture.lower[i]), float(mixture.upper[i])],
            "mean": _defined(mean)[i],
            "standard_deviation": _defined(spread)[i],
            "quantiles": dict(zip(map(str, _QUANTILES), _defined(values), strict=True)),
        }
    return {
        "name": model.name,
        "sha256": model.sha256,
        "components": int(mixture.weights.size),
        "marginals": marginals,
        "correlations": [_defined(row) for row in correlations],
        "card": model.provenance,
    }


def fit_document(model: InteractionModel, out: Path) -> Mapping[str, object]:
    """Return the document that ``harness fit --json`` prints."""
    return {"out": str(out), "name": model.name, "sha256": model.sha256, "card": model.provenance}


def _defined(values: FloatArray) -> list[float | None]:
    """Return the numbers; None replaces non-finite numbers."""
    return [float(value) if np.isfinite(value) else None for value in values]


def _print_card(console: Console, model: InteractionModel) -> None:
    """Print the table over K, and the model's data and method."""
    card = check_form(_Card, model.provenance, model.name)
    headings = ("K", "log L", "BIC", "gain", "held-out v_p", "less chosen", "held-out v")
    candidates = [
        (
            f"{fit.components}" + ("" if fit.converged else "*"),
            f"{fit.log_likelihood:.0f}",
            f"{fit.bic:.0f}",
            "" if fit.bic_gain_share is None else f"{fit.bic_gain_share:.0%}",
            *map(_plus_minus, (fit.held_out, fit.held_out_less_chosen, fit.held_out_driver)),
        )
        for fit in card.candidates
    ]
    _print_table(console, "Number of components", headings, candidates)
    rule = card.rule.get("components")
    words = "cannot be applied or is not reached" if rule is None else f"gives K = {rule}"
    norms = [fit.gradient_norm for fit in card.candidates if fit.gradient_norm is not None]
    steepest = f" Largest gradient at a fit's end: {max(norms):.1g} per encounter." if norms else ""
    console.print(
        f"K = {card.components} ({card.chosen_by}); the paper's 10 % rule {words}. "
        f"Gain: gain in BIC, as a share of the gain by the second component. Held-out: mean log "
        f"f(v_p | 1/R, v) and log f(v | 1/R, v_p, 1/T_adv) per encounter, on vehicles that the fit "
        f"has not seen, nats ± "
        f"standard error over vehicles, {card.folds_of_vehicles} folds.{steepest}"
    )
    outside = dict(card.rows_outside_box)
    total = outside.pop("any", 0)
    by_column = ", ".join(f"{name} {rows}" for name, rows in outside.items() if rows)
    console.print(
        f"{card.rows} of {card.rows_read} rows in the box, {total} outside"
        + (f" ({by_column})." if by_column else ".")
    )
    console.print(
        f"{_some(card.encounters, 'encounter')}, {_some(card.vehicles, 'vehicle')} "
        f"(effective {_short(card.effective_vehicles)}), effective rows "
        f"{_short(card.effective_rows)}; weighed by {card.weigh}."
    )
    near = card.near_state
    console.print(
        f"Within {near.within_m:g} m and {near.within_mps:g} m/s of ({near.range_m:g} m, "
        f"{near.vehicle_speed_mps:g} m/s): {near.rows} rows (effective "
        f"{_short(near.effective_rows)}), {_some(near.encounters, 'encounter')}, "
        f"{_some(near.vehicles, 'vehicle')} (effective {_short(near.effective_vehicles)})."
    )
    for line in (
        *(f"Warning: {warning}" for warning in card.warnings),
        *(f"$ {command}" for command in card.commands),
        f"Rows sha256 {card.rows_sha256}",
    ):
        console.print(line, soft_wrap=True)


def _print_table(
    console: Console, title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]
) -> None:
    """Print a table with a first column of text and further columns of numbers."""
    table = Table(title=title, box=SIMPLE_HEAD, pad_edge=False)
    table.add_column(headings[0])
    for heading in headings[1:]:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _print_files(console: Console, what: str, paths: Sequence[Path]) -> None:
    if paths:
        console.print(f"{what}: {', '.join(str(path) for path in paths)}", soft_wrap=True)


def _some(count: int | None, noun: str) -> str:
    return f"unknown {noun}s" if count is None else counted(count, noun)


def _short(value: float | None, digits: int = 4) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def _plus_minus(score: _Score | None) -> str:
    if score is None or score.mean is None:
        return ""
    error = score.standard_error
    return f"{score.mean:.3f}" if error is None else f"{score.mean:.3f}±{error:.3f}"
