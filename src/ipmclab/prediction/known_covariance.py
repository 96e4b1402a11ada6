"""What a fit knows of an actuator's parameters in one run, as one covariance: the bands of a prediction rest on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ipmclab.confidence import wider_for_few
from ipmclab.measurement.random_effect import FEWEST
from ipmclab.named_matrix import Table, matrix_of
from ipmclab.run import FloatArray


@dataclass(frozen=True, eq=False)
class KnownCovariance:
    """Parameters of an actuator that are not exact.

    Parameters
    ----------
    names : tuple of str
    covariance : float array, shape (n, n) [SI]
        Without the directions of which nothing is known.
    left_out : tuple of str
        Parameters of which nothing is known for a run such as this one.
    """

    names: tuple[str, ...]
    covariance: FloatArray
    left_out: tuple[str, ...] = ()


def known_of(
    table: Table, values: Mapping[str, float], parameters: Sequence[str], own: Sequence[str] = ()
) -> KnownCovariance:
    """What is known of an actuator's parameters in one run.

    Of a parameter that each run of the fit has for itself, a new run has another: as far from the mean of three others
    or more as they are from each other, with a variance whose normal interval of 95 % is Student's. What that mean
    has in common with the errors of other parameters, the value of the new run has too.

    Parameters
    ----------
    table : mapping of name to mapping of name to float [SI]
        Covariance of the fit.
    values : mapping of name to float [SI]
        What the fit found.
    parameters : sequence of str
        All parameters of the actuator.
    own : sequence of str
        For a run of the fit, the endings of what belongs to it, such as ``[0]``.
    """
    chosen: dict[str, list[str]] = {}
    others: dict[str, list[str]] = {}
    for name in table:
        base, bracket, rest = name.partition("[")
        if base not in parameters:
            continue
        if not bracket or bracket + rest in own:
            chosen[base] = [name]
        elif name in values:
            others.setdefault(base, []).append(name)
    remaining = {base: found for base, found in others.items() if base not in chosen}
    of_others = {base: found for base, found in remaining.items() if len(found) >= FEWEST}
    made_of = chosen | of_others
    every = [name for found in made_of.values() for name in found]
    mean = np.zeros((len(made_of), len(every)))
    for row, found in zip(mean, made_of.values(), strict=True):
        row[[every.index(name) for name in found]] = 1.0 / len(found)
    # What all runs are off by together, they are together with the parameters that they share: a gain with a zero that
    # no reading shows is known by their product alone.
    covariance = mean @ matrix_of(table, every) @ mean.T
    places = range(len(chosen), len(made_of))
    covariance[places, places] += [_of_another([values[name] for name in found]) for found in of_others.values()]
    return KnownCovariance(tuple(made_of), covariance, tuple(base for base in remaining if base not in of_others))


def _of_another(found: Sequence[float]) -> float:
    count = len(found)
    return float(np.var(found, ddof=1)) * (1.0 + 1.0 / count) * wider_for_few(count - 1) ** 2
