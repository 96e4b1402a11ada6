"""What is known of free parameters beforehand: from the actuator's file, else from what strips have."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

from ipmclab.confidence import NORMAL_95
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.free import FreeParameters, Prior, names_of
from ipmclab.identification.problem.stated import stated_covariance
from ipmclab.identification.problem.unknowns import actuator_unknown
from ipmclab.model import Actuator
from ipmclab.model.declared import group_of
from ipmclab.model.kinds import groups
from ipmclab.model.parameters import Parameter
from ipmclab.run import Finding

_NOTHING_NEW: Final = 0.9  # of the error beforehand: an error above that is the prior again
_WORSE: Final = 1.1  # of the error beforehand
_SURPRISING: Final = 3.0  # standard deviations
_LEAST_MOVED: Final = 0.1  # of the deviation beforehand: where the readings add next to nothing, nothing is surprising


def with_priors(actuator: Actuator, names: FreeParameters, prior: str | Iterable[str]) -> FreeParameters:
    """Free parameters, with what is known beforehand of those that are named.

    Parameters
    ----------
    actuator : Actuator
        Its value and standard uncertainty are what is known, together where an earlier fit found them together; where
        it states no uncertainty, the range that strips have (``Declaration.likely``), as 95 %.
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
    {'circuit.sheet_resistance': Prior(value=0.5001, uncertainty=0.29, follows={}, merely_uncertain=False, ...)}
    """
    parameters = actuator.parameters()
    found: dict[str, Prior] = {}
    words = [prior] if isinstance(prior, str) else list(prior)
    given = {word.strip() for text in words for word in str(text).split(",")} - {""}
    for name in sorted(names_of(parameters, prior, "prior")):
        if group_of(name) in given and actuator.standard_uncertainties.get(name, 0.0) == 0.0:
            declared = actuator.structure.declarations[name]
            if declared.likely is None or name not in names.actuator:
                continue  # a group names what is known of it
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
        found[name] = Prior(
            *_known(actuator, parameters[name]), of_literature=parameters[name].standard_uncertainty == 0.0
        )
    for word in sorted(given & set(groups())):
        if not any(group_of(name) == word for name in found):
            raise InputError(
                f"nothing is known beforehand of any parameter of {word!r}",
                code="no-prior",
                where="prior",
                repair='write { value = "...", standard_uncertainty = "..." } in the actuator\'s file, or leave it out',
            )
    stated = [name for name in names.shared if name in found and parameters[name].standard_uncertainty > 0.0]
    return replace(
        names,
        priors={name: found[name] for name in names.actuator if name in found},
        together=stated_covariance(actuator, stated),
    )


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
            repair='write { value = "...", standard_uncertainty = "..." } in the actuator\'s file, or do not name it',
        )
    low, high = likely
    if log:
        middle = math.sqrt(low * high)
        return middle, middle * math.log(high / low) / (2.0 * NORMAL_95)
    return 0.5 * (low + high), (high - low) / (2.0 * NORMAL_95)


def prior_findings(actuator: Actuator, priors: Mapping[str, Prior], fit: Fit, alone: Fit) -> tuple[Finding, ...]:
    """What the readings added to what was known beforehand, and whether they agree with it.

    They are asked alone: beside a wrong prior, zeros and slopes of sensors or a start that was not at rest may take up
    what the two disagree by. Where a prior follows others, or the readings are not asked, it counts how far the fit
    moved from it.

    Parameters
    ----------
    actuator : Actuator
        As it was given.
    priors : mapping of name to Prior
        By the names that the fit has: its branches and modes are sorted.
    fit : Fit
    alone : Fit
        To the same runs, with nothing known beforehand.
    """
    declared = actuator.parameters()
    found = []
    for name, one in fit.parameters.items():
        if one.prior is None:
            continue
        base, prior = declared[name.partition("[")[0]], priors[name.partition("[")[0]]
        free = alone.parameters.get(name)
        log = actuator_unknown(base, None).log

        def shown(value: float, error: float, base: Parameter = base, log: bool = log) -> str:
            width = f"{100.0 * error / value:.2g} %" if log else base.quantity.text(error)
            return f"{base.quantity.text(value, digits=4)} within {width}"

        before = shown(*one.prior) + (", as the literature has it," if prior.of_literature else "")
        own = shown(free.value, free.standard_error) if free is not None and free.determined else ""
        if free is None or prior.follows:
            sigmas = _apart(one.prior, (one.value, one.standard_error), log=log, moved=True)
        else:
            sigmas = _apart(one.prior, (free.value, free.standard_error), log=log, moved=False) if own else 0.0
        left = one.standard_error / one.prior[1] * (one.prior[0] / one.value if log else 1.0)
        values = {"deviations": sigmas, "error_left": left}
        after = shown(one.value, one.standard_error)
        if sigmas > _SURPRISING:
            asked = f"the readings alone say {own}" if own else f"the readings ask for {after}"
            found.append(
                Finding(
                    "prior-contradicted",
                    "warning",
                    f"{name} was {before} beforehand (one standard deviation), but {asked}: "
                    f"{sigmas:.1f} standard deviations apart",
                    "measure it again, or leave its prior out; as long as they disagree the fit is neither",
                    values=values,
                )
            )
            continue
        if free is None:
            continue
        added = f"the readings alone say {own}, " if own else "the readings alone leave it open, "
        added += "and add nothing" if left > _NOTHING_NEW else f"both leave {100.0 * left:.2g} % of that error"
        repair = ""
        if left > _WORSE:
            added += f", and what is held with an uncertainty of its own makes it worse, {after}"
            repair = "free what `fixed-uncertainty` names, under its own prior"
        found.append(Finding("prior", "info", f"{name} was {before} beforehand; {added}", repair, values=values))
    return (*found, *_seen_before(actuator, fit))


def _apart(before: tuple[float, float], after: tuple[float, float], *, log: bool, moved: bool) -> float:
    """Distance of two values in their common standard deviation; of one that ``moved``, by which it should.

    An estimate that uses all that its prior says differs from it by as much as its variance is smaller (Hausman,
    Econometrica 46, 1251, 1978): that is the two variances' difference.
    """
    (a, a_error), (b, b_error) = before, after
    away, (first, last) = (math.log(b / a), (a_error / a, b_error / b)) if log else (b - a, (a_error, b_error))
    if moved:
        return abs(away) / math.sqrt(max(first**2 - last**2, (_LEAST_MOVED * first) ** 2))
    return abs(away) / math.hypot(first, last)


def _seen_before(actuator: Actuator, fit: Fit) -> tuple[Finding, ...]:
    """A prior that came from the same readings counts them twice."""
    table = actuator.fit_table or {}
    earlier = {str(run.get("content_sha256")) for run in table.get("runs", ())}
    fitted = {str(entry.get("name")) for entry in table.get("parameters", ())}
    twice = [n for n, one in fit.parameters.items() if one.prior is not None and n.partition("[")[0] in fitted]
    if not twice or not earlier & {content for _, content in fit.runs}:
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
