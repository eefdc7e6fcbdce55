"""Whether several reference drivers lead to the same result."""

from collections.abc import Sequence

from harness.old.statistics.entries import Finding


def agreement(ratios: Sequence[tuple[str, Finding]]) -> str:
    """Return whether the intervals of the ratio of times lie on the same side of 1, as a sentence.

    Args:
        ratios: the name of each reference, and the ratio of times against it.
    """
    sides, parts = set(), []
    for name, ratio in ratios:
        if ratio.number is None or ratio.low is None or ratio.high is None:
            sides.add("unknown")
            parts.append(f"{name} undefined")
            continue
        sides.add("less" if ratio.high < 1 else "more" if ratio.low > 1 else "unknown")
        parts.append(f"{name} {ratio.number:.3f} ({ratio.low:.3f} … {ratio.high:.3f})")
    listed = f"ratio of times {'; '.join(parts)}"
    if {"less", "more"} <= sides:
        return f"Whether the AV takes less time than a human depends on the reference: {listed}."
    significant = sides - {"unknown"}
    if not significant:
        return f"The AV is not shown to be faster or slower than any reference: {listed}."
    against = "every reference" if "unknown" not in sides else "some of the references"
    rest = "; against the others neither is shown to be faster" if "unknown" in sides else ""
    return f"The AV takes {significant.pop()} time than {against}{rest}: {listed}."
