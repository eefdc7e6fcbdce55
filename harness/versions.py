"""Versions that decide what is computed."""

import platform
from importlib import metadata

_LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow")


def versions_of_runs() -> dict[str, str]:
    """What a run depends on."""
    found = versions_of_fits()
    return {"harness": found.pop("harness"), "sumo": metadata.version("libsumo"), **found}


def versions_of_fits() -> dict[str, str]:
    """What a fit of the interaction model depends on, which needs no SUMO."""
    return {
        "harness": metadata.version("crosswalk-harness"),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in _LIBRARIES},
    }
