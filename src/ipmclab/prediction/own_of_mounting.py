"""What each mounting of a fit has for itself, and what of it a run has that the fit never saw."""

from __future__ import annotations

from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.record import ending_of, own_values
from ipmclab.model import Actuator


def mountings_of_fit(fit: Fit) -> tuple[str, ...]:
    """The mountings that the runs of a fit name, in the order of the runs."""
    return tuple(dict.fromkeys(observation.mounting for observation in fit.observations if observation.mounting))


def own_of_mounting(fit: Fit, mounting: str | None) -> dict[str, float]:
    """What a fit found for one of its mountings by itself [SI].

    Parameters
    ----------
    fit : Fit
    mounting : str or None
        As a run names it.

    Returns
    -------
    own : dict of str to float
        By the names of the actuator's parameters. Empty where the fit knows no such mounting, or its mountings share
        everything.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip, name = load_actuator("friend-2"), "circuit.contact_resistance"
    >>> runs = []
    >>> for mounting, contact in (("a", 0.5), ("b", 1.5)):
    ...     run = simulate(strip.replace(**{name: contact}), "sine 1 V 0.1 Hz", duration=20, rate=25)
    ...     runs.append(replace(run, metadata=replace(run.metadata, mounting_id=mounting)))
    >>> fit = identify(strip, runs, free="circuit.dc_resistivity", per_mounting=name)
    >>> round(own_of_mounting(fit, "b")[name], 3), own_of_mounting(fit, "c"), own_of_mounting(fit, None)
    (1.5, {}, {})
    """
    if not mounting:
        return {}
    return own_values({name: one.value for name, one in fit.parameters.items()}, [ending_of(mounting)])


def own_names_of_mountings(fit: Fit) -> tuple[str, ...]:
    """The parameters of which each mounting of a fit has its own."""
    return tuple(dict.fromkeys(name for mounting in mountings_of_fit(fit) for name in own_of_mounting(fit, mounting)))


def strip_of_each_mounting(fit: Fit) -> dict[str, Actuator]:
    """The fitted strip as each of its mountings holds it, by mounting; none where they share everything."""
    return {
        mounting: fit.actuator.replace(**own)
        for mounting in mountings_of_fit(fit)
        if (own := own_of_mounting(fit, mounting))
    }
