"""Which stage the actuator lacks: each is tried, and the readings say which makes them likelier."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.identification.diagnostics.extend import Extended, afresh, from_here
from ipmclab.identification.diagnostics.left import Left, deviance
from ipmclab.identification.diagnostics.score_directions import along_directions, score_directions
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.record import as_read
from ipmclab.model import Actuator
from ipmclab.model.stages.kind import Trial
from ipmclab.ties import largest_first

CLEAR: Final = 25.0  # of evidence, from which a stage is named
SHARE: Final = 0.2  # of the power beyond noise that it has to take away
_AS_WELL: Final = 10.0  # less evidence than the best one has: another stage that would do as well
_AT_LEAST: Final = 30.0  # steps along a stage of which less than none was asked


@dataclass(frozen=True)
class Tried:
    """What a stage would explain.

    Parameters
    ----------
    stage : str
    evidence : float
        Twice the logarithm by which the readings of all outputs that are doubted become likelier, noise estimated
        again, less what a chance fit of the stage's parameters would give (Schwarz).
    shares : mapping of output to float
        Part of the power beyond noise that it would take away.
    """

    stage: str
    evidence: float
    shares: Mapping[str, float]


def tried_stages(actuator: Actuator, names: FreeParameters, every: Sequence[Left]) -> list[Tried]:
    """What each stage that an actuator lacks would explain of what is left, the best first.

    Empty where nothing that is left follows the voltage.

    Parameters
    ----------
    actuator : Actuator
        That was given.
    names : FreeParameters
        That were free.
    every : sequence of Left
        One for each output.
    """
    doubted = [left for left in every if left.is_doubted]
    if not any(left.follows or left.bends for left in doubted):
        return []
    problem, theta = doubted[0].problem, doubted[0].theta
    strip = actuator.replace(**problem.values(theta, problem.records[0].place))
    some = score_directions(strip, [as_read(record) for record in problem.records], [left.output for left in every])
    found: dict[str, Extended] = {}
    for name, (_, direction, size) in _hints(actuator, doubted, some).items():
        extended = from_here(problem, theta, strip, direction, size if direction.both_ways else max(size, _AT_LEAST))
        if extended is not None:
            found[name] = extended
    own = deviance(doubted, problem, doubted[0].here)
    tried = {name: _judged(name, one, doubted, own) for name, one in found.items()}
    if any(left.is_large(problem, left.here) for left in doubted):
        # So far from the readings that a little of a stage is no guide: each from what the readings themselves show.
        # Where one leaves the noise alone, only those that did not go with the fit as it is.
        best = [found[one.stage] for one in _best_first(tried)[:1]]
        enough = any(not any(left.is_large(of, one.evaluation) for left in doubted) for of, one in best)
        for direction in {one.stage: one for one in some}.values():
            known = found.get(direction.stage)
            if enough and known is not None:
                continue
            extended = afresh(problem, actuator, names, direction, known)
            if extended is not None and extended is not known:
                tried[direction.stage] = _judged(direction.stage, extended, doubted, own)
    return _best_first(tried)


def _hints(actuator: Actuator, doubted: Sequence[Left], some: Sequence[Trial]) -> dict[str, tuple[float, Trial, float]]:
    """For each stage the direction that would lower chi-square most under the noise, by how much, and its size."""
    best: dict[str, tuple[float, Trial, float]] = {}
    for left in doubted:
        mine = [one for one in some if left.output in one.outputs]
        mine, rows = along_directions(left.problem, left.theta, actuator, mine, left.output)
        if not mine:
            continue
        evidence = left.evidence(rows)
        for direction, gain, size in zip(mine, *evidence.alone(left.shapes), strict=True):
            worth = abs(gain) if direction.both_ways else gain
            if direction.stage not in best or worth > best[direction.stage][0]:
                best[direction.stage] = float(worth), direction, float(size)
    return best


def _judged(name: str, extended: Extended, doubted: Sequence[Left], own: float) -> Tried:
    """What a stage would explain of what is left; ``own`` is the deviance of the fit as it is."""
    problem, here = extended[0], extended[1].evaluation
    added = len(problem.unknowns) - len(doubted[0].problem.unknowns)
    gain = own - deviance(doubted, problem, here)
    shares = {}
    for left in doubted:
        squares = left.squares(left.problem, left.here)
        beyond = max(squares - left.noise, 0.01 * squares)
        shares[left.output] = min((squares - left.squares(problem, here)) / beyond, 1.0)
    readings = sum(len(piece.time) for left in doubted for piece in left.pieces)
    return Tried(name, gain - max(added, 1) * math.log(readings), shares)


def _best_first(tried: Mapping[str, Tried]) -> list[Tried]:
    sure = [one for one in tried.values() if math.isfinite(one.evidence)]
    return [sure[k] for k in largest_first([one.evidence for one in sure])]


def named(tried: Sequence[Tried]) -> list[Tried]:
    """The stages to name: the best one, if it is clear, and those that would do as well."""
    clear = [one for one in tried if one.evidence > CLEAR and max(one.shares.values()) > SHARE]
    return [one for one in clear if one.evidence > clear[0].evidence - _AS_WELL]
