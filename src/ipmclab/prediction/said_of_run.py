"""What the user must know about how a run was compared, and what it shows of why it was missed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from ipmclab.identification.problem.record import LONGEST_DELAY
from ipmclab.prediction.read_off import MOSTLY, rows_that_show_zero
from ipmclab.quality.beginning import REPAIR
from ipmclab.quality.record import Record
from ipmclab.quality.rows_at_rest import rest_rows
from ipmclab.run import Finding
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.prediction.run_validation import RunValidation
    from ipmclab.prediction.scores import Comparison

_GOOD: Final = 50.0
"""Percent of fit of minus the prediction from which on nothing but a sign explains it (convention)."""
_AGAINST: Final = -0.9
"""Cosine between readings and prediction below which they lie on opposite sides of rest (convention)."""


def begins_under_voltage(one: RunValidation) -> bool:
    """Whether the voltage was on before the record began, so that a prediction from rest cannot meet its beginning.

    Not where the contact came within the record: until then the strip was at rest.
    """
    if one.used_in_fit or not Record.of(one.run).begins_under_voltage:
        return False
    return not any(finding.code == "contact-missing" for finding in one.record_findings)


def turned_outputs(one: RunValidation) -> tuple[str, ...]:
    """The outputs that were missed, and that minus the prediction follows.

    Minus the prediction has a fit of 50 % and more; or it lies on the side of the readings (a cosine beyond 0.9), and
    the record by itself shows that this channel answers the wrong way.
    """
    if one.used_in_fit or begins_under_voltage(one):
        return ()
    opposite = {finding.channel for finding in one.record_findings if finding.code == "response-opposite"}
    return tuple(
        name
        for name, score in one.scores.items()
        if score.fit_percent is not None
        and score.fit_percent <= 0.0
        and _is_turned(one.comparisons[name], shown=name in opposite)
    )


def drifting_outputs(one: RunValidation) -> dict[str, tuple[float, bool]]:
    """The outputs that were missed because their sensor drifts, its slope [SI/s], and whether rows at 0 V show that.

    Without that slope less than half of what was missed is left. A prediction has no drift: how a sensor drifts in a
    run says nothing of another. Of a motion without rows at 0 V it is the line through what was missed, which may be
    the strip's own as well.
    """
    if one.used_in_fit or one.run.metadata.starts_from_rest is False:
        return {}
    slopes = {f.channel: f.values["slope"] for f in one.record_findings if f.code == "drift-before-step"}
    found = {}
    for name, score in one.scores.items():
        if score.fit_percent is None or score.fit_percent > 0.0:
            continue
        used = one.comparisons[name].used
        time, missed = one.run.time[used], (one.comparisons[name].measured - one.comparisons[name].predicted)[used]
        slope = slopes.get(name)
        if slope is not None:
            # The zero that was taken off is the mean of the rows at 0 V.
            drifted = float(slope) * (time - float(np.mean(one.run.time[: rest_rows(one.run)])))
        elif not rows_that_show_zero(one.run) and name != "current" and len(time) > 2:
            slope = np.polyfit(time - time[0], missed, 1)[0]
            drifted, missed = float(slope) * (time - time.mean()), missed - missed.mean()
        else:
            continue
        if np.linalg.norm(missed - drifted) < MOSTLY * np.linalg.norm(missed):
            found[name] = float(slope), name in slopes
    return found


def current_rises(runs: Iterable[RunValidation]) -> list[str]:
    """The runs whose current rises again at constant voltage."""
    return [one.label for one in runs if any(finding.code == "current-rises" for finding in one.record_findings)]


def _is_turned(comparison: Comparison, *, shown: bool) -> bool:
    read, predicted = comparison.measured[comparison.used], comparison.predicted[comparison.used]
    if float(np.linalg.norm(read + predicted)) <= (1.0 - _GOOD / 100.0) * float(np.linalg.norm(read - read.mean())):
        return True
    return shown and float(read @ predicted) < _AGAINST * float(np.linalg.norm(read) * np.linalg.norm(predicted))


def said_of_run(one: RunValidation) -> list[Finding]:
    """What the user must know about how this run was compared."""
    found = [
        Finding(
            "sign-turned",
            "warning",
            f"{one.label}: the {CHANNELS[name].name} goes the other way than predicted, and the negative of the "
            "prediction follows it: its sign is reversed, here or in the runs of the fit",
            repair="reverse the sign of this channel in the import map or the rig file, of the record that is wrong",
            channel=name,
        )
        for name in turned_outputs(one)
    ]
    begins = begins_under_voltage(one)
    if begins:
        found.append(
            Finding(
                "begins-under-voltage",
                "warning",
                f"{one.label} begins under voltage, the prediction from rest: its beginning cannot be predicted",
                repair=REPAIR,
                values={"voltage": float(one.run.voltage[0])},
            )
        )
    if one.used_in_fit:
        found.append(
            Finding(
                "used-in-fit",
                "info",
                f"{one.label} was used to identify the actuator: its scores show a fit, not a prediction",
                repair="validate on a run that identify was not given",
            )
        )
    elif one.rows_in_fit is not None:
        first, stop = one.rows_in_fit
        found.append(
            Finding(
                "rows-of-the-fit",
                "info",
                f"{one.rows_in_words} were given to the fit: there the scores show a fit, not a prediction",
                repair="validate on a run that shares no row with one of the fit",
                values={"first": first, "stop": stop},
            )
        )
    if one.run.hold == "unknown" and not (begins and one.delay is None):
        found.append(_delay_in_words(one))
    for name, zero in one.zeros.items():
        amount = f"{CHANNELS[name].to_display(zero):.3g} {CHANNELS[name].display_unit}"
        if one.used_in_fit:
            source = "as in the fit"
        elif rows_that_show_zero(one.run):
            source = "the mean before the voltage first moves"
        elif name == "current":
            source = "which its wave shows"
        else:
            source = "an offset that is most of what was missed, also before the strip has moved much"
        found.append(
            Finding(
                "zero-taken-off",
                "info",
                f"{one.label}: {amount} of {name}, {source}, was subtracted as the sensor's zero",
                channel=name,
                values={"zero": zero},
            )
        )
    if one.run.metadata.starts_from_rest is False and not (one.used_in_fit or begins):
        found.append(
            Finding(
                "assumed-rest",
                "warning",
                f"{one.label} does not start from rest, yet the prediction does: its beginning cannot agree",
                repair="begin a record when the strip is discharged, or judge the later part",
            )
        )
    # Where the laser lost the strip, the rows of the prediction are none of the record's.
    found += [
        replace(beyond, message=f"{one.label}: {beyond.message}", samples=(), effect="none")
        for beyond in one.predicted.metadata.findings
    ]
    return found


def _delay_in_words(one: RunValidation) -> Finding:
    """Where the edges of a foreign record were taken to lie."""
    start = f"{one.label} does not say when its output changed"
    if one.delay is None:
        return Finding(
            "no-edge-shown",
            "info",
            f"{start}, and its voltage shows no edge: the voltage is assumed to act at its rows",
            repair="keep some rows before the first edge when cutting a record",
        )
    side = "before" if one.delay < 0 else "after"
    text = f"{start}: the voltage is assumed to act {abs(one.delay) * 1e3:.3g} ms {side} its row"
    if one.used_in_fit:
        return Finding("delay-of-the-fit", "info", f"{text}, as in the fit", values={"delay": one.delay})
    at_end = abs(one.delay) * one.run.rate > LONGEST_DELAY - 0.1
    return Finding(
        "estimated-delay",
        "warning" if at_end else "info",
        f"{text}, the delay at which the predicted shape is nearest"
        + (f"; that is the end of the {LONGEST_DELAY} rows searched" if at_end else ""),
        repair="use a model of this strip, or say how the voltage was held (hold) when importing" if at_end else "",
        values={"delay": one.delay},
    )
