"""What is said of strips of one make, in a terminal and on a page alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ipmclab.comparison.population import Population, Scatter

Read = Callable[[float], str]
"""An SI value as people read it, with its unit."""


def sentences(one: Population, read: Read) -> Iterator[str]:
    """Scatter, strips unlike the others, and how the chains did.

    Parameters
    ----------
    one : Population
    read : callable
        Gives a value [SI] of its metric as people read it.
    """
    yield f"One standard deviation between {', '.join(_scatter(one, each, read) for each in one.scatter)}."
    unlike = [each for each in one.strip_deviations if each.is_unlike]
    for each in unlike:
        size = f"x {each.value:.3g}" if one.model.is_ratio else read(each.value)
        yield f"{each.sample} is unlike the others: {size} of what they let expect (p = {each.p_value:.2g})."
    if one.strip_deviations and not unlike:
        yield f"None of {len(one.strip_deviations)} strips is unlike the others."
    worst = max(each.convergence.r_hat for each in one.scatter)
    least = min(min(each.convergence.bulk, each.convergence.tail) for each in one.scatter)
    yield (
        f"The chains agree after {one.steps} steps: R-hat is at most {worst:.4f}, with {least:.0f} effective samples "
        "or more."
    )


def _scatter(one: Population, each: Scatter, read: Read) -> str:
    """A scatter as people read it: of magnitudes the factor that one standard deviation is."""
    if one.model.is_ratio:
        low, middle, high = (math.exp(min(value, 700.0)) for value in (each.interval[0], each.median, each.interval[1]))
        return f"{each.name} a factor {middle:.3g} ({low:.3g} to {high:.3g})"
    low, high = each.interval
    return f"{each.name} {read(each.median)} ({read(low)} to {read(high)})"
