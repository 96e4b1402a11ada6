"""What strips of one make do: the posterior of a metric's mean, of its scatter, and of the next strip's reading.

The same model as ``mixed``: a linear one of the factors with random intercepts of strip and of mounting. Coefficients
and intercepts are normal under given standard deviations, and are integrated in closed form; Markov chains walk over
the logarithms of the standard deviations alone. Beforehand every coefficient is as likely as any other, and each
standard deviation has a half Cauchy distribution (Gelman, Bayesian Analysis 1 (2006) 515) whose scale is three times
what the factors leave of the readings: hardly anything is said of it, and it is never below zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, stdtr

from ipmclab.comparison.compare import HEADLINES, Comparison
from ipmclab.comparison.fits import WIDE, mixture_quantiles
from ipmclab.comparison.metric_model import MOUNTING, STRIP, MetricModel, StripDeviation, shares_of
from ipmclab.comparison.mixed import RESIDUAL
from ipmclab.comparison.own_scatter import own_scatter
from ipmclab.comparison.table import RunRow
from ipmclab.errors import InputError, IpmclabError
from ipmclab.posterior.convergence import Convergence
from ipmclab.posterior.coordinates import Straight
from ipmclab.posterior.packages import bayes_package
from ipmclab.posterior.sampling import Chains, sample

FloatArray = npt.NDArray[np.float64]

Known = tuple[float, tuple[float, float]]
"""A value and its 95 % interval."""

SEED: Final = 20261124
STEPS: Final = 4000
_KEPT: Final = 2000  # draws, of all chains together: intervals are mixtures over them
_LEAST: Final = 1e-4  # of the scale: a standard deviation is not asked below
_MOST: Final = 1e3
_FEWEST: Final = 300.0  # effective draws with which the others of a strip are found by weights
_COMPONENTS: Final = (RESIDUAL, MOUNTING, STRIP)


@dataclass(frozen=True)
class Scatter:
    """One standard deviation of a population.

    Parameters
    ----------
    name : "repeats", "mounting" or "strip"
    median : float
        Of the logarithm where magnitudes are compared, else [SI].
    interval : (float, float)
        95 %.
    convergence : Convergence
    """

    name: str
    median: float
    interval: tuple[float, float]
    convergence: Convergence


@dataclass(frozen=True)
class OfCondition:
    """What a population says of one condition, each value with its 95 % interval [SI].

    Parameters
    ----------
    condition : mapping of factor to float
    next_strip, mean : (float, (float, float))
        What a strip that was not measured will read, once; what such strips read on average.
    by_mixed_model : (float, (float, float)) or None
        The next strip, as the mixed model has it.
    """

    condition: Mapping[str, float]
    next_strip: Known
    mean: Known
    by_mixed_model: Known | None


@dataclass(frozen=True, eq=False)
class Population:
    """What strips of one make do in one metric.

    Parameters
    ----------
    model : MetricModel
    scatter : tuple of Scatter
        Of strips, of mountings where these can be determined, and of repeats.
    strip_deviations : tuple of StripDeviation
        Each strip against what the others let expect of it, the farthest first; the ``p_value`` is how likely a strip
        of this make is as far out, for as many strips as were looked at (Holm). Empty for fewer than four strips.
    steps : int
        Of each walker, until the chains agreed.
    seed : int
    """

    model: MetricModel
    scatter: tuple[Scatter, ...]
    strip_deviations: tuple[StripDeviation, ...]
    steps: int
    seed: int
    _sums: _Sums = field(repr=False)
    _components: FloatArray = field(repr=False)

    def conditions(self) -> list[OfCondition]:
        """What it says of each condition that was measured."""
        return [
            OfCondition(one, self.next_strip(one), self.mean(one), self.model.next_strip(one))
            for one in self.model.conditions()
        ]

    def mean(self, condition: Mapping[str, float]) -> Known:
        """What strips of this make read on average, with its 95 % interval.

        Parameters
        ----------
        condition : mapping of factor to float [SI]
            Every one of ``model.factors``.
        """
        row = self.model.row_of(condition)
        return self._known(*self._sums.expected(self._components, row))

    def next_strip(self, condition: Mapping[str, float]) -> Known:
        """What a strip that was not measured will read, once, in a mounting of its own, with its 95 % interval."""
        centre, variance = self._sums.expected(self._components, self.model.row_of(condition))
        return self._known(centre, variance + self._components.sum(axis=1))

    def _known(self, centre: FloatArray, variance: FloatArray) -> Known:
        low, middle, high = mixture_quantiles(centre, np.sqrt(variance), (0.025, 0.5, 0.975))
        if self.model.is_ratio:
            low, middle, high = (math.exp(min(one, 700.0)) for one in (low, middle, high))
        return middle, (low, high)


def population_of(model: MetricModel, *, seed: int = SEED, steps: int = STEPS) -> Population:
    """Sample what strips of one make do in one metric (emcee), and judge the chains (ArviZ).

    Parameters
    ----------
    model : MetricModel
    seed : int
        The same seed gives the same answer.
    steps : int
        Most steps of each walker.

    Raises
    ------
    InputError
        Fewer than three strips, or runs that cannot determine how far strips differ; packages that are not installed.
    IpmclabError
        The chains do not agree: nothing is reported.

    Examples
    --------
    >>> from ipmclab.comparison.metric_model import model_metric
    >>> from ipmclab.comparison.table import RunRow
    >>> from ipmclab.quality.metrics import Metric
    >>> def run(strip, size):
    ...     metric = Metric("largest", "displacement", size, "m", None, "as printed")
    ...     return RunRow("run.nc", strip, "1", "", "", "step", {}, {"displacement.largest": metric})
    >>> rows = [run(*one) for one in (("a", 1.0e-3), ("a", 1.1e-3), ("b", 1.3e-3), ("b", 1.2e-3), ("c", 0.8e-3))]
    >>> found = population_of(model_metric("displacement.largest", "step", rows, ()))
    >>> value, (low, high) = found.next_strip({})
    >>> low < 0.8e-3 < value < 1.3e-3 < high
    True
    """
    if model.next_strip(model.conditions()[0]) is None:
        raise InputError(
            f"{len(model.samples)} strips do not show how much strips differ in {model.label}",
            code="too-few-strips",
            where=f"{model.waveform}: {model.key}",
            repair="measure three strips or more, one of them twice",
        )
    bayes_package("emcee")
    sums = _Sums.of(model.design, model.values, model.rows)
    chains, names = _walk(model, sums, seed, steps)
    flat = chains.vectors.reshape(-1, len(names))
    low, middle, high = np.exp(np.quantile(flat, (0.025, 0.5, 0.975), axis=0))
    scatter = tuple(
        Scatter(name, float(middle[at]), (float(low[at]), float(high[at])), chains.judgement.of[name])
        for at, name in enumerate(names)
    )
    components = _variances(_thinned(flat), names)
    return Population(
        model=model,
        scatter=tuple(reversed(scatter)),
        strip_deviations=_deviations(model, sums, components, seed, steps),
        steps=chains.steps,
        seed=seed,
        _sums=sums,
        _components=components,
    )


def populations_of(
    comparison: Comparison,
    *,
    seed: int = SEED,
    steps: int = STEPS,
    on_progress: Callable[[int, int], None] = lambda *_: None,
) -> tuple[dict[str, Population], dict[str, str]]:
    """Sample what strips of one make do, in each metric by which strips are distinguished.

    Parameters
    ----------
    comparison : Comparison
        What ``compare`` returned. Largest displacement and force and their amplitudes are sampled, or else the metrics
        that it was asked for.
    seed, steps : int
        As ``population_of`` takes them.
    on_progress : function of (int, int), optional
        Called with how many metrics are done, and of how many.

    Returns
    -------
    populations : mapping of name to Population
        By waveform and metric.
    unknown : mapping of name to str
        Why nothing is reported of others.
    """
    models = [one for one in comparison.models if one.key in HEADLINES] or list(comparison.models)
    found: dict[str, Population] = {}
    unknown: dict[str, str] = {}
    for place, model in enumerate(models):
        name = f"{model.waveform}: {model.label}"
        on_progress(place, len(models))
        try:
            found[name] = population_of(model, seed=seed, steps=steps)
        except IpmclabError as error:
            if error.code == "missing-package":
                raise
            unknown[name] = error.message
    return found, unknown


@dataclass(frozen=True, eq=False)
class _Sums:
    """What the likelihood needs of the readings: products within mountings, and sums over each.

    Parameters
    ----------
    within : float array, shape (k, k)
        Products of the columns, the readings last, about their means over each mounting.
    sums : float array, shape (n_mounting, k)
    counts : float array, shape (n_mounting,)
    strips : float array, shape (n_strip, n_mounting)
        1 where a mounting is of a strip.
    """

    within: FloatArray
    sums: FloatArray
    counts: FloatArray
    strips: FloatArray

    @classmethod
    def of(cls, design: FloatArray, values: FloatArray, rows: Sequence[RunRow]) -> _Sums:
        columns = np.column_stack([design, values])
        mountings = [(row.strip, row.mounting) for row in rows]
        each = list(dict.fromkeys(mountings))
        chosen = [np.array([one == of for of in mountings]) for one in each]
        within = sum(
            ((part := columns[of] - columns[of].mean(axis=0)).T @ part for of in chosen),
            np.zeros((columns.shape[1],) * 2),
        )
        strips = list(dict.fromkeys(strip for strip, _ in each))
        return cls(
            np.asarray(within),
            np.array([columns[of].sum(axis=0) for of in chosen]),
            np.array([float(of.sum()) for of in chosen]),
            np.array([[float(one == strip) for one, _ in each] for strip in strips]),
        )

    def log_likelihood(self, components: FloatArray) -> FloatArray:
        """Restricted likelihood under variances of repeats, mountings and strips, shape (n, 3) to (n,)."""
        products, logarithm = self._products(components)
        own, across, squares = products[:, :-1, :-1], products[:, :-1, -1], products[:, -1, -1]
        solved = np.linalg.solve(own, across[:, :, None])[:, :, 0]
        left = squares - np.sum(across * solved, axis=1)
        return np.asarray(-0.5 * (logarithm + np.linalg.slogdet(own)[1] + left))

    def expected(self, components: FloatArray, row: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and variance of what the design says in a row, under each of some variances."""
        products, _ = self._products(components)
        inverse = np.linalg.inv(products[:, :-1, :-1])
        centre = np.einsum("pij,pj,i->p", inverse, products[:, :-1, -1], row)
        return centre, np.einsum("pij,i,j->p", inverse, row, row)

    def _products(self, components: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``A' V^-1 A`` of all columns, and the logarithm of the determinant of V."""
        repeats, mounting, strip = (components[:, at, None] for at in range(3))
        variances = repeats + self.counts * mounting
        weights = 1.0 / (self.counts * variances)
        found = self.within / repeats[:, :, None] + np.einsum("pj,jk,jl->pkl", weights, self.sums, self.sums)
        totals = np.einsum("gj,pj,jk->pgk", self.strips, 1.0 / variances, self.sums)
        sizes = (self.counts / variances) @ self.strips.T
        beyond = strip / (1.0 + strip * sizes)
        found = found - np.einsum("pg,pgk,pgl->pkl", beyond, totals, totals)
        logarithm = np.sum((self.counts - 1.0) * np.log(repeats) + np.log(variances), axis=1)
        return found, logarithm + np.sum(np.log1p(strip * sizes), axis=1)


def _walk(model: MetricModel, sums: _Sums, seed: int, steps: int) -> tuple[Chains, list[str]]:
    """Chains over the logarithms of the standard deviations that these readings can determine."""
    left = model.values - model.design @ np.linalg.lstsq(model.design, model.values)[0]
    scale = math.sqrt(float(left @ left) / max(len(left) - model.design.shape[1], 1))
    names = [name for name in _COMPONENTS if name in model.fit.variances]
    lowest, highest = math.log(_LEAST * scale), math.log(_MOST * scale)

    def density(entries: FloatArray) -> FloatArray:
        inside = np.all((entries > lowest) & (entries < highest), axis=1)
        held = np.clip(entries, lowest, highest)
        beforehand = np.sum(held - np.log1p(np.exp(2.0 * (held - math.log(WIDE * scale)))), axis=1)
        return np.where(inside, beforehand + sums.log_likelihood(_variances(held, names)), -np.inf)

    variances = [max(model.fit.variances[name], (0.1 * scale) ** 2) for name in names]
    middle = 0.5 * np.log(variances)
    chains = sample(density, Straight(middle, 0.5 * np.eye(len(names))), names, seed=seed, steps=steps)
    if not chains.judgement.agrees:
        raise IpmclabError(
            f"the chains do not agree after {steps} steps: {'; '.join(chains.judgement.complaints)}",
            code="posterior-not-converged",
            where=f"{model.waveform}: {model.key}",
            repair="measure more strips, or look at the interval of the mixed model, which needs no chains",
        )
    return chains, names


def _thinned(draws: FloatArray) -> FloatArray:
    return draws[:: max(len(draws) // _KEPT, 1)]


def _variances(entries: FloatArray, names: Sequence[str]) -> FloatArray:
    """Variances of repeats, mountings and strips, 0 where nothing determines one, shape (n, 3)."""
    found = np.zeros((len(entries), len(_COMPONENTS)))
    for at, name in enumerate(names):
        found[:, _COMPONENTS.index(name)] = np.exp(2.0 * entries[:, at])
    return found


def _deviations(
    model: MetricModel, sums: _Sums, components: FloatArray, seed: int, steps: int
) -> tuple[StripDeviation, ...]:
    """Each strip against the posterior of the others: weights take its own readings out of that of all.

    Where one strip moves the posterior so far that few draws would have weight, that of the others is sampled again.
    """
    found = []
    whole = sums.log_likelihood(components)
    for sample_id in model.samples if len(model.samples) >= 4 else ():
        own = np.array([row.sample == sample_id for row in model.rows])
        x = model.design[~own]
        if len(x) <= x.shape[1] or np.linalg.matrix_rank(x) < x.shape[1]:
            continue  # the strip alone has a level of a factor
        others = [row for row in model.rows if row.sample != sample_id]
        rest, drawn = _Sums.of(x, model.values[~own], others), components
        weights = _weights(rest.log_likelihood(components) - whole)
        if 1.0 / float(np.sum(weights**2)) < _FEWEST:
            drawn = _of_the_others(model, own, rest, seed, steps)
            weights = np.full(len(drawn), 1.0 / len(drawn))
        mine = [row for row in model.rows if row.sample == sample_id]
        shares = shares_of(mine)
        centre, variance = rest.expected(drawn, model.design[own].mean(axis=0))
        among = variance + drawn @ [shares[name] for name in _COMPONENTS]
        scatter = own_scatter(_less_effects(model, own, x), [row.mounting for row in mine])
        more = scatter.beyond(drawn[:, :2] @ [shares[name] for name in _COMPONENTS[:2]])
        value = float(model.values[own].mean())
        # Of each draw the scatter among strips is given; that of the strip itself is known by its own readings.
        freedom = scatter.freedom * ((among + more) / np.where(more > 0.0, more, 1.0)) ** 2
        away = (value - centre) / np.sqrt(among + more)
        below = float(weights @ np.where(more > 0.0, stdtr(freedom, away), ndtr(away)))
        found.append((sample_id, value - float(weights @ centre), 2.0 * min(below, 1.0 - below)))
    return model.judged(found)


def _less_effects(model: MetricModel, own: npt.NDArray[np.bool_], others: FloatArray) -> FloatArray:
    """The readings of a strip less what the factors do in the others."""
    effects = np.linalg.lstsq(others, model.values[~own])[0]
    return np.asarray(model.values[own] - model.design[own] @ effects)


def _of_the_others(model: MetricModel, own: npt.NDArray[np.bool_], rest: _Sums, seed: int, steps: int) -> FloatArray:
    from ipmclab.comparison.metric_model import model_metric

    rows = [row for row, is_own in zip(model.rows, own, strict=True) if not is_own]
    others = model_metric(model.key, model.waveform, rows, model.factors)
    if others is None:
        raise IpmclabError("the others are too few", code="too-few-strips", where=model.key, repair="measure more")
    chains, names = _walk(others, rest, seed, steps)
    return _variances(_thinned(chains.vectors.reshape(-1, len(names))), names)


def _weights(logarithms: FloatArray) -> FloatArray:
    found = np.exp(logarithms - logarithms.max())
    return np.asarray(found / found.sum())
