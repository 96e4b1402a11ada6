"""The band of a record that is compared with a prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.ages import rates_of
from ipmclab.fit.fit import Fit
from ipmclab.fit.rows import listed
from ipmclab.fit.unmodelled import LEVEL, Unmodelled
from ipmclab.identification.problem.free_run import seen_from_sensor
from ipmclab.identification.problem.record import PreparedRun, model_hold
from ipmclab.model import Actuator
from ipmclab.prediction.bands import (
    Drive,
    known_in,
    next_mountings,
    noise_between,
    noise_of,
    noise_outputs,
    standard_error_here,
    standard_error_of,
    standard_error_of_model,
    standard_error_of_next,
)
from ipmclab.prediction.in_state import state_in
from ipmclab.prediction.own_of_mounting import mountings_of_fit, own_names_of_mountings, own_of_mounting
from ipmclab.quality.rows_at_rest import rest_rows
from ipmclab.run import Finding, Run

FloatArray = npt.NDArray[np.float64]

_LONGER: Final = 1.1  # times as long as the longest run of the fit, from which a run is called longer (convention)
_MANY: Final = 0.1  # of the rows under voltage, from which on other voltages are said (convention)
_NAMED: Final = 3  # voltages, that are said one by one (convention)


def band_of_run(
    fit: Fit,
    model: Actuator,
    record: PreparedRun,
    place: int | None,
    delay: float,
    start: Mapping[str, float],
    zeros: Mapping[str, float],
) -> dict[str, FloatArray]:
    """Half the width of the 95 % band of each reading [SI], for the outputs of which a fit knows the noise.

    Parameters
    ----------
    fit : Fit
    model : Actuator
        As it was simulated for this record, in the reference state of its laws.
    record : PreparedRun
    place : int or None
        Where the run is in the fit; None where it is new.
    delay : float [s]
    start : mapping of name to float
        The state that it was simulated from, empty for rest.
    zeros : mapping of output to float
        Zeros that were taken off the readings.
    """
    run = record.run
    outputs = [name for name in noise_outputs(fit) if name in record.readings]
    if not outputs:
        return {}
    state, rates = state_in(fit, fit.actuator, record.run), rates_of(fit)
    if place is not None:
        state = fit.observations[place].state
    drive = Drive(run.time, run.voltage, model_hold(record), delay, start, state, rates)

    def mountings(strip: Actuator) -> Actuator:
        return seen_from_sensor(strip, record.series_resistance)

    others = [] if place is not None else next_mountings(fit, fit.actuator, run.metadata.mounting_id)
    away: dict[str, FloatArray] = {}
    if place is not None:
        deviation = standard_error_of(known_in(fit, place), model, drive, outputs)
    else:
        predicted = dict(zip(outputs, drive.outputs(model, outputs), strict=True))
        if others:
            strips = [mountings(strip) for strip in others]
            deviation = standard_error_of_next(fit, strips, model, drive, predicted)
        else:
            deviation, away = standard_error_here(fit, run.metadata.mounting_id, model, drive, predicted, mountings)
    lacking = {}
    if place is None:  # what the model misses in a run of the fit is in the noise of that run
        lacking = standard_error_of_model(fit, run.metadata.mounting_id, model, drive, outputs)
    since = run.time - run.time[0]
    observed = fit.observations if place is None else [fit.observations[place]]
    found = {}
    for output in outputs:
        of_these = [one for one in observed if output in one.noise] or fit.observations
        level = place is None and output not in zeros
        noise = noise_of(of_these, output, since, level=level, drift=place is None)
        if others:
            noise = noise_between(fit, output, noise)
        found[output] = NORMAL_95 * np.hypot(np.hypot(deviation[output], lacking.get(output, 0.0)), noise)
        if output in away:
            found[output] += away[output]
    return found


def place_in(fit: Fit, run: Run) -> int | None:
    """Where a run is in a fit; None for one that it never saw."""
    hashes = [observation.content_sha256 for observation in fit.observations]
    return hashes.index(run.content_sha256) if run.content_sha256 in hashes else None


def another_mounting(fit: Fit, run: Run, label: str) -> list[Finding]:
    """That a run is of a mounting that the fit never saw, and what its band holds for."""
    mounting = run.metadata.mounting_id
    mountings = mountings_of_fit(fit)
    if not mounting or not mountings or mounting in mountings:
        return []
    said = f"{label} is of mounting {mounting}, and the fit is of {', '.join(mountings)}"
    if next_mountings(fit, fit.actuator, mounting):
        return [Finding("another-mounting", "info", f"{said}: its band is that of the next mounting")]
    return [
        Finding(
            "another-mounting",
            "warning",
            f"{said}: how far another mounting lies from these cannot be estimated, and the band does not contain it",
            "identify from three mountings of the strip or more",
        )
    ]


def beyond_fit(fit: Fit, run: Run, label: str) -> list[Finding]:
    """What of a new run no run of the fit showed: how long it lasts under voltage, and at which voltages it is."""
    resting = rest_rows(run)
    if place_in(fit, run) is not None or resting == len(run):
        return []
    lacking = [one for output, one in fit.unmodelled.items() if output in run.channels]
    return [*_longer_than_fit(lacking, run, label, resting), *_other_voltages(lacking, run, label, resting)]


def _longer_than_fit(lacking: Sequence[Unmodelled], run: Run, label: str, resting: int) -> list[Finding]:
    """That a run is longer under voltage than every run of the fit, so that nothing showed what comes last."""
    seen = max((one.seen for one in lacking), default=0.0)
    lasts = float(run.time[-1] - run.time[resting])
    if not 0.0 < _LONGER * seen < lasts:
        return []
    return [
        Finding(
            "longer-than-fit",
            "info",
            f"{label} lasts {lasts:.3g} s under voltage, the longest run of the fit {seen:.3g} s: what the strip does "
            "only after that is not in its band",
            "fit a run that is as long",
            values={"lasts": lasts, "seen": seen},
        )
    ]


def _other_voltages(lacking: Sequence[Unmodelled], run: Run, label: str, resting: int) -> list[Finding]:
    """That a run is at voltages which no run of the fit was at, so that nothing showed what the strip does there.

    A model without a leak answers in proportion, and one with a leak by its law; a fit at one voltage tests neither.
    """
    levels = np.unique([0.0, *(level for one in lacking for level in one.levels)])
    largest = float(np.abs(levels).max())
    voltage = run.voltage[resting:]
    if not largest > 0.0:
        return []
    nearest = levels[np.searchsorted(0.5 * (levels[1:] + levels[:-1]), voltage)]
    other = np.abs(voltage - nearest) > LEVEL * largest
    share = float(np.mean(other))
    if share < _MANY:
        return []
    lowest, highest = float(voltage[other].min()), float(voltage[other].max())
    of_fit = levels[np.abs(levels) > LEVEL * largest]
    return [
        Finding(
            "other-voltages",
            "info",
            f"{100.0 * share:.0f} % of {label} is at voltages ({_in_words(voltage[other])}) at which no run of the fit "
            f"was ({_in_words(of_fit)}): what the strip does only there is not in its band",
            "fit a run that goes through these voltages",
            values={"share": share, "lowest": lowest, "highest": highest},
        )
    ]


def _in_words(voltages: FloatArray) -> str:
    """Some voltages, or between which they lie."""
    few = np.unique([float(f"{one:.2g}") for one in np.unique(voltages)])
    if len(few) <= _NAMED:
        return f"{listed([f'{one:g}' for one in few])} V"
    return f"{few[0]:g} to {few[-1]:g} V"


def own_mounting(fit: Fit, run: Run, label: str) -> list[Finding]:
    """With which mounting's own parameters a new run was predicted, where the mountings of a fit have some."""
    mounting, names = run.metadata.mounting_id, own_names_of_mountings(fit)
    if not names or place_in(fit, run) is not None:
        return []
    own = own_of_mounting(fit, mounting)
    if own:
        units = {name: fit.actuator.parameters()[name].unit for name in own}
        values_text = listed([f"{name} ({value:.4g} {units[name]})".replace(" )", ")") for name, value in own.items()])
        said = f"{label} is of mounting {mounting}, and was predicted with that mounting's own {values_text}"
        return [Finding("own-mounting", "info", said, values=own)]
    if mounting:
        return []
    mountings = mountings_of_fit(fit)
    each = (
        f"each of mountings {listed(mountings)} has its own"
        if len(mountings) > 1
        else f"mounting {mountings[0]} has its own"
    )
    return [
        Finding(
            "mounting-not-named",
            "warning",
            f"{label} does not say of which mounting it is, and {each} {listed(names)}: it was predicted with the "
            f"average over the fit's runs, and its band holds what "
            f"{'each of these mountings' if len(mountings) > 1 else 'this mounting'} answers, but not "
            "what another would",
            "give the run its mounting_id",
        )
    ]
