"""Versions of the software that the results depend on."""

import platform
from importlib import metadata

_LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow")


def versions_of_runs() -> dict[str, str]:
    """The versions that a run depends on."""
    versions = versions_of_fits()
    return {"harness": versions.pop("harness"), "sumo": metadata.version("libsumo"), **versions}


def versions_of_fits() -> dict[str, str]:
    """The versions that a fit of the interaction model depends on; it needs no SUMO."""
    return {
        "harness": metadata.version("crosswalk-harness"),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in _LIBRARIES},
    }
