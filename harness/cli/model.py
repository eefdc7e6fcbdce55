"""The commands about recordings and models of them: ``extract, fit, model, validate``."""

import shlex
import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.output import progress_bar, show
from harness.core.errors import InputError
from harness.core.files import check_target
from harness.studies.defaults import CRITERION, FOLDS, SEED, STARTS, WEIGH


def extract(
    data: options.DataArgument,
    format_: options.FormatOption,
    out: Annotated[Path, Option(help="File for the rows (.parquet).")],
    settings: options.SetOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Extract the model's variables from recorded trajectories.

    --set changes a rule of the extraction, e.g. --set min_angle_deg=60.
    """
    check_target(out, ".parquet")
    from harness.model.trajectories import extraction
    from harness.studies.models.model_results import extraction_result

    with unwinding():
        extracted = extraction.extract(data, format_, **options.changes_of(settings))
        result = extraction_result(extracted, [f"Rows: {out}"])
        extraction.write_rows(out, extracted, _command())
    show(result, [out], full=full, quiet=quiet, as_json=as_json)


def fit(
    rows: Annotated[Path, Argument(help="Rows that `harness extract` wrote.")],
    out: Annotated[Path, Option(help="File for the model (.json).")],
    components: options.ComponentsOption = "1..20",
    choose: options.ChooseOption = CRITERION,
    weigh: options.WeighOption = WEIGH,
    bounds: options.BoundsOption = None,
    starts: Annotated[int, Option(min=1, help="Random starts of each fit.")] = STARTS,
    folds: options.FoldsOption = FOLDS,
    seed: Annotated[int, Option(min=0, help="Seed of starts and folds.")] = SEED,
    name: Annotated[str | None, Option(help="The model's name; default: that of its file.")] = None,
    workers: options.WorkersOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Fit the interaction model to rows, and choose the number K."""
    check_target(out, ".json")
    from harness.studies.models.card import fit_model
    from harness.studies.models.fits import FitSettings, components_of
    from harness.studies.models.model_results import model_result
    from harness.studies.running.workers import default_workers

    box, numbers = tuple(bounds or ()), components_of(components)
    how = FitSettings(numbers, choose, starts, folds, seed, weigh, box)
    with progress_bar(quiet or as_json, "fits") as advance, unwinding():
        fitted = fit_model(
            rows,
            out,
            name=name or out.stem,
            command=_command(),
            settings=how,
            workers=workers or default_workers(),
            progress=advance,
        )
    result = model_result("fit", fitted, str(out), [f"Model: {out}"])
    show(result, [out], full=full, quiet=quiet, as_json=as_json)


def model(
    model: Annotated[str, Argument(help="A model file, or the name of a shipped model.")],
    out: options.ResultPageOption = None,
    figures: options.FiguresOption = None,
    rows: Annotated[Path | None, Option(help="Rows to draw beside the model.")] = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Print a model's card; with --out, write a page with figures.

    The figures are the paper's; --figures writes them as files.
    """
    from harness.model.interaction import model_named
    from harness.studies.models.model_results import model_result

    if out:
        check_target(out)
    if rows and not (out or figures):
        raise InputError("--rows", "needs a page or figures", "--out or --figures")
    loaded, written = model_named(model), list[Path]()
    result = model_result("model", loaded, model)
    if out or figures:
        from harness.report.model_figures import write_model_page

        with unwinding():
            written = write_model_page(loaded, result, rows, out, figures)
    show(result, written or [loaded.name], full=full, quiet=quiet, as_json=as_json)


def validate(
    data: options.DataArgument,
    format_: options.FormatOption,
    drivers: options.DriversOption,
    out: options.ResultPageOption = None,
    settings: options.SetOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Compare strategies with recorded drivers, in their place."""
    from harness.studies.models.validation import validate as validated

    if out:
        check_target(out)
    with progress_bar(quiet or as_json, "drivers") as advance, unwinding():
        result = validated(
            data, format_, drivers.split(","), options.settings_of(settings), advance
        )
    if out is not None:
        from harness.report.page import write_result

        write_result(result, out)
    nearest = [str(record["driver"]) for record in result.records]
    show(result, nearest, full=full, quiet=quiet, as_json=as_json)


def _command() -> str:
    return shlex.join(["harness", *sys.argv[1:]])
