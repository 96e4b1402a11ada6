"""What a fitted strip would answer to a run, and how that moves with everything that the fit does not know exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.fit.ages import rates_of
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.record import ending_of
from ipmclab.identification.problem.unknowns import Unknown, actuator_unknown
from ipmclab.model import Actuator
from ipmclab.model.environment import Environment, equilibrium
from ipmclab.model.environment.age import AGE, Age
from ipmclab.model.environment.sorption import slope
from ipmclab.model.sensitivity import Kept, sensitivities
from ipmclab.planning.candidates import REST_BEFORE, Candidate
from ipmclab.prediction.own_of_mounting import own_of_mounting
from ipmclab.strip_state.dose import dose_now
from ipmclab.strip_state.in_state import in_state, strip_in_state
from ipmclab.strip_state.run_state import RunState
from ipmclab.strip_state.state_of_run import HUMIDITY_ERROR

FloatArray = npt.NDArray[np.float64]

_RATE_OF_AGE: Final = 0.1  # of a logarithm for each unit of dose: what counts as a change of order one


@dataclass(frozen=True, eq=False)
class Answer:
    """What a strip would answer to a signal, and how that moves.

    Parameters
    ----------
    time, voltage : float array, shape (n_time,) [s], [V]
        With the rest before the signal.
    outputs : mapping of output to float array, shape (n_time,) [SI]
        The current, and what the fit read.
    entries : mapping of output to float array, shape (n_time, n) [SI]
        By each entry of what is fitted: logarithms, or values over their scale.
    held : mapping of output to float array, shape (n_time, n_held)
        By each fixed value with a stated uncertainty.
    own : mapping of output to float array, shape (n_time, n_own) [SI]
        By the parameters that each run has for itself.
    water : mapping of output to float array, shape (n_time,) [SI]
        By the water of the strip, in its standard errors; empty where it is exact.
    """

    time: FloatArray
    voltage: FloatArray
    outputs: Mapping[str, FloatArray]
    entries: Mapping[str, FloatArray]
    held: Mapping[str, FloatArray]
    own: Mapping[str, FloatArray]
    water: Mapping[str, FloatArray]


class FittedStrip:
    """A fitted strip that is still clamped as in the last run of its fit, and as old as after it.

    Parameters
    ----------
    fit : Fit

    Raises
    ------
    InputError
        None of its runs has the noise that was found.
    """

    def __init__(self, fit: Fit) -> None:
        if not any(one.noise for one in fit.observations):
            raise InputError(
                "the fit does not state the noise of its runs: the information of another run is not known",
                code="no-noise",
                where="fit",
                repair="take the file as identify wrote it, or identify again",
            )
        self.fit = fit
        mounting = fit.observations[-1].mounting
        self.actuator = fit.actuator.replace(**own_of_mounting(fit, mounting))
        values = self.actuator.parameter_values
        bases = {name: name.removesuffix(ending_of(mounting)) for name in fit.covariance}
        of_strip = {name: base for name, base in bases.items() if base in values or base.startswith(AGE)}
        self.names = tuple(name for name in of_strip if name in fit.parameters)
        """What was fitted and is the same in the next run."""
        self.bases = tuple(of_strip[name] for name in self.names)
        self.held = tuple(name for name in of_strip if name not in fit.parameters)
        """Fixed values with a stated uncertainty."""
        each = dict.fromkeys(name.partition("[")[0] for name in fit.parameters if "[" in name)
        self.own = tuple(base for base in each if base in values and base not in self.bases)
        """What each run has for itself."""
        self.outputs = tuple(dict.fromkeys(name for one in fit.observations for name in one.noise))
        self.rates = rates_of(fit)
        self._kept = Kept()

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The entries that the fit moves."""
        known = self.actuator.parameters()
        return tuple(
            Unknown(base, base, None, False, _RATE_OF_AGE, -math.inf, math.inf)
            if base.startswith(AGE)
            else actuator_unknown(known[base], None)
            for base in self.bases
        )

    @cached_property
    def chains(self) -> FloatArray:
        """Derivative of each value by its entry."""
        values = [self.fit.parameters[name].value for name in self.names]
        return np.array([unknown.chain(value) for unknown, value in zip(self.unknowns, values, strict=True)])

    @cached_property
    def last_condition(self) -> Environment | None:
        """In which the strip was last; None where its parameters follow none, or nobody said it."""
        known_states = [one.state for one in self.fit.observations if one.state is not None]
        if not known_states or known_states[-1].temperature is None or known_states[-1].relative_humidity is None:
            return None
        return Environment(known_states[-1].temperature, known_states[-1].relative_humidity)

    def answer(self, candidate: Candidate, rate: float) -> Answer:
        """What the strip would answer to a run.

        Parameters
        ----------
        candidate : Candidate
        rate : float [Hz]
            Of the rows.
        """
        time = np.arange(round((REST_BEFORE + candidate.duration) * rate)) / rate
        voltage = candidate.signal.voltage(time - REST_BEFORE)
        asked = (*self.bases, *self.held, *self.own)
        strip, names, moves, by_water = self._moves(asked, self._state(candidate.condition))
        read = tuple(dict.fromkeys(("current", *self.outputs)))
        found = sensitivities(strip, names, time, voltage, "zero", outputs=read, asked=(), kept=self._kept)
        rows = dict(zip(read, found.parameters, strict=True))
        slopes = {output: rows[output] @ moves.T for output in self.outputs}
        first, last = len(self.bases), len(self.bases) + len(self.held)
        return Answer(
            time,
            voltage,
            dict(zip(read, found.values, strict=True)),
            {output: slopes[output][:, :first] * self.chains for output in self.outputs},
            {output: slopes[output][:, first:last] for output in self.outputs},
            {output: slopes[output][:, last:] for output in self.outputs},
            {output: rows[output] @ by_water for output in self.outputs} if by_water.any() else {},
        )

    def difference_to(self, rival: Actuator, candidate: Candidate, answer: Answer) -> dict[str, FloatArray]:
        """How far another model answers from the strip in the outputs of the fit [SI]."""
        state = self._state(candidate.condition)
        model = rival if state is None else strip_in_state(rival, state, {})
        found = sensitivities(model, (), answer.time, answer.voltage, "zero", outputs=self.outputs, asked=())
        return {
            output: values - answer.outputs[output] for output, values in zip(self.outputs, found.values, strict=True)
        }

    def _moves(
        self, asked: Sequence[str], state: RunState | None
    ) -> tuple[Actuator, tuple[str, ...], FloatArray, FloatArray]:
        """The strip in a state, its parameters, and by how much they move with what is asked, and with the water."""
        if state is None:
            return self.actuator, tuple(asked), np.eye(len(asked)), np.zeros(len(asked))
        plain = [name for name in asked if not name.startswith(AGE)]
        there = in_state(self.actuator.parameter_values, state, plain, water=state.found, rates=self.rates)
        rows = {**dict(zip(plain, there.by, strict=True)), **there.by_rate}
        moves = np.array([rows[name] for name in asked]).reshape(len(asked), len(there.names))
        strip = strip_in_state(self.actuator, state, self.rates)
        return strip, there.names, moves, there.by_water * state.standard_uncertainty

    def _state(self, condition: Environment | None) -> RunState | None:
        """The state of the strip in the next run; None where nothing of it follows one."""
        known_states = [one.state for one in self.fit.observations if one.state is not None]
        doses = {scale: dose_now(known_states, scale) for scale in {Age.of(name).scale for name in self.rates}}
        if condition is None:
            return replace(known_states[-1], doses=doses, found=None) if known_states else None
        values = self.actuator.parameter_values
        water = equilibrium(values, condition).water_content
        uncertainty = float(slope(values, condition.relative_humidity / 100.0)) * HUMIDITY_ERROR / 100.0
        return RunState(water, uncertainty, "assumed", condition.temperature, condition.relative_humidity, doses=doses)
