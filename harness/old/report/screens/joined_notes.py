"""The notes of several cells as one list."""

import re
from collections.abc import Sequence

from harness.old.statistics.findings import Note, Rank

MOST_NOTED = 8
"""Maximum number of cells that a note names."""

_COUNT = re.compile(r"(?<!\S)\d+(?:,\d{3})*\b(?!\.\d)")


def joined_notes(cells: Sequence[tuple[int, Sequence[Note]]]) -> list[Note]:
    """Return the notes of several cells with the cells' numbers.  Equal notes are merged.

    Notes on what is left out are also merged if they differ only in counts, which become ranges.
    """
    alike: dict[tuple[Rank, str], dict[str, list[int]]] = {}
    for cell, notes in cells:
        for note in notes:
            ranged = note.rank in (Rank.LEFT_OUT, Rank.UNENDED) and "…" not in note.text
            words = _COUNT.sub("", note.text) if ranged else note.text
            alike.setdefault((note.rank, words), {}).setdefault(note.text, []).append(cell)
    joined = []
    for (rank, _), texts in alike.items():
        where = sorted(cell for each in texts.values() for cell in each)
        text = _with_ranges([*texts])
        everywhere = len(where) == len(cells) > 1
        joined.append(Note(rank, text if everywhere else f"{_cells(where)}: {text}"))
    return joined


def _with_ranges(texts: Sequence[str]) -> str:
    """Return texts that differ only in counts as one, with the least and the greatest counts."""
    counts = ([int(count.replace(",", "")) for count in _COUNT.findall(text)] for text in texts)
    ends = ((min(column), max(column)) for column in zip(*counts, strict=True))
    ranges = (" … ".join(f"{count:,}" for count in sorted({*both})) for both in ends)
    return _COUNT.sub(lambda _: next(ranges), texts[0])


def _cells(numbers: list[int]) -> str:
    shown = ", ".join(str(number) for number in numbers[:MOST_NOTED])
    more = f" and {len(numbers) - MOST_NOTED:,} more" if len(numbers) > MOST_NOTED else ""
    return f"Cell{'s' * (len(numbers) > 1)} {shown}{more}"
