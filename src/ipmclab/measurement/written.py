"""What is in a file for a measured number, so that a message can show it as it was written."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

_FEWEST: Final = 3  # readings of which one can lie far from the others
_TIMES: Final = 5.0  # the range of the others, by which a reading lies far from the others
_SLIP: Final = 0.1  # of the others: a digit or a unit that is wrong moves a reading by at least as much
_LISTED: Final = 5

REPAIR: Final = "write it again; is its unit right?"


@dataclass(frozen=True)
class Written:
    """A number, or readings of it.

    Parameters
    ----------
    where : str
        File and key.
    texts : tuple of str
        As they were written, with their units.
    values : tuple of float [SI]
    """

    where: str
    texts: tuple[str, ...]
    values: tuple[float, ...]

    @property
    def said(self) -> str:
        """The text, or all of them where they are few.

        Examples
        --------
        >>> Written("p.toml: density.mass", ("145.7 g",), (0.1457,)).said
        '"145.7 g"'
        """
        if len(self.texts) <= _LISTED:
            listed = ", ".join(f'"{text}"' for text in self.texts)
            return listed if len(self.texts) == 1 else f"[{listed}]"
        return f"{len(self.texts)} readings from {self._range(range(len(self.texts)))}"

    @property
    def outlier(self) -> int | None:
        """Place of the one reading that lies so far from all others that it is a slip; None where there is none.

        Examples
        --------
        >>> Written("width", ("5.01 mm", "50.0 mm", "4.99 mm"), (5.01e-3, 50e-3, 4.99e-3)).outlier
        1
        """
        if len(self.values) < _FEWEST:
            return None
        values = np.array(self.values)
        for place in (int(values.argmin()), int(values.argmax())):
            others = np.delete(values, place)
            gap = float(np.min(np.abs(others - values[place])))
            if gap > _TIMES * float(np.ptp(others)) and gap > _SLIP * abs(float(np.median(others))):
                return place
        return None

    def slip(self) -> tuple[str, str] | None:
        """The file and key of a reading that lies far from the others, and what is to be said of it; None where there
        is none."""
        place = self.outlier
        if place is None:
            return None
        others = self._range(k for k in range(len(self.texts)) if k != place)
        text = f'"{self.texts[place]}", number {place + 1} of {len(self.texts)}, lies far from the others ({others})'
        return f"{self.where}[{place}]", text

    def _range(self, places: Iterable[int]) -> str:
        ordered = sorted(places, key=lambda place: self.values[place])
        return f"{self.texts[ordered[0]]} to {self.texts[ordered[-1]]}"


def scatter_of(source: str) -> str:
    """What the contribution of the scatter of readings is called.

    Examples
    --------
    >>> scatter_of("width")
    'scatter of the readings of the width'
    """
    return f"scatter of the readings of the {source}"
