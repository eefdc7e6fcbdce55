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
    typer.Argument(help=f"A scenario file (TOML), or the name of a shipped one: {_SHIPPED}."),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change a key of the scenario, e.g. --set ego.initial_speed_mps=8. Repeatable.",
        metavar="KEY=VALUE",
    ),
]
VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        help="Vary a key over values or a range, e.g. --vary pedestrians.flow_per_hour=50,100 "
        "--vary strategies.soft_yield.p1=0:0.1:0.02. Repeatable: the grid of all.",
        metavar="KEY=V1,V2,…",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(help="Folder for the results; default runs/<scenario>-<next number>."),
]
PairsOption = Annotated[
    int | None, typer.Option(help="Number of pairs of each cell, instead of the scenario's.")
]
SeedOption = Annotated[int | None, typer.Option(help="Root seed, instead of the scenario's.")]
UntilOption = Annotated[
    str | None,
    typer.Option(
        help="Stop when every cell's interval is this narrow (half-width), or at --pairs: "
        "mu=0.01 or kappa=0.005. Looks at 1,000 pairs and at each doubling.",
        metavar="MEASURE=WIDTH",
    ),
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Worker processes; default: all cores.")
]
DaskOption = Annotated[
    str | None,
    typer.Option(
        help="Run the tasks on a Dask cluster, e.g. tcp://127.0.0.1:8786 (pip install "
        "crosswalk-harness[cluster]); its workers must have one thread each.",
        metavar="ADDRESS",
    ),
]
SumoOutputsOption = Annotated[
    Literal["all", "crashed"] | None,
    typer.Option(
        help="Run episodes again one by one with SUMO's own outputs on, into RUN/sumo. "
        "Slower: each episode gets a SUMO of its own.",
    ),
]
EngineOption = Annotated[
    Literal["sumo", "plain"],
    typer.Option(
        help="plain: the same kinematics without SUMO, faster, without SUMO's verdict and outputs; "
        "some records are repeated in SUMO (--audit)."
    ),
]
AuditOption = Annotated[
    float | None,
    typer.Option(
        help="With --engine plain: the share of the pairs that is repeated in SUMO, beside every "
        "crash; default 0.01.",
        metavar="SHARE",
        min=0.0,
        max=1.0,
    ),
]
SettleOption = Annotated[
    bool,
    typer.Option(
        "--settle",
        help="Hours of traffic: find each cell's warm-up by a pilot, the longest that a queue "
        "takes to clear; at most the counted time.",
    ),
]
TracesOption = Annotated[bool, typer.Option("--traces", help="Keep every step in traces.parquet.")]
FullOption = Annotated[
    bool, typer.Option("--full", help="Print every number, not only the first screen.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the results as JSON and nothing else.")
]
ArmOption = Annotated[Literal["av", "human"], typer.Option(help="Whose episodes.")]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only the path of what was written.")
]


def settings_of(
    settings: list[str] | None, pairs: int | None = None, seed: int | None = None
) -> list[Any]:
    """The changes of --set, --pairs and --seed, in the order in which they are applied."""
    from harness.scenario import Setting, parse_setting

    chosen = [parse_setting(text) for text in settings or []]
    if pairs is not None:
        chosen.append(Setting("experiment.pairs", pairs, "--pairs"))
    if seed is not None:
        chosen.append(Setting("experiment.seed", seed, "--seed"))
    return chosen


def not_with(option: str, other: str, allowed: str) -> InputError:
    """The refusal of two options that exclude each other."""
    return InputError(option, f"cannot be combined with {other}", allowed)


def refuse_without(needed: str, is_given: bool, **options: object) -> None:
    """Refuse options that say nothing without another one.

    Args:
        needed: the other option.
        is_given: whether it is given.
        options: by their names, None or False where they are not given.

    Raises:
        InputError: one of them is given without it.
    """
    for name, value in options.items():
        if value not in (None, False) and not is_given:
            raise InputError(f"--{name}", f"needs {needed}", needed)
