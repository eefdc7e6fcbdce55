"""Figures as small SVG for a page, with selectable text and the page's colours.

Every colour of ``style`` becomes a variable of the page's style sheet, so that one picture serves
the light and the dark scheme.  Identifiers get a prefix, so that a page can hold many pictures.
"""

import io
import re
import xml.etree.ElementTree as ET
from types import MappingProxyType

from matplotlib.figure import Figure

from harness.report import style

CSS_VARIABLES = MappingProxyType({
    style.INK: "--ink", style.MUTED: "--muted", style.GRID: "--grid", style.BLUE: "--blue",
    style.VERMILLION: "--vermillion", style.GREEN: "--green", style.PURPLE: "--purple",
    style.ORANGE: "--orange", "#ffffff": "--card",
})  # fmt: skip
"""The page's variable for each colour that a figure may use."""

_SVG = "http://www.w3.org/2000/svg"
_LINK = "http://www.w3.org/1999/xlink"
_COLOUR = re.compile(r"#[0-9a-f]{6}\b")
_NUMBER = re.compile(r"-?\d+\.\d{3,}")


def inline_svg(figure: Figure, prefix: str, title: str, description: str) -> str:
    """A figure as an ``<svg>`` element.

    Args:
        figure: a figure made inside ``style.styled``; its background becomes transparent.
        prefix: prefix of all identifiers, different for every figure of a page.
        title: the figure's name, for screen readers.
        description: a description of its content, for screen readers.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    root = ET.fromstring(buffer.getvalue())
    del root.attrib["width"], root.attrib["height"]
    root.attrib |= {"role": "img", "aria-labelledby": f"{prefix}-title {prefix}-desc"}
    for element in list(root.iter()):
        # A style sheet would apply to the whole page.
        for name in ("metadata", "style"):
            for child in element.findall(f"{{{_SVG}}}{name}"):
                element.remove(child)
        _rewrite(element, prefix)
    for position, (tag, text) in enumerate((("title", title), ("desc", description))):
        words = ET.Element(f"{{{_SVG}}}{tag}", {"id": f"{prefix}-{tag}"})
        words.text = text
        root.insert(position, words)
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _LINK)
    return ET.tostring(root, encoding="unicode")


def _rewrite(element: ET.Element, prefix: str) -> None:
    for name, value in element.attrib.items():
        if name == "id":
            element.attrib[name] = f"{prefix}-{value}"
        elif name == f"{{{_LINK}}}href":
            element.attrib[name] = value.replace("#", f"#{prefix}-")
        elif name in ("style", "fill", "stroke"):
            element.attrib[name] = _COLOUR.sub(_variable, value)
        elif name in ("d", "x", "y"):
            element.attrib[name] = _NUMBER.sub(lambda match: f"{float(match[0]):.2f}", value)
        if "url(#" in element.attrib[name]:
            element.attrib[name] = element.attrib[name].replace("url(#", f"url(#{prefix}-")


def _variable(match: re.Match[str]) -> str:
    """The page's variable for a colour of the style; other colours do not change."""
    return f"var({CSS_VARIABLES[match[0]]})" if match[0] in CSS_VARIABLES else match[0]
