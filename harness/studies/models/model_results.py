"""An extraction or a fitted model in; what ``extract``, ``fit`` or ``model`` shows out."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from harness.core.documents import as_plain, check_form
from harness.model.interaction import VARIABLES, InteractionModel
from harness.model.mixture.conditional import Conditional
from harness.model.trajectories.extraction import Extraction
from harness.model.trajectories.rules import REASONS
from harness.results.finding import Finding, Plain, Style
from harness.results.notes import Note
from harness.results.result import Column, Entered, Result, Shown, Table, listed
from harness.studies.models.card import score_of

_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)

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


class _Form(BaseModel):
    model_config = ConfigDict(strict=True)


class _Counts(_Form):
    rows: int
    encounters: int | None
    vehicles: int | None
    effective_vehicles: float | None = None


class _Near(_Counts):
    range_m: float
    vehicle_speed_mps: float
    within_m: float
    within_mps: float


class _Rule(_Form):
    components: int | None


class _Score(_Form):
    mean: float
    standard_error: float | None


class _Fit(_Form):
    components: int
    log_likelihood: float
    bic: float
    bic_gain_share: float | None
    held_out: _Score | None
    held_out_less_chosen: _Score | None
    held_out_driver: _Score | None


class _Card(_Counts):
    """What is shown of a card; see ``card.card``."""

    rows_read: int
    rows_outside_box: dict[str, int]
    rows_sha256: str
    weigh: str
    components: int
    chosen_by: str
    rule: _Rule
    near_state: _Near
    candidates: list[_Fit]
    warnings: list[str]
    commands: list[str]


def model_result(
    command: str, model: InteractionModel, file: str, closing: Sequence[str] = ()
) -> Result:
    """What ``fit`` and ``model`` show of a model: the table over K, its data, and its marginals.

    Raises:
        InputError: the model's card has another form than those of ``harness fit``.
    """
    title = f"{model.name}: K = {model.mixture.weights.size}, sha256 {model.sha256[:16]}"
    facts: dict[str, Plain] = {"name": model.name, "sha256": model.sha256}
    marginals = _marginals(model)
    if "candidates" not in model.provenance:  # by another program
        said = tuple(f"{key}: {value}" for key, value in model.provenance.items())
        return Result(command, title, "", "", marginals, (), (), tuple(closing), said, facts)
    card = check_form(_Card, as_plain(model.provenance), f"{file}: provenance")
    columns = ((name, n) for name, n in card.rows_outside_box.items() if n and name != "any")
    outside = ", ".join(f"{name} {n}" for name, n in columns)
    records = [
        {column.key: _number(getattr(fit, column.key), card.vehicles) for column in _OVER_K}
        for fit in card.candidates
    ]
    rows = [tuple(map(_entered, record.values(), _OVER_K.values())) for record in records]
    rule = "is not reached" if card.rule.components is None else f"gives K = {card.rule.components}"
    near = card.near_state
    return Result(
        command=command,
        title=title,
        scope=f"{card.rows:,} of {card.rows_read:,} rows in the box"
        f"{outside and f' (outside: {outside})'}, "
        f"{_known(card.encounters, 'encounters')}, "
        f"{_known(card.vehicles, 'vehicles', card.effective_vehicles)}; weighed by {card.weigh}",
        about=f"K = {card.components} ({card.chosen_by}); the paper's 10 % rule {rule}. Within "
        f"{near.within_m:g} m and {near.within_mps:g} m/s of ({near.range_m:g} m, "
        f"{near.vehicle_speed_mps:g} m/s): {near.rows:,} rows, "
        f"{_known(near.vehicles, 'vehicles', near.effective_vehicles)}.",
        screen=Table("", tuple(_OVER_K), tuple(rows), legend=_LEGEND),
        full=(marginals,),
        notes=_notes(card.warnings),
        closing=tuple(closing),
        remarks=(*(f"$ {each}" for each in card.commands), f"rows {card.rows_sha256}"),
        facts=facts | {"chosen_by": card.chosen_by, "components": card.components},
        records=records,
    )


def extraction_result(extraction: Extraction, closing: Sequence[str]) -> Result:
    """What ``extract`` shows: quartiles of the columns, and the rows that each rule left out."""
    counts = extraction.counts
    names = {"count": "rows", "25%": "25 %", "50%": "50 %", "75%": "75 %"}
    frame = extraction.rows.drop(columns="time_s").describe().T.drop(columns=["mean", "std"])
    frame = frame.round(3).astype(object).where(frame.notna(), None).rename(columns=names)
    quartiles: Any = frame.reset_index(names="column").to_dict("records")
    dropped: list[dict[str, Plain]] = [
        {"rule": words, "of": level, "number": counts.dropped[level][reason]}
        for level, reasons in REASONS.items()
        for reason, words in reasons.items()
        if counts.dropped[level][reason]
    ]
    known = _known(counts.pairs, "encounters"), _known(counts.vehicles, "vehicles")
    title = ", ".join([f"{counts.rows:,} rows", *known])
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


def _number(value: float | _Score | None, vehicles: int | None) -> Plain | Finding:
    """A number of a candidate; K is a whole number."""
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, float):
        return Finding(value)
    return score_of(value.mean, value.standard_error, vehicles)


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
        rows.append((name, *(Shown(Finding(float(value)), Style(digits=3)) for value in numbers)))
    headings = ("variable", "low", "high", "mean", "sd", *(f"{100 * q:g} %" for q in _QUANTILES))
    columns = tuple(Column(heading, heading) for heading in headings)
    return Table("Marginals of the truncated mixture", columns, tuple(rows))


def _known(count: int | None, name: str, effective: float | None = None) -> str:
    """A count in words, with the effective number if there is one."""
    if count is None:
        return f"an unknown number of {name}"
    return f"{count:,} {name}" + ("" if effective is None else f" (effective {effective:.3g})")
