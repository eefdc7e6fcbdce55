"""Hostile content for files a user hands in, and what must come of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from harness.errors import InputError

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


def files_below(folder: Path) -> set[Path]:
    """Every file and folder below a folder."""
    return set(folder.rglob("*"))
