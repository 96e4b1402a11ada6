"""Fits of which somebody did not want to see the end: what they say of it, and who must not use them."""

from __future__ import annotations

from typing import Final

from ipmclab.fit.fit import Fit
from ipmclab.run import Finding

NO_STAGES: Final = Finding(
    "stages-not-tried",
    "warning",
    "the fit was interrupted before it was asked what the model lacks",
    "let it run to its end to have the residuals judged and missing stages named",
)

NO_PROFILES: Final = Finding(
    "intervals-not-followed",
    "warning",
    "the fit was interrupted before its intervals were followed to their ends: they are from the standard errors alone",
    "let it run to its end to have intervals that are right where the readings show little",
)

NO_COMPARISON: Final = Finding(
    "prior-not-compared",
    "warning",
    "the fit was interrupted before the readings were fitted without what is known beforehand",
    "let it run to its end to have said whether they agree with that",
)

_INTERRUPTED: Final = (NO_STAGES, NO_PROFILES, NO_COMPARISON)


def uninterrupted(fit: Fit) -> Fit:
    """A fit that was let run to its end; else Ctrl-C is raised again, and ends the work of which the fit is a part.

    Raises
    ------
    KeyboardInterrupt
    """
    if any(one in fit.findings for one in _INTERRUPTED):
        raise KeyboardInterrupt
    return fit
