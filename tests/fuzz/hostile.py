"""Hostile content in the place of a good file's: by its bytes, or by its kind."""

import io
import json
import re
from collections.abc import Callable, Iterator
from typing import Any
from xml.sax.saxutils import escape

import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import HealthCheck, Phase, settings, strategies as st

from harness.core.errors import InputError

full = False
"""Whether all cases are run, not a sample; set before the tests are read."""


def cases(number: int) -> settings:
    """So many cases in full, in a sample a two-hundredth of them; what fails, fails everywhere."""
    return settings(
        max_examples=number if full else max(3, number // 200),
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
        # A command is too slow for hundreds of attempts to fail with less.
        phases=[Phase.explicit, Phase.generate],
    )


_NAMES = ["../../x", "/etc/passwd", "<script>", "$(touch x)", "a b;c|d", "..", "", "\u202e", "π-网"]
_NAMES += ["nul\x00l", "x" * 300, "-rf", "\ud800", "[/x][b]", "$\\frac{$", "\x1b[2J", "{{7*7}}"]
_NAMES += ["nan", "a\u2028b\rd", "file.\n.toml", "no_such_module:Strategy"]
NAMES = st.one_of(st.sampled_from(_NAMES), st.text(max_size=30))
_EDGES = [0, -1, 1, 2**31, 2**63, 10**400, 1e308, -1e308, 5e-324, float("nan"), float("inf")]
NUMBERS = st.one_of(st.sampled_from(_EDGES), st.floats(), st.integers())
SCALARS = st.one_of(NUMBERS, st.booleans(), st.none(), NAMES)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(NAMES, inner, max_size=3)),
    max_leaves=6,
)
_WHERE = st.integers(0, 2**31)
# SUMO makes everybody of a flow of people first, which takes for ever in such a long one.
_BEGINS = re.compile(r'(?s)(?!.*<personFlow[^>]* (begin|end|number)="-?\d{7})').match
_NAMED_PLACES = st.sampled_from(["0,0", "0,0 0,0", "1e308,0 -1e308,0", "nan,nan 1,1", "1,2,3 4"])


def hostile(content: bytes, suffix: str) -> st.SearchStrategy[bytes]:
    """A file's content spoilt, or other values where it has good ones."""
    by_kind = {".json": _json, ".toml": _toml, ".parquet": _parquet, ".csv": _csv, ".xml": _xml}
    spoilt = cut_and_flipped(content)
    return st.one_of(by_kind[suffix](content), spoilt) if suffix in by_kind else spoilt


def cut_and_flipped(content: bytes) -> st.SearchStrategy[bytes]:
    """A file's bytes cut off, with some changed, or twice."""

    def change(flips: list[tuple[int, int]], end: int | None, doubled: bool) -> bytes:
        changed = bytearray(content)
        for place, value in flips:
            changed[place % max(1, len(changed))] = value
        cut = bytes(changed if end is None else changed[: end % (len(changed) + 1)])
        return cut + cut if doubled else cut

    flips = st.lists(st.tuples(_WHERE, st.integers(0, 255)), max_size=6)
    return st.builds(change, flips, st.one_of(st.none(), _WHERE), st.booleans())


def _json(content: bytes) -> st.SearchStrategy[bytes]:
    def change(which: int, value: Any) -> bytes:
        document = json.loads(content)
        places = list(_places(document))
        node, key = places[which % len(places)]
        node[key] = value
        return json.dumps(document).encode()

    return st.builds(change, _WHERE, VALUES)


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Where a value stands in a document, of every value."""
    if isinstance(node, dict | list):
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            yield node, key
            yield from _places(node[key])


def _toml(content: bytes) -> st.SearchStrategy[bytes]:
    keys = list(re.finditer(r"(?m)^(\w+) = .*$", content.decode()))

    def change(which: int, value: Any) -> bytes:
        at = keys[which % len(keys)]
        # A scalar or a list of JSON is one of TOML.
        new = f"{at[1]} = {json.dumps(value)}"
        return (content.decode()[: at.start()] + new + content.decode()[at.end() :]).encode()

    return st.builds(change, _WHERE, VALUES)


def _xml(content: bytes) -> st.SearchStrategy[bytes]:
    """Other values of attributes, or elements that are missing or there twice."""
    text = content.decode()
    values = list(re.finditer(r'="([^"]*)"', text))
    elements = list(re.finditer(r"(?m)^ *<(?!/|\?|!).*/>$", text))

    def valued(place: int, value: Any) -> str:
        at = values[place % len(values)]
        return text[: at.start(1)] + escape(str(value), {'"': "&quot;"}) + text[at.end(1) :]

    def missing_or_twice(place: int, times: int) -> str:
        at = elements[place % len(elements)]
        return text[: at.start()] + at[0] * times + text[at.end() :]

    changed = st.one_of(
        st.builds(valued, _WHERE, st.one_of(SCALARS, _NAMED_PLACES)).filter(_BEGINS),
        st.builds(missing_or_twice, _WHERE, st.sampled_from([0, 2])),
    )
    return changed.map(lambda text: text.encode("utf-8", "replace"))


def _csv(content: bytes) -> st.SearchStrategy[bytes]:
    cells = re.split(r"([,\n])", content.decode())

    def change(places: list[tuple[int, str]]) -> bytes:
        changed = list(cells)
        for place, text in places:
            changed[2 * place % len(changed)] = text
        return "".join(changed).encode("utf-8", "replace")

    text = st.one_of(NUMBERS.map(repr), NAMES)
    return st.builds(change, st.lists(st.tuples(_WHERE, text), min_size=1, max_size=5))


_TYPES = [pa.string(), pa.binary(), pa.bool_(), pa.int8(), pa.uint64(), pa.float16(), pa.date32()]
_TYPES += [pa.decimal128(38, 2), pa.duration("s"), pa.dictionary(pa.int8(), pa.string())]


def _parquet(content: bytes) -> st.SearchStrategy[bytes]:
    """A table with a column of another type, with other values, or missing; or with other rows."""
    good = pq.read_table(io.BytesIO(content))

    def replaced(number: int, make: Callable[[pa.ChunkedArray], Any]) -> pa.Table:
        return good.set_column(number, good.column_names[number], make(good.column(number)))

    def one_value(number: int, row: int, value: Any) -> pa.Table:
        values = good.column(number).to_pylist()
        if values:
            values[row % len(values)] = value
        return replaced(number, lambda column: pa.array(values, type=column.type))

    def change(what: int, number: int, row: int, value: Any, to: pa.DataType) -> bytes:
        number, buffer = number % good.num_columns, io.BytesIO()
        ways: list[Callable[[], pa.Table]] = [
            lambda: replaced(number, lambda column: column.cast(to, safe=False)),
            lambda: replaced(number, lambda column: pa.array([[v] for v in column.to_pylist()])),
            lambda: replaced(number, lambda column: pa.array([value] * len(column))),
            lambda: one_value(number, row, value),
            lambda: good.append_column(good.column_names[number], good.column(number)),
            lambda: good.drop_columns([good.column_names[number]]),
            lambda: good.slice(row % max(1, good.num_rows)),
            lambda: pa.concat_tables([good, good]),
            lambda: good.take(list(reversed(range(good.num_rows)))),
        ]
        try:
            pq.write_table(ways[what % len(ways)](), buffer)
        except (pa.ArrowException, OverflowError, TypeError, ValueError):
            return content  # Arrow itself does not let it be
        return buffer.getvalue()

    return st.builds(change, _WHERE, _WHERE, _WHERE, SCALARS, st.sampled_from(_TYPES))


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
