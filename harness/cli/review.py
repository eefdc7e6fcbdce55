"""Commands on a run folder: ``replay``, ``score``, ``export``."""

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.output import print_line
from harness.errors import InputError


def replay(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A finished run folder.")],
    pair: Annotated[int, typer.Option(help="Which pair.")],
    out: Annotated[Path, typer.Option(help="A new folder for SUMO's output files.")],
    cell: Annotated[int, typer.Option(help="Which cell of a sweep.")] = 0,
    arm: Annotated[str, typer.Option(help="av, human or both.")] = "both",
) -> None:
    """Run one episode again in a fresh SUMO, with SUMO's own outputs on."""
    from harness.encounter import Arm
    from harness.replay import replay as run_again

    if arm not in ("av", "human", "both"):
        raise InputError(f"--arm {arm}", "no such arm", "av, human or both")
    arms = list(Arm) if arm == "both" else [Arm(arm)]
    replayed = run_again(run_folder, pair, arms, cell, out)
    for episode in replayed:
        verdict = "differs from" if episode.differences else "is identical to"
        print_line(f"{episode.folder}: the record {verdict} the stored one")
        for difference in episode.differences:
            print_line(f"    {difference}")
    if any(episode.differences for episode in replayed):
        raise typer.Exit(1)


def score(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run with --traces.")],
    out: Annotated[Path, typer.Option(help="A new folder for the recomputed run.")],
) -> None:
    """Recompute measures and summary from kept traces, without simulating."""
    from harness.scoring import score as recompute

    print_line(str(recompute(run_folder, out)))


def export(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    csv: Annotated[bool, typer.Option("--csv", help="Write every table as CSV.")] = False,
) -> None:
    """Write the tables of a run folder in another format, beside the originals."""
    from harness.run_folder import export_csv

    if not csv:
        raise InputError("export", "no format given", "--csv")
    for path in export_csv(run_folder):
        print_line(str(path))
