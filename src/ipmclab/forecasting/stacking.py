r"""Several simple forecasts as one: weighed by how each missed earlier in the same record, with a band from the rest.

From a past step :math:`j`, forecaster :math:`k` says that the reading changes by :math:`d_k(j, h)` within a lead
:math:`h`; it changed by :math:`y(j, h)`. Leads are the eighths of the asked horizon :math:`H`; past steps are all those
from which the lead has passed. A pair counts by

.. math:: c(j, h) = \frac{\delta}{n_h H}\,e^{-a/(4H)}

where :math:`\delta` is the time between past steps, :math:`n_h` the number of leads and :math:`a` the age of what came.
The sum :math:`N` of all counts is then the number of horizons that have been observed, older ones less. The weights are

.. math::

   w = \arg\min_{w_k \ge 0,\ \sum w_k \le 1}\ \sum_{j,h} \frac{c}{h^2}\Big(y - \sum_k w_k d_k\Big)^2
       + m \sum_k w_k^2 \left\langle d_k^2/h^2 \right\rangle .

What is missing to one is the weight of holding the last value, which says 0. The second sum (the angle is a mean by the
counts) takes the time before the record as one in which each forecaster said what it usually says and the reading
stayed: an endless one, that counts :math:`m = 4 e^{-T/(4H)}` horizons after a record of the length :math:`T`. So where
little has been observed, the forecast stays near holding. The errors :math:`e = y - \sum w_k d_k` of the same pairs
give the band: the quantile of :math:`|e|/h^{3/4}` at the level, with the counts as weights, is widened as Student's t
is against the normal for :math:`N + 3` degrees of freedom, and grows as :math:`h^{3/4}`. These errors are those of
means over steps: how far a single reading lies from the mean of its step is added, in squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

LEADS: Final = 8  # parts of a horizon at which misses are looked at (convention)
MEMORY: Final = 4.0
"""Horizons after which a miss counts 1/e (convention)."""
GROWTH: Final = 0.75
"""Power of the lead by which misses grow: 0.5 for a random walk, 1 for a wrong rate (convention between the two)."""
BORROWED: Final = 3.0
"""Degrees of freedom of the band where nothing has been observed. ``benchmarks.forecast`` tries other values of all."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """What was said from past steps, and what came.

    Parameters
    ----------
    lead : float array, shape (n_pairs,) [s]
    count : float array, shape (n_pairs,)
        Their sum is the number of horizons observed.
    said : float array, shape (n_pairs, n_forecasters) [SI]
    came : float array, shape (n_pairs,) [SI]
    before : float
        Horizons that the time before the record counts.
    """

    lead: FloatArray
    count: FloatArray
    said: FloatArray
    came: FloatArray
    before: float

    @property
    def observed(self) -> float:
        """How many horizons have been observed, older ones less."""
        return float(self.count.sum())


def weigh(pairs: Pairs) -> FloatArray:
    """The weight of each forecaster; what is missing to one is that of holding.

    Examples
    --------
    >>> lead = np.ones(40)
    >>> truth = np.linspace(-1.0, 1.0, 40)
    >>> pairs = Pairs(lead, np.full(40, 50.0), np.column_stack([truth, -truth]), truth, 0.1)
    >>> weigh(pairs).round(2).tolist()
    [1.0, 0.0]
    """
    from scipy.optimize import nnls

    said, came = (values / pairs.lead[:, None] for values in (pairs.said, pairs.came[:, None]))
    size = np.sqrt(np.average(said**2, axis=0, weights=pairs.count))
    moves = size > 1e-9 * max(float(np.abs(came).max(initial=0.0)), 1e-300)
    weights = np.zeros(len(size))
    if not moves.any():
        return weights
    share = np.sqrt(pairs.count)[:, None]
    inside = np.vstack([share * said[:, moves], np.sqrt(pairs.before) * np.diag(size[moves])])
    wanted = np.concatenate([(share * came)[:, 0], np.zeros(len(size[moves]))])
    # Weights that sum to one, holding among them, as one equation that outweighs the others.
    heavy = 1e4 * np.sqrt(np.sum(inside**2))
    rows = np.vstack([np.column_stack([inside, np.zeros(len(inside))]), np.full(1 + len(size[moves]), heavy)])
    weights[moves] = nnls(rows, np.append(wanted, heavy))[0][:-1]
    return weights


def half_width(
    pairs: Pairs, weights: FloatArray, lead: FloatArray, level: float, *, scatter: float = 0.0
) -> FloatArray:
    """Half of the band of a reading at each lead [SI].

    Parameters
    ----------
    pairs : Pairs
    weights : float array, shape (n_forecasters,)
    lead : float array, shape (n_time,) [s]
    level : float
    scatter : float [SI]
        Standard deviation of a reading about the mean of its step.
    """
    from scipy.special import ndtri, stdtrit

    missed = np.abs(pairs.came - pairs.said @ weights) / pairs.lead**GROWTH
    order = np.argsort(missed)
    share = np.cumsum(pairs.count[order]) / pairs.observed
    usual = missed[order][min(int(np.searchsorted(share, level)), len(order) - 1)]
    upper = 0.5 + 0.5 * level
    normal = float(ndtri(upper))
    wider = float(stdtrit(pairs.observed + BORROWED, upper)) / normal
    return np.asarray(np.hypot(usual * wider * lead**GROWTH, normal * scatter))
