"""Parameters of several strips, each with its own fit: how far strips of this make differ, and the next one.

A fit of one strip cannot know this. Estimates are held as they are fitted, in their logarithm or as they are, with the
error that each fit states: the way of the next mounting (``random_effect``), and its posterior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.unknowns import Unknown, actuator_unknown
from ipmclab.measurement.random_effect import FEWEST, random_effect
from ipmclab.posterior.convergence import Convergence
from ipmclab.posterior.coordinates import Straight
from ipmclab.posterior.sampling import sample

FloatArray = npt.NDArray[np.float64]

SEED: Final = 20261124
STEPS: Final = 4000
WIDE: Final = 3.0
"""Scale of a scatter's half Cauchy distribution beforehand, over what the values show: nearly flat where it lies."""

_KEPT: Final = 2000


@dataclass(frozen=True)
class Sampled:
    """The posterior of one parameter over strips.

    Parameters
    ----------
    between : (float, (float, float))
        Standard deviation between strips, of the logarithm or [SI], with its 95 % interval.
    next_strip : (float, float) [SI]
        Where the value of the next strip lies with 95 %.
    convergence : Convergence
    """

    between: tuple[float, tuple[float, float]]
    next_strip: tuple[float, float]
    convergence: Convergence


@dataclass(frozen=True)
class ParameterOfStrips:
    """One parameter over several strips.

    Parameters
    ----------
    name, unit : str
    values : tuple of float [SI]
        Of the strips whose fits determine it.
    strips : tuple of str
    is_log : bool
        Whether it is the logarithm that is distributed.
    typical : float [SI]
    between : float
        Standard deviation between strips, of the logarithm or [SI], the errors of the fits taken off.
    p_value : float
        How often strips that are alike differ as much.
    next_strip : (float, float) [SI], optional
        95 %; None with fewer than three strips.
    sampled : Sampled, optional
    """

    name: str
    unit: str
    values: tuple[float, ...]
    strips: tuple[str, ...]
    is_log: bool
    typical: float
    between: float
    p_value: float
    next_strip: tuple[float, float] | None
    sampled: Sampled | None = None


def compare_fits(fits: Sequence[Fit], *, posterior: bool = False, seed: int = SEED) -> tuple[ParameterOfStrips, ...]:
    """Hold the parameters of several strips side by side.

    Parameters
    ----------
    fits : sequence of Fit
        Of one strip each.
    posterior : bool
        Whether the scatter is sampled too (extra ``bayes``).
    seed : int

    Raises
    ------
    InputError
        Fewer than two fits, two fits of one strip, or no parameter that two of them determine.
    IpmclabError
        Chains do not agree.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ipmclab import identify, load_actuator, simulate
    >>> from ipmclab.sample import Sample
    >>> strip, leak, fits = load_actuator("friend-2"), "circuit.dc_resistivity", []
    >>> for name, value in (("a", 30.0), ("b", 40.0), ("c", 36.0)):
    ...     other = replace(strip.replace(**{leak: value}), sample=Sample(id=name))
    ...     run = simulate(other, "step 1 V", duration=20, rate=20)
    ...     fits.append(identify(other, run, free=leak))
    >>> (found,) = compare_fits(fits)
    >>> found.strips, round(found.typical), found.next_strip[0] < 30.0 < 40.0 < found.next_strip[1]
    (('a', 'b', 'c'), 35, True)
    """
    strips = [_strip_of(fit) for fit in fits]
    for place, one in enumerate(strips):
        if one in strips[:place]:
            raise InputError(
                f"two fits are of the strip {one!r}",
                code="same-strip",
                where="fits",
                repair="fit all runs of a strip together, and give each strip its own sample id",
            )
    if len(fits) < 2:
        raise InputError(
            "one fit says nothing of another strip",
            code="too-few-strips",
            where="fits",
            repair="give fits of three strips or more",
        )
    names = dict.fromkeys(name for fit in fits for name in fit.parameters if name in fit.actuator.parameters())
    found = (_one(name, fits, strips, posterior=posterior, seed=seed) for name in names)
    estimated = tuple(one for one in found if one is not None)
    if not estimated:
        raise InputError(
            "no two of the fits determine the same parameter",
            code="nothing-shared",
            where="fits",
            repair="identify the same parameters of each strip",
        )
    return estimated


def _strip_of(fit: Fit) -> str:
    own = fit.actuator.sample
    return fit.actuator.name if own is None else own.id


def _one(
    name: str, fits: Sequence[Fit], strips: Sequence[str], *, posterior: bool, seed: int
) -> ParameterOfStrips | None:
    having = [(strip, fit) for strip, fit in zip(strips, fits, strict=True) if name in fit.parameters]
    known = [(strip, fit.parameters[name]) for strip, fit in having]
    known = [(strip, one) for strip, one in known if one.determined and math.isfinite(one.standard_error)]
    if len(known) < 2:
        return None
    entry = actuator_unknown(having[0][1].actuator.parameters()[name], None)
    values = np.array([entry.entry(one.value) for _, one in known])
    errors = np.array([one.standard_error / abs(entry.chain(one.value)) for _, one in known])
    effect = random_effect(values, errors)
    scale = 1.0 if entry.log else entry.scale
    return ParameterOfStrips(
        name=name,
        unit=known[0][1].unit,
        values=tuple(one.value for _, one in known),
        strips=tuple(strip for strip, _ in known),
        is_log=entry.log,
        typical=entry.value(effect.mean),
        between=scale * effect.between,
        p_value=effect.p_value,
        next_strip=None if effect.next_one is None else _values(entry, effect.next_one),
        sampled=_sampled(name, entry, values, errors, seed) if posterior and len(known) >= FEWEST else None,
    )


def _values(entry: Unknown, ends: tuple[float, float]) -> tuple[float, float]:
    return entry.value(ends[0]), entry.value(ends[1])


def _sampled(name: str, entry: Unknown, values: FloatArray, errors: FloatArray, seed: int) -> Sampled:
    """The posterior: each mean is as likely as any other, and the standard deviation half Cauchy."""
    scale = WIDE * float(np.std(values, ddof=1))
    scale = max(scale, 1e-6 * float(np.abs(values).max()), 1e-12)
    own = np.square(errors)

    def weighted(logarithms: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        weights = 1.0 / (own + np.exp(2.0 * logarithms)[:, None])
        total = weights.sum(axis=1)
        return weights, weights @ values / total, total

    def density(entries: FloatArray) -> FloatArray:
        logarithms = np.clip(entries[:, 0], math.log(1e-6 * scale), math.log(1e6 * scale))
        weights, mean, total = weighted(logarithms)
        squares = np.sum(weights * (values - mean[:, None]) ** 2, axis=1)
        likelihood = 0.5 * (np.log(weights).sum(axis=1) - np.log(total) - squares)
        beforehand = logarithms - np.log1p(np.exp(2.0 * (logarithms - math.log(scale))))
        return np.where(logarithms == entries[:, 0], likelihood + beforehand, -np.inf)

    start = Straight(np.array([math.log(scale / WIDE)]), np.array([[0.5]]))
    chains = sample(density, start, [name], seed=seed, steps=STEPS)
    if not chains.judgement.agrees:
        raise IpmclabError(
            f"the chains do not agree after {STEPS} steps: {'; '.join(chains.judgement.complaints)}",
            code="posterior-not-converged",
            where=name,
            repair="leave --posterior out: the other interval of the comparison needs no chains",
        )
    logarithms = chains.vectors.reshape(-1)
    drawn = logarithms[:: max(len(logarithms) // _KEPT, 1)]
    _, mean, total = weighted(drawn)
    low, high = mixture_quantiles(mean, np.sqrt(1.0 / total + np.exp(2.0 * drawn)), (0.025, 0.975))
    least, middle, most = np.exp(np.quantile(logarithms, (0.025, 0.5, 0.975))) * (1.0 if entry.log else entry.scale)
    between = float(middle), (float(least), float(most))
    return Sampled(between, _values(entry, (low, high)), chains.judgement.of[name])


def mixture_quantiles(centre: FloatArray, deviation: FloatArray, shares: Sequence[float]) -> tuple[float, ...]:
    """Of a mixture of normal distributions, each as likely.

    Examples
    --------
    >>> [round(one, 2) for one in mixture_quantiles(np.zeros(2), np.ones(2), (0.025, 0.5))]
    [-1.96, 0.0]
    """
    from scipy.optimize import brentq

    low, high = float(np.min(centre - 40.0 * deviation)), float(np.max(centre + 40.0 * deviation))
    return tuple(
        float(brentq(lambda x, share=share: float(np.mean(ndtr((x - centre) / deviation))) - share, low, high))
        for share in shares
    )
