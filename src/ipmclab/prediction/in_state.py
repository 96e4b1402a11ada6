"""A fitted strip in a state that its fit may not contain: its parameters there, how well they are known,
doubts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.fit.ages import rates_of
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_file import fit_of
from ipmclab.model import Actuator
from ipmclab.model.environment.age import AGE, SCALES, Age, grown
from ipmclab.prediction.known_covariance import KnownCovariance
from ipmclab.run import Finding, Run
from ipmclab.strip_state.dose import dose_now
from ipmclab.strip_state.doubtful import doubtful, extrapolated
from ipmclab.strip_state.in_state import InState, in_state
from ipmclab.strip_state.run_state import RunState
from ipmclab.strip_state.state_of_run import says_environment, state_of

FloatArray = npt.NDArray[np.float64]


def state_in(fit: Fit | None, actuator: Actuator, run: Run) -> RunState | None:
    """The state of a strip in a run; None where nothing follows it, or the run does not say it.

    A run of the fit is in the state that the fit found; any other comes after the last run of the fit.

    Parameters
    ----------
    fit : Fit or None
        That the actuator carries.
    actuator : Actuator
    run : Run
    """
    if fit is not None:
        for observation in fit.observations:
            if observation.content_sha256 == run.content_sha256:
                return observation.state
    follows = bool(actuator.structure.environment) and says_environment(run)
    rates = rates_of(fit)
    if not follows and not rates:
        return None
    state = state_of(actuator, run, label="run") if follows else RunState()
    states = _seen(fit)
    doses = {scale: dose_now(states, scale) for scale in {Age.of(name).scale for name in rates}}
    return replace(state, doses=doses)


def _seen(fit: Fit | None) -> list[RunState]:
    """The states in which the runs of a fit were."""
    return [one.state for one in fit.observations if one.state is not None] if fit is not None else []


def as_it_is_now(actuator: Actuator) -> Actuator:
    """A fitted strip after the last run of its fit, in the reference state; the same where nothing of it ages.

    Parameters
    ----------
    actuator : Actuator
        With the table of its fit.
    """
    if actuator.fit_table is None:
        return actuator
    try:
        fit = fit_of(actuator, where=actuator.name)
    except InputError:  # a table that no fit wrote says nothing of ages, as it says nothing of errors (``sure_answer``)
        return actuator
    rates = rates_of(fit)
    factors = grown(rates, {scale: dose_now(_seen(fit), scale) for scale in SCALES})
    aged = {name: value * factors.get(name, 1.0) for name, value in actuator.parameter_values.items()}
    return replace(actuator, parameter_values=aged) if rates else actuator


def environment_of_run(fit: Fit | None, actuator: Actuator, run: Run, label: str) -> list[Finding]:
    """What is to be said of the environment of a new run: where its fit never was, not in equilibrium, water on it.

    Parameters
    ----------
    fit : Fit or None
        That the actuator carries.
    actuator : Actuator
    run : Run
    label : str
        For the messages.
    """
    if not actuator.structure.environment:
        return []
    if not says_environment(run):
        return [
            Finding(
                "environment-not-stated",
                "warning",
                f"{label} does not say its temperature and humidity: it was predicted in the state of reference",
                "give the run its temperature and relative_humidity",
            )
        ]
    state = state_in(fit, actuator, run)
    if state is None:
        return []
    return [*extrapolated(state, _seen(fit), label), *doubtful(actuator, run, state, label)]


def known_in_state(
    known: KnownCovariance, actuator: Actuator, state: RunState, rates: Mapping[str, float]
) -> tuple[tuple[str, ...], FloatArray]:
    """What is known of the parameters of a strip in a state, with what is known of its water content.

    Parameters
    ----------
    known : KnownCovariance
        Of the reference state, with the laws and with how fast parameters age.
    actuator : Actuator
        As it is in the reference state.
    state : RunState
    rates : mapping of name to float

    Returns
    -------
    names : tuple of str
    covariance : float array, shape (n_names, n_names) [SI]
    """
    there, moves = moves_in_state(known.names, actuator, state, rates)
    covariance = moves.T @ known.covariance @ moves
    if state.found is None:  # else it is a run of the fit, whose readings say how wet the strip was
        covariance += np.outer(there.by_water, there.by_water) * state.standard_uncertainty**2
    return there.names, covariance


def moves_in_state(
    names: Sequence[str], actuator: Actuator, state: RunState, rates: Mapping[str, float]
) -> tuple[InState, FloatArray]:
    """The parameters of a strip in a state, and how they move with some of the reference state, laws and rates too.

    Returns
    -------
    there : InState
    moves : float array, shape (n_names, n_there)
    """
    own = [name for name in names if not name.startswith(AGE)]
    there = in_state(actuator.parameter_values, state, own, water=state.found, rates=rates)
    nothing = np.zeros(len(there.names))
    rows = dict(zip(own, there.by, strict=True)) | {name: there.by_rate.get(name, nothing) for name in rates}
    return there, np.array([rows.get(name, nothing) for name in names]).reshape(len(names), len(there.names))
