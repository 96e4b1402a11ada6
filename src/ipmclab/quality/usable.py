"""From findings to the samples that identification may use."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from ipmclab.quality.record import RESPONSES
from ipmclab.run import Finding, Run

_WHOLE_STRIP = frozenset({"contact-missing"})
"""Without contact no channel answers to the voltage, whichever showed it."""


def usable(run: Run, findings: Iterable[Finding]) -> dict[str, npt.NDArray[np.bool_]]:
    """Which readings of each response are values: present, not masked, not merely bounds.

    Parameters
    ----------
    run : Run
    findings : iterable of Finding
        What ``check`` found.

    Returns
    -------
    usable : dict of channel to bool array, shape (n_time,)

    Examples
    --------
    >>> from ipmclab.run import Run
    >>> run = Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[1.0, 1.0, 1.0], current=[0.3, float("nan"), 0.1])
    >>> usable(run, [])["current"].tolist()
    [True, False, True]
    """
    masks = {name: np.isfinite(getattr(run, name)) for name in RESPONSES if getattr(run, name) is not None}
    for finding in findings:
        if finding.effect == "none":
            continue
        whole = finding.channel in (None, "voltage") or finding.code in _WHOLE_STRIP
        for name in masks if whole else masks.keys() & {finding.channel}:
            for start, stop in finding.samples:
                masks[name][start:stop] = False
    return masks


def noise_only(findings: Iterable[Finding]) -> frozenset[str]:
    """Channels in which ``check`` finds nothing but noise: no number of them says anything of the strip.

    Parameters
    ----------
    findings : iterable of Finding

    Returns
    -------
    channels : frozenset of str
    """
    return frozenset(one.channel for one in findings if one.code == "noise-only" and one.channel)


def unmasked(run: Run, findings: Iterable[Finding]) -> dict[str, npt.NDArray[np.bool_]]:
    """Which readings of each response are values or bounds: present and not masked.

    Parameters
    ----------
    run : Run
    findings : iterable of Finding

    Returns
    -------
    unmasked : dict of channel to bool array, shape (n_time,)
    """
    return usable(run, [finding for finding in findings if finding.effect == "mask"])


def censored(run: Run, findings: Iterable[Finding]) -> dict[str, npt.NDArray[np.int8]]:
    """Which readings are bounds: 1 where the true value is at least the reading, -1 where it is at most that.

    Parameters
    ----------
    run : Run
    findings : iterable of Finding

    Returns
    -------
    censored : dict of channel to int8 array, shape (n_time,)
        0 where the reading is a value, or masked.
    """
    found = list(findings)
    bounds = {name: np.zeros(len(run), dtype=np.int8) for name in RESPONSES if getattr(run, name) is not None}
    for finding in found:
        if finding.effect in ("lower_bound", "upper_bound") and finding.channel in bounds:
            for start, stop in finding.samples:
                bounds[finding.channel][start:stop] = 1 if finding.effect == "lower_bound" else -1
    allowed = unmasked(run, found)
    return {name: np.where(allowed[name], bound, 0).astype(np.int8) for name, bound in bounds.items()}
