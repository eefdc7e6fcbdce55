"""Versions of the software that the results depend on."""

import platform
from importlib import metadata

_LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "shapely")
"""Libraries whose version may change the last bits of a result."""


def versions_of_runs() -> dict[str, str]:
    """The versions that a run depends on; without SUMO only the plain engine runs."""
    versions = versions_of_fits()
    try:
        sumo = metadata.version("libsumo")
    except metadata.PackageNotFoundError:
        sumo = "none"
    return {"harness": versions.pop("harness"), "sumo": sumo, **versions}


def versions_of_fits() -> dict[str, str]:
    """The versions that a fit of the interaction model depends on; it needs no SUMO."""
    return {
        "harness": metadata.version("crosswalk-harness"),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in _LIBRARIES},
    }
