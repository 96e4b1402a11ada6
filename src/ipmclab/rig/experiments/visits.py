"""The order in which an experiment visits its conditions, and comes back to its reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ipmclab.rig.experiments.environments import Order, Reference, TargetEnvironment


@dataclass(frozen=True)
class Visit:
    """One time that the chamber is brought to a condition.

    Parameters
    ----------
    environment : TargetEnvironment
    is_reference : bool
    number, of : int
        This visit, counted from 1, and how many there are.
    again : int
        How often its condition has been visited before.
    """

    environment: TargetEnvironment
    is_reference: bool
    number: int
    of: int
    again: int

    def __str__(self) -> str:
        """As people say it."""
        what = " (reference)" if self.is_reference else ""
        return f"{self.environment.name}{what}, condition {self.number} of {self.of}"


def visits(
    environments: Sequence[TargetEnvironment], order: Order, reference: Reference | None = None
) -> tuple[Visit, ...]:
    """Every visit of an experiment, in order.

    A palindromic order goes up the list and down again. Each condition then is at mirrored times, so that a drift
    that is linear in time looks like no function of the environment. The reference is at mirrored times too.

    Parameters
    ----------
    environments : sequence of TargetEnvironment
    order : "palindromic" or "listed"
    reference : Reference, optional

    Examples
    --------
    >>> air = [TargetEnvironment(25.0, humidity, 1.0, 3.0, 0.0, 0.0) for humidity in (30.0, 50.0, 70.0)]
    >>> [visit.environment.relative_humidity for visit in visits(air, "palindromic")]
    [30.0, 50.0, 70.0, 50.0, 30.0]
    >>> at = Reference(TargetEnvironment(20.0, 80.0, 1.0, 3.0, 0.0, 0.0), every=2)
    >>> [visit.environment.relative_humidity for visit in visits(air, "palindromic", at)]
    [80.0, 30.0, 50.0, 80.0, 70.0, 80.0, 50.0, 30.0, 80.0]
    """
    places = list(_places(len(environments), order, None if reference is None else reference.every))
    found: list[Visit] = []
    seen: dict[int | None, int] = {}
    for number, place in enumerate(places, start=1):
        if place is None:
            assert reference is not None
            environment = reference.environment
        else:
            environment = environments[place]
        found.append(Visit(environment, place is None, number, len(places), seen.get(place, 0)))
        seen[place] = seen.get(place, 0) + 1
    return tuple(found)


def _places(count: int, order: Order, every: int | None) -> Iterator[int | None]:
    """Places in the list, None for the reference."""
    if every is None:
        yield from range(count)
        yield from reversed(range(count - 1)) if order == "palindromic" else ()
        return
    way: list[int | None] = [None]
    for place in range(count):
        way.append(place)
        if (place + 1) % every == 0 and (place + 1 < count or order == "listed"):
            way.append(None)
    if order == "listed":
        yield from way if way[-1] is None else [*way, None]
        return
    # At the turn: the reference where the stretch about it would be too long without, with the last one on both sides.
    rest = way[::-1].index(None)
    if 2 * rest - 1 > every:
        yield from [*way, None, *reversed(way)]
    else:
        yield from [*way, *reversed(way[:-1])]
