"""A figure as text that can stand inside an HTML page."""

from __future__ import annotations

import io
import re
from xml.sax.saxutils import escape

from markupsafe import Markup
from matplotlib.figure import Figure

from ipmclab.reporting.style import COLOURS, style

_NO_METADATA = {"Creator": None, "Date": None, "Format": None, "Type": None}
_NUMBER = re.compile(r"-?\d+\.\d{3,}")


def inline_svg(figure: Figure, name: str, description: str) -> Markup:
    """Write a figure as an SVG element for an HTML page.

    Several such elements may stand in one page: every id starts with ``name``, and no style
    rule leaks out. Colours follow the page (CSS variables of the names in ``style.COLOURS``),
    so that the figure works on light and dark paper.

    Parameters
    ----------
    figure : Figure
    name : str
        Unique in the page; letters, digits and hyphens.
    description : str
        What the figure shows, for readers who do not see it.

    Returns
    -------
    svg : Markup
        One ``<svg>`` element, as a text that a template inserts as it is.

    Examples
    --------
    >>> inline_svg(Figure(figsize=(1, 1)), "empty", "nothing")[:29]
    Markup('<svg class="figure" role="img')
    """
    buffer = io.StringIO()
    with style():
        figure.savefig(buffer, format="svg", metadata=_NO_METADATA, transparent=True)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    # A thousandth of a point is not visible, and paths are most of the file.
    text = re.sub(r' d="[^"]*"', lambda path: _NUMBER.sub(_shorten, path.group()), text)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = text.replace("url(#", f"url(#{name}-").replace('href="#', f'href="#{name}-')
    for role, colour in COLOURS.items():
        text = text.replace(colour, f"var(--{role})")
    text = re.sub(r"font-family: [^;\"]*", "font-family: var(--sans)", text)
    box = re.search(r'viewBox="([^"]*)"', text)
    assert box is not None
    head = (
        f'<svg class="figure" role="img" aria-labelledby="{name}-title" viewBox="{box.group(1)}" '
        f'xmlns:xlink="http://www.w3.org/1999/xlink"><title id="{name}-title">{escape(description)}</title>'
    )
    # Texts in the figure were escaped by the writer of the SVG.
    return Markup(re.sub(r"<svg[^>]*>", lambda _: head, text, count=1).strip())


def standalone_svg(text: str) -> str:
    """Make a file of what ``inline_svg`` wrote: in its own colours on white paper, outside any page.

    Parameters
    ----------
    text : str
        The ``<svg>`` element.

    Returns
    -------
    file : str

    Examples
    --------
    >>> standalone_svg('<svg class="figure"><path style="stroke: var(--blue)"/></svg>')[-38:]
    '<path style="stroke: #0072b2"/></svg>\\n'
    """
    colours = {**COLOURS, "sans": "'DejaVu Sans', sans-serif"}
    text = re.sub(r"var\(--(\w+)\)", lambda name: colours.get(name[1], name[0]), text)
    head = '<svg xmlns="http://www.w3.org/2000/svg" style="background: #ffffff" '
    return text.replace("<svg ", head, 1) + "\n"


def _shorten(match: re.Match[str]) -> str:
    return f"{float(match.group()):.2f}".rstrip("0").rstrip(".")
