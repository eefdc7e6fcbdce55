"""The time of a call of ``harness.evaluate`` with 20 pairs, from the second call on.

It prints the median over ten candidates and its ratio to the first target, 0.15 s on two cores.
Run it on a quiet machine: ``python -m benchmarks.candidates``.
"""

from time import perf_counter

import numpy as np

import harness

TARGET_S = 0.15


def main() -> None:
    """Print the times."""
    times_s = []
    for gap_s in np.linspace(0.5, 4.0, 11):
        begin_s = perf_counter()
        candidate = {"strategies.gap_yield.critical_gap_s": gap_s}
        harness.evaluate([candidate], "cctc_flow", 20, settings={"arms.av": "gap_yield"}, workers=2)
        times_s.append(perf_counter() - begin_s)
    median_s = float(np.median(times_s[1:]))
    ratio = median_s / TARGET_S
    print(f"first call {times_s[0]:.2f} s, then {median_s:.3f} s: {ratio:.2f} of {TARGET_S} s")


if __name__ == "__main__":
    main()
