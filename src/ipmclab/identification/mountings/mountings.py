"""The mountings of a strip: what each says by itself, and what the next one is to be expected to say."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.confidence import REJECT
from ipmclab.errors import IpmclabError
from ipmclab.fit.fit import Fit, FittedParameter
from ipmclab.fit.fit_table import changed
from ipmclab.fit.mountings import Mounting, Mountings
from ipmclab.identification.mountings.common_error import Parted, loadings_of, loadings_of_joint, parted
from ipmclab.identification.problem.record import label_of, places_of_mountings
from ipmclab.identification.problem.unknowns import Unknown, actuator_unknown
from ipmclab.measurement.random_effect import FEWEST, random_effect
from ipmclab.model import Actuator
from ipmclab.progress import part
from ipmclab.run import Finding, Run

_ENDING: Final = "[mounting "
_DRAGGED: Final = 2.0  # standard errors of the mean of all mountings


def each_mounting(runs: Sequence[Run], refit: Callable[[tuple[int, ...]], Fit]) -> tuple[Mounting, ...]:
    """Every mounting of a strip fitted by itself; nothing where the runs are of one mounting, or of several strips.

    Parameters
    ----------
    runs : sequence of Run
    refit : function of a tuple of int
        Fits the runs at these places alone.
    """
    places = places_of_mountings(enumerate(runs))
    several = len({run.metadata.sample.id for run in runs if run.metadata.sample is not None}) > 1
    if len(places) < 2 or several:
        return ()
    each = []
    for number, (name, of_these) in enumerate(places.items()):
        with part(f"mounting {name}", number / len(places), (number + 1) / len(places)):
            each.append(_alone(name, tuple(label_of(runs[place], place) for place in of_these), of_these, refit))
    return tuple(each)


def with_mountings(fit: Fit, each: Sequence[Mounting]) -> Fit:
    """A fit of all runs together with the interval of the next mounting."""
    unknowns = _unknowns(fit)
    between: dict[str, float] = {}
    p_value: dict[str, float] = {}
    unknown: dict[str, str] = {}
    parameters: dict[str, FittedParameter] = dict(fit.parameters)
    differing = differ(each, fit.actuator)
    for base, entry in unknowns.items():
        own = [name for name in fit.parameters if name == base or name.startswith(f"{base}{_ENDING}")]
        values, errors = _estimates(fit, entry, own, each)
        if len(values) < 2:
            unknown[base] = _too_few(len(each), len(values))
            continue
        found = random_effect(values, errors.own, common=errors.common)
        p_value[base] = found.p_value
        if found.next_one is None:
            unknown[base] = _too_few(len(each), len(values))
            continue
        between[base] = found.between
        low, high = entry.value(found.next_one[0]), entry.value(found.next_one[1])
        shared = fit.parameters.get(base)
        speaks = shared is not None and (shared.determined or not differing)
        if shared is not None and speaks and all(map(math.isfinite, shared.interval)):
            # Mountings that differ so much that one value for all cannot be estimated leave an interval of what that
            # average misses. Else what bends the squares of all together is common to the next one too; and what is
            # known of one clamping is never less than what is known of the strip.
            low, high = min(low, shared.interval[0]), max(high, shared.interval[1])
        for name in own:
            parameters[name] = replace(parameters[name], interval_next_mounting=(low, high))
    mountings = Mountings(tuple(each), between, tuple(base for base in between if unknowns[base].log), p_value, unknown)
    return changed(
        fit, parameters=parameters, mountings=mountings, findings=(*fit.findings, *_findings(fit, mountings))
    )


def why_unknown(fit: Fit) -> str:
    """Why nothing is said of the next mounting; empty where it is said of some parameter at least.

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> why_unknown(identify(strip, simulate(strip, "step 1 V", duration=20, rate=50)))
    'the value at another mounting cannot be estimated: these runs do not say of which mounting they are'
    """
    if any(one.interval_next_mounting is not None for one in fit.parameters.values()):
        return ""
    names = {observation.mounting for observation in fit.observations if observation.mounting}
    start = "the value at another mounting cannot be estimated"
    if not names:
        return f"{start}: these runs do not say of which mounting they are"
    if len(names) < FEWEST:
        count = "one mounting" if len(names) == 1 else "two mountings"
        return f"{start} from {count}: it takes three or more of the same strip"
    if fit.mountings is None:
        return f"{start}: these runs are of more than one strip"
    return f"{start}: no parameter is determined by three mountings or more, each by itself"


def _too_few(mountings: int, determined: int) -> str:
    if mountings < FEWEST:
        return f"cannot be estimated from {mountings} mountings: it takes {FEWEST} or more"
    return (
        f"cannot be estimated: {determined} of {mountings} mountings determine it by themselves, and it takes {FEWEST}"
    )


def _alone(
    name: str, labels: tuple[str, ...], places: tuple[int, ...], refit: Callable[[tuple[int, ...]], Fit]
) -> Mounting:
    try:
        own = refit(places)
    except IpmclabError:  # too few readings, or not of every output: it says nothing by itself
        return Mounting(name, labels)
    shared = {base: one for base, one in own.parameters.items() if "[" not in base}
    values = {name: one.value for name, one in own.parameters.items() if not name.startswith("observation.")}
    errors = {base: one.standard_error if one.determined else math.inf for base, one in shared.items()}
    outputs = {output for observation in own.observations for output in observation.noise}
    squares = {out: [run.noise[out] ** 2 for run in own.observations if out in run.noise] for out in sorted(outputs)}
    noise = {output: math.sqrt(sum(each) / len(each)) for output, each in squares.items()}
    loadings = {base: moved for base, moved in loadings_of(own).items() if base in shared and moved}
    return Mounting(name, labels, values, errors, noise, loadings)


def _unknowns(fit: Fit) -> dict[str, Unknown]:
    """What differs between mountings: what all runs share, and what each mounting has for itself."""
    known = fit.actuator.parameters()
    found: dict[str, Unknown] = {}
    for name in fit.parameters:
        base, bracket, rest = name.partition("[")
        if base in known and (not bracket or f"[{rest}".startswith(_ENDING)):
            found.setdefault(base, actuator_unknown(known[base], None))
    return found


def _estimates(fit: Fit, entry: Unknown, own: Sequence[str], each: Sequence[Mounting]) -> tuple[list[float], Parted]:
    """Entries with their standard errors, of the mountings that determine them."""
    if own and own[0] == entry.base:
        return _by_themselves(entry, each)
    finite = [one for name in own if (one := fit.parameters[name]).determined and math.isfinite(one.standard_error)]
    chains = np.array([entry.chain(one.value) for one in finite])
    errors = np.array([one.standard_error for one in finite]) / chains
    loadings = loadings_of_joint(fit, [one.name for one in finite]) / chains[:, None]
    return [entry.entry(one.value) for one in finite], parted(errors, loadings)


def _by_themselves(entry: Unknown, each: Sequence[Mounting]) -> tuple[list[float], Parted]:
    name = entry.base
    finite = [one for one in each if math.isfinite(one.errors.get(name, math.inf))]
    chains = np.array([entry.chain(one.values[name]) for one in finite])
    errors = np.array([one.errors[name] for one in finite]) / chains
    causes = list(dict.fromkeys(cause for one in finite for cause in one.loadings.get(name, {})))
    loadings = np.array([[one.loadings.get(name, {}).get(cause, 0.0) for cause in causes] for one in finite])
    moved = loadings.reshape(len(finite), len(causes)) / chains[:, None]
    return [entry.entry(one.values[name]) for one in finite], parted(errors, moved)


def differ(each: Sequence[Mounting], actuator: Actuator) -> dict[str, float]:
    """The shared parameters in which mountings differ by more than their own errors, each with its p-value."""
    known = actuator.parameters()
    found = {}
    for base in dict.fromkeys(name for one in each for name in one.values if name in known):
        entries, errors = _by_themselves(actuator_unknown(known[base], None), each)
        if len(entries) > 1:
            found[base] = random_effect(entries, errors.own).p_value
    return {base: p_value for base, p_value in found.items() if p_value < REJECT / len(found)}


def dragged(fit: Fit, each: Sequence[Mounting]) -> tuple[str, ...]:
    """The shared parameters that the fit of all runs puts elsewhere than the mean of the mountings by themselves."""
    found = []
    for base, entry in _unknowns(fit).items():
        if base not in fit.parameters:
            continue
        entries, errors = _by_themselves(entry, each)
        if len(entries) < 2 or not errors.own.all():
            continue
        weights = 1.0 / np.square(errors.own)
        away = entry.entry(fit.parameters[base].value) - float(weights @ entries / weights.sum())
        if abs(away) * math.sqrt(weights.sum()) > _DRAGGED:
            found.append(base)
    return tuple(found)


def _findings(fit: Fit, mountings: Mountings) -> list[Finding]:
    """That one value for all mountings is an average of what differs."""
    differing = differ(mountings.each, fit.actuator)
    if not differing:
        return []
    sizes = {base: mountings.between[base] for base in differing if base in mountings.between}
    widest = max(sizes, key=lambda base: (base in mountings.logarithms, sizes[base]), default=None)
    far = ""
    if widest is not None:
        factor = math.exp(sizes[widest])
        size = (
            f"by a factor of {factor:.3g}"
            if widest in mountings.logarithms
            else f"by {sizes[widest]:.3g} {fit.parameters[widest].unit}".rstrip()
        )
        far = f": from one to the next {widest} changes {size} (one standard deviation)"
    return [
        Finding(
            "mountings-differ",
            "warning",
            f"{len(mountings.each)} mountings differ by more than their errors in {', '.join(differing)} (p < 0.1 %)"
            f"{far}. One value for all is an average, and its interval says nothing of any one mounting",
            "fit each mounting by itself, or name what the clamp changes in per_mounting; what to expect of another "
            "mounting is its own interval, from three mountings on",
            values={f"between.{base}": size for base, size in sizes.items()},
        )
    ]
