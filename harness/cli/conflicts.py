"""The command ``conflicts``."""

from harness.cli import options
from harness.cli.output import show


def conflicts(
    fcd: options.FcdArgument,
    net: options.NetOption,
    person_fcd: options.PersonFcdOption = None,
    types: options.TypesOption = None,
    edge: options.EdgeOption = None,
    settings: options.SetOption = None,
    table: options.TableOption = None,
    full: options.FullOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Measure conflicts of people and vehicles in a SUMO output; nothing is simulated."""
    from harness.core.files import write_csv
    from harness.scenario.file import set_thresholds
    from harness.studies.conflicts import conflicts as measured

    thresholds = set_thresholds(options.settings_of(settings), "conflicts")
    files = [fcd] if person_fcd is None else [fcd, person_fcd]
    result, rows = measured(files, net, types or (), edge or (), thresholds)
    if table is not None:
        write_csv(table, rows)
    show(result, full, False, as_json)
