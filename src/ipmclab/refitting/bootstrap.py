"""The parametric bootstrap: fit again to what the fitted model would have given under other draws of the noise.

A fit to readings that were drawn again is the same problem with its residuals shifted by a draw of the noise: no
reading is made, and nothing is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.engine import Engine, Here
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.solved import solved
from ipmclab.kinds import tell_kinds
from ipmclab.one_thread import on_one_thread
from ipmclab.progress import OnProgress, reporting_to, stage
from ipmclab.refitting.again import fits_again, fitted, values_of
from ipmclab.run import FloatArray

SEED: Final = 20261121  # a date: any would do
FEWEST_DRAWS: Final = 40  # draws of which a 95 % interval leaves one out on each side


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


@tell_kinds
@on_one_thread
def bootstrap(
    fit: Fit, count: int = 1000, *, seed: int = SEED, engine: Engine | None = None, progress: OnProgress | None = None
) -> Bootstrap:
    """Fit again to readings drawn again, and see how the parameters scatter.

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
        Called with what is being done, and the fraction that is done.

    Returns
    -------
    bootstrap : Bootstrap

    Raises
    ------
    InputError
        A fit that was read from a file, or too few draws.
    IpmclabError
        Fits to so many draws failed that too few are left.

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
    correlated = solved(fit).correlated
    with reporting_to(progress):
        stage(f"bootstrap of {count} fits", 0.0, 1.0, usual=count)
        shifts = _shifts(correlated, count, np.random.default_rng(seed))
        thetas = fits_again(fitted(fit), shifts, count, engine or Here())
    return _told(fit, thetas, count)


def _shifts(correlated: Correlated, count: int, generator: np.random.Generator) -> Iterator[FloatArray]:
    """What residuals at the fit are shifted by where only noise that is drawn again is left of them."""
    here = correlated.solution.evaluation
    silent = np.asarray(~here.rows[:-1].any(axis=0))  # readings at the end of their range, which only bound the model
    for _ in range(count):
        # Away from what a bound says, a residual is model less reading, and the reading is the model here and noise.
        yield np.where(silent, 0.0, correlated.drawn(generator)) - here.residual


def _told(fit: Fit, thetas: list[FloatArray | None], count: int) -> Bootstrap:
    problem = solved(fit).problem
    done = [theta for theta in thetas if theta is not None]
    if len(done) < FEWEST_DRAWS:
        raise IpmclabError(
            f"{count - len(done)} of {count} fits to drawn readings failed, and {len(done)} do not give a 95 % "
            f"interval, which needs {FEWEST_DRAWS}",
            code="too-few-draws",
            where="count",
            repair="free fewer parameters: identify says which these runs determine; or draw more",
        )
    samples = values_of(problem, done)
    found = {name: samples[name] for name in fit.parameters if np.isfinite(samples.get(name, np.nan)).all()}
    finite = {name: np.isfinite(fit.parameters[name].standard_error) for name in found}
    ends = {name: np.quantile(values, [0.025, 0.975]) for name, values in found.items()}
    return Bootstrap(
        samples=found,
        intervals={
            name: (float(low), float(high)) if finite[name] else fit.parameters[name].interval
            for name, (low, high) in ends.items()
        },
        standard_errors={
            name: float(np.std(values, ddof=1)) if finite[name] else float("inf") for name, values in found.items()
        },
        failed=count - len(done),
    )
