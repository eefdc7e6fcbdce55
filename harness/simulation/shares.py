"""The numbers of a pair: SUMO's seed, and which vehicles are AVs, by their ids alone."""

import hashlib
from collections.abc import Iterable, Set

_SEEDS_APART = 1_000_003
"""Distance of SUMO's seeds of two successive values of ``experiment.seed``; odd, so that the values
do not repeat before all of SUMO's seeds are used."""
_SEEDS = 2**31
"""SUMO's seeds lie below this."""


def number_of(name: str) -> int:
    """A number ≥ 0 that keys the random streams of a vehicle, person or crosswalk by its id."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=6).digest(), "big")


def uniform_of(seed: int, vehicle: str) -> float:
    """A number from 0 to 1 that belongs to a vehicle of a pair.

    Args:
        seed: SUMO's seed of the pair.
        vehicle: SUMO's id of the vehicle.
    """
    digest = hashlib.blake2b(f"{seed}:{vehicle}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") / 2**64


def sumo_seed(seed: int, config_seed: int, pair: int) -> int:
    """SUMO's seed of a pair: the configuration's plus the pair's number, for seed 1.

    Another ``experiment.seed`` has other seeds for all pairs, below a million pairs.
    """
    return (config_seed + pair + _SEEDS_APART * (seed - 1)) % _SEEDS


def is_automated(
    seed: int, vehicle: str, kinds: Set[str], share: float, av_types: Iterable[str]
) -> bool:
    """Whether a vehicle is an AV; the same in both arms of a pair.

    A greater share only adds AVs, since a vehicle's number does not depend on the share.

    Args:
        seed: SUMO's seed of the pair.
        vehicle: SUMO's id of the vehicle.
        kinds: its vType and its vClass.
        share: the share of AVs among vehicles of ``av_types``.
        av_types: vTypes and vClasses of which AVs are.

    >>> [is_automated(1, "car7", {"passenger"}, share, {"passenger"}) for share in (0, 0.95, 1)]
    [False, True, True]
    >>> is_automated(1, "bus7", {"bus"}, 1.0, {"passenger"})
    False
    """
    return not kinds.isdisjoint(av_types) and uniform_of(seed, vehicle) < share
