"""What every measure of ``MEASURES`` must be, whichever they are."""

from pathlib import Path

import pytest

from harness.measures import MEASURES, Measure

DOCS = Path(__file__).parents[2] / "docs" / "measures.md"


def row_of(measure: Measure) -> str:
    """The line of docs/measures.md that an entry asks for."""
    cells = (measure.unit, measure.formula, measure.undefined_when, measure.source)
    return f"| `{measure.column}` | " + " | ".join(cells) + " |"


@pytest.mark.parametrize("measure", MEASURES, ids=lambda measure: measure.column)
def test_is_documented(measure: Measure) -> None:
    rows = DOCS.read_text(encoding="utf-8").splitlines()
    assert row_of(measure) in rows
