"""What is known of fixed parameters: their stated uncertainties, and how those of an earlier fit move together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from ipmclab.fit.as_fitted import is_same
from ipmclab.model import Actuator
from ipmclab.named_matrix import table_of
from ipmclab.run import FloatArray

_SAME: Final = 1e-9
"""Part of a variance, and of the largest eigenvalue: what is less is rounding."""


def stated_covariance(actuator: Actuator, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Covariance [SI] of parameters that a fit holds at stated uncertainties.

    Where an earlier fit found some of them, they are wrong together: the resistance of a branch may be known to half of
    its value and its series resistance to 1 %, and all that both give together to a thousandth. What the file states
    beyond what that fit knew (other minima, stages that may be there) is each parameter's own. A number that somebody
    changed since, or stated better than the fit did, stands alone.

    Parameters
    ----------
    actuator : Actuator
    names : sequence of str
        With a stated uncertainty.

    Returns
    -------
    covariance : mapping of name to mapping of name to float
    """
    if not names:
        return {}
    stated = np.array([actuator.standard_uncertainties[name] for name in names])
    found = np.diag(stated**2)
    together = _of_earlier_fit(actuator, names)
    known = together.diagonal()
    kept = (known > 0.0) & (stated**2 >= known * (1.0 - _SAME))
    values = (actuator.fit_table or {}).get("values", {})
    values = values if isinstance(values, Mapping) else {}
    kept &= np.array([is_same(actuator[name], values.get(name)) for name in names], dtype=bool)
    places = np.ix_(kept, kept)
    if _is_covariance(together[places]):
        own = found[places].diagonal()
        found[places] = together[places]
        found[kept, kept] = own
    return table_of(names, found)


def _of_earlier_fit(actuator: Actuator, names: Sequence[str]) -> FloatArray:
    """What the fit that the actuator carries knew of its parameters; zero where the table does not say."""
    nothing = np.zeros((len(names), len(names)))
    table: Any = (actuator.fit_table or {}).get("covariance", {})
    try:
        places = {str(name): place for place, name in enumerate(table["names"])}
        rows = np.array(table["rows"], dtype=np.float64).reshape(len(places), len(places))
    except (KeyError, TypeError, ValueError):
        return nothing  # none, or written by hand
    kept = [number for number, name in enumerate(names) if name in places]
    there = [places[names[number]] for number in kept]
    nothing[np.ix_(kept, kept)] = rows[np.ix_(there, there)]
    return nothing


def _is_covariance(matrix: FloatArray) -> bool:
    if not (len(matrix) and np.isfinite(matrix).all()):
        return False
    size = np.sqrt(matrix.diagonal())
    correlation = matrix / (size[:, None] * size)
    return bool(np.allclose(correlation, correlation.T) and np.linalg.eigvalsh(correlation)[0] > -_SAME)
