"""How far a simulated output may lie from the truth, and from what would be read: bands from a fit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95, wider_for_few
from ipmclab.errors import InputError
from ipmclab.fit.ages import rates_of
from ipmclab.fit.as_fitted import need_as_fitted
from ipmclab.fit.fit import Fit
from ipmclab.fit.mountings import Mounting
from ipmclab.fit.observation import Observation
from ipmclab.identification.mountings.common_error import common_covariance
from ipmclab.identification.problem.record import ending_of, own_endings
from ipmclab.kinds import tell_kinds
from ipmclab.measurement.random_effect import FEWEST
from ipmclab.model import Actuator
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.sensitivity import sensitivities
from ipmclab.model.simulate import with_shunt
from ipmclab.prediction.in_state import known_in_state, moves_in_state, state_in
from ipmclab.prediction.known_covariance import KnownCovariance, known_of
from ipmclab.prediction.own_of_mounting import own_of_mounting, strip_of_each_mounting
from ipmclab.run import Hold, Run
from ipmclab.strip_state.in_state import strip_in_state
from ipmclab.strip_state.run_state import RunState

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bands:
    """A simulated run with its uncertainty.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    predicted : mapping of output to float array, shape (n_time,) [SI]
    of_parameters : mapping of output to float array, shape (n_time,) [SI]
        Standard deviation from the parameters, if the model is right.
    of_noise : mapping of output to float array, shape (n_time,) [SI]
        Standard deviation of the noise of a reading, as the runs of the fit had it: zero and drift of a new run are not
        known beforehand, so those of the fit count as spread.
    left_out : tuple of str
        Free parameters of which nothing is known: the band does not contain what they may change.
    mounting : str
        Whether the band holds for the mountings of the fit (``"the fit's"``), for one that the fit never saw (``"the
        next"``), or for one of the fit with what that has for itself (``"mounting strip-7-a"``).
    of_model : mapping of output to float array, shape (n_time,) [SI]
        Standard deviation from relaxations that the model may lack, as far as the readings of the fit allow them.
    away : mapping of output to float array, shape (n_time,) [SI]
        How far the answer of the farthest mounting of the fit lies from what is predicted, where each has parameters of
        its own and the band holds for all of them; else empty.
    """

    time: FloatArray
    predicted: Mapping[str, FloatArray]
    of_parameters: Mapping[str, FloatArray]
    of_noise: Mapping[str, FloatArray]
    left_out: tuple[str, ...]
    mounting: str = "the fit's"
    of_model: Mapping[str, FloatArray] = field(default_factory=dict)
    away: Mapping[str, FloatArray] = field(default_factory=dict)

    def interval(self, output: str, level: float = 0.95, *, of_readings: bool = True) -> tuple[FloatArray, FloatArray]:
        """Ends between which a reading lies (or the strip's answer itself) with a probability, shape (n_time,) each.

        Raises
        ------
        InputError
            A probability that is not between 0 and 1, an output that the fit has no noise of.
        """
        reach = self.reach(output, level, of_readings=of_readings)
        return self.predicted[output] - reach, self.predicted[output] + reach

    def reach(self, output: str, level: float = 0.95, *, of_readings: bool = True) -> FloatArray:
        """Half the width of the interval [SI], shape (n_time,)."""
        from scipy.special import ndtri

        if not 0.0 < level < 1.0:
            raise InputError(
                f"a probability of {level:g} is none",
                code="bad-level",
                where="level",
                repair="give one between 0 and 1, such as 0.95",
            )
        if output not in self.predicted:
            raise InputError(
                f"there is no band of {output!r}: the fit read {', '.join(self.predicted)} alone",
                code="no-band",
                where="output",
                repair=f"ask for {' or '.join(map(repr, self.predicted))}, or fit runs that have it",
            )
        noise = self.of_noise[output] if of_readings else 0.0
        model = self.of_model.get(output, 0.0)
        deviation = np.sqrt(self.of_parameters[output] ** 2 + np.square(model) + np.square(noise))
        reach = float(ndtri(0.5 + 0.5 * level)) * deviation
        return np.asarray(reach + self.away[output] if output in self.away else reach)


@tell_kinds
def prediction_bands(fit: Fit, run: Run) -> Bands:
    """Simulate a fitted actuator at the voltage of a run that starts at rest, with bands.

    The parameters count to first order, with the errors and correlations of the fit; so do fixed parameters with a
    stated uncertainty. Where each mounting of the fit has parameters of its own, a run that names one of them is
    simulated with that mounting's, and of a run that names none the band holds what every mounting of the fit answers.
    A strip whose parameters follow the environment is simulated in that of the run, after the last run of the fit.
    For a run of a mounting that the fit never saw, the band holds what three mountings or more of the fit, each by
    itself, say of the next one; with fewer it is that of the fit's own mounting.

    Parameters
    ----------
    fit : Fit
        As ``identify`` returned it, or ``read_fit`` read it.
    run : Run
        Its time, voltage, hold and mounting are used, and a shunt that its voltage was sensed upstream of; what was
        read is not.

    Returns
    -------
    bands : Bands
        Of the outputs that the fit read.

    Raises
    ------
    InputError
        No fit, no run, or a fit whose file was edited so that its actuator is another one.

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab import Run, identify, load_actuator, prediction_bands, simulate
    >>> strip = load_actuator("friend-2")
    >>> clean = simulate(strip, "step 1 V", duration=40, rate=50)
    >>> noise = 1e-4 * np.random.default_rng(20261121).standard_normal(2000)
    >>> run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
    >>> fit = identify(strip, [run], free="electrical")
    >>> bands = prediction_bands(fit, simulate(strip, "sine 1 V 0.2 Hz", duration=10, rate=50))
    >>> low, high = bands.interval("current")
    >>> bool(1.9e-4 < np.median(high - bands.predicted["current"]) < 2.1e-4)
    True
    """
    need_as_fitted(fit)
    outputs = noise_outputs(fit)
    hold: Hold = "zero" if run.hold == "unknown" else run.hold
    drive = Drive(run.time, run.voltage, hold, state=state_in(fit, fit.actuator, run), rates=rates_of(fit))
    mounting = run.metadata.mounting_id
    own = own_of_mounting(fit, mounting)
    since = run.time - run.time[0]
    strip = with_shunt(fit.actuator.replace(**own) if own else fit.actuator, run)
    predicted = dict(zip(outputs, drive.outputs(strip, outputs), strict=True))
    others = [with_shunt(one, run) for one in next_mountings(fit, fit.actuator, mounting)]
    away: dict[str, FloatArray] = {}
    if others:
        deviation = standard_error_of_next(fit, others, strip, drive, predicted)
    else:
        deviation, away = standard_error_here(fit, mounting, strip, drive, predicted, lambda one: with_shunt(one, run))
    noise = {output: noise_of(fit.observations, output, since) for output in outputs}
    if others:
        noise = {output: noise_between(fit, output, noise[output]) for output in outputs}
    held = "the next" if others else f"mounting {mounting}" if own else "the fit's"
    model = standard_error_of_model(fit, mounting, strip, drive, outputs)
    return Bands(run.time, predicted, deviation, noise, _left_out(fit, mounting), held, model, away)


@dataclass(frozen=True, eq=False)
class Drive:
    """What a strip is driven with, how the run begins, and in which state the strip is."""

    time: FloatArray
    voltage: FloatArray
    hold: Hold
    delay: float = 0.0
    initial_state: Mapping[str, float] | None = None
    state: RunState | None = None
    rates: Mapping[str, float] = field(default_factory=dict)

    def of(self, actuator: Actuator) -> Actuator:
        """An actuator as it is in this state: aged, and moved by its laws."""
        return actuator if self.state is None else strip_in_state(actuator, self.state, self.rates)

    def outputs(self, actuator: Actuator, outputs: Sequence[str]) -> FloatArray:
        """What an actuator answers, shape (n_output, n_time)."""
        return simulate_outputs(
            self.of(actuator),
            self.time,
            self.voltage,
            self.hold,
            outputs=outputs,
            initial_state=self.initial_state or None,
            delay=self.delay,
        )

    def derivatives(self, actuator: Actuator, names: Sequence[str], outputs: Sequence[str]) -> FloatArray:
        """Of what an actuator answers by some parameters, shape (n_output, n_time, n_names)."""
        found = sensitivities(
            self.of(actuator),
            names,
            self.time,
            self.voltage,
            self.hold,
            outputs=outputs,
            initial_state=self.initial_state or None,
            delay=self.delay,
            asked=(),
        )
        return np.asarray(found.parameters)


def noise_outputs(fit: Fit) -> list[str]:
    """The outputs that a fit read, of whose noise it knows."""
    return list(dict.fromkeys(name for observation in fit.observations for name in observation.noise))


def values_of(fit: Fit) -> dict[str, float]:
    """What a fit found, by name."""
    return {name: one.value for name, one in fit.parameters.items()}


def known_in(fit: Fit, place: int | None, mounting: str | None = None) -> KnownCovariance:
    """What a fit knows of the parameters in one of its runs, or (None) in a new one, which may name its mounting."""
    own: tuple[str, ...] = (ending_of(mounting),) if mounting else ()
    if place is not None:
        own = own_endings(place, fit.observations[place].mounting)
    return known_of(fit.covariance, values_of(fit), [*fit.actuator.parameter_values, *rates_of(fit)], own)


def standard_error_of(
    known: KnownCovariance, actuator: Actuator, drive: Drive, outputs: Sequence[str]
) -> dict[str, FloatArray]:
    """Standard deviation of each output from what is not known of the parameters [SI]."""
    names, covariance = known.names, known.covariance
    if drive.state is not None:
        names, covariance = known_in_state(known, actuator, drive.state, drive.rates)
    found = drive.derivatives(actuator, names, outputs)
    variances = np.einsum("kij,jl,kil->ki", found, covariance, found)
    return dict(zip(outputs, np.sqrt(np.maximum(variances, 0.0)), strict=True))


def standard_error_of_model(
    fit: Fit, mounting: str | None, actuator: Actuator, drive: Drive, outputs: Sequence[str]
) -> dict[str, FloatArray]:
    """Standard deviation of each output from what the model of a fit may lack, in a new run [SI].

    Of an output without any it is nothing. Of what each run or mounting of the fit has for itself, a run of none of
    them is simulated with the average, and so has the average of how that moved.

    Parameters
    ----------
    fit : Fit
    mounting : str or None
        As the run names it.
    actuator : Actuator
        As it was simulated.
    drive : Drive
    outputs : sequence of str
    """
    found = {output: np.zeros(len(drive.time)) for output in outputs}
    for output in fit.unmodelled.keys() & found.keys():
        one = fit.unmodelled[output]
        moved = {
            base: values
            for base, values in _moved_in(fit, one.moved, mounting).items()
            if base in actuator.parameter_values or base in drive.rates
        }
        names, columns = tuple(moved), np.array(list(moved.values())).reshape(len(moved), len(one.amplitudes))
        if drive.state is not None:
            there, moves = moves_in_state(names, actuator, drive.state, drive.rates)
            names, columns = there.names, moves.T @ columns
        missed = one.answers(drive.time, drive.voltage)
        if names:
            missed = missed + columns.T @ drive.derivatives(actuator, names, [output])[0].T
        found[output] = np.sqrt(np.sum(missed**2, axis=0))
    return found


def _moved_in(fit: Fit, moved: Mapping[str, Sequence[float]], mounting: str | None) -> dict[str, FloatArray]:
    """How far parameters moved as a new run has them, which may name its mounting; without endings of their names."""
    own = ending_of(mounting) if mounting else ""
    endings = [own_endings(place, observation.mounting) for place, observation in enumerate(fit.observations)]
    found: dict[str, FloatArray] = {}
    for base in dict.fromkeys(name.partition("[")[0] for name in moved):
        if base in moved or base + own in moved:
            found[base] = np.array(moved.get(base + own, moved.get(base)))
        else:
            of_each = [moved[base + ending] for each in endings for ending in each if base + ending in moved]
            found[base] = np.sum(of_each, axis=0) / len(endings)
    return found


def standard_error_here(
    fit: Fit,
    mounting: str | None,
    model: Actuator,
    drive: Drive,
    predicted: Mapping[str, FloatArray],
    as_read: Callable[[Actuator], Actuator],
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Standard deviation of a prediction of a new run, and how far mountings of the fit lie from it [SI].

    Parameters
    ----------
    fit : Fit
    mounting : str or None
        As the run names it.
    model : Actuator
        As it was simulated.
    drive : Drive
    predicted : mapping of output to float array, shape (n_time,) [SI]
    as_read : function of Actuator to Actuator
        A strip as the instruments of this run see it.

    Returns
    -------
    deviation : dict of output to float array, shape (n_time,) [SI]
    away : dict of output to float array, shape (n_time,) [SI]
        Empty where the run names its mounting, or the mountings share everything.
    """
    outputs = list(predicted)
    strips = {} if mounting else strip_of_each_mounting(fit)
    if not strips:
        return standard_error_of(known_in(fit, None, mounting), model, drive, outputs), {}
    deviation, away = ({output: np.zeros(len(drive.time)) for output in outputs} for _ in range(2))
    for name, one in strips.items():
        strip = as_read(one)
        each = standard_error_of(known_in(fit, None, name), strip, drive, outputs)
        for output, answer in zip(outputs, drive.outputs(strip, outputs), strict=True):
            deviation[output] = np.maximum(deviation[output], each[output])
            away[output] = np.maximum(away[output], np.abs(answer - predicted[output]))
    return deviation, away


def _left_out(fit: Fit, mounting: str | None) -> tuple[str, ...]:
    """Of what nothing is known for a new run, which may name its mounting."""
    strips = strip_of_each_mounting(fit)
    # What another mounting has for itself is nothing to a run that names its own.
    ending = tuple(ending_of(name) for name in strips if mounting in strips and name != mounting)
    unlimited = [
        name
        for name, one in fit.parameters.items()
        if not math.isfinite(one.standard_error) and not name.endswith(ending)
    ]
    # The band of a run that names none holds every mounting: of each its own is known.
    found = known_in(fit, None, mounting or next(iter(strips), None))
    return tuple(dict.fromkeys((*unlimited, *found.left_out)))


def next_mountings(fit: Fit, actuator: Actuator, mounting: str | None) -> list[Actuator]:
    """The strip as each mounting of a fit found it, for a run of another mounting; else, or with too few, none."""
    known_mountings = {observation.mounting for observation in fit.observations}
    if not mounting or mounting in known_mountings or fit.mountings is None:
        return []
    found = [actuator.replace(**_by_itself(actuator, one)) for one in fit.mountings.each if one.values]
    return found if len(found) >= FEWEST else []


def _by_itself(actuator: Actuator, mounting: Mounting) -> dict[str, float]:
    """The parameters as the fit of one mounting found them, the average where each of its runs has its own.

    All of one fit: a gain that goes with another zero than its own answers something else.
    """
    found: dict[str, list[float]] = {}
    for name, value in mounting.values.items():
        found.setdefault(name.partition("[")[0], []).append(value)
    return {name: sum(each) / len(each) for name, each in found.items() if name in actuator.parameter_values}


def standard_deviation_between(
    strips: Sequence[Actuator], drive: Drive, predicted: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Standard deviation that stands for Student's interval of one more mounting about a prediction [SI].

    What each mounting answers is simulated: strips that differ threefold are beyond first order.
    """
    outputs = list(predicted)
    each = np.array([drive.outputs(strip, outputs) for strip in strips])
    count = len(strips)
    wider = wider_for_few(count - 1) * math.sqrt(1.0 + 1.0 / count)
    deviation, middle = wider * each.std(axis=0, ddof=1), each.mean(axis=0)
    return {
        output: np.hypot(deviation[row], (middle[row] - predicted[output]) / NORMAL_95)
        for row, output in enumerate(outputs)
    }


def standard_error_of_next(
    fit: Fit, strips: Sequence[Actuator], model: Actuator, drive: Drive, predicted: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Standard deviation of a prediction of the next mounting: between mountings, and what they have in common [SI].

    What was stated, or known beforehand, is wrong by the same amount in all of them, so their answers do not show it.
    """
    between = standard_deviation_between(strips, drive, predicted)
    each = [] if fit.mountings is None else [one for one in fit.mountings.each if one.loadings]
    if not each:
        return between
    names, covariance = common_covariance(fit, [one.loadings for one in each], [one.values for one in each])
    common = standard_error_of(KnownCovariance(names, covariance), model, drive, list(predicted))
    return {output: np.hypot(between[output], common[output]) for output in predicted}


def noise_of(
    observations: Sequence[Observation], output: str, since: FloatArray, *, level: bool = True, drift: bool = True
) -> FloatArray:
    """Standard deviation of a reading, as the root of the mean square over runs [SI], shape (n_time,).

    Parameters
    ----------
    observations : sequence of Observation
    output : str
    since : float array, shape (n_time,) [s]
        Time since the start of the run.
    level, drift : bool
        Whether a zero and a slope of the sensor are in the readings; not where they were taken off.
    """
    own = [observation for observation in observations if output in observation.noise]
    total = np.zeros(len(since))
    for observation in own:
        model = observation.noise_model.get(output)
        total += observation.noise[output] ** 2 if model is None else model.deviation(since) ** 2
        zero = observation.offset.get(output, 0.0) if level else 0.0
        total += (zero + (observation.drift.get(output, 0.0) * since if drift else 0.0)) ** 2
    return np.asarray(np.sqrt(total / len(own)))


def noise_between(fit: Fit, output: str, otherwise: FloatArray) -> FloatArray:
    """Noise of a run of the next mounting [SI]: what the mountings leave, each fitted by itself.

    What one fit of all leaves has the differences between them in it.
    """
    each = [] if fit.mountings is None else [one.noise[output] for one in fit.mountings.each if output in one.noise]
    return np.full_like(otherwise, math.sqrt(sum(noise**2 for noise in each) / len(each))) if each else otherwise
