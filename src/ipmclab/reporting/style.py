"""The look of every figure: one set of colours, one set of settings, no global state."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib

COLOURS: Final[dict[str, str]] = {
    "ink": "#1c2126",
    "muted": "#5f6973",
    "rule": "#d5dadf",
    "paper": "#ffffff",
    "measured": "#a9b3bc",
    "mask": "#c9a227",
    "blue": "#0072b2",
    "vermillion": "#d55e00",
    "green": "#009e73",
    "purple": "#cc79a7",
    "sky": "#56b4e9",
    "orange": "#e69f00",
}
"""Roles and their colours on white paper.

The last six are of Okabe and Ito (2008), distinguishable by colour-blind readers. Each hex
value occurs once, so that an inlined figure can exchange it for the colour of the page.
"""

SERIES: Final = ("blue", "vermillion", "green", "purple", "sky", "orange")
"""Colours of things that are compared with each other, in this order."""

LINES: Final = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (5, 1.4, 1.2, 1.4)))
"""Line patterns in addition to the colours: a figure stays readable in black and white."""

PAGE_WIDTH: Final = 7.2
"""Width of a figure over the whole page [inch]."""

_SETTINGS: Final[dict[Any, Any]] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 6.0,
    "axes.titley": 1.0,  # where it is anyway: a panel has no ticks above it that would have to be looked for
    "axes.labelsize": 8.5,
    "axes.labelcolor": COLOURS["ink"],
    "axes.edgecolor": COLOURS["muted"],
    "axes.linewidth": 0.6,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "axes.formatter.use_mathtext": False,
    "axes.unicode_minus": True,
    "grid.color": COLOURS["rule"],
    "grid.linewidth": 0.5,
    "text.parse_math": False,
    "text.color": COLOURS["ink"],
    "xtick.color": COLOURS["muted"],
    "ytick.color": COLOURS["muted"],
    "xtick.labelcolor": COLOURS["ink"],
    "ytick.labelcolor": COLOURS["ink"],
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "legend.handlelength": 1.8,
    "figure.facecolor": COLOURS["paper"],
    "savefig.facecolor": "auto",
    "figure.dpi": 100,
    "savefig.dpi": 200,
    "svg.fonttype": "none",
    "svg.hashsalt": "ipmclab",
    "pdf.fonttype": 42,
}


@contextmanager
def style() -> Iterator[None]:
    """The settings of every figure, for as long as it is drawn and written."""
    with matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes, or right in an SVG; it is no fault of the user.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


def label_text(name: str, *, longest: int = 40) -> str:
    """A name that a user gave, as a figure can show it.

    Matplotlib hides labels that begin with an underscore; an SVG cannot hold control characters.

    Examples
    --------
    >>> label_text("step 1 V"), label_text("a" * 50, longest=9)
    ('step 1 V', 'aaaa…aaaa')
    """
    shown = "".join(letter if letter.isprintable() else " " for letter in name)
    if len(shown) > longest:
        half = (longest - 1) // 2
        shown = f"{shown[:half]}…{shown[-half:]}"
    return f"\u200a{shown}" if shown.startswith("_") else shown
