"""Hostile content for files a user hands in, and what must come of it."""

from collections import Counter
from collections.abc import Callable
from typing import Any

from hypothesis import settings, strategies as st

from harness.errors import InputError

full = False
"""Whether all cases are run, not a sample; set before the tests are read."""

planned: Counter[str] = Counter()
"""Cases in full of each kind of file."""


def cases(kind: str, number: int) -> settings:
    """A test's part of the cases of its kind of file: so many in full, up to 15 in a sample."""
    planned[kind] += number
    return settings(max_examples=number if full else min(15, max(3, number // 200)))


NAMES = st.one_of(
    st.sampled_from(
        [
            "../../x",
            "/etc/passwd",
            "<script>alert(1)</script>",
            "$(touch x)",
            "`id`",
            "a b;c|d&e",
            "..",
            "",
            " ",
            "\u202e",
            "naïve-π-网",
            "__proto__",
            "nul\x00l",
            "x" * 300,
            "-rf",
            "os:system",
            "..:x",
            "\ud800",
            "[/x][bold]",
            "$\\frac{$",
            "\x1b[2J\x9b",
            "</script><img src=x onerror=alert(1)>",
            "\"'><b>",
            "{{7*7}}",
            "%s%n",
            "nan",
            "a\u2028b\x85c\rd",
            "file.\n.toml",
        ]
    ),
    st.text(max_size=30),
)

NUMBERS = st.one_of(
    st.sampled_from(
        [0, -1, 1, 2**31, 2**63, 2**64, 10**400, -0.0, 1e308, -1e308, 5e-324, 1e-9, 0.1 + 0.2]
    ),
    st.sampled_from([float("nan"), float("inf"), float("-inf")]),
    st.floats(),
    st.integers(),
)

SCALARS = st.one_of(NUMBERS, st.booleans(), st.none(), NAMES)

VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(NAMES, inner, max_size=3)),
    max_leaves=6,
)


def cut_and_flipped(content: bytes) -> st.SearchStrategy[bytes]:
    """A file's bytes cut off, with some changed, or with a piece moved."""

    def change(where: list[int], values: bytes, end: int, doubled: bool) -> bytes:
        changed = bytearray(content)
        for place, value in zip(where, values, strict=False):
            changed[place % max(1, len(changed))] = value
        cut = bytes(changed[: end % (len(changed) + 1)]) if end >= 0 else bytes(changed)
        return cut + cut if doubled else cut

    return st.builds(
        change,
        st.lists(st.integers(0, 2**31), max_size=6),
        st.binary(min_size=6, max_size=6),
        st.one_of(st.just(-1), st.integers(0, 2**31)),
        st.booleans(),
    )


def accepted_or_refused_in_one_line(read: Callable[[], Any]) -> bool:
    """Whether ``read`` accepts what it was given; a refusal is an InputError of one line."""
    try:
        read()
    except InputError as error:
        text = str(error)
        assert text == " ".join(text.split()), text
        assert text.split(": ")[0], text
        return False
    return True
