"""``harness crossings`` of a SUMO configuration: one untouched run, or a scenario file."""

import os
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from harness.core.errors import InputError
from harness.engine.starting import scratch_prefix
from harness.old.cli.interruption import unwinding
from harness.old.cli.output import print_json, print_line, progress_bar, say
from harness.old.cli.written import seen_from, write_new

if TYPE_CHECKING:
    from harness.encounter.simulation.listing import OwnScenario

_NO_CROSSWALK = (
    "the network has no crossing: netconvert --sidewalks.guess --crossings.guess adds them"
)


def of_configuration(file: Path, write: Path | None, edges: list[str], *, as_json: bool) -> None:
    """List the crosswalks of a scenario, or write a scenario file for some of them.

    Raises:
        InputError: the configuration, a crosswalk or the new file is refused.
        EngineError: SUMO lost the simulation.
    """
    from harness.encounter.simulation.listing import own_scenario, simulation_text

    if write is not None and write.exists():
        raise InputError("--write", f"{write} exists", "a new file")
    with unwinding(), TemporaryDirectory(prefix=scratch_prefix(os.getpid())) as folder:
        scenario = own_scenario(file, Path(folder))
        if write is None:
            _list(scenario, Path(folder), as_json=as_json)
            return
        text, added, bends = simulation_text(scenario, edges, seen_from(file, write.parent))
        write_new(write, text)
    for name in added:
        say(f"note: {name} lies within R0 of a chosen crosswalk and is chosen with it")
    for sentence in bends:
        say(f"note: {sentence}")
    if as_json:
        print_json({"written": str(write), "crossings": list(edges), "added": list(added)})
    else:
        print_line(str(write))


def _list(scenario: "OwnScenario", folder: Path, *, as_json: bool) -> None:
    """Simulate the scenario once and print its crosswalks."""
    from harness.encounter.simulation.listing import crosswalk_rows
    from harness.old.report.screens.crosswalk_table import print_crosswalks

    config = scenario.config
    with progress_bar("simulated s", as_json) as advance:
        rows, simulated_s = crosswalk_rows(scenario, folder, advance)
    if not rows:
        say(f"note: {_NO_CROSSWALK}")
    if not as_json:
        print_crosswalks(config.path, rows, simulated_s)
        return
    print_json(
        {
            "config": str(config.path),
            "begin_s": config.begin_s,
            "end_s": config.end_s,
            "simulated_s": simulated_s,
            "crossings": [{**asdict(row), "usable": row.usable} for row in rows],
        }
    )
