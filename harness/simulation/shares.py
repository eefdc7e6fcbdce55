"""A seed and a pair in; SUMO's seed, and which vehicles are AVs (by their ids alone), out."""

from collections.abc import Iterable, Set

from harness.core.seeding import NUMBERS, number_of


def is_automated(
    key: bytes, vehicle: str, kinds: Set[str], share: float, av_types: Iterable[str]
) -> bool:
    """Whether a vehicle is an AV; the same in both arms of a pair.

    A greater share only adds AVs, since a vehicle's number does not depend on the share.

    Args:
        key: random bytes of the pair.
        vehicle: SUMO's id of the vehicle.
        kinds: its vType and its vClass.
        share: the share of AVs among vehicles of ``av_types``.
        av_types: vTypes and vClasses of which AVs are.

    >>> key = b"pair 0"
    >>> [is_automated(key, "car7", {"passenger"}, share, {"passenger"}) for share in (0, 0.95, 1)]
    [False, True, True]
    >>> is_automated(key, "bus7", {"bus"}, 1.0, {"passenger"})
    False
    """
    return not kinds.isdisjoint(av_types) and number_of(vehicle, key) / NUMBERS < share
