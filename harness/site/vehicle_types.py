"""The types and classes of the vehicles that come in a user's scenario."""

import os
from collections.abc import Iterator
from pathlib import Path

from harness.site.configuration import SumoConfig, elements_of

_BY_MODE = {
    "car": "DEFAULT_VEHTYPE",
    "bicycle": "DEFAULT_BIKETYPE",
    "taxi": "DEFAULT_TAXITYPE",
}
"""SUMO's type of the vehicle that a person's trip brings along."""

_DEFAULTS = {
    "DEFAULT_VEHTYPE": "passenger",
    "DEFAULT_BIKETYPE": "bicycle",
    "DEFAULT_TAXITYPE": "taxi",
    "DEFAULT_RAILTYPE": "rail",
}

_Types = dict[str, set[tuple[str, str]]]
"""By the name of a vType or of a distribution of vTypes: its types, each with its class."""


def types_that_come(config: SumoConfig) -> Iterator[tuple[str, str]]:
    """Type and class of every vehicle and flow in the files, one after another.

    Vehicles that people bring along count too.  A type that no file defines has the class
    ``passenger``.

    Raises:
        InputError: a file cannot be read as XML.
    """
    types: _Types = {name: {(name, vehicle_class)} for name, vehicle_class in _DEFAULTS.items()}
    # SUMO reads the additional files first.
    for option in ("additional-files", "route-files"):
        for file in config.files(option):
            yield from _coming(file, types)


def _coming(file: Path, types: _Types) -> Iterator[tuple[str, str]]:
    distribution: str | None = None
    for element in elements_of(file):
        tag = element.tag
        if tag == "vTypeDistribution":
            distribution = element.get("id", "")
            names = element.get("vTypes", "").split()
            types[distribution] = set().union(*(_named(name, types) for name in names))
        elif tag == "vType":
            name = element.get("id", "")
            types[name] = {(name, element.get("vClass", "passenger"))}
            if distribution is not None:
                types[distribution] |= types[name]
        elif tag in ("vehicle", "trip", "flow"):
            distribution = None
            yield from _named(element.get("type", "DEFAULT_VEHTYPE"), types)
        elif tag == "personTrip":
            own = element.get("vTypes", "").split()
            modes = element.get("modes", "").split()
            for name in own or [_BY_MODE[mode] for mode in modes if mode in _BY_MODE]:
                yield from _named(name, types)
        elif tag == "include":
            included = Path(os.path.normpath(file.parent / element.get("href", "")))
            yield from _coming(included, types)


def _named(name: str, types: _Types) -> set[tuple[str, str]]:
    return types.get(name, {(name, "passenger")})
