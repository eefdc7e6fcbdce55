"""Read-only copies: what is passed on cannot be changed by whoever gets it, or by its maker."""

import copyreg
from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, cast

import numpy as np


def frozen(value: Any) -> Any:
    """A read-only copy of tables, lists and arrays, and of those in tables and lists.

    Lists become tuples.  An array that is read-only is not copied, and neither is anything else.

    >>> frozen({"pairs": [1, {"seed": 2}]})
    mappingproxy({'pairs': (1, mappingproxy({'seed': 2}))})
    """
    if isinstance(value, Mapping):
        return MappingProxyType({key: frozen(part) for key, part in value.items()})
    if isinstance(value, list):
        return tuple(map(frozen, value))
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value = value.copy()
        value.setflags(write=False)
    return value


class Frozen:
    """A frozen dataclass in which tables, lists and arrays are read-only too."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Replace every field by a read-only copy."""
        for each in fields(cast(Any, self)):
            object.__setattr__(self, each.name, frozen(getattr(self, each.name)))


# Read-only tables go to other processes.
copyreg.pickle(MappingProxyType, lambda table: (frozen, (dict(table),)))
