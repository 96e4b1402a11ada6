"""What is known of free parameters beforehand: from the actuator's file, else from what strips have."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from ipmclab.errors import InputError
from ipmclab.identify.fit import FittedParameter
from ipmclab.identify.free import FreeParameters, names_of
from ipmclab.identify.unknowns import actuator_unknown
from ipmclab.model import Actuator
from ipmclab.model.parameters import Parameter
from ipmclab.run import Finding

_95: Final = 1.959964
_NOTHING_NEW: Final = 0.9  # of the error beforehand: an error above that is the prior again
_SURPRISING: Final = 3.0  # standard deviations
_NO_ROOM: Final = 1e-3  # of the variance beforehand: less is rounding


def with_priors(actuator: Actuator, names: FreeParameters, prior: str | Iterable[str]) -> FreeParameters:
    """Free parameters, with what is known beforehand of those that are named.

    Parameters
    ----------
    actuator : Actuator
        Its value and standard uncertainty are what is known; where it states no uncertainty, the range that strips
        have (``Declaration.likely``), as 95 %.
    names : FreeParameters
    prior : str or iterable of str
        Groups, dotted names or comma lists of them, all of them free.

    Raises
    ------
    InputError
        A name that is unknown or not free, or of which nothing is known beforehand.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> strip = load_actuator("friend-1-measured")
    >>> free = FreeParameters(("circuit.sheet_resistance", "circuit.dc_resistivity"))
    >>> dict(with_priors(strip, free, "circuit.sheet_resistance").priors)
    {'circuit.sheet_resistance': (0.5001, 0.29)}
    """
    parameters = actuator.parameters()
    found: dict[str, tuple[float, float]] = {}
    for name in names_of(parameters, prior, "prior"):
        if name not in parameters:
            raise InputError(
                f"{name!r} is found from the readings alone",
                code="no-prior",
                where="prior",
                repair="name parameters of the actuator",
            )
        if name not in names.actuator:
            raise InputError(
                f"{name!r} is not free",
                code="prior-not-free",
                where="prior",
                repair="free it too; the stated uncertainty of a parameter that is not free counts without being named",
            )
        found[name] = _known(actuator, parameters[name])
    return replace(names, priors={name: found[name] for name in names.actuator if name in found})


def _known(actuator: Actuator, parameter: Parameter) -> tuple[float, float]:
    """Value and standard uncertainty [SI], for a logarithm those of the median."""
    log = actuator_unknown(parameter, None).log
    likely = actuator.structure.declarations[parameter.name].likely
    if parameter.standard_uncertainty > 0.0:
        if log and parameter.value <= 0.0:
            raise InputError(
                f"{parameter.name} is 0, and it is moved as a logarithm: there is no prior about 0",
                code="no-prior",
                where="prior",
                repair="state a value above 0, with an uncertainty of its own size where little is known",
            )
        return parameter.value, parameter.standard_uncertainty
    if likely is None:
        raise InputError(
            f"nothing is known beforehand of {parameter.name}: its value has no standard uncertainty",
            code="no-prior",
            where="prior",
            repair='write { value = "...", standard_uncertainty = "..." } in the actuator\'s file, or leave its name out',
        )
    low, high = likely
    if log:
        middle = math.sqrt(low * high)
        return middle, middle * math.log(high / low) / (2.0 * _95)
    return 0.5 * (low + high), (high - low) / (2.0 * _95)


def prior_findings(
    actuator: Actuator, parameters: Mapping[str, FittedParameter], runs: Sequence[str]
) -> tuple[Finding, ...]:
    """What the readings added to what was known beforehand, and whether they agree with it.

    Parameters
    ----------
    actuator : Actuator
        As it was given.
    parameters : mapping of name to FittedParameter
    runs : sequence of str
        Hashes of the runs of this fit.
    """
    declared = actuator.parameters()
    found = []
    for name, one in parameters.items():
        if one.prior is None:
            continue
        base = declared[name.partition("[")[0]]
        log = actuator_unknown(base, None).log
        centre, before = one.prior
        away, after = (
            (math.log(one.value / centre), one.standard_error / one.value)
            if log
            else (one.value - centre, one.standard_error)
        )
        before = before / centre if log else before
        shown = f"{base.quantity.to_display(centre):.4g} {base.quantity.display_unit}".rstrip()
        width = f"{100.0 * before:.2g} %" if log else f"{base.quantity.to_display(before):.2g}"
        # What readings move a value by has this variance where they agree with what was known.
        room = max(before**2 - after**2, _NO_ROOM * before**2)
        sigmas = abs(away) / math.sqrt(room)
        values = {"centre": centre, "deviations": sigmas, "error_left": after / before}
        if sigmas > _SURPRISING:
            now = f"{base.quantity.to_display(one.value):.4g} {base.quantity.display_unit}".rstrip()
            found.append(
                Finding(
                    "prior-contradicted",
                    "warning",
                    f"{name} was {shown} within {width} (one standard deviation) beforehand, but the readings draw it "
                    f"to {now}, {sigmas:.1f} standard deviations of what the two may differ by",
                    "measure it again, or fit without its prior and see what else moves",
                    values=values,
                )
            )
            continue
        added = (
            "the readings add nothing to that"
            if after > _NOTHING_NEW * before
            else f"the readings leave {100.0 * after / before:.2g} % of that error"
        )
        found.append(
            Finding("prior", "info", f"{name} was {shown} within {width} beforehand: {added}", "", values=values)
        )
    return (*found, *_seen_before(actuator, parameters, runs))


def _seen_before(
    actuator: Actuator, parameters: Mapping[str, FittedParameter], runs: Sequence[str]
) -> tuple[Finding, ...]:
    """A prior that came from the same readings counts them twice."""
    table = actuator.fit_table or {}
    earlier = {str(run.get("content_sha256")) for run in table.get("runs", ())}
    fitted = {str(entry.get("name")) for entry in table.get("parameters", ())}
    twice = [name for name, one in parameters.items() if one.prior is not None and name.partition("[")[0] in fitted]
    if not twice or not earlier & set(runs):
        return ()
    return (
        Finding(
            "prior-from-these-runs",
            "warning",
            f"what was known beforehand of {', '.join(twice)} came from a fit to the same runs: their readings count "
            "twice, and the errors are too small",
            "give other runs, or the actuator as it was before that fit",
        ),
    )
