"""Peak currents against the voltage over the series resistance."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ipmclab.consistency.fact import Fact
from ipmclab.consistency.known import KnownStrip, Values
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
from ipmclab.run import Finding
from ipmclab.units import CURRENT

CODE = "peak-above-series-resistance"


def peak_above_series_resistance(known: KnownStrip, facts: Sequence[Fact]) -> list[Finding]:
    """``peak-above-series-resistance``: a current that not even a short circuit behind the electrodes would draw.

    Of a lumped electrode the bound is V/(2 R_e + R_contact); where the electrode is a line or the clamped section is
    fed directly, it is the current just after a step, which no passive circuit exceeds. The worst is reported.
    """
    structure = known.actuator.structure
    lumped = not structure.clamp and not structure.line
    names = ["geometry.free_length", "geometry.clamped_length", "geometry.width", "circuit.sheet_resistance"]
    names += ["circuit.contact_resistance"] if known.values["circuit.contact_resistance"] > 0.0 else []

    def series(values: Values) -> float:
        if not lumped:
            admittance = float(known.actuator.assembled(values).d[0, 0].real)
            return 1.0 / admittance if admittance > 0.0 else 0.0
        return float(known.actuator.circuit.elements(values).series.real)

    resistance = series(known.values)
    if resistance <= 0.0:
        return []
    peaks = [one for one in facts if one.metric == "peak_current" and one.waveform in ("step", "sine", "square")]
    above = [fact for fact in peaks if fact.value > fact.swing / resistance]
    if not above:
        return []
    relative = known.standard_uncertainty(series, names) / resistance
    found = []
    for fact in above:
        allowed = Amount.of(fact.swing / resistance, relative * fact.swing / resistance, CURRENT)
        measured = Amount.of(fact.value, fact.uncertainty, CURRENT)
        sigmas = sigmas_between(measured, allowed)
        if sigmas > SURE:
            found.append((sigmas, measured, allowed, fact))
    if not found:
        return []
    sigmas, measured, allowed, fact = max(found, key=lambda one: (one[1].value / one[2].value, one[0]))
    others = len(found) - 1
    what = "in series with the branches" if lumped else "at the first instant"
    more = f" (and {others} more)" if others else ""
    bound = "at least " if fact.at_least else ""
    return [
        conflict(
            CODE,
            f"{fact.where}{more}: the current reaches {bound}{measured} where {fact.swing:.3g} V over "
            f"{resistance:.4g} ohm {what} allow {allowed} at most: {how_sure(sigmas)}" + known.taken(names),
            "measure the resistance from clamp to clamp with a 10 kHz tone, where the branches are a short circuit; if "
            "it is as the model has it, the clamped section is fed directly (add the clamp or line stage)",
            found=measured,
            expected=allowed,
            sigmas=sigmas,
            channel="current",
            more={"series_resistance": resistance, "voltage": fact.swing, "count": len(found)}
            | ({"largest_ratio": measured.value / allowed.value} if math.isfinite(measured.value) else {}),
        )
    ]
