"""Checks that SUMO's packages are installed in the version that this package needs."""

from importlib import metadata

from harness.core.errors import InputError

_PACKAGES = ("libsumo", "eclipse-sumo", "sumolib", "traci")


def check_packages() -> None:
    """Refuse a SUMO that is missing or that has another version than this package needs.

    Raises:
        InputError: a package is missing or has the wrong version; says how to install it.
    """
    try:
        needed = metadata.requires("crosswalk-harness") or []
    except metadata.PackageNotFoundError:
        raise InputError("crosswalk-harness", "is not installed", "pip install .") from None
    for requirement in needed:
        name, _, version = requirement.partition("==")
        if name not in _PACKAGES:
            continue
        allowed = f"{version} (pip install {requirement})"
        try:
            installed = metadata.version(name)
        except metadata.PackageNotFoundError:
            raise InputError(name, "is not installed", allowed) from None
        if installed != version:
            raise InputError(name, f"version {installed} is installed", allowed)
