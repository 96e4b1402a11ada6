"""What is known of a strip: by its fit, and by runs that are not recorded yet."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.named_matrix import matrix_of
from ipmclab.normal_equations import lengths, pseudo_inverse
from ipmclab.planning.answer import FittedStrip
from ipmclab.planning.information import RunInformation

FloatArray = npt.NDArray[np.float64]

_WIDEST: Final = 1e3
"""Standard deviation of an entry that may be anything: its logarithm, or in its scales."""

_WIDER: Final = 10.0  # times the allowed range, by which an error is asked whether it rests on that alone
_FELT: Final = 2.0

_ROUNDING: Final = 1e-15  # of a variance, that is left of it with others: a covariance in floating point leaves no less
_DETERMINED: Final = 1e-12  # of the largest information, columns of length 1


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known of the entries of a fit.

    Every parameter lies in its allowed range, which counts as a prior as wide: so a direction that no reading shows is
    badly known, and nothing is singular.

    Parameters
    ----------
    fitted : float array, shape (n, n + n_held)
        Information of the fit about the entries, then between them and the held values.
    beforehand : float array, shape (n,)
        Information of the allowed ranges.
    stated : float array, shape (n_held, n_held)
        Covariance of fixed values with a stated uncertainty.
    further : RunInformation, optional
        By runs that come after it.
    """

    fitted: FloatArray
    beforehand: FloatArray
    stated: FloatArray
    further: RunInformation | None = None

    @classmethod
    def of(cls, strip: FittedStrip) -> Knowledge:
        """What a fit knows."""
        names, held = strip.names, strip.held
        covariance = matrix_of(strip.fit.covariance, (*names, *held))
        scale = np.append(strip.chains, np.ones(len(held)))
        covariance = covariance / np.outer(scale, scale)
        count = len(names)
        stated, across = covariance[count:, count:], covariance[:count, count:]
        slopes = across @ pseudo_inverse(stated) if held else np.zeros((count, 0))
        # What is left when the held values are exact, and what the table leaves out: directions that are open.
        own = _inverse(covariance[:count, :count] - slopes @ stated @ slopes.T + _open(strip))
        beforehand = np.array([1.0 / _width(one) ** 2 for one in strip.unknowns])
        return cls(np.hstack([own, -own @ slopes]), beforehand, stated)

    def after(self, runs: RunInformation) -> Knowledge:
        """What is known after a further run."""
        return replace(self, further=runs if self.further is None else self.further + runs)

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the entries, then of the held values, shape (n + n_held, n + n_held)."""
        count = len(self.beforehand)
        information = self.fitted if self.further is None else self.fitted + self.further.information
        alone = _inverse(information[:, :count] + np.diag(self.beforehand))
        moved = -alone @ information[:, count:]
        passed = moved @ self.stated
        return np.block([[alone + passed @ moved.T, passed], [passed.T, self.stated]])

    @cached_property
    def errors(self) -> FloatArray:
        """Standard error of each entry, shape (n,)."""
        return np.sqrt(self.covariance.diagonal()[: len(self.beforehand)])

    @cached_property
    def open(self) -> npt.NDArray[np.bool_]:
        """Entries of which nothing is known but that they lie in their allowed range, shape (n,)."""
        wider = replace(self, beforehand=self.beforehand / _WIDER**2)
        return np.asarray(wider.errors > _FELT * self.errors)

    @property
    def rank(self) -> int:
        """Combinations of the entries that the readings determine at all."""
        count = len(self.beforehand)
        own = (self.fitted if self.further is None else self.fitted + self.further.information)[:, :count]
        size = lengths(own.diagonal())
        values = np.linalg.eigvalsh(own / np.outer(size, size))
        return int(np.count_nonzero(values > _DETERMINED * values[-1]))

    @cached_property
    def evidence(self) -> tuple[float, ...]:
        """Squared standard errors by which each rival differs, if it is true, whatever the entries are then.

        By the further runs: what the fit's own readings say of a rival is not asked.
        """
        if self.further is None:
            return ()
        count = len(self.beforehand)
        found = []
        for one in self.further.rivals:
            information = one.information
            information[:count, :count] += self.fitted[:, :count] + np.diag(self.beforehand)
            across = information[:count, count]
            known = float(across @ _inverse(information[:count, :count]) @ across)
            found.append(max(float(information[count, count]) - known, 0.0))
        return tuple(found)


def _inverse(matrix: FloatArray) -> FloatArray:
    """Of a covariance or an information: a column of length 1 has no less left after the others than rounding."""
    size = lengths(matrix.diagonal())
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T) / np.outer(size, size))
    turned = vectors / size[:, None]
    return np.asarray((turned / np.maximum(values, _ROUNDING)) @ turned.T)


def _open(strip: FittedStrip) -> FloatArray:
    """Variance along the directions of which the readings of a fit say nothing, whose covariance leaves it out."""
    found = np.zeros((len(strip.names), len(strip.names)))
    for one in strip.fit.undetermined:
        if math.isinf(one.error):
            along = np.array([one.coefficients.get(name, 0.0) for name in strip.names])
            found += _WIDEST**2 * np.outer(along, along)
    return found


def _width(unknown: Unknown) -> float:
    """Standard deviation of an entry that is anywhere in its allowed range."""
    low, high = (max(end, 1e-300) if unknown.log else end for end in (unknown.lower, unknown.upper))
    return min((unknown.entry(high) - unknown.entry(low)) / math.sqrt(12.0), _WIDEST)
