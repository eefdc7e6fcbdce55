"""The key over which the figures of a sweep are drawn, and its label."""

from harness.old.studies.runs.run_data import RunData
from harness.scenario.units import unit_of

_FLOW = "pedestrians.flow_per_hour"


def across_key(run: RunData) -> str | None:
    """Return the key of the x axis: the flow, or else the numeric key with the most values."""
    varied = run.summary[run.varied_keys].select_dtypes("number").dropna(axis="columns").nunique()
    numeric = varied[varied > 1]
    if _FLOW in numeric or numeric.empty:
        return _FLOW if _FLOW in numeric else None
    return str(numeric.idxmax())


def axis_label(key: str) -> str:
    """Return a varied key as an axis label, with the unit in which the key's name ends."""
    if key == _FLOW:
        return "pedestrian flow λ (per hour)"
    *section, name = key.split(".")
    owner = f"{section[1]}: " if section[:1] == ["strategies"] and len(section) > 1 else ""
    ending, unit = unit_of(name) or ("", "")
    words = owner + name.removesuffix(ending).replace("_", " ")
    return f"{words} ({unit})" if unit else words
