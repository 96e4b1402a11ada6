"""What a fit says of the noise that it found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ipmclab.fit.in_brief import NOT_DESCRIBED
from ipmclab.fit.observation import Observation
from ipmclab.identification.noise.blind import Blind
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.hum import hum_in
from ipmclab.identification.noise.pieces import Key
from ipmclab.identification.noise.weighting import at_rest_and_driven
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.uncertainty.covariance import Uncertainty
from ipmclab.run import Finding, Severity
from ipmclab.units import CHANNELS

_MUCH_MORE: Final = 2.0
"""Times the noise at 0 V: a hundred rows tell it to a tenth, and to a third where neighbours are alike."""

_NOTICED: Final = 0.05
"""Part of the range of the readings: who looks at the curve sees a drift that is larger."""

_SCATTER: Final = 1.3
"""Times the scatter of neighbouring readings: a noise that grows under voltage is no error of the model."""

_MODEL_ERRS: Final = "model-error"
_LOOK: Final = "look at the residuals in the report"


def noise_findings(correlated: Correlated, found: Uncertainty) -> list[Finding]:
    """A finding for each output whose residuals are not white, and one where no noise describes them.

    Parameters
    ----------
    correlated : Correlated
    found : Uncertainty
        With the outputs that are autocorrelated even under the noise.
    """
    labels = {record.place: record.label for record in correlated.problem.records}
    wrong = {key: sizes for key in correlated.problem.pieces if (sizes := _model_error(correlated, key)) is not None}
    findings = []
    for (place, output), (at_rest, driven) in wrong.items():
        left, noise_at_rest = CHANNELS[output].text(driven), CHANNELS[output].text(at_rest)
        said = (
            f"under voltage the model leaves {left} (rms) of the {output}, where the noise at 0 V is {noise_at_rest}: "
            "it lacks something, and the intervals count what it leaves as noise"
        )
        repair = f"{_LOOK}; another branch or stage may help: ipmclab choose"
        findings.append(_found(_MODEL_ERRS, labels[place], output, said, repair, driven=driven, at_rest=at_rest))
    # What the model lacks is no noise: nothing more is said of it as one.
    noises = {key: noise for key, noise in correlated.noise.items() if key not in wrong}
    coloured = [key for key in found.coloured if key not in wrong]
    drifting = {key for key, noise in noises.items() if noise.terms.drifts}
    for (place, output), noise in noises.items():
        only_allowed_for = (
            output in correlated.blind and noise.terms.trend and not noise.terms.order and not noise.terms.walk
        )
        if noise.terms.is_white or only_allowed_for:
            continue
        drifts = ", so that it drifts" if noise.terms.drifts else ""
        said = (
            f"the residuals of {output} are no white noise about zero; taken as {noise.terms}{drifts}: errors and "
            "intervals allow for it"
        )
        repair = f"{_LOOK}; if they follow the voltage, the model lacks something"
        findings.append(_found("coloured-residuals", labels[place], output, said, repair))
    findings += [_drift_not_excluded(output, blind) for output, blind in correlated.blind.items()]
    for place, output in dict.fromkeys((*noises, *coloured)):
        hum = hum_in(correlated, (place, output))
        if hum is None:
            continue
        said = (
            f"the {output} holds a hum of {hum.frequency:.3g} Hz with an amplitude of "
            f"{CHANNELS[output].text(hum.amplitude)}: intervals, above all of what an edge determines, may be too "
            "small, for no noise model describes it"
        )
        repair = (
            "find its source; at a rate below twice its frequency the mains shows itself at another one: read faster, "
            "or average over a period of the mains"
        )
        found_hum = {"frequency": hum.frequency, "amplitude": hum.amplitude}
        findings.append(_found(NOT_DESCRIBED, labels[place], output, said, repair, **found_hum))
    for (place, output), growth in found.growing.items():
        if (place, output) in wrong:
            continue
        grows = f"grows with it up to {growth.times:.2g} times (by ranks, p < 0.1 %)"
        code, said = "noise-grows", f"the noise of the {output} {grows}: errors and intervals allow for it"
        if (place, output) in drifting:
            code, said = NOT_DESCRIBED, f"the {output} drifts and its noise {grows}: intervals may be too small"
        repair = f"{_LOOK}; a further branch or stage may help, or another range of the converter"
        findings.append(_found(code, labels[place], output, said, repair, times=growth.times))
    for place, output in coloured:
        code, repair = "coloured-residuals", f"{_LOOK}; a further branch may help"
        said = (
            f"what no model of the noise of {output} describes is autocorrelated (Ljung-Box, p < 0.1 %); errors and "
            "intervals allow for it (Newey-West), but the model leaves something unexplained"
        )
        if (place, output) in drifting:
            code, repair = NOT_DESCRIBED, f"{_LOOK}; a further branch or stage may help; leave out what drifts"
            said = (
                f"the {output} drifts, and no noise model describes the rest (Ljung-Box, p < 0.1 %): intervals may be "
                "too small, for a sum of autocovariances does not hold under a drift"
            )
        findings.append(_found(code, labels[place], output, said, repair))
    return findings


def _found(code: str, label: str, output: str, said: str, repair: str, **values: float) -> Finding:
    """A warning where the noise is not described or the model errs, else a note."""
    severity: Severity = "warning" if code in (NOT_DESCRIBED, _MODEL_ERRS) else "info"
    return Finding(code, severity, f"{label}: {said}", repair, channel=output, values=values)


def drift_findings(problem: Problem, observations: Sequence[Observation]) -> list[Finding]:
    """A finding for each sensor that is taken to drift, a warning where that is not small."""
    findings = []
    for record, observation in zip(problem.records, observations, strict=True):
        for output, drift in observation.drift.items():
            reading = record.readings.get(output)
            if reading is None or not drift:
                continue
            time = record.times_of(output)
            moved = drift * float(time[-1] - time[0])
            findings.append(
                Finding(
                    "sensor-drift",
                    "warning" if abs(moved) > _NOTICED * observation.span[output] else "info",
                    f"{record.label}: the sensor of the {output} is taken to drift by {CHANNELS[output].text(moved)} "
                    "over the record, which no prediction holds; creep looks the same",
                    "record half a minute at 0 V before the voltage: these rows show whether the sensor drifts; where "
                    "the strip itself creeps, give the actuator the stage that what is left asks for",
                    channel=output,
                    values={"drift": drift},
                )
            )
    return findings


def _model_error(correlated: Correlated, key: Key) -> tuple[float, float] | None:
    """What a fit leaves at 0 V and under voltage, where that is much more, and more than readings scatter by."""
    if key not in correlated.shapes or correlated.is_weighted:
        return None
    sizes = at_rest_and_driven(correlated, key)
    scatter = correlated.problem.readings[key].noise
    return sizes if sizes is not None and sizes[1] > max(_MUCH_MORE * sizes[0], _SCATTER * scatter) else None


def _drift_not_excluded(output: str, blind: Blind) -> Finding:
    if blind.allowed:
        what = (
            "Values and intervals allow for an offset and a straight drift, which makes an interval up to "
            f"{blind.wider:.2g} times as wide"
        )
    else:
        what = "Values and intervals assume that there is none: with a drift some parameters would be undetermined"
    return Finding(
        "drift-not-excluded",
        "info",
        f"no run here would show a drift of the {output} by three times its noise: the slow answer of the strip looks "
        f"the same. {what}",
        "add a run that turns back, such as a sine or a step that ends at 0 V: a drift does not",
        channel=output,
        values={"wider": blind.wider},
    )
