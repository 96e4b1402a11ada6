"""What a fit says of the noise that it found."""

from __future__ import annotations

from ipmclab.identify.noise.blind import Blind
from ipmclab.identify.noise.correlate import Correlated
from ipmclab.identify.noise.hum import Hum, hum_in
from ipmclab.identify.problem import Problem
from ipmclab.identify.uncertainty.covariance import Uncertainty
from ipmclab.run import Finding
from ipmclab.units import CHANNELS


def noise_findings(problem: Problem, correlated: Correlated, found: Uncertainty) -> list[Finding]:
    """A finding for each output whose residuals are not white, and one where no noise describes them.

    Parameters
    ----------
    problem : Problem
    correlated : Correlated
    found : Uncertainty
        With the outputs that hang together even under the noise.
    """
    findings = []
    labels = {record.place: record.label for record in problem.records}
    for (place, output), noise in correlated.noise.items():
        only_allowed_for = (
            output in correlated.blind and noise.terms.trend and not noise.terms.order and not noise.terms.walk
        )
        if noise.terms.is_white or only_allowed_for:
            continue
        drifts = ", so that it drifts" if noise.terms.drifts else ""
        findings.append(
            Finding(
                "coloured-residuals",
                "info",
                f"{labels[place]}: the residuals of {output} are no white noise about zero; taken as {noise.terms}"
                f"{drifts}: values, errors and intervals allow for it",
                "look at the residuals in the report; if they follow the voltage, the model lacks something",
                channel=output,
            )
        )
    findings += [_drift_not_excluded(output, blind) for output, blind in correlated.blind.items()]
    for output in sorted(correlated.contradicted):
        findings.append(
            Finding(
                "model-error-like-noise",
                "warning",
                f"the residuals of {output} hang together, but not as noise would: under any noise that describes them "
                "the parameters would lie where least squares cannot have come from (Hausman, p < 0.1 %). The model "
                "lacks something; values are those of least squares",
                "look at the residuals in the report; a further branch or stage may help",
                channel=output,
            )
        )
    for place, output in dict.fromkeys((*correlated.noise, *found.coloured)):
        hum = hum_in(correlated, (place, output))
        if hum is not None:
            findings.append(_hum(labels[place], output, hum))
    for (place, output), growth in found.growing.items():
        model = correlated.noise.get((place, output))
        walks = model is not None and model.terms.drifts
        grows = f"larger where the {output} is, up to {growth.times:.2g} times (Spearman, p < 0.1 %)"
        findings.append(
            Finding(
                "noise-not-described" if walks else "noise-grows",
                "warning" if walks else "info",
                f"{labels[place]}: {output} drifts, and its noise is {grows}: errors and intervals may be too small"
                if walks
                else f"{labels[place]}: the noise of {output} is {grows}: errors and intervals allow for it",
                "look at the residuals in the report; a further branch or stage may help, or another range of the "
                "converter",
                channel=output,
                values={"times": growth.times},
            )
        )
    for place, output in found.coloured:
        model = correlated.noise.get((place, output))
        if model is not None and model.terms.drifts:
            findings.append(
                Finding(
                    "noise-not-described",
                    "warning",
                    f"{labels[place]}: {output} drifts, and what no model of its noise describes hangs together too "
                    "(Ljung-Box, p < 0.1 %): a sum of autocovariances does not hold under a drift, so errors and "
                    "intervals may be too small",
                    "look at the residuals in the report; a further branch or stage may help; leave out what drifts",
                    channel=output,
                )
            )
        else:
            findings.append(
                Finding(
                    "coloured-residuals",
                    "info",
                    f"{labels[place]}: what no model of the noise of {output} describes hangs together (Ljung-Box, "
                    "p < 0.1 %); errors and intervals allow for it (Newey-West), but the model leaves something "
                    "unexplained",
                    "look at the residuals in the report; a further branch may help",
                    channel=output,
                )
            )
    return findings


def _hum(label: str, output: str, hum: Hum) -> Finding:
    channel = CHANNELS[output]
    return Finding(
        "noise-not-described",
        "warning",
        f"{label}: the {output} holds a hum of {hum.frequency:.3g} Hz with an amplitude of "
        f"{channel.to_display(hum.amplitude):.2g} {channel.display_unit}, which no noise here describes: errors and "
        "intervals, of what an edge tells above all, may be too small",
        "find its source; at a rate below twice its frequency the mains shows itself at another one: read faster, or "
        "average over a period of the mains",
        channel=output,
        values={"frequency": hum.frequency, "amplitude": hum.amplitude},
    )


def _drift_not_excluded(output: str, blind: Blind) -> Finding:
    if blind.allowed:
        what = (
            "Values and intervals allow for an offset and a straight drift, which makes an interval up to "
            f"{blind.wider:.2g} times as wide"
        )
    else:
        what = "Values and intervals rest on there being none: beside a drift some of these parameters would be open"
    return Finding(
        "drift-not-excluded",
        "info",
        f"no run here would show a drift of the {output} by three times its noise: the slow answer of the strip looks "
        f"the same. {what}",
        "add a run that turns back, such as a sine or a step that ends at 0 V: it shows a drift apart from the strip",
        channel=output,
        values={"wider": blind.wider},
    )
