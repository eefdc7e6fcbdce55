"""Options that several commands share."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from harness.core.errors import InputError
from harness.core.resources import shipped_directory

_SHIPPED = ", ".join(sorted(file.stem for file in shipped_directory("scenarios").glob("*.toml")))

RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")]
ScenarioArgument = Annotated[
    str,
    typer.Argument(help=f"A scenario file (TOML), or the name of a shipped scenario: {_SHIPPED}."),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change a key of the scenario, e.g. --set ego.initial_speed_mps=8. Repeatable.",
        metavar="KEY=VALUE",
    ),
]
ThresholdsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change a conflict threshold, e.g. --set conflicts.ttc_s=2. Repeatable.",
        metavar="KEY=VALUE",
    ),
]
VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        help="Vary a key over values or a range, e.g. --vary pedestrians.flow_per_hour=50,100 "
        "--vary strategies.soft_yield.p1=0:0.1:0.02. Repeatable: cells form the full grid. "
        "It replaces the [sweep] of the scenario file.",
        metavar="KEY=V1,V2,…",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(help="Folder for the results; default runs/<scenario>-<next number>."),
]
PairsOption = Annotated[
    int | None, typer.Option(help="Number of pairs per cell, instead of the scenario's.")
]
SeedOption = Annotated[int | None, typer.Option(help="Root seed, instead of the scenario's.")]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Worker processes; default: all cores.")
]
DaskOption = Annotated[
    str | None,
    typer.Option(
        help="Run on a Dask cluster, e.g. tcp://127.0.0.1:8786 (pip install "
        "crosswalk-harness[cluster]); each of its workers must have one thread.",
        metavar="ADDRESS",
    ),
]
EngineOption = Annotated[
    Literal["sumo", "plain"],
    typer.Option(
        help="plain: the same kinematics, faster, without SUMO's collision check and outputs."
    ),
]
TracesOption = Annotated[
    bool, typer.Option("--traces", help="Write every time step to traces.parquet.")
]
FullOption = Annotated[
    bool, typer.Option("--full", help="Print every number, not only the first screen.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print only the results, as JSON.")]
ArmOption = Annotated[
    Literal["av", "human"],
    typer.Option(help="Arm of the episodes: the AV's or the human driver's."),
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only the paths of the written files.")
]


def settings_of(
    settings: list[str] | None,
    pairs: int | None = None,
    seed: int | None = None,
) -> list[Any]:
    """Return the changes of --set, --pairs and --seed in the order of application."""
    from harness.scenario import Setting, parse_setting

    chosen = [parse_setting(text) for text in settings or []]
    if pairs is not None:
        chosen.append(Setting("experiment.pairs", pairs, "--pairs"))
    if seed is not None:
        chosen.append(Setting("experiment.seed", seed, "--seed"))
    return chosen


def not_with(option: str, other: str, allowed: str) -> InputError:
    """Return the error for two options that exclude each other."""
    return InputError(option, f"cannot be combined with {other}", allowed)


def refuse_without(needed: str, is_given: bool, **options: object) -> None:
    """Refuse options that have no effect without another option.

    Args:
        needed: the other option.
        is_given: whether the other option is given.
        options: values by name; None or False if an option is not given.

    Raises:
        InputError: an option is given without the needed one.
    """
    for name, value in options.items():
        if value not in (None, False) and not is_given:
            raise InputError(f"--{name}", f"needs {needed}", needed)
