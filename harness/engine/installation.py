"""Whether SUMO's packages are there, in the one version that everything here was measured with."""

from importlib import metadata

from harness.core.errors import InputError

_PACKAGES = ("libsumo", "eclipse-sumo", "sumolib", "traci")


def check_packages() -> None:
    """Refuse a SUMO that is missing, or of another version than this package asks for.

    Raises:
        InputError: which package, and how to get the right one.
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
