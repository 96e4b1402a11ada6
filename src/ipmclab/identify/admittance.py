"""The circuit as poles and residues, and back: what a current can tell about its elements.

Seen from its terminals, a series resistance before a leak and RC branches in parallel is
Y(s) = D + sum_j r_j/(s - lambda_j): with two branches five numbers, whatever the six elements are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

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
        return bool(self.series >= 0 and np.all(np.isfinite(values)) and np.all(values > 0))


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


def _modes(elements: Elements) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poles, eigenvectors and inlet weights of the symmetric form, in which w_i = sqrt(C_i) v_i are the states."""
    resistance, capacitance = elements.resistances, elements.capacitances
    divider = 1.0 / (1.0 + elements.series * (1.0 / elements.leak + np.sum(1.0 / resistance)))
    inlet = 1.0 / (resistance * np.sqrt(capacitance))
    system = elements.series * divider * np.outer(inlet, inlet) - np.diag(1.0 / (resistance * capacitance))
    poles, vectors = np.linalg.eigh(system)
    return poles, vectors, divider * inlet


def capacitor_voltages(elements: Elements, amplitudes: FloatArray) -> FloatArray:
    """Voltages of the capacitors [V] that add to the current one decay of each mode with this amplitude [A]."""
    _, vectors, inlet = _modes(elements)
    voltages: FloatArray = vectors @ (-amplitudes / (vectors.T @ inlet)) / np.sqrt(elements.capacitances)
    return voltages


def admittance(elements: Elements) -> tuple[Admittance, FloatArray]:
    """Poles and residues of a circuit (Friend, eqs 4.1 to 4.6), and their derivatives.

    With w_i = sqrt(C_i) v_i as states the system matrix is symmetric, so that poles are real
    and their derivatives follow from first-order perturbation of its eigenvectors.

    Returns
    -------
    admittance : Admittance
        Poles fastest first.
    derivatives : float array, shape (1 + 2 n_branch, 2 + 2 n_branch)
        Of direct, residues and poles (rows) with respect to the series resistance [1/ohm] and to
        the logarithms of leak, resistances and capacitances (columns).
    """
    series, resistance, capacitance = elements.series, elements.resistances, elements.capacitances
    branches = len(resistance)
    conductance = 1.0 / elements.leak + np.sum(1.0 / resistance)
    divider = 1.0 / (1.0 + series * conductance)
    node = series * divider
    poles, vectors, weighted = _modes(elements)
    inlet = weighted / divider
    coupling = vectors.T @ weighted

    parameters = 2 + 2 * branches
    each = np.arange(branches)
    d_series = np.zeros(parameters)
    d_series[0] = 1.0
    d_conductance = np.zeros(parameters)
    d_conductance[1] = -1.0 / elements.leak
    d_conductance[2 + each] = -1.0 / resistance
    d_divider = -divider * divider * (d_series * conductance + series * d_conductance)
    d_node = divider * divider * (d_series - series * series * d_conductance)
    d_inlet = np.zeros((parameters, branches))
    d_inlet[2 + each, each] = -inlet
    d_inlet[2 + branches + each, each] = -0.5 * inlet
    d_system = d_node[:, None, None] * np.outer(inlet, inlet) + node * (
        d_inlet[:, :, None] * inlet + inlet[:, None] * d_inlet[:, None, :]
    )
    rate = 1.0 / (resistance * capacitance)
    d_system[2 + each, each, each] += rate
    d_system[2 + branches + each, each, each] += rate

    turned = vectors.T @ d_system @ vectors
    d_poles = np.diagonal(turned, axis1=1, axis2=2)
    gap = poles[None, :] - poles[:, None]
    gap[each, each] = np.inf
    mixing = turned / gap
    d_coupling = (d_divider[:, None] * inlet + divider * d_inlet) @ vectors
    d_coupling += np.einsum("k,pkj->pj", coupling, mixing)
    derivatives = np.vstack(
        [
            divider * divider * (d_conductance - conductance * conductance * d_series),
            (-2.0 * coupling * d_coupling).T,
            d_poles.T,
        ]
    )
    return Admittance(conductance * divider, -coupling * coupling, poles), derivatives


def elements(series: float, seen: Admittance) -> Elements:
    """The elements that show an admittance behind a given series resistance.

    Behind the series resistance lies G = Y/(1 - series Y), whose partial fractions are the leak
    and the branches (Foster's second form). Noise can make the answer unphysical: look at
    ``Elements.is_physical``. Branches come fastest first.

    Parameters
    ----------
    series : float [ohm]
    seen : Admittance
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        remaining = 1.0 - series * seen.direct
        system = np.diag(seen.poles) + np.outer(seen.residues, np.full(len(seen.poles), series / remaining))
        if not np.all(np.isfinite(system)):
            nothing = np.full(len(seen.poles), np.nan)
            return Elements(series, np.nan, nothing, nothing)
        rates = np.linalg.eigvals(system)
        if np.iscomplexobj(rates) and np.any(rates.imag != 0):
            nothing = np.full(len(seen.poles), np.nan)
            return Elements(series, np.nan, nothing, nothing)
        rates = np.sort(rates.real)
        if series > 0:
            inverse = rates[:, None] - seen.poles
            residues = 1.0 / (series * series * np.sum(seen.residues / (inverse * inverse), axis=1))
        else:
            residues = seen.residues[np.argsort(seen.poles)]
        resistances = rates / residues
        capacitances = -1.0 / (rates * resistances)
        leak = 1.0 / (seen.direct / remaining - np.sum(1.0 / resistances))
    return Elements(series, float(leak), resistances, capacitances)
