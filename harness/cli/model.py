"""Commands about the interaction model: ``extract``, ``fit``, ``model``."""

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Option

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.output import progress_bar, show
from harness.core.errors import InputError, unknown_name

if TYPE_CHECKING:
    from harness.core.encounter import FloatArray

MOST_COMPONENTS = 100

_FIGURES = "Folder for the figures, PNG and PDF."
_BOUNDS = (
    "Bounds of a variable, e.g. vehicle_speed_mps=0.3:8 or inverse_range_per_m=1/60:0.5. "
    "Repeatable; rows outside are left out and counted."
)
_REFITS = "Number of refits to resampled vehicles, as models beside the model: NAME.refit-1.json …"


def extract(
    paths: Annotated[list[Path], Argument(help="Files or folders of trajectories.")],
    format_: Annotated[str, Option("--format", help="vci, mobileye, table …: see docs/model.md.")],
    out: Annotated[Path, Option(help="File for the rows (.parquet).")],
    settings: options.SetOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Extract the model's variables from raw trajectories; --set changes a rule or an option."""
    _check_target(out, ".parquet")
    from harness.model import trajectories
    from harness.scenario import parse_setting
    from harness.studies.model_card import extraction_result

    chosen = {setting.key: setting.value for setting in map(parse_setting, settings or [])}
    words = ["harness", "extract", *map(str, paths), "--format", format_]
    words += [word for text in settings or [] for word in ("--set", text)]
    with unwinding():
        extraction = trajectories.extract(paths, format_, **chosen)
        trajectories.write_rows(out, extraction, shlex.join([*words, "--out", str(out)]))
    result = extraction_result(trajectories.summary(extraction), [f"Rows: {out}"])
    show(result, full, quiet, as_json, [out])


def fit(
    rows: Annotated[Path, Argument(help="Rows as `harness extract` writes them.")],
    out: Annotated[Path, Option(help="File for the model (.json).")],
    components: Annotated[str, Option(help="1..20, 10 (the paper's), or 2,5,10.")] = "1..20",
    choose: Annotated[
        Literal["held-out", "bic", "rule"], Option(help="Criterion for K; rule is the paper's.")
    ] = "held-out",
    weigh: Annotated[
        Literal["row", "encounter", "vehicle"], Option(help="What counts the same.")
    ] = "encounter",
    bounds: Annotated[list[str] | None, Option(help=_BOUNDS, metavar="NAME=LOW:HIGH")] = None,
    starts: Annotated[int, Option(min=1, help="Random starts of each fit.")] = 3,
    folds: Annotated[int, Option(min=0, help="Folds of vehicles for held-out scores.")] = 5,
    seed: Annotated[int, Option(min=0, help="Seed of the starts and folds.")] = 1,
    refits: Annotated[int, Option(min=0, help=_REFITS)] = 0,
    near: Annotated[
        str, Option(help="State R,v of which the card tells the data near it.")
    ] = "30,5",
    name: Annotated[str | None, Option(help="The model's name; default: that of its file.")] = None,
    workers: options.WorkersOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Fit the interaction model to extracted rows, for each number of components; choose one."""
    _check_target(out, ".json")
    ks, state = _components(components), _state(near)
    lower, upper = _bounds(bounds or [])
    from harness.model.interaction import write_model
    from harness.model.sample import make_sample, read_rows
    from harness.studies import fitting
    from harness.studies.model_card import card, model_result
    from harness.studies.workers import default_workers

    file = read_rows(rows)
    sample = make_sample(file.rows, weigh=weigh, lower=lower, upper=upper)
    if refits:
        fitting.check_refits(sample)
    chosen = fitting.Settings(ks, choose, starts, folds, seed)
    words = ["harness", "fit", str(rows), "--components", components, "--choose", choose]
    words += ["--weigh", weigh, *(word for text in bounds or [] for word in ("--bounds", text))]
    words += ["--starts", str(starts), "--folds", str(folds), "--seed", str(seed), "--near", near]
    words += ["--name", name or out.stem, "--out", str(out)]
    count, written = workers or default_workers(), [out]
    with progress_bar(quiet or as_json, "fits") as advance, unwinding():
        fitted = fitting.fit(sample, chosen, count, advance)
        again = []
        if refits:
            k = fitted.chosen.components
            again = fitting.refits(sample, k, refits, chosen, count, advance)
    with unwinding():
        kept = card(sample, chosen, fitted, file, shlex.join(words), state)
        model = write_model(out, fitted.chosen.fit.mixture, name or out.stem, kept)
        for number, mixture in enumerate(again, 1):
            beside = out.with_name(f"{out.stem}.refit-{number}.json")
            of = {"refit": number, "of": model.sha256, "seed": seed, "rows_sha256": file.sha256}
            write_model(beside, mixture, f"{model.name}-refit-{number}", of)
            written.append(beside)
    closing = [
        f"Model: {out}",
        *(f"Refits: {written[1]} to {each.name}" for each in written[-1:] if again),
    ]
    show(model_result("fit", model, str(out), closing), full, quiet, as_json, written)


def model(
    model: Annotated[str, Argument(help="A model file, or the name of a shipped model.")],
    figures: Annotated[Path | None, Option(help=_FIGURES)] = None,
    rows: Annotated[Path | None, Option(help="The fitted rows, for the figures.")] = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Show a model: its card, the table over K, and its marginals; --figures draws the paper's."""
    if rows is not None and figures is None:
        raise InputError("--rows", "needs --figures", "--figures DIR")
    from harness.model.interaction import load_model
    from harness.studies.model_card import model_result

    is_file = Path(model).suffix == ".json" or Path(model).exists()
    loaded = load_model(model, model if is_file else None)
    written: list[Path] = []
    if figures is not None:
        from harness.model.sample import make_sample, read_rows
        from harness.report.model_figures import save_figures

        sample = None
        if rows is not None:
            unit = str(loaded.provenance.get("weigh", "row")).partition(",")[0]
            lower, upper = loaded.mixture.lower, loaded.mixture.upper
            table = read_rows(rows).rows
            sample = make_sample(table, weigh=unit, lower=lower, upper=upper)
        with unwinding():
            written = save_figures(loaded, sample, figures)
    result = model_result("model", loaded, model, [f"Figure: {path}" for path in written])
    show(result, full, quiet, as_json, written or [loaded.name])


def _components(text: str) -> tuple[int, ...]:
    """``1..20``, ``10`` or ``2,5,10`` as ascending numbers."""
    numbers: set[int] = set()
    for part in text.split(","):
        first, dots, last = part.partition("..")
        low, high = (
            int(each) if each.isdigit() else 0 for each in (first, last if dots else first)
        )
        if not 1 <= low <= high <= MOST_COMPONENTS:
            allowed = f"whole numbers from 1 to {MOST_COMPONENTS}: 1..20, 10 or 2,5,10"
            raise InputError(f"--components {text}", f"{part!r} is not accepted", allowed)
        numbers.update(range(low, high + 1))
    return tuple(sorted(numbers))


def _state(text: str) -> tuple[float, float]:
    """``30,5`` as (R in m, v in m/s), both above 0."""
    values = [_number(part) for part in text.split(",")]
    if len(values) != 2 or not all(0 < value < float("inf") for value in values):
        raise InputError(f"--near {text}", "is not a state", "R,v above 0, e.g. 30,5")
    return values[0], values[1]


def _bounds(texts: list[str]) -> "tuple[FloatArray, FloatArray]":
    """Lower and upper bounds, each of shape (4,): the defaults with the named changes."""
    import numpy as np

    from harness.model.interaction import VARIABLES
    from harness.model.sample import BOX_LOWER, BOX_UPPER

    lower, upper = np.array(BOX_LOWER), np.array(BOX_UPPER)
    for text in texts:
        name, _, values = text.partition("=")
        if name not in VARIABLES:
            raise unknown_name(f"--bounds {text}", "variable", name, VARIABLES)
        low, _, high = values.partition(":")
        index = VARIABLES.index(name)
        lower[index], upper[index] = _number(low), _number(high)
        if not lower[index] < upper[index]:
            allowed = "NAME=LOW:HIGH, e.g. vehicle_speed_mps=0.3:8 or inverse_range_per_m=1/60:0.5"
            raise InputError(f"--bounds {text}", "is not accepted", allowed)
    return lower, upper


def _number(text: str) -> float:
    """A number, or a ratio such as 1/60; NaN if it is none."""
    above, slash, below = text.partition("/")
    try:
        return float(above) / float(below) if slash else float(above)
    except (ValueError, ZeroDivisionError):
        return float("nan")


def _check_target(path: Path, suffix: str) -> None:
    """Refuse a file that cannot be written, before any work begins."""
    where = f"--out {path}"
    if path.suffix != suffix or path.is_dir():
        raise InputError(where, f"does not name a {suffix} file", f"a file name ending in {suffix}")
    if not os.access(path.parent, os.W_OK):
        raise InputError(where, "its folder is missing or not writable", "a writable folder")
