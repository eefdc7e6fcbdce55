"""Other thresholds of conflicts than the default ones (``--set conflicts.…``)."""

from collections.abc import Sequence
from typing import Any

from harness.core.errors import InputError, nearest_name
from harness.scenario.file import Setting, apply_setting, validate
from harness.scenario.sections import ConflictsSection


def set_thresholds(settings: Sequence[Setting], source: str) -> ConflictsSection:
    """The conflict thresholds with some of them set (``conflicts.…``).

    Raises:
        InputError: a setting is not a threshold, or its value is not allowed.
    """
    thresholds = [f"conflicts.{name}" for name in ConflictsSection.model_fields]
    tree: dict[str, Any] = {}
    sources = {setting.key: setting.source for setting in settings}
    for setting in settings:
        if setting.key not in thresholds:
            nearest = nearest_name(setting.key, thresholds)
            problem = "is not a conflict threshold"
            where = f"{setting.source} {setting.key}"
            raise InputError(where, problem, ", ".join(thresholds), nearest)
        apply_setting(tree, setting)
    return validate(tree, source, sources).conflicts
