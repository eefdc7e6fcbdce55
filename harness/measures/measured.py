"""The measures of a record as attributes, by their columns' names.

Type checkers read ``measured.pyi``; ``python -m tests.record_stub`` writes it from the catalogue.
"""

from typing import Any

from harness.measures.catalogue import COLUMNS

_PLACE = {column: number for number, column in enumerate(COLUMNS)}


class Measured:
    """Has ``values``, those of the catalogue in its order; each is also an attribute."""

    __slots__ = ()

    values: Any

    def __getattr__(self, name: str) -> Any:
        """A measure by its column's name."""
        if name not in _PLACE:
            raise AttributeError(name)
        return self.values[_PLACE[name]]
