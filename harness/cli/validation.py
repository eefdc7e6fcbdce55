"""``validate``: compares drivers with recorded ones."""

from harness.cli import options
from harness.cli.output import progress_bar, show


def validate(
    data: options.DataArgument,
    format_: options.FormatOption,
    drivers: options.DriversOption,
    out: options.ResultPageOption = None,
    folds: options.FoldsOption = 5,
    settings: options.SetOption = None,
    full: options.FullOption = False,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Compare drivers with recordings: each drives in place of the recorded driver."""
    from harness.studies.validation import validate as validated

    names = [name for name in drivers.split(",") if name]
    with progress_bar(quiet or as_json, "drivers") as advance:
        result = validated(data, format_, names, options.settings_of(settings), folds, advance)
    if out is not None:
        from harness.report.page import write_result

        write_result(result, out)
    show(result, full, quiet, as_json, [str(record["driver"]) for record in result.records])
