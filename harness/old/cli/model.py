"""The commands ``extract``, ``fit`` and ``model show`` for the interaction model.

Each command imports its modules when it is called.
"""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.core.errors import InputError
from harness.old.cli import model_options
from harness.old.cli.interruption import unwinding
from harness.old.cli.options import JsonOption, QuietOption
from harness.old.cli.output import emit, progress_bar

if TYPE_CHECKING:
    from harness.model.trajectories import Extraction

_STATE = "30,5"

PlotsOption = Annotated[
    Path | None, typer.Option(help="Folder for the figures, PNG and PDF.", metavar="DIR")
]


def extract(
    paths: Annotated[
        list[Path], typer.Argument(help="Files or folders of trajectories.", metavar="PATH…")
    ],
    format_: Annotated[
        str,
        typer.Option(
            "--format",
            help="Data format, e.g. vci (fixed camera) or table (rows you already have); "
            "docs/model.md lists all formats.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="File for the rows (.parquet).")],
    plots: PlotsOption = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Change a rule or a format option, e.g. --set min_angle_deg=60. Repeatable.",
            metavar="KEY=VALUE",
        ),
    ] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Extract the model's variables from raw trajectories."""
    model_options.check_target(out, "--out", ".parquet")
    model_options.check_folder(plots)
    from harness.model import trajectories
    from harness.old.report.screens.model_terminal import print_extraction
    from harness.scenario import parse_setting

    options = {setting.key: setting.value for setting in map(parse_setting, settings or [])}
    clips = trajectories.read_clips(paths, format_, **options) if plots else []
    extraction = trajectories.extract(paths, format_, **options)
    if extraction.rows.empty:
        raise InputError(str(paths[0]), f"no row passes the rules{_most_frequent(extraction)}")
    words = ["harness", "extract", *map(str, paths), "--format", format_]
    words += [word for text in settings or [] for word in ("--set", text)]
    figures = []
    with unwinding():
        trajectories.write_rows(out, extraction, shlex.join([*words, "--out", str(out)]))
        if plots is not None:
            from harness.old.report.drawing.plots import plot_trajectories

            figures = plot_trajectories(clips, extraction.rows, plots)
    summary = trajectories.summary(extraction)
    document = {"out": str(out), "figures": [str(path) for path in figures], **summary}
    emit(quiet, as_json, document, [out], lambda: print_extraction(summary, out, figures))


def fit(
    rows: Annotated[
        Path, typer.Argument(help="Rows as `harness extract` writes them.", metavar="ROWS")
    ],
    out: Annotated[Path, typer.Option(help="File for the model (.json).")],
    components: Annotated[
        str, typer.Option(help="Numbers of components: 1..20, 10 (the paper's), or 2,5,10.")
    ] = "1..20",
    choose: Annotated[
        Literal["held-out", "bic", "rule"],
        typer.Option(help="Criterion that chooses K; rule is the paper's."),
    ] = "held-out",
    weigh: Annotated[
        Literal["row", "encounter", "vehicle"],
        typer.Option(help="Unit of equal weight: each row, encounter or vehicle counts the same."),
    ] = "encounter",
    bounds: Annotated[
        list[str] | None,
        typer.Option(
            help="Bounds of a model variable, e.g. vehicle_speed_mps=0.3:8 or "
            "inverse_range_per_m=1/60:0.5. Repeatable.",
            metavar="NAME=LOW:HIGH",
        ),
    ] = None,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Refuse rows outside the bounds instead of dropping them."),
    ] = False,
    starts: Annotated[
        int, typer.Option(min=1, help="Random starts of each fit; the best fit is kept.")
    ] = 3,
    folds: Annotated[
        int,
        typer.Option(min=0, help="Number of folds of vehicles for held-out scores; 0: no scores."),
    ] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the starts and folds.")] = 1,
    refits: Annotated[
        int,
        typer.Option(
            help="Number of refits to resampled vehicles, at least 5, for `harness run "
            "--over-model`; they are kept beside the model, in NAME.refits.json. 0: none. An "
            "interrupted command goes on if it is repeated.",
            metavar="N",
        ),
    ] = 0,
    keep_model: Annotated[
        bool,
        typer.Option(
            "--keep-model",
            help="With --refits: do not fit the model again; make refits of the one in --out.",
        ),
    ] = False,
    near: Annotated[
        str,
        typer.Option(help="State R,v in m and m/s; the model's card describes the data near it."),
    ] = _STATE,
    name: Annotated[
        str | None, typer.Option(help="Name of the model; default: the name of its file.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, help="Worker processes; default: one per core. Results do not depend on it."
        ),
    ] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Fit the interaction model to extracted rows.

    The command fits a model for each number of components and chooses one.
    """
    ks, state = model_options.components(components), model_options.state(near)
    box = model_options.bounds(bounds)
    model_options.check_target(out, "--out", ".json")
    model_options.check_refits(refits, keep_model)
    from harness.model.interaction import read_model, refits_beside, write_model
    from harness.old.report.screens.model_terminal import fit_document, print_fit
    from harness.old.studies import calibration
    from harness.old.studies.calibration.calibrate import job_count
    from harness.old.studies.workers.pool import default_workers

    file = calibration.read_rows(rows)
    model = read_model(out) if keep_model else None
    unit, (lower, upper) = (weigh, box) if model is None else calibration.recipe_of(model)
    sample = calibration.make_sample(file.rows, weigh=unit, lower=lower, upper=upper, strict=strict)
    if refits:
        calibration.check_refits(sample, model)
    count = workers or default_workers()
    if model is None:
        settings = calibration.Settings(ks, choose, starts=starts, folds=folds, seed=seed)
        command = ["harness", "fit", str(rows), "--components", components]
        command += ["--choose", choose, "--weigh", weigh]
        command += [*model_options.as_options(box), *(["--strict"] if strict else [])]
        command += ["--starts", str(starts), "--folds", str(folds), "--seed", str(seed)]
        command += ["--near", near, "--name", name or out.stem, "--out", str(out)]
        jobs = job_count(sample, settings)
        with progress_bar("fits", quiet or as_json) as advance, unwinding():
            fitted = calibration.calibrate(
                sample, settings, count, lambda done: advance(done, jobs)
            )
        card = calibration.card(sample, settings, fitted, file, shlex.join(command), state)
        with unwinding():
            model = write_model(out, fitted.chosen.mixture, name or out.stem, card)
    document, lines = fit_document(model, out), [out]
    beside = refits_beside(out) if refits else None
    if beside is not None:
        again = calibration.RefitSettings(refits, seed, starts)
        with progress_bar("refits", quiet or as_json) as advance, unwinding():
            calibration.make_refits(beside, model, sample, file.sha256, again, count, advance)
        document, lines = {**document, "refits": str(beside)}, [*lines, beside]
    emit(quiet, as_json, document, lines, lambda: print_fit(model, out, beside))


def show(
    model: Annotated[
        str, typer.Argument(help="A model file, or the name of a shipped model.", metavar="MODEL")
    ],
    plots: PlotsOption = None,
    rows: Annotated[
        Path | None,
        typer.Option(
            help="With --plots: the rows that the model was fitted to, drawn for comparison."
        ),
    ] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Show a model's card, moments and marginals.

    With --plots, the command also draws the paper's figures for the model.
    """
    model_options.check_folder(plots)
    if rows is not None and plots is None:
        raise InputError("--rows", "needs --plots", "--plots DIR")
    from harness.model.interaction import load_model
    from harness.old.report.screens.model_terminal import check_card, model_document, print_model

    is_file = Path(model).suffix == ".json" or Path(model).exists()
    loaded = load_model(model, model if is_file else None)
    check_card(loaded, model)
    figures: list[Path] = []
    if plots is not None:
        from harness.old.report.drawing.plots import plot_model
        from harness.old.studies.calibration import make_sample, read_rows, recipe_of

        sample = None
        if rows is not None:
            weigh, (lower, upper) = recipe_of(loaded)
            table = read_rows(rows).rows
            sample = make_sample(table, weigh=weigh, lower=lower, upper=upper)
        with unwinding():
            figures = plot_model(loaded, sample, plots)
    document = {**model_document(loaded), "figures": [*map(str, figures)]}
    lines = [*map(str, figures)] or [loaded.name]
    emit(quiet, as_json, document, lines, lambda: print_model(loaded, figures))


def _most_frequent(extraction: "Extraction") -> str:
    """Name the rule that excluded the most rows."""
    levels = extraction.counts.dropped.values()
    dropped = {reason: count for level in levels for reason, count in level.items() if count}
    if not dropped:
        return ""
    reason = max(dropped, key=lambda key: dropped[key])
    return f" (the rule that excluded the most is {reason}: {dropped[reason]})"


group = typer.Typer(
    help="Show a fitted interaction model.", no_args_is_help=True, rich_markup_mode=None
)
group.command()(show)


@group.callback()
def _group() -> None:
    """Show a fitted interaction model."""
    # Without a callback typer would merge the only command, `show`, into the group.
