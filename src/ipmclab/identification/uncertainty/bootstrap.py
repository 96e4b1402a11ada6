"""The parametric bootstrap: fit again to what the fitted model would have given under other draws of the noise.

A fit to readings that were drawn anew is the same problem with its residuals shifted by a draw of the noise: no reading
is made, and nothing is simulated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.engine import Engine, Here, in_order
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.problem.order import Order
from ipmclab.identification.problem.problem import Evaluation, Problem
from ipmclab.identification.search.solve import descend
from ipmclab.identification.solved import solved
from ipmclab.one_thread import on_one_thread
from ipmclab.progress import Tell, stage, telling, tick

FloatArray = npt.NDArray[np.float64]

SEED: Final = 20261121
FEWEST_DRAWS: Final = 40  # draws of which a 95 % interval leaves one out on each side
_NEAR: Final = 1e-8


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Fits to readings as the fitted model gives them under the noise that was found.

    Parameters
    ----------
    samples : mapping of name to float array, shape (n_fits,) [SI]
        The value of each parameter in each fit.
    intervals : mapping of name to pair of float [SI]
        From the 2.5th to the 97.5th percentile.
    standard_errors : mapping of name to float [SI]
    failed : int
        How many draws could not be fitted; they are not among the samples.
    """

    samples: Mapping[str, FloatArray]
    intervals: Mapping[str, tuple[float, float]]
    standard_errors: Mapping[str, float]
    failed: int

    def __str__(self) -> str:
        """A line for each parameter."""
        count = len(next(iter(self.samples.values()), ()))
        width = max((len(name) for name in self.samples), default=0)
        lines = [f"Bootstrap of {count} fits, {self.failed} failed"]
        lines += [f"  {name:<{width}}  {low:.6g} to {high:.6g}" for name, (low, high) in self.intervals.items()]
        return "\n".join(lines)

    __repr__ = __str__


@on_one_thread
def bootstrap(
    fit: Fit, count: int = 1000, *, seed: int = SEED, engine: Engine | None = None, progress: Tell | None = None
) -> Bootstrap:
    """Fit again to readings drawn anew, and see how the parameters scatter.

    The noise is that which the fit found, with its correlation; its own uncertainty is not drawn, and neither is a
    fixed parameter, both of which the intervals of the fit count. A parameter of which the readings say nothing has no
    interval here either: a fit stays where it starts along such a direction.

    Parameters
    ----------
    fit : Fit
        What ``identify`` returned.
    count : int
        How many draws, at least 40.
    seed : int
        The same seed gives the same draws.
    engine : Engine, optional
        Who fits: this process where it is left out. The answer is the same, to the last bit.
    progress : function of (str, float), optional
        Told what is being done, and the fraction that is done.

    Returns
    -------
    bootstrap : Bootstrap

    Raises
    ------
    InputError
        A fit that was read from a file, or too few draws.

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> run = simulate(load_actuator("friend-2"), "step 1 V", duration=20, rate=50)
    >>> fit = identify(load_actuator("friend-2"), run, free="circuit.dc_resistivity")
    >>> len(bootstrap(fit, 40).samples["circuit.dc_resistivity"])
    40
    """
    if count < FEWEST_DRAWS:
        raise InputError(
            f"{count} draws do not give a 95 % interval, which needs {FEWEST_DRAWS}",
            code="out-of-range",
            where="count",
            repair="give 1000, or at least 40",
        )
    estimate = solved(fit)
    with telling(progress):
        thetas = _draws(estimate.correlated, _starts(fit), count, np.random.default_rng(seed), engine or Here())
    return _told(fit, thetas, count)


class Drawn:
    """A problem as it is for readings drawn anew.

    Parameters
    ----------
    problem : Problem
    here : Evaluation
        At the parameters from which readings are drawn.
    noise : float array, shape (n_rows,)
        Of its residuals; zeros and slopes of sensors are taken out.
    """

    def __init__(self, problem: Problem, here: Evaluation, noise: FloatArray) -> None:
        self._problem = problem
        # Away from what a bound says, a residual is model less reading, and the reading is the model here and noise.
        self._shift = noise - here.residual
        self.lower, self.upper = problem.lower, problem.upper

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian."""
        return self.shifted(self._problem.evaluate(theta))

    def shifted(self, there: Evaluation) -> Evaluation:
        """An evaluation of the problem itself, as one of this."""
        rows = there.rows.copy()
        rows[-1] += self._shift
        return Evaluation(rows, there.beforehand)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """What every fit to readings drawn anew starts from."""

    problem: Problem
    theta: FloatArray
    here: Evaluation
    starts: list[FloatArray]


def _draws(
    correlated: Correlated, starts: list[FloatArray], count: int, generator: np.random.Generator, engine: Engine
) -> list[FloatArray | None]:
    stage(f"bootstrap of {count} fits", 0.0, 1.0, usual=count)
    here = correlated.solution.evaluation
    silent = np.asarray(~here.rows[:-1].any(axis=0))  # readings at the end of their range, which only bound the model
    drawn = (np.where(silent, 0.0, correlated.drawn(generator)) for _ in range(count))
    fitted = _Fitted(correlated.problem, correlated.solution.theta, here, starts)
    return in_order(engine, _fit_again, fitted, drawn, count)


@on_one_thread
def _fit_again(fitted: _Fitted, noise: FloatArray) -> FloatArray | None:
    """Where the fit to one draw ends; None where it does not."""
    drawn = Drawn(fitted.problem, fitted.here, noise)
    best = descend(drawn, fitted.theta, drawn.shifted(fitted.here), tolerance=_NEAR)
    for start in fitted.starts:
        other = descend(drawn, start, evaluations=40, tolerance=_NEAR)
        best = other if other.evaluation.cost < best.evaluation.cost else best
    tick()
    return best.theta if best.converged else None


def _starts(fit: Fit) -> list[FloatArray]:
    """Other fits as good, from which the search begins too."""
    estimate = solved(fit)
    names = [unknown.name for unknown in estimate.problem.unknowns]
    own = estimate.solution.theta
    return [
        np.array([rival.entries.get(name, entry) for name, entry in zip(names, own, strict=True)])
        for rival in estimate.rivals
    ]


def _told(fit: Fit, thetas: list[FloatArray | None], count: int) -> Bootstrap:

    problem = solved(fit).problem
    first = problem.records[0].place
    asked = [(place, unknown) for place, unknown in enumerate(problem.unknowns) if not unknown.nuisance]
    samples: dict[str, list[float]] = {name: [] for name in fit.parameters}
    done = [theta for theta in thetas if theta is not None]
    for theta in done:
        # Branches and modes are named by their place in the row of time constants, in each fit anew.
        order = Order(problem.in_reference(theta, first))
        for place, unknown in asked:
            samples[order(unknown.name)].append(unknown.value(float(theta[place])))
    found = {name: np.array(values) for name, values in samples.items() if len(values) == len(done) > 0}
    seen = {name: np.isfinite(fit.parameters[name].standard_error) for name in found}
    ends = {name: np.quantile(values, [0.025, 0.975]) for name, values in found.items()}
    return Bootstrap(
        samples=found,
        intervals={
            name: (float(low), float(high)) if seen[name] else fit.parameters[name].interval
            for name, (low, high) in ends.items()
        },
        standard_errors={
            name: float(np.std(values, ddof=1)) if seen[name] else float("inf") for name, values in found.items()
        },
        failed=count - len(done),
    )
