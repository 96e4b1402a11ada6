"""The circuit as poles and residues, and back: what a current can show of its elements.

Seen from its terminals, a series resistance before a leak and RC branches in parallel is
Y(s) = D + sum_j r_j/(s - lambda_j): with two branches five numbers, whatever the six elements are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.poles_loop import admittance_slopes, admittances_slopes

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Elements:
    """The lumped elements of a circuit.

    Parameters
    ----------
    series : float [ohm]
        Both electrodes, the contact and a shunt, in series.
    leak : float [ohm]
        R_dc.
    resistances : float array, shape (n_branch,) [ohm]
    capacitances : float array, shape (n_branch,) [F]
    """

    series: float
    leak: float
    resistances: FloatArray
    capacitances: FloatArray

    def is_physical(self) -> bool:
        """Whether every element is finite and above zero (the series resistance may be zero)."""
        values = np.array([self.leak, *self.resistances, *self.capacitances])
        return bool(self.series >= 0 and ((values > 0) & (values < np.inf)).all())


@dataclass(frozen=True)
class Admittance:
    """Y(s) = direct + sum_j residues_j/(s - poles_j).

    Parameters
    ----------
    direct : float [S]
    residues : float array, shape (n_branch,) [S/s]
    poles : float array, shape (n_branch,) [1/s]
    """

    direct: float
    residues: FloatArray
    poles: FloatArray


def _modes(
    series: FloatArray, leak: FloatArray, resistances: FloatArray, capacitances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poles, eigenvectors and inlets of the symmetric form, in which w_i = sqrt(C_i) v_i are the states.

    They are those of its inverse, diag(R C) + s/(1 + s/R_dc) sqrt(C) sqrt(C)', whose eigenvalues are the time
    constants: nothing cancels in that sum, and its rounding falls on the fastest mode, not on the slow ones that a
    record shows. By the interlacing theorem each time constant lies between two neighbouring R C, so that no pole can
    come out with the wrong sign. Of many circuits every array has that axis first.
    """
    own, root = resistances * capacitances, np.sqrt(capacitances)
    divider = (1.0 + series / leak)[..., None]
    shared = series[..., None] / divider
    system = (shared * root)[..., :, None] * root[..., None, :]
    diagonal = np.arange(own.shape[-1])
    system[..., diagonal, diagonal] += own
    times, vectors = np.linalg.eigh(system)
    least = np.sort(own)
    most = least[..., -1:] + shared * capacitances.sum(axis=-1, keepdims=True)
    times = times.clip(least, np.concatenate([least[..., 1:], most], axis=-1))
    return -1.0 / times, vectors, (root[..., None, :] @ vectors)[..., 0, :] / (times * divider)


def _of(elements: Elements) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The modes of one circuit."""
    return _modes(np.float64(elements.series), np.float64(elements.leak), elements.resistances, elements.capacitances)  # type: ignore[arg-type]


def capacitor_voltages(elements: Elements, amplitudes: FloatArray) -> FloatArray:
    """Voltages of the capacitors [V] that add to the current one decay of each mode with this amplitude [A]."""
    _, vectors, admittance = _of(elements)
    voltages: FloatArray = vectors @ (-amplitudes / admittance) / np.sqrt(elements.capacitances)
    return voltages


def admittance(elements: Elements) -> tuple[Admittance, FloatArray]:
    """Poles and residues of a circuit (Friend, eqs 4.1 to 4.6), and their derivatives.

    With w_i = sqrt(C_i) v_i as states the system matrix is symmetric, so that the poles are real.

    Returns
    -------
    admittance : Admittance
        Poles fastest first.
    derivatives : float array, shape (1 + 2 n_branch, 2 + 2 n_branch)
        Of direct, residues and poles (rows) with respect to the series resistance [1/ohm] and to
        the logarithms of leak, resistances and capacitances (columns).
    """
    poles, vectors, admittance = _of(elements)
    residues = np.empty(len(poles))
    derivatives = np.empty((1 + 2 * len(poles), 2 + 2 * len(poles)))
    direct = admittance_slopes(
        elements.series,
        elements.leak,
        elements.resistances,
        elements.capacitances,
        poles,
        vectors,
        admittance,
        residues,
        derivatives,
    )
    return Admittance(direct, residues, poles), derivatives


class Admittances(NamedTuple):
    """The admittances of many circuits, and their derivatives; as ``admittance``, with the axis of circuits first."""

    direct: FloatArray
    residues: FloatArray
    poles: FloatArray
    derivatives: FloatArray


def admittances(series: FloatArray, leak: FloatArray, resistances: FloatArray, capacitances: FloatArray) -> Admittances:
    """Poles and residues of many circuits, and their derivatives.

    Parameters
    ----------
    series, leak : float array, shape (n_circuit,) [ohm]
    resistances, capacitances : float array, shape (n_circuit, n_branch) [ohm, F]
    """
    poles, vectors, admittance = _modes(series, leak, resistances, capacitances)
    circuits, branches = poles.shape
    direct, residues = np.empty(circuits), np.empty((circuits, branches))
    derivatives = np.empty((circuits, 1 + 2 * branches, 2 + 2 * branches))
    admittances_slopes(
        series, leak, resistances, capacitances, poles, vectors, admittance, direct, residues, derivatives
    )
    return Admittances(direct, residues, poles, derivatives)


def elements(series: float, admittance: Admittance) -> Elements:
    """The elements that show an admittance behind a given series resistance.

    Behind the series resistance lies G = Y/(1 - series Y), whose partial fractions are the leak
    and the branches (Foster's second form). Noise can make the answer unphysical: look at
    ``Elements.is_physical``. Branches come fastest first.

    Parameters
    ----------
    series : float [ohm]
    admittance : Admittance
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        remaining = 1.0 - series * admittance.direct
        system = np.diag(admittance.poles) + (admittance.residues * (series / remaining))[:, None]
        if not np.isfinite(system).all():
            nothing = np.full(len(admittance.poles), np.nan)
            return Elements(series, np.nan, nothing, nothing)
        rates = np.linalg.eigvals(system)
        if np.iscomplexobj(rates) and (rates.imag != 0).any():
            nothing = np.full(len(admittance.poles), np.nan)
            return Elements(series, np.nan, nothing, nothing)
        rates = np.sort(rates.real)
        if series > 0:
            inverse = rates[:, None] - admittance.poles
            residues = 1.0 / (series * series * np.sum(admittance.residues / (inverse * inverse), axis=1))
        else:
            residues = admittance.residues[np.argsort(admittance.poles)]
        resistances = rates / residues
        capacitances = -1.0 / (rates * resistances)
        leak = 1.0 / (admittance.direct / remaining - np.sum(1.0 / resistances))
    return Elements(series, float(leak), resistances, capacitances)
