"""Questions to the readings whose answers hang on their noise: whether a run began at rest, and whether a stage shows.

White noise is what a first fit takes for granted. Under autocorrelated noise a start from rest is contradicted,
and a stage is seen, far more often than the tests for white noise say.
"""

from __future__ import annotations

from collections.abc import Set

from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.search.rest import could_be_zero


def at_rest_after_all(under: Correlated, places: Set[int]) -> dict[int, list[int]]:
    """Runs whose start differs from rest by no more than their noise does, and the entries of their start.

    Parameters
    ----------
    under : Correlated
    places : set of int
        Of the runs whose start was freed because white noise would contradict rest.
    """
    if not under.shapes:
        return {}
    found: dict[int, list[int]] = {}
    for place in places:
        there = [
            column
            for column, unknown in enumerate(under.problem.unknowns)
            if unknown.is_start and unknown.place == place
        ]
        if there and could_be_zero(under.solution, there, under.spread_of_all):
            found[place] = there
    return found
