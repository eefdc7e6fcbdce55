"""Writes what is known of the reference drivers, which the notes of runs read.

    python -m benchmarks.references ../shared/data/dut

writes ``harness/results/validated.json``: the result of ``harness validate`` for all built-in
drivers, and the ratios of times against both references in the scenarios of the documentation.
"""

import json
import sys
import tempfile
from datetime import date
from pathlib import Path
from typing import Any

from harness.core.files import write_file
from harness.results import references
from harness.results.finding import finding_to_dict
from harness.scenario.file import Setting, read_scenario_file
from harness.scenario.study import study_of
from harness.scenario.variation import parse_variation
from harness.strategies.registry import STRATEGIES
from harness.studies.models.validation import validate
from harness.studies.running.run import run

DRIVERS = [name for name in STRATEGIES if name != "sumo_driver"]
AVS, REFERENCES = "soft_yield,hard_yield,gap_yield,emergency_brake", "human_gmm,human_recorded"
SCENARIOS: tuple[tuple[str, dict[str, float]], ...] = (
    ("cctc", {}),
    ("cctc_flow", {}),
    ("cctc_flow", {"pedestrians.flow_per_hour": 1000.0}),
)


def validated(data: Path) -> dict[str, Any]:
    """The drivers of the package in place of those of the DUT set."""
    result = validate([data], "vci", DRIVERS).to_dict()
    facts = result["facts"] | {"date": date.today().isoformat()}
    return {"facts": facts, "records": result["records"]}


def time_ratios(pairs: int) -> list[dict[str, Any]]:
    """The ratio of times of each AV against each reference in each scenario."""
    varied = [parse_variation(f"arms.av={AVS}"), parse_variation(f"arms.human={REFERENCES}")]
    rows: list[dict[str, Any]] = []
    for name, changes in SCENARIOS:
        settings = [Setting(*each) for each in {"experiment.pairs": pairs, **changes}.items()]
        with tempfile.TemporaryDirectory() as folder:
            study = study_of(read_scenario_file(name, settings), varied)
            done = run(study, out=Path(folder) / "run", engine="plain", workers=1)
        rows += [
            {
                "scenario": name,
                "settings": changes,
                "av": cell.scenario.arms.av,
                "reference": cell.scenario.arms.human,
                "pairs": pairs,
                "time_ratio": finding_to_dict(cell["time_ratio"]),
            }
            for cell in done.cells
        ]
    return rows


def main() -> None:
    """Write the file."""
    known = {"validation": validated(Path(sys.argv[1])), "runs": time_ratios(1_000)}
    write_file(references.FILE, f"{json.dumps(known, indent=1, ensure_ascii=False)}\n".encode())


if __name__ == "__main__":
    main()
