"""Whether Markov chains give the same, and how much: what has to hold before anything is reported of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.posterior.packages import bayes_package

FloatArray = npt.NDArray[np.float64]

LARGEST_R_HAT: Final = 1.01
"""Rank-normalised split R-hat (Vehtari et al. 2021) of the ensembles, the walkers of each taken together: they are too
many, and each too short, for an R-hat of their own (Margossian et al. 2024)."""

LEAST_SIZE: Final = 1000.0
"""Effective samples, of the bulk and of the tails: an end of a 95 % interval is then known to 0.09 of the deviation."""

_TAILS: Final = (0.05, 0.95)
"""Quantiles whose effective size is that of the tails (Vehtari et al. 2021)."""

LEAST_LENGTHS: Final = 50.0
"""Autocorrelation times that the chains must be long, for these to be known (Foreman-Mackey et al. 2013)."""


@dataclass(frozen=True)
class Convergence:
    """Of one entry.

    Parameters
    ----------
    r_hat : float
    bulk, tail : float
        Effective sample sizes.
    autocorrelation_time : float
        In steps.
    """

    r_hat: float
    bulk: float
    tail: float
    autocorrelation_time: float


@dataclass(frozen=True)
class Judgement:
    """Of all entries.

    Parameters
    ----------
    of : mapping of name to Convergence
    lengths : float
        Length of the chains in the longest autocorrelation time.
    complaints : tuple of str
        What does not hold, the worst entry of each kind; empty where the chains agree.
    """

    of: Mapping[str, Convergence]
    lengths: float
    complaints: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether the chains may be reported."""
        return not self.complaints


def judge(chains: FloatArray, names: Sequence[str], ensembles: int) -> Judgement:
    """Judge chains.

    Parameters
    ----------
    chains : float array, shape (n_chain, n_draw, n_entry)
        Those of an ensemble one after the other.
    names : sequence of str
    ensembles : int
    """
    arviz, emcee = bayes_package("arviz"), bayes_package("emcee")
    found = {}
    for number, name in enumerate(names):
        one = chains[:, :, number]
        with np.errstate(invalid="ignore", divide="ignore"):  # a walker that never moved has no autocorrelation
            time = float(emcee.autocorr.integrated_time(one.T, quiet=True, tol=0, has_walkers=True)[0])
        found[name] = Convergence(
            r_hat=float(arviz.rhat(_together(one, ensembles))),
            bulk=float(arviz.ess(one)),
            tail=float(arviz.ess(one, method="tail", prob=_TAILS)),
            autocorrelation_time=time,
        )
    lengths = chains.shape[1] / max(one.autocorrelation_time for one in found.values())
    complaints = []
    name = max(found, key=lambda key: found[key].r_hat if np.isfinite(found[key].r_hat) else np.inf)
    if not found[name].r_hat <= LARGEST_R_HAT:
        complaints.append(f"R-hat of {name} is {found[name].r_hat:.3f} (at most {LARGEST_R_HAT:g})")
    for what, word in (("bulk", "effective samples"), ("tail", "effective samples in the tails")):
        name = min(found, key=lambda key: getattr(found[key], what))
        if not getattr(found[name], what) >= LEAST_SIZE:
            complaints.append(f"{name} has {getattr(found[name], what):.0f} {word} (at least {LEAST_SIZE:.0f})")
    name = max(found, key=lambda key: found[key].autocorrelation_time)
    if not lengths >= LEAST_LENGTHS:
        complaints.append(
            f"the chains are {lengths:.0f} autocorrelation times of {name} long (at least {LEAST_LENGTHS:.0f})"
        )
    return Judgement(found, lengths, tuple(complaints))


def _together(chains: FloatArray, ensembles: int) -> FloatArray:
    """The walkers of each ensemble as one chain, step by step, shape (n_ensemble, n_draw)."""
    separate = chains.reshape(ensembles, -1, chains.shape[1])
    return np.swapaxes(separate, 1, 2).reshape(ensembles, -1)
