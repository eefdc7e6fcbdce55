"""Writes the types of a record's measures from the catalogue: ``python -m tests.record_stub``."""

from pathlib import Path

import harness
from harness.measures.catalogue import MEASURES

PATH = Path(harness.__file__).parent / "measures" / "measured.pyi"


def stub() -> str:
    """The content of ``harness/measures/measured.pyi``."""
    lines = [
        "# Written by `python -m tests.record_stub` from the catalogue; a test holds it to that."
    ]
    lines += ["", "class Measured:"]
    for measure in MEASURES:
        kind = measure.kind.__name__
        may_lack = "" if measure.undefined_when == "never" else " | None"
        lines += ["    @property", f"    def {measure.column}(self) -> {kind}{may_lack}: ..."]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PATH.write_text(stub(), encoding="utf-8")
