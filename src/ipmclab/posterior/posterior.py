"""The posterior of a fit: samples of its parameters, given out only where the chains agree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.destination import replacing
from ipmclab.engine import Engine
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.identification.mountings.mountings import why_unknown
from ipmclab.identification.problem.stated import stated_covariance
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.solved import Estimate, solved
from ipmclab.kinds import tell_kinds
from ipmclab.model.order import Order
from ipmclab.model.parameters import Parameter
from ipmclab.posterior.convergence import Convergence, Judgement
from ipmclab.posterior.coordinates import Straight
from ipmclab.posterior.density import Density
from ipmclab.posterior.doubts import doubts
from ipmclab.posterior.packages import bayes_package
from ipmclab.posterior.sampling import LEAST_STEPS, Chains, sample
from ipmclab.prediction.remarks import averages
from ipmclab.progress import OnProgress, part, reporting_to, stage
from ipmclab.run import Finding
from ipmclab.units import CHANNELS, TIME, Quantity
from ipmclab.version import __version__

FloatArray = npt.NDArray[np.float64]

SEED: Final = 20261121  # a date: any would do
STEPS: Final = 5000  # of each walker (convention; whether chains agree is asked)
_AT_BOUND: Final = 0.1  # of an interval: samples that come so near to a bound are ended by it
_DRAWS: Final = 500  # of each chain that are kept: neighbours say nearly the same


@dataclass(frozen=True)
class SampledParameter:
    """One parameter of a posterior.

    Parameters
    ----------
    name : str
    unit, symbol : str
    quantity : Quantity or None
        Gives the unit that people read; None for slopes of sensors.
    mean, median, standard_deviation : float [SI]
    interval : pair of float [SI]
        From the 2.5th to the 97.5th percentile.
    prior : pair of float [SI] or None
        Value and standard uncertainty beforehand; None where every value between the bounds was as likely.
    at_bound : bool
        Whether the samples reach a bound of the parameter: then its bound, not the readings, ends the interval.
    is_free : bool
        Whether the fit moved it; else it is a fixed parameter whose stated uncertainty matters.
    convergence : Convergence
    interval_next_mounting : pair of float [SI] or None
        Where the fit expects the value of the next mounting of the strip; None where it cannot be estimated.
    is_average : bool
        Whether the mountings of the fit differ by more than their errors: the samples then hold for none of them.
    """

    name: str
    unit: str
    symbol: str
    quantity: Quantity | None
    mean: float
    median: float
    standard_deviation: float
    interval: tuple[float, float]
    prior: tuple[float, float] | None
    at_bound: bool
    is_free: bool
    convergence: Convergence
    interval_next_mounting: tuple[float, float] | None
    is_average: bool


@dataclass(frozen=True, eq=False)
class Posterior:
    """Samples of the parameters of a fit, from chains that agree.

    Parameters
    ----------
    actuator : str
        Its name.
    parameters : mapping of name to SampledParameter
    samples : mapping of name to float array, shape (n_chain, n_draw) [SI]
    log_density : float array, shape (n_chain, n_draw)
        Up to a constant, over the entries that the fit moves.
    left_out : tuple of str
        Free parameters that the readings do not show at all, and which the fit switched off.
    findings : tuple of Finding
        What contradicts the likelihood: residuals that no noise describes, a prior that is contradicted, mountings
        that differ.
    next_mounting_unknown : str
        Why nothing is said of the next mounting; empty where something is.
    runs : tuple of (label, content hash)
    seed, steps : int
        Of the chains; every walker made so many steps, of which the later half was kept.
    accepted : float
        Part of the proposals that were accepted.
    """

    actuator: str
    parameters: Mapping[str, SampledParameter]
    samples: Mapping[str, FloatArray] = field(repr=False)
    log_density: FloatArray = field(repr=False)
    left_out: tuple[str, ...]
    findings: tuple[Finding, ...]
    next_mounting_unknown: str
    runs: tuple[tuple[str, str], ...]
    seed: int
    steps: int
    accepted: float

    @cached_property
    def data(self) -> Any:
        """The same as ArviZ has samples, groups ``posterior`` and ``sample_stats``.

        That is ``arviz.InferenceData``, and from its version 1.0 on ``xarray.DataTree``.
        """
        arviz = bayes_package("arviz")
        about = {
            "actuator": self.actuator,
            "inference_library": "ipmclab",
            "inference_library_version": __version__,
            "runs": [content for _, content in self.runs],
            "seed": self.seed,
            "steps": self.steps,
        }
        groups = {"posterior": dict(self.samples), "sample_stats": {"lp": self.log_density}}
        if arviz.__version__.startswith("0."):
            return arviz.from_dict(**groups, posterior_attrs=about)
        return arviz.from_dict(groups, attrs={"posterior": about})

    def correlation(self, one: str, other: str) -> float:
        """Of two parameters, over all samples."""
        return float(np.corrcoef(self.samples[one].ravel(), self.samples[other].ravel())[0, 1])


@tell_kinds
def sample_posterior(
    fit: Fit, *, seed: int = SEED, steps: int = STEPS, engine: Engine | None = None, progress: OnProgress | None = None
) -> Posterior:
    """Draw samples of the parameters of a fit, by Markov chains (emcee), and judge them (ArviZ).

    The likelihood is that of the fit: its readings under the noise that their residuals show, integrated over the
    offset, the trend and the scale of each output's noise; what shapes that noise is sampled together with the
    parameters. A parameter with a prior has that; any other is as likely anywhere between its bounds, in its logarithm
    where the fit moves that. Fixed parameters whose stated uncertainty matters are sampled too.

    Parameters
    ----------
    fit : Fit
        From ``identify``, not from a file.
    seed : int
        The same seed gives the same samples.
    steps : int
        Most steps of each walker.
    engine : Engine, optional
        Who draws: this process where it is left out. The samples are the same, to the last bit; two ensembles of
        walkers walk at the same time, and no more.
    progress : function of (str, float), optional
        Called with a sentence and the fraction that is done. Whatever it raises ends the work.

    Returns
    -------
    posterior : Posterior

    Raises
    ------
    InputError
        A fit that was read from a file, fewer than 400 steps, packages that are not installed.
    IpmclabError
        The chains do not agree: nothing is reported of them.

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab import Run, identify, load_actuator, sample_posterior, simulate
    >>> strip = load_actuator("friend-2")
    >>> clean = simulate(strip, "step 1 V", duration=10, rate=20)
    >>> noise = 1e-4 * np.random.default_rng(20261121).standard_normal(200)
    >>> run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
    >>> fit = identify(strip, [run], free="circuit.dc_resistivity")
    >>> found = sample_posterior(fit).parameters["circuit.dc_resistivity"]
    >>> round(found.standard_deviation / fit.parameters["circuit.dc_resistivity"].standard_error, 1)
    1.0
    """
    if fit.estimate is None:
        raise InputError(
            "a fit that was read from a file no longer has its readings",
            code="no-readings",
            where="fit",
            repair="identify again, and sample that fit",
        )
    if steps < LEAST_STEPS:
        raise InputError(
            f"{steps} steps are too few", code="out-of-range", where="steps", repair=f"give {LEAST_STEPS} or more"
        )
    for package in ("emcee", "arviz"):
        bayes_package(package)
    with reporting_to(progress):
        return _sample(fit, solved(fit), seed, steps, engine)


def _sample(fit: Fit, estimate: Estimate, seed: int, steps: int, engine: Engine | None) -> Posterior:
    stage("looking for the valley that the readings leave open", 0.0, 0.05, 300)
    free = {unknown.base for unknown in estimate.problem.unknowns}
    stated = {n: p for n, p in estimate.parameters.items() if p.standard_uncertainty > 0.0 and n not in free}
    order = Order(estimate.problem.in_reference(estimate.solution.theta, estimate.problem.records[0].place))
    density = Density(estimate, stated, _together(fit, stated, order))
    names = [order(unknown.name) for unknown in density.unknowns]
    others = [_place(rival, density) for rival in estimate.rivals] if isinstance(density.coordinates, Straight) else []
    with part("", 0.05, 1.0):
        chains = sample(density, density.coordinates, names, seed=seed, steps=steps, others=others, engine=engine)
    if not chains.judgement.agrees:
        raise _not_converged(chains.judgement, steps)
    return _told(fit, density, chains, names, seed)


def _together(fit: Fit, stated: Mapping[str, Parameter], order: Order) -> dict[str, dict[str, float]]:
    """Covariance [SI] of what is stated of fixed parameters, by the names that they have in the problem."""
    found = {one: dict.fromkeys(stated, 0.0) for one in stated}
    for name, parameter in stated.items():
        found[name][name] = parameter.standard_uncertainty**2
    now = {order(name): name for name in stated if order(name) in fit.actuator.standard_uncertainties}
    for one, row in stated_covariance(fit.actuator, list(now)).items():
        found[now[one]] |= {now[other]: value for other, value in row.items()}
    return found


def _place(rival: Rival, density: Density) -> FloatArray:
    """Another fit as a vector of the density."""
    found, count = density.coordinates.middle.copy(), len(density.unknowns)
    found[:count] = rival.vector_of(density.unknowns, found[:count])
    return found


def _told(fit: Fit, density: Density, chains: Chains, names: list[str], seed: int) -> Posterior:
    estimate = solved(fit)
    known, averaged = fit.actuator.parameters(), averages(fit)
    unknowns = len(estimate.problem.unknowns)
    thin = max(chains.vectors.shape[1] // _DRAWS, 1)
    parameters: dict[str, SampledParameter] = {}
    samples: dict[str, FloatArray] = {}
    for number, (unknown, name) in enumerate(zip(density.unknowns, names, strict=True)):
        if unknown.nuisance:
            continue
        values = unknown.values(chains.vectors[:, :, number])
        low, median, high = (float(one) for one in np.quantile(values, (0.025, 0.5, 0.975)))
        parameters[name] = SampledParameter(
            name=name,
            **_unit(name, known),
            mean=float(values.mean()),
            median=median,
            standard_deviation=float(values.std()),
            interval=(low, high),
            prior=unknown.beforehand,
            at_bound=_at_bound(unknown, (low, high)),
            is_free=number < unknowns,
            convergence=chains.judgement.of[name],
            interval_next_mounting=fit.parameters[name].interval_next_mounting if name in fit.parameters else None,
            is_average=name in averaged,
        )
        samples[name] = values[:, ::thin]
    sequence = [name for name in (*fit.parameters, *parameters) if name in parameters]
    return Posterior(
        actuator=fit.actuator.name,
        parameters={name: parameters[name] for name in dict.fromkeys(sequence)},
        samples={name: samples[name] for name in dict.fromkeys(sequence)},
        log_density=chains.log_density[:, ::thin],
        left_out=tuple(name for name in fit.parameters if name not in parameters),
        findings=doubts(fit, estimate),
        next_mounting_unknown=why_unknown(fit),
        runs=fit.runs,
        seed=seed,
        steps=chains.steps,
        accepted=chains.accepted,
    )


def _at_bound(unknown: Unknown, interval: tuple[float, float]) -> bool:
    low, high = (unknown.entry(max(end, unknown.lower)) for end in interval)
    lower, upper = unknown.limits
    return low - lower < _AT_BOUND * (high - low) or upper - high < _AT_BOUND * (high - low)


def _unit(name: str, known: Mapping[str, Parameter]) -> dict[str, Any]:
    """Unit, symbol and quantity of a parameter of the actuator, or of the observation of one run."""
    base = name.partition("[")[0]
    if base in known:
        return {"unit": known[base].unit, "symbol": known[base].symbol, "quantity": known[base].quantity}
    what, _, output = base.removeprefix("observation.").partition(".")
    if what == "delay":
        return {"unit": TIME.unit, "symbol": "delay", "quantity": TIME}
    unit = CHANNELS[output].unit
    if what == "offset":
        return {"unit": unit, "symbol": "offset", "quantity": CHANNELS[output]}
    return {"unit": f"{unit}/s", "symbol": "drift", "quantity": None}


def _not_converged(judgement: Judgement, steps: int) -> IpmclabError:
    worst = max(judgement.of, key=lambda name: judgement.of[name].autocorrelation_time)
    return IpmclabError(
        f"the chains do not agree after {steps} steps: {'; '.join(judgement.complaints)}",
        code="posterior-not-converged",
        where="posterior",
        repair=f"give more steps (--steps {10 * steps}), state what is known of {worst} beforehand (--prior), fix it, "
        "or free fewer parameters",
    )


@tell_kinds
def write_posterior(posterior: Posterior, path: str | Path, *, overwrite: bool = False) -> None:
    """Write the samples as a netCDF file, which ``arviz.from_netcdf`` reads.

    Parameters
    ----------
    posterior : Posterior
    path : str or Path
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        The file exists, or its folder does not.
    """
    with replacing(path, overwrite=overwrite) as temporary:
        posterior.data.to_netcdf(str(temporary))
