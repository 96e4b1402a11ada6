"""Circuits whose branches have given time constants: a linear problem, solved for many sets of them at once.

Behind a series resistance R a circuit is a sum of conductances at the node voltage u,

    i = g_dc u + sum_j g_j h(T_j) u,    h(T) = s T/(1 + s T),

so that with u known the conductances of any time constants T_j follow by linear least squares. The node voltage is that
of a fit near by, u = v - R i, whose parts have a closed form: what a pole a answers to what a pole b answers to v is
(x_a - x_b)/(a - b), x being the answers to v itself. The products of all columns are made once, and every set of time
constants is a few rows and columns of them. It gives starts: the node voltage of another circuit is another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun, drive
from ipmclab.identification.problem.response import lumped
from ipmclab.model.admittance import Elements, admittance
from ipmclab.model.numerics.drive import Drive, responses
from ipmclab.model.stages.circuit import DC, branch_names
from ipmclab.run import FloatArray

IndexArray = npt.NDArray[np.intp]

_MET: Final = 1e-6  # of a pole: of two that are nearer, the difference has lost its digits
_RIDGE: Final = 1e-13  # of a squared column: far above rounding, far below what readings tell


@dataclass(frozen=True, eq=False)
class BranchTimes:
    """The linear problem about one fit.

    Parameters
    ----------
    theta : float array, shape (n_unknown,)
        The fit.
    times : float array, shape (n_times,) [s]
    products : float array, shape (n_times + 2, n_times + 2)
        Of the weighted columns with each other: the node voltage, what a branch of each time constant makes of it, the
        readings.
    circuit : Elements
        Of the fit.
    columns : int array, shape (1 + 2 n_branch,)
        The entries of the dc resistivity, then of resistivity and permittivity of each branch.
    """

    theta: FloatArray
    times: FloatArray
    products: FloatArray
    circuit: Elements
    columns: IndexArray

    @classmethod
    def of(cls, problem: Problem, theta: FloatArray, here: Evaluation, times: FloatArray, branches: int) -> Self | None:
        """About a fit of a circuit that is read by its current; None where not all of it is free and shared."""
        place = {unknown.name: column for column, unknown in enumerate(problem.unknowns)}
        names = [DC, *(name for number in range(branches) for name in branch_names(number))]
        if not set(names) <= set(place):
            return None
        products = np.zeros((len(times) + 2, len(times) + 2))
        for record in problem.records:
            rows = _rows(problem, record, theta, times, branches)
            rows[-1] -= here.residual[problem.pieces[record.place, "current"]]
            products += rows @ rows.T
        circuit = lumped(branches, problem.values(theta, problem.records[0].place))
        return cls(theta, times, products, circuit, np.array([place[name] for name in names], dtype=np.intp))

    def start(self, held: int, branch: int) -> FloatArray | None:
        """The vector of the best circuit in which a branch has one of the times and the others any; None without one.

        Parameters
        ----------
        held : int
            Which time.
        branch : int
            The number of the branch.
        """
        count = len(self.circuit.resistances)
        others = np.array(
            list(combinations([n for n in range(len(self.times)) if n != held], count - 1)), dtype=np.intp
        )
        chosen = np.insert(others.reshape(-1, count - 1), branch, held, axis=1)
        conductances, left = self._solved(chosen)
        possible = np.flatnonzero((conductances > 0.0).all(axis=1))
        if not len(possible):
            return None
        best = possible[np.argmin(left[possible])]
        leak, own = conductances[best, 0], conductances[best, 1:]
        moved = np.empty(1 + 2 * count)
        moved[0] = -np.log(leak * self.circuit.leak)
        moved[1::2] = -np.log(own * self.circuit.resistances)
        moved[2::2] = np.log(self.times[chosen[best]] * own / self.circuit.capacitances)
        theta = self.theta.copy()
        theta[self.columns] += moved
        return theta

    def _solved(self, chosen: IndexArray) -> tuple[FloatArray, FloatArray]:
        """The conductances of each set of times, that of the dc path first, and what they leave of the readings."""
        sets = np.insert(chosen + 1, 0, 0, axis=1)
        sizes = np.sqrt(np.maximum(self.products.diagonal(), 1e-300))
        scaled = self.products / (sizes[:, None] * sizes)
        inner = scaled[sets[:, :, None], sets[:, None, :]] + _RIDGE * np.eye(sets.shape[1])
        outer = scaled[sets, -1]
        found = np.linalg.solve(inner, outer[:, :, None])[:, :, 0]
        return found * sizes[-1] / sizes[sets], scaled[-1, -1] - (found * outer).sum(axis=1)


def _rows(problem: Problem, record: PreparedRun, theta: FloatArray, times: FloatArray, branches: int) -> FloatArray:
    """The columns of one run as rows, and last its current by the fit, all as the noise weighs them."""
    key = record.place, "current"
    circuit = lumped(branches, problem.values(theta, record.place), record.series_resistance)
    node, behind, current = _answers(drive(record, problem.delay(theta, record)), circuit, times)
    reading = record.readings["current"]
    weight = np.where(reading.exact, 1.0 / problem.noise[key], 0.0)
    if reading.weights is not None:
        weight *= reading.weights
    return problem.whitened(key, (np.vstack([node, behind, current]) * weight)[:, reading.used])


def _answers(given: Drive, circuit: Elements, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The node voltage [V], that less the voltage of a capacitor charged with each time constant, and the current."""
    fractions, _ = admittance(circuit)
    own, slopes = responses(given, fractions.poles)
    poles = -1.0 / times
    low, _ = responses(given, poles)
    current = fractions.direct * given.present + fractions.residues @ own
    node = given.present - circuit.series * current
    filtered = (1.0 - circuit.series * fractions.direct) * low
    for pole, residue, answer, slope in zip(fractions.poles, fractions.residues, own, slopes, strict=True):
        differences = poles - pole
        met = np.abs(differences) < _MET * np.abs(pole)
        twice = np.where(met[:, None], slope, (low - answer) / np.where(met, 1.0, differences)[:, None])
        filtered -= circuit.series * residue * twice
    return node, node - filtered / times[:, None], current
