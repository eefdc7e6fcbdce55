"""The texts of numbers and of names: a view writes every value by these functions."""

import math
from unicodedata import category

from harness.measures.queues import level_of_service
from harness.results.estimators import CONFIDENCE, zero_bound
from harness.results.finding import Finding, Form, Style
from harness.results.result import Entered, Shown, Versus
from harness.scenario.study import as_written

DASH = "–"
"""An undefined number; a note, or the finding's reason, says why."""

_SMALLEST_PER_CENT = 1e-6
_SHARES = (Form.SHARE, Form.EVENTS)


def printable(value: object) -> str:
    r"""A text from a file, with control and formatting characters as escapes.

    >>> printable("stop\x1b[31m")
    'stop\\x1b[31m'
    """
    signs = str(value)
    control = (sign for sign in signs if category(sign)[0] == "C")
    return signs.translate({ord(sign): sign.encode("unicode_escape").decode() for sign in control})


def plain_text(value: object) -> str:
    """A value that is no finding, as a user would write it; empty if there is none."""
    return "" if value is None else printable(as_written(value))


def value_text(shown: Shown) -> str:
    """A number with its unit per cent and, if its interval is unreliable, a star.

    >>> value_text(Shown(Finding(-2.961, reliable=False)))
    '−2.96*'
    >>> value_text(Shown(Finding(0.04, n=50, events=2), Style(Form.EVENTS)))
    '2 of 50'
    >>> value_text(Shown(Finding(0.0002), Style(digits=3)))
    '< 0.001'
    """
    finding, style = shown
    if finding.value is None:
        return DASH
    star = "*" if finding.reliable is False else ""
    if style.form is Form.LEVEL:
        return f"{level_of_service(finding.value)}{star}"
    if style.form is Form.EVENTS and finding.events is not None and finding.n is not None:
        return f"{finding.events:,} of {finding.n:,}{star}"
    decimals = _decimals(finding, style)
    if style.form is Form.NUMBER and finding.low is None and 0 < 2 * finding.value < 10**-decimals:
        return f"< {10**-decimals:g}"
    percent = " %" if style.form in _SHARES else ""
    return f"{_number(finding.value, decimals, style)}{percent}{star}"


def interval_text(shown: Shown, confidence: float = CONFIDENCE) -> str:
    """The ends of an interval, or the bound that 0 events leave open; empty without an interval.

    Args:
        shown: the number; the ends have as many decimals as the value.
        confidence: the confidence of its interval.

    >>> interval_text(Shown(Finding(0.754, 0.71, 0.8249)))
    '0.71 … 0.82'
    >>> interval_text(Shown(Finding(0.0, 0.0, 0.0711, 50, 0), Style(Form.EVENTS, 1)))
    'below 5.8 %'
    >>> interval_text(Shown(Finding(11.0, 4.9, 17.1), Style(Form.LEVEL)))
    'A … C'
    >>> interval_text(Shown(Finding(0.06, 1e-18, 0.98), Style(Form.SHARE, 1)))  # of two pairs
    '0.0 … 98.0 %'
    """
    finding, style = shown
    low, high = finding.low, finding.high
    if finding.value is None or low is None or high is None:
        return ""
    if is_bound(shown):
        bound = zero_bound(high, confidence)
        return f"below {_number(bound, _decimals(Finding(bound), style), style)} %"
    if style.form is Form.LEVEL:
        return f"{level_of_service(low)} … {level_of_service(high)}"
    decimals = _decimals(finding, style)
    # Rounding may have moved a bound of 0.
    low = 0.0 if abs(low) < 1e-6 * abs(finding.value) else low
    percent = " %" if style.form in _SHARES else ""
    return f"{_number(low, decimals, style)} … {_number(high, decimals, style)}{percent}"


def is_bound(shown: Shown) -> bool:
    """Whether a number is 0 events of some trials, which leave only an upper bound."""
    return shown.style.form is Form.EVENTS and shown.finding.events == 0


def numbers_of(entered: Entered) -> tuple[Shown, ...]:
    """The numbers of a table's cell: none, one, or the AV's and the reference's."""
    if isinstance(entered, Versus):
        return tuple(entered)
    return (entered,) if isinstance(entered, Shown) else ()


def text_and_ends(entered: Entered, confidence: float = CONFIDENCE) -> tuple[str, str]:
    """The text of a table's cell, and that of its interval or intervals; either may be empty.

    >>> av, human = (Shown(Finding(share, 0.1, 0.4), Style(Form.SHARE, 0)) for share in (0.3, 0.2))
    >>> text_and_ends(Versus(av, human))
    ('30 / 20 %', '10 … 40 %')
    """
    shown = numbers_of(entered)
    if not shown:
        return plain_text(entered), ""
    ends = dict.fromkeys(interval_text(each, confidence) for each in shown)
    return _joined([value_text(each) for each in shown]), _joined([*ends] if any(ends) else [])


def text_of(entered: Entered, confidence: float = CONFIDENCE, interval: bool = True) -> str:
    """The text of a table's cell, with the interval in parentheses if it is asked for.

    >>> text_of(Shown(Finding(0.3, 0.178, 0.451), Style(Form.SHARE, 0)))
    '30 % (18 … 45 %)'
    """
    value, ends = text_and_ends(entered, confidence)
    return f"{value} ({ends})" if interval and ends else value


def _joined(texts: list[str]) -> str:
    """The AV's and the reference's text, which say what both end with once."""
    if len(texts) < 2:
        return "".join(texts)
    av, reference = (text or DASH for text in texts)
    for end in (" %", f" of {reference.rpartition(' of ')[2]}"):
        if av.endswith(end) and reference.endswith(end):
            av = av.removesuffix(end)
    return f"{av} / {reference}"


def level_text(confidence: float) -> str:
    """A level of confidence in per cent.

    >>> level_text(1 - 0.05 / 3)
    '98.33 %'
    """
    return f"{100 * confidence:.4g} %"


def counted_noun(count: int, noun: str) -> str:
    """A number with its noun.

    >>> counted_noun(1_000, "pair")
    '1,000 pairs'
    """
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def _decimals(finding: Finding, style: Style) -> int:
    """The decimals of a value and its interval.

    A small share has two digits: a bound of 0.0003 must not become 0.0, because no number of pairs
    shows that there is no risk.
    """
    if style.form is Form.COUNT:
        return 0
    size = next((100 * abs(value) for value in (finding.value, finding.high) if value), 0.0)
    if style.form not in _SHARES or not _SMALLEST_PER_CENT < size < 10.0 ** (1 - style.digits):
        return style.digits
    return max(style.digits, 1 - math.floor(math.log10(size)))


def _number(value: float, decimals: int, style: Style) -> str:
    per_cent = style.form in _SHARES
    size = 100 * value if per_cent else value
    if per_cent and 0 < abs(size) <= _SMALLEST_PER_CENT:
        return f"{size:.1e}".replace("-", "−")
    return f"{size:z,.{decimals}f}".replace("-", "−")
