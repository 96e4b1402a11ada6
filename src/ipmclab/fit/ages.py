"""How fast the parameters of a strip age."""

from __future__ import annotations

from ipmclab.fit.fit import Fit
from ipmclab.model.environment.age import AGE


def rates_of(fit: Fit | None) -> dict[str, float]:
    """How fast parameters age, as a fit found it."""
    return {} if fit is None else {name: one.value for name, one in fit.parameters.items() if name.startswith(AGE)}
