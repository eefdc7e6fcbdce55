"""Prints the results of ``extract``, ``fit`` and ``model show``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from harness.errors import one_line
from harness.interaction import VARIABLES, InteractionModel
from harness.report.console import make_console
from harness.report.tables import counted
from harness.trajectories import REASONS

_SYMBOLS = ("1/R (1/m)", "v (m/s)", "v_p (m/s)", "1/T_adv (1/s)")
_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
_SHOWN = (0.05, 0.5, 0.95)


def print_extraction(summary: Mapping[str, Any], out: Path, figures: Sequence[Path]) -> None:
    """Counts, quartiles, and what each rule left out."""
    console, counts = make_console(), summary["counts"]
    console.print(
        f"{counted(summary['rows'], 'row')} of {_some(summary['encounters'], 'encounter')} with "
        f"{_some(summary['vehicles'], 'vehicle')}, from {_some(counts['clips'], 'clip')} "
        f"({counted(counts['candidates'], 'candidate row')})."
    )
    table = Table(title="Quartiles")
    for heading in ("column", "rows", "min", "25 %", "median", "75 %", "max"):
        table.add_column(heading, justify="left" if heading == "column" else "right")
    for name, of in summary["quartiles"].items():
        numbers = (of[key] for key in ("min", "q25", "median", "q75", "max"))
        table.add_row(name, str(of["n"]), *(_short(number) for number in numbers))
    console.print(table)
    dropped = Table(title="Left out")
    for heading in ("what", "number", "rule"):
        dropped.add_column(heading, justify="right" if heading == "number" else "left")
    for level, reasons in REASONS.items():
        for reason, words in reasons.items():
            if counts["dropped"][level][reason]:
                dropped.add_row(level, str(counts["dropped"][level][reason]), words)
    console.print(dropped)
    for clip, why in counts["skipped"].items():
        console.print(one_line(f"Clip {clip} not used: {why}"), soft_wrap=True)
    for note in counts["notes"]:
        console.print(one_line(note), soft_wrap=True)
    _print_files(console, "Rows", [out])
    _print_files(console, "Figures", figures)


def print_fit(model: InteractionModel, out: Path) -> None:
    """The table over K and the card's main lines."""
    console = make_console()
    _print_candidates(console, model.provenance)
    _print_card(console, model.provenance)
    _print_files(console, "Model", [out])


def print_model(model: InteractionModel, figures: Sequence[Path]) -> None:
    """Card, moments and marginals."""
    console, card = make_console(), model.provenance
    console.print(f"{model.name}: K = {model.mixture.weights.size}, sha256 {model.sha256}")
    if "candidates" in card:  # `harness fit` wrote it
        _print_candidates(console, card)
        _print_card(console, card)
    else:
        for key, value in card.items():
            console.print(f"{key}: {value}", soft_wrap=True)
    document = model_document(model)
    table = Table(title="Marginals of the truncated mixture", box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("variable", "low", "high", "mean", "sd", *(f"{q:.0%}" for q in _SHOWN)):
        justify: Literal["left", "right"] = "left" if heading == "variable" else "right"
        table.add_column(heading, justify=justify, no_wrap=True)
    for name, of in zip(_SYMBOLS, document["marginals"].values(), strict=True):
        quantiles = [of["quantiles"][str(q)] for q in _SHOWN]
        numbers = (*of["bounds"], of["mean"], of["standard_deviation"], *quantiles)
        table.add_row(name, *("" if number is None else f"{number:.3g}" for number in numbers))
    console.print(table)
    correlations = Table(title="Correlations")
    correlations.add_column("")
    for name in _SYMBOLS:
        correlations.add_column(name, justify="right")
    for name, row in zip(_SYMBOLS, document["correlations"], strict=True):
        correlations.add_row(name, *("" if value is None else f"{value:.2f}" for value in row))
    console.print(correlations)
    _print_files(console, "Figures", figures)


def model_document(model: InteractionModel) -> dict[str, Any]:
    """A model as plain data: card, moments, marginals."""
    mixture = model.mixture
    mean, covariance = mixture.mean(), mixture.covariance()
    # A component of which nearly nothing is in the box has no moments to speak of.
    with np.errstate(all="ignore"):
        spread = np.sqrt(np.diag(covariance))
        correlations = covariance / np.outer(spread, spread)
    marginals = {}
    for i, name in enumerate(VARIABLES):
        values = mixture.conditional(i, ()).ppf(np.array(_QUANTILES), np.empty((1, 0)))
        marginals[name] = {
            "bounds": [float(mixture.lower[i]), float(mixture.upper[i])],
            "mean": _defined(mean[i]),
            "standard_deviation": _defined(spread[i]),
            "quantiles": {str(q): _defined(v) for q, v in zip(_QUANTILES, values, strict=True)},
        }
    return {
        "name": model.name,
        "sha256": model.sha256,
        "components": int(mixture.weights.size),
        "marginals": marginals,
        "correlations": [[_defined(value) for value in row] for row in correlations],
        "card": model.provenance,
    }


def _defined(value: float) -> float | None:
    """None where it is not finite."""
    return float(value) if np.isfinite(value) else None


def fit_document(model: InteractionModel, out: Path) -> dict[str, Any]:
    """The document that ``harness fit --json`` prints."""
    return {"out": str(out), "name": model.name, "sha256": model.sha256, "card": model.provenance}


def _print_candidates(console: Console, card: Mapping[str, Any]) -> None:
    table = Table(title="Number of components")
    headings = ("K", "log L", "BIC", "gain", "held-out v_p", "less chosen", "held-out v")
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for of in card["candidates"]:
        chosen = of["components"] == card["components"]
        table.add_row(
            f"{of['components']}" + ("" if of["converged"] else "*"),
            f"{of['log_likelihood']:.0f}",
            f"{of['bic']:.0f}",
            "" if of["bic_gain_share"] is None else f"{of['bic_gain_share']:.0%}",
            _plus_minus(of["held_out"]),
            _plus_minus(of["held_out_less_chosen"]),
            _plus_minus(of["held_out_driver"]),
            style="bold" if chosen else None,
        )
    console.print(table)
    rule = card["rule"]["components"]
    words = "cannot be applied or is not reached" if rule is None else f"gives K = {rule}"
    console.print(
        f"K = {card['components']} ({card['chosen_by']}); the paper's 10 % rule {words}. "
        f"Gain: of BIC, as a share of the second component's. Held-out: mean log f(v_p | 1/R, v) "
        f"and log f(v | 1/R, v_p, 1/T_adv) per encounter on vehicles not fitted on, nats ± "
        f"standard error over vehicles, {card['folds_of_vehicles']} folds.{_steepest(card)}"
    )


def _steepest(card: Mapping[str, Any]) -> str:
    """The largest gradient norm over K; cards of earlier versions do not say it."""
    norms = [of["gradient_norm"] for of in card["candidates"] if "gradient_norm" in of]
    return f" Largest gradient at a fit's end: {max(norms):.1g} per encounter." if norms else ""


def _print_card(console: Console, card: Mapping[str, Any]) -> None:
    outside = card["rows_outside_box"]
    by_column = ", ".join(f"{name} {n}" for name, n in outside.items() if n and name != "any")
    near = card["near_state"]
    console.print(
        f"{card['rows']} of {card['rows_read']} rows in the box, {outside['any']} outside"
        + (f" ({by_column})." if by_column else ".")
    )
    console.print(
        f"{_some(card['encounters'], 'encounter')}, {_some(card['vehicles'], 'vehicle')} "
        f"(effective {_short(card['effective_vehicles'])}), effective rows "
        f"{_short(card['effective_rows'])}; weighed by {card['weigh']}."
    )
    console.print(
        f"Within {near['within_m']:g} m and {near['within_mps']:g} m/s of ({near['range_m']:g} m, "
        f"{near['vehicle_speed_mps']:g} m/s): {near['rows']} rows (effective "
        f"{_short(near['effective_rows'])}), {_some(near['encounters'], 'encounter')}, "
        f"{_some(near['vehicles'], 'vehicle')} (effective {_short(near['effective_vehicles'])})."
    )
    for warning in card["warnings"]:
        console.print(f"Warning: {warning}")
    for command in card["commands"]:
        console.print(f"$ {command}", soft_wrap=True)
    console.print(f"Rows sha256 {card['rows_sha256']}", soft_wrap=True)


def _print_files(console: Console, what: str, paths: Sequence[Path]) -> None:
    if paths:
        console.print(f"{what}: {', '.join(str(path) for path in paths)}", soft_wrap=True)


def _some(count: int | None, noun: str) -> str:
    return f"unknown {noun}s" if count is None else counted(count, noun)


def _short(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _plus_minus(score: Mapping[str, float | None] | None) -> str:
    if score is None or score["mean"] is None:
        return ""
    error = score["standard_error"]
    return f"{score['mean']:.3f}" if error is None else f"{score['mean']:.3f}±{error:.3f}"
