"""A fit: an actuator identified from runs, with its uncertainty and its diagnosis."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.fit.known import Known
from ipmclab.fit.left_out import LeftOut
from ipmclab.fit.mountings import Mountings
from ipmclab.fit.observation import Observation
from ipmclab.fit.output_diagnosis import OutputDiagnosis
from ipmclab.fit.practical import Practical
from ipmclab.fit.profile import Profile
from ipmclab.fit.unmodelled import Unmodelled
from ipmclab.model import Actuator
from ipmclab.run import Finding
from ipmclab.shown import Shown

FloatArray = npt.NDArray[np.float64]

DETERMINED: Final = 0.42
"""A parameter is determined when its standard error is below this part of its value."""


@dataclass(frozen=True)
class FittedParameter:
    """One free parameter after a fit.

    Parameters
    ----------
    name : str
        Dotted; with the place of its run where each run has its own.
    value : float [SI]
    unit, symbol : str
    standard_error : float [SI]
        Infinite where the readings leave a direction free that moves it.
    interval : pair of float [SI]
        95 %: from the curvature where the error is small, from the profile of the likelihood where it is
        not; 0 or infinite where open.
    determined : bool
        Whether the readings fix it to better than 42 % (one standard error), within its bounds.
    at_bound : bool
    interval_next_mounting : pair of float [SI] or None
        95 % for its value at another clamping; None where runs of fewer than three mountings cannot determine it.
    prior : pair of float [SI] or None
        Value and standard uncertainty of what was known beforehand, where the fit used it.
    prior_of_literature : bool
        Whether that is what strips have by the literature, and nobody stated it of this one.
    """

    name: str
    value: float
    unit: str
    symbol: str
    standard_error: float
    interval: tuple[float, float]
    determined: bool
    at_bound: bool = False
    interval_next_mounting: tuple[float, float] | None = None
    prior: tuple[float, float] | None = None
    prior_of_literature: bool = False


@dataclass(frozen=True)
class Direction:
    """A combination of parameters that the readings do not determine.

    Parameters
    ----------
    coefficients : mapping of name to float
        Relative change of each parameter along it (unit length).
    sentence : str
        What is not known, and what would cure it.
    error : float
        Standard error along it, as a logarithm; infinite where the readings say nothing at all.
    cures : tuple of str
        What would determine it, the quickest first: ``measure`` and a parameter, or ``record`` and an output. Empty
        where nothing but more or better readings of the same kind would.
    """

    coefficients: Mapping[str, float]
    sentence: str
    error: float
    cures: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Fit(Shown):
    """What ``identify`` returns, and ``read_fit`` reads back.

    Parameters
    ----------
    actuator : Actuator
        With the fitted values; a parameter that each run has for itself is at the mean of them.
    parameters : mapping of name to FittedParameter
    undetermined : tuple of Direction
        Empty when nothing is free to move.
    correlations : mapping of name to mapping of name to float
        NaN where a parameter is not determined at all.
    rank : int
        Number of combinations of free parameters that the readings determine.
    singular_values : tuple of float
        Of the weighted logarithmic Jacobian, largest first: one over the standard error of each combination.
    observations : tuple of Observation
        One for each run, in the order of the call.
    findings : tuple of Finding
    converged : bool
    message : str
        How the search ended; why, where it did not converge.
    evaluations : int
        How often the model was run on all records.
    residuals : tuple of mapping of output to float array, shape (n_time,) [SI]
        Reading minus model, NaN where a reading was not used; empty in a fit that was read from a file.
    software_version : str
    covariance : mapping of name to mapping of name to float [SI]
        Of the free parameters, and of the fixed ones with a stated uncertainty; without the directions of which the
        readings say nothing, and not widened by other fits that are as good.
    mountings : Mountings or None
        What each mounting says by itself; None where all runs are of one.
    left_out : tuple of LeftOut
        Each run predicted by the others, where that was asked for.
    practical : Practical or None
        How well the readings separate the parameters.
    profiles : mapping of name to Profile
        Where ``profile`` followed them.
    procedure : mapping, optional
        The steps that came before it, as ``Characterisation.to_table`` gives them, where it is the joint fit of a
        procedure.
    diagnoses : tuple of OutputDiagnosis
        What is left of each output of each run: noise, or what follows the voltage.
    known : tuple of Known
        Quantities that the readings determine, whatever they leave open of the parameters: resistances, time constants,
        static gains, bandwidths, stiffness.
    unmodelled : mapping of output to Unmodelled
        Relaxations that the model may lack, as far as the readings allow them; without those that it meets exactly.
    estimate : object, optional
        The solved problem itself, for what may follow (``identification.solved`` knows what it is); None in a fit that
        was read from a file.
    """

    actuator: Actuator
    parameters: Mapping[str, FittedParameter]
    undetermined: tuple[Direction, ...]
    correlations: Mapping[str, Mapping[str, float]]
    rank: int
    singular_values: tuple[float, ...]
    observations: tuple[Observation, ...]
    findings: tuple[Finding, ...]
    converged: bool
    message: str
    evaluations: int = 0
    residuals: tuple[Mapping[str, FloatArray], ...] = field(default=())
    software_version: str = ""
    covariance: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    mountings: Mountings | None = None
    left_out: tuple[LeftOut, ...] = ()
    practical: Practical | None = None
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    procedure: Mapping[str, Any] | None = None
    diagnoses: tuple[OutputDiagnosis, ...] = ()
    known: tuple[Known, ...] = ()
    unmodelled: Mapping[str, Unmodelled] = field(default_factory=dict)
    estimate: object | None = field(default=None, repr=False)

    def __str__(self) -> str:
        """A line for the fit, one for each parameter, and what is not determined."""
        lines = [f"Fit of {self.actuator.name} to {len(self.observations)} run(s): {self.message}"]
        if not self.converged:
            lines[0] = f"{lines[0]} (did not converge)"
        width = max((len(name) for name in self.parameters), default=0)
        for name, one in self.parameters.items():
            low, high = one.interval
            value = f"{one.value:.6g} {one.unit}".rstrip() if one.determined else "not determined"
            bound = ", at its bound" if one.at_bound else ""
            lines.append(f"  {name:<{width}}  {value}, 95 % interval {low:.6g} to {high:.6g}{bound}")
        lines += [f"  not determined: {direction.sentence}" for direction in self.undetermined]
        return "\n".join(lines)

    __repr__ = __str__

    def summary(self) -> str:
        """The short answer: the parameters, what else is known, one verdict, and the findings that matter most.

        Returns
        -------
        summary : str
            Sentences and findings in lines of at most 100 columns; a row of the table is as wide as its names need.
            ``findings``, ``undetermined`` and a report say all.

        Examples
        --------
        >>> from ipmclab import identify, load_actuator, simulate
        >>> strip = load_actuator("friend-2")
        >>> fit = identify(strip, simulate(strip, "step 1 V", duration=40, rate=50), free="circuit.dc_resistivity")
        >>> print(fit.summary())
        parameter                       value                   95 % interval  unit
        circuit.dc_resistivity  43.42040816...
        This fit can be used to predict the current (residual ...
        parameter is determined.
        2 more findings: see fit.findings
        """
        # Found by its name when it is asked for, as what a notebook shows is: no value imports what words it.
        said: str = importlib.import_module("ipmclab.fit.answer").summary_of(self)
        return said

    @property
    def noise(self) -> tuple[Mapping[str, float], ...]:
        """Standard deviation of the residuals of each run and output [SI]."""
        return tuple(observation.noise for observation in self.observations)

    @property
    def runs(self) -> tuple[tuple[str, str], ...]:
        """Label and content hash of each run."""
        return tuple((observation.label, observation.content_sha256) for observation in self.observations)
