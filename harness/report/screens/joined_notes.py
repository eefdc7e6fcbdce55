"""The notes of several cells as one list."""

import re
from collections.abc import Sequence

from harness.statistics.findings import Note, Rank

MOST_NOTED = 8
"""Maximum number of cells that a note names."""

_COUNT = re.compile(r"(?<!\S)\d+(?:,\d{3})*\b(?!\.\d)")


def joined_notes(cells: Sequence[tuple[int, Sequence[Note]]]) -> list[Note]:
    """Return the notes of several cells with the cells' numbers.  Equal notes are merged.

    A note on what is left out of every cell is merged too, with the ranges of its counts.
    """
    numbers: dict[Note, list[int]] = {}
    for cell, notes in cells:
        for note in notes:
            numbers.setdefault(note, []).append(cell)
    alike: dict[tuple[Rank, str], list[Note]] = {}
    for note in numbers:
        alike.setdefault((note.rank, _COUNT.sub("", note.text)), []).append(note)
    joined = []
    for (rank, words), notes in alike.items():
        everywhere = sum(len(numbers[note]) for note in notes) == len(cells) > 1
        if everywhere and (len(notes) == 1 or (rank is Rank.LEFT_OUT and "…" not in words)):
            joined.append(Note(rank, _with_ranges([note.text for note in notes])))
        else:
            for note in notes:
                joined.append(Note(rank, f"{_cells(numbers[note])}: {note.text}"))
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
