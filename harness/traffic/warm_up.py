"""How long a road takes to forget how it began."""

import numpy as np

from harness.encounter import FloatArray


def longest_queue_s(due_s: FloatArray, left_s: FloatArray, end_s: float) -> float:
    """The longest time for which a vehicle was late at every moment.

    A queue that has cleared goes on as one that begins empty: the longest that it took to clear
    tells how long it remembers (docs/method.md).

    Args:
        due_s: when each vehicle that was late was due through, in any order.
        left_s: when each was through, infinite for who never was.
        end_s: when nobody looked any more.

    >>> due_s, left_s = np.array([5.0, 0.0, 60.0]), np.array([25.0, 10.0, 90.0])
    >>> longest_queue_s(due_s, left_s, 80.0)  # from 0 to 25 s, and from 60 to 80 s
    25.0
    """
    order = np.argsort(due_s)
    due, until = due_s[order], np.minimum(np.maximum.accumulate(left_s[order]), end_s)
    if not len(due):
        return 0.0
    first = np.append(True, due[1:] > until[:-1])
    last = np.append(first[1:], True)
    return float((until[last] - due[first]).max())
