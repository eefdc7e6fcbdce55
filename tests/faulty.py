"""A strategy that fails in the ways it is told to, as a user's own: ``tests.faulty:Faulty``."""

import ctypes
import os
import sys
import time
from collections.abc import Callable

import numpy as np

from harness.core.seeding import stream
from harness.core.vocabulary import Observation

NAME = "tests.faulty:Faulty"

Fault = Callable[[Observation], object]


def raise_error(_observation: Observation) -> None:
    raise RuntimeError("on purpose")


def hang(_observation: Observation) -> None:
    while True:
        time.sleep(0.05)


def hang_in_c(_observation: Observation) -> None:
    # PyDLL keeps the interpreter's lock: no Python code runs any more.
    ctypes.PyDLL(None).pause()


def lose_ego(_observation: Observation) -> float:
    import libsumo

    for name in libsumo.vehicle.getIDList():
        libsumo.vehicle.remove(name)
    return 0.0


def babble(_observation: Observation) -> float:
    for file in (sys.stdout, sys.stderr):
        print("x" * 2_000_000, file=file)
    return 0.0


FAULTS: dict[str, Fault] = {
    "raises": raise_error,
    "nan": lambda _: float("nan"),
    "text": lambda _: "fast",
    "loses_ego": lose_ego,
    "exits": lambda _: sys.exit(3),
    "aborts": lambda _: os.abort(),
    "leaves": lambda _: os._exit(0),
    "segfaults": lambda _: ctypes.string_at(0),
    "babbles": babble,
    "dawdles": lambda seen: time.sleep(2.5 * (seen.time_s < 0.35)) or 0.0,
    "fallback": lambda _: 0.0,
    "model_use": lambda _: 0.0,
    "hangs": hang,
    "hangs_in_c": hang_in_c,
}


class Faulty:
    """Drives at constant speed; in pairs whose first random number is given it fails.

    Each parameter is named after a fault and holds the number, which identifies the pair.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        *,
        raises: float = -1.0,
        nan: float = -1.0,
        text: float = -1.0,
        loses_ego: float = -1.0,
        exits: float = -1.0,
        aborts: float = -1.0,
        leaves: float = -1.0,
        segfaults: float = -1.0,
        babbles: float = -1.0,
        dawdles: float = -1.0,
        fallback: float = -1.0,
        model_use: float = -1.0,
        hangs: float = -1.0,
        hangs_in_c: float = -1.0,
    ) -> None:
        given = dict(locals())
        drawn = rng.random()
        found = [name for name in FAULTS if given[name] == drawn]
        self.fault = FAULTS[found[0]] if found else None

    def __getattr__(self, name: str) -> object:
        if name in ("fallback", "model_use") and self.fault is FAULTS[name]:
            raise LookupError("on purpose")
        raise AttributeError(name)

    def decide(self, observation: Observation) -> object:
        if self.fault is not None and observation.time_s > 0.25:
            return self.fault(observation)
        return 0.0


def struck(faults: dict[str, int]) -> dict[str, object]:
    """Keys of a scenario that let each fault strike its pair: what is drawn first, under seed 1."""
    drawn = {fault: stream(1, "av_strategy", pair).random() for fault, pair in faults.items()}
    return {f'strategies."{NAME}".{fault}': number for fault, number in drawn.items()}
