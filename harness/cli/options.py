"""The options of all commands."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from harness.core.files import shipped_directory
from harness.studies.defaults import Criterion, WhoDrove

if TYPE_CHECKING:
    from harness.scenario import Setting

_SHIPPED = ", ".join(sorted(file.stem for file in shipped_directory("scenarios").glob("*.toml")))
_SCENARIO = f"A scenario file (TOML), or the name of a shipped scenario: {_SHIPPED}."
_SET = "Change a key of the scenario, e.g. --set ego.initial_speed_mps=8. Repeatable."
_VARY = (
    "Vary a key, e.g. --vary pedestrians.flow_per_hour=50,100 "
    "--vary strategies.soft_yield.p1=0,0.02,0.04. Repeatable: cells form the full grid. "
    "It replaces the [sweep] of the scenario file."
)

ScenarioArgument = Annotated[str, Argument(help=_SCENARIO)]
StudyArgument = Annotated[str, Argument(help=f"{_SCENARIO} Or a run folder, for its study.")]
RunArgument = Annotated[Path, Argument(metavar="RUN", help="A run folder.")]

_CHECK = "Check whether a strategy keeps the rules; your own is my_module:MyStrategy."
CheckOption = Annotated[str | None, Option("--check", help=_CHECK, metavar="STRATEGY")]
ScenarioOption = Annotated[str, Option(help="With --check: scenario with crosswalk and ego.")]
SetOption = Annotated[list[str] | None, Option("--set", help=_SET, metavar="KEY=VALUE")]
ThresholdOption = Annotated[
    list[str] | None,
    Option("--set", help="Another threshold, e.g. conflicts.pet_s=1.", metavar="KEY=VALUE"),
]
VaryOption = Annotated[list[str] | None, Option("--vary", help=_VARY, metavar="KEY=V1,V2,…")]
OutOption = Annotated[Path | None, Option(help="Folder; default runs/<scenario>-<next number>.")]
SeedOption = Annotated[int | None, Option(help="Root seed, instead of the scenario's.")]
WorkersOption = Annotated[int | None, Option(min=1, max=1024, help="Processes; default: cores.")]
EngineOption = Annotated[Literal["sumo", "plain"], Option(help="plain: faster, without SUMO.")]
DaskOption = Annotated[str | None, Option(help="Dask scheduler, e.g. tcp://127.0.0.1:8786.")]

CellOption = Annotated[int, Option(help="Number of the cell in a sweep.")]
ArmOption = Annotated[Literal["av", "human"], Option(help="The AV's or the reference's arm.")]
ByOption = Annotated[str, Option(help="Measure to rank by, e.g. min_ttc_s, delay_s, stops.")]
_DRIVER = "Of simulations: only passages that the AVs' strategy, the reference or SUMO drove."
DriverOption = Annotated[WhoDrove | None, Option(help=_DRIVER)]
Mu0Option = Annotated[float | None, Option(help="Upper limit of μ for the allowed interval.")]
Kappa0Option = Annotated[float | None, Option(help="Upper limit of κ for the allowed interval.")]
_EVENT = "crashed, or a limit: 'pet_s<1', 'min_ttc_s<0.5', 'min_gap_m<1', 'contact_speed_mps>5'."
EventOption = Annotated[str, Option(help=_EVENT)]
ResultPageOption = Annotated[Path | None, Option(help="A file for the page.", metavar="PAGE")]
FiguresOption = Annotated[Path | None, Option(help="Folder for the figures, PNG and PDF.")]
TableOption = Annotated[
    Path | None, Option(help="CSV file for the rows; replaces an existing file.")
]
NewFolderOption = Annotated[Path | None, Option(help="A new folder for the files.")]

DataArgument = Annotated[list[Path], Argument(metavar="DATA…", help="Recorded trajectories.")]
FormatOption = Annotated[str, Option("--format", help="Format of the data, e.g. vci.")]
_DRIVERS = "Strategies, shipped or your own, e.g. human_gmm,human_yield,my.module:Class."
DriversOption = Annotated[str, Option(help=_DRIVERS, metavar="NAME,…")]
_FOLDS = (
    "Folds of vehicles, without each of which the model is fitted again; 0: no held-out scores."
)
FoldsOption = Annotated[int, Option(min=0, help=_FOLDS)]

ComponentsOption = Annotated[str, Option(help="Numbers of components: 1..20, or 10 (the paper's).")]
ChooseOption = Annotated[Criterion, Option(help="Criterion for K; rule: the paper's.")]
WeighOption = Annotated[
    Literal["row", "encounter", "vehicle"], Option(help="What has equal weight.")
]
_BOUNDS = "Bounds of a variable, e.g. vehicle_speed_mps=0.3:14 or inverse_range_per_m=1/80:0.5."
BoundsOption = Annotated[list[str] | None, Option(help=_BOUNDS, metavar="NAME=LOW:HIGH")]

WriteOption = Annotated[Path | None, Option(help="A new scenario file.", metavar="SCENARIO.toml")]
EdgeOption = Annotated[list[str] | None, Option("--edge", help="A crosswalk to write. Repeatable.")]

GuiOption = Annotated[bool, Option("--gui", help="Show in sumo-gui, one arm after the other.")]
DebugOption = Annotated[bool, Option("--debug", help="Run in this process: breakpoint() works.")]

_EGO = "recorded: with its trajectory; free: at R0 with v0, for another driver."
EgoOption = Annotated[Literal["recorded", "free"], Option(help=_EGO)]
_PASSAGE = "Of simulations: ids of the vehicle and the crosswalk."
PassageOption = Annotated[tuple[str, str] | None, Option(help=_PASSAGE, metavar="ID ID")]
FullOption = Annotated[bool, Option("--full", help="Print every number, with all notes.")]
JsonOption = Annotated[bool, Option("--json", help="Print the results as JSON.")]
QuietOption = Annotated[bool, Option("--quiet", "-q", help="Print only paths or names.")]


def settings_of(
    settings: list[str] | None, pairs: int | None = None, seed: int | None = None
) -> "tuple[Setting, ...]":
    """The changes of --set, --pairs and --seed in the order of application."""
    from harness.scenario.file import as_settings, parse_setting

    return as_settings([*map(parse_setting, settings or [])], pairs=pairs, seed=seed)


def changes_of(settings: list[str] | None) -> dict[str, Any]:
    """The changes of --set by key."""
    return {setting.key: setting.value for setting in settings_of(settings)}
