"""What a frozen record holds is its own, and nobody can write to it."""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from harness.core.freezing import Frozen


@dataclass(frozen=True)
class Kept(Frozen):
    table: Mapping[str, Any]


def test_a_record_keeps_what_it_was_given_whatever_its_maker_does() -> None:
    places_m, names, table = np.zeros(2), ["a"], {"seed": 1}
    kept = Kept({"places_m": places_m, "names": names, "rows": (table,)})
    places_m[0], table["seed"] = 1.0, 2
    names.append("b")
    assert (kept.table["names"], kept.table["rows"][0]) == (("a",), {"seed": 1})
    assert kept.table["places_m"].tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="read-only"):
        kept.table["places_m"][0] = 1.0
    assert pickle.loads(pickle.dumps(kept)).table["rows"] == kept.table["rows"]
