"""Read-only copies: what is passed on cannot be changed by whoever gets it, or by its maker."""

import copyreg
from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, TypeVar, cast

import numpy as np

_T = TypeVar("_T")


def frozen(value: _T) -> _T:
    """A read-only copy of tables, lists and arrays, and of those in tables, lists and tuples.

    Lists become tuples.  An array that is read-only is not copied, and neither is anything else.
    Named tuples stay as they are: whoever makes one makes its parts read-only.

    >>> frozen({"pairs": [1, {"seed": 2}]})
    mappingproxy({'pairs': (1, mappingproxy({'seed': 2}))})
    """
    if isinstance(value, Mapping):
        return cast(_T, MappingProxyType({key: frozen(part) for key, part in value.items()}))
    if isinstance(value, list) or type(value) is tuple:
        return cast(_T, tuple(frozen(part) for part in cast(Any, value)))
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
