"""Rows whitened by the noise that was found, so that their squares are minus twice the log likelihood."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property

from ipmclab.identification.noise.pieces import Key
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Noise, Problem
from ipmclab.run import FloatArray
from ipmclab.statespace.whitening import Whitening


class Changed(Problem):
    """A problem with the readings and unknowns of a plain one, the rows of some outputs of some runs changed."""

    def __init__(self, plain: Problem, keys: Iterable[Key]) -> None:
        super().__init__(plain.base, plain.records, plain.unknowns, plain.responder, plain.noise)
        self._plain, self._keys = plain, tuple(keys)

    @property
    def plain(self) -> Problem:
        """The problem that is not changed."""
        return self._plain

    def without(self, columns: Sequence[int], values: Mapping[str, float]) -> Problem:
        """The problem with fewer unknowns, changed alike, and other values of what is no longer free."""
        return self.on(self.plain.without(columns, values))

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Changed residuals and Jacobian."""
        return self.changed(super().evaluate(theta))

    def changed(self, here: Evaluation) -> Evaluation:
        """An evaluation of the plain problem as one of this."""
        rows = here.rows.copy()
        for key in self._keys:
            rows[:, self.pieces[key]] = self.whitened(key, rows[:, self.pieces[key]])
        return Evaluation(rows, here.beforehand)

    def fixed_jacobian(self, theta: FloatArray, names: Sequence[str]) -> FloatArray:
        """Changed derivatives of the residuals with respect to fixed parameters [per SI unit]."""
        found = super().fixed_jacobian(theta, names)
        for key in self._keys:
            found[self.pieces[key]] = self.whitened(key, found[self.pieces[key]].T).T
        return found


class CorrelatedProblem(Changed):
    """The same problem with correlated noise.

    Parameters
    ----------
    plain : Problem
    whitenings : mapping of (place, output) to Whitening
        In units of the problem's ``noise``; an output without one has white noise.
    """

    def __init__(self, plain: Problem, whitenings: Mapping[Key, Whitening]) -> None:
        super().__init__(plain, whitenings)
        self.whitenings = dict(whitenings)

    @cached_property
    def on_means(self) -> Problem | None:
        """None: what neighbours have in common does not show in means."""
        return None

    def on(self, plain: Problem) -> Problem:
        """Another problem, of some of the same readings, whitened alike."""
        return CorrelatedProblem(plain, {key: one for key, one in self.whitenings.items() if key in plain.pieces})

    def with_noise(self, noise: Noise) -> Problem:
        """The problem with other weights, and white."""
        return self.plain.with_noise(noise)

    def whitened(self, key: Key, rows: FloatArray) -> FloatArray:
        """Rows of one output of one run, whitened where its noise is not white."""
        whitening = self.whitenings.get(key)
        return rows if whitening is None else whitening.apply(rows)
