"""The estimation itself: start, search, weigh, and ask the readings whether the assumptions hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from typing import Final

import numpy as np

from ipmclab.confidence import NORMAL_95
from ipmclab.identification.noise.correlate import Correlated, with_noise
from ipmclab.identification.noise.unseen import Unseen, without_unseen
from ipmclab.identification.noise.weighting import weighted
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.problem.unknowns import unknowns_of
from ipmclab.identification.search.along import along_valleys, nearest_zero
from ipmclab.identification.search.as_good import allowed_places, still_rivals
from ipmclab.identification.search.assumed import (
    assumed_zeros,
    could_be_zero,
    is_assumed_zero,
    not_at_rest,
    start_not_at_rest,
    with_less,
    without_idle,
    zero_kept,
)
from ipmclab.identification.search.descent import minimum_from, settled_nearest, start_with_fewer, weigh
from ipmclab.identification.search.doublet import has_doublet
from ipmclab.identification.search.doubts import contradicted_currents
from ipmclab.identification.search.everywhere import Everywhere
from ipmclab.identification.search.lowest import find_minima
from ipmclab.identification.search.names_of_poles import with_slow_poles_slow
from ipmclab.identification.search.pose import need_as_many_readings, solved_for, without_leak
from ipmclab.identification.search.settled import settled_with_unfelt_held
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.starts.start_circuit import zero_of_wave
from ipmclab.identification.search.tangent import entry_errors, null_directions
from ipmclab.identification.search.valleys import Minima, Rival
from ipmclab.identification.solved import Estimate
from ipmclab.identification.uncertainty.may_be_there import with_usual_stages
from ipmclab.identification.uncertainty.unshown_zero import unshown_zeros
from ipmclab.model import Actuator
from ipmclab.progress import stage
from ipmclab.run import FloatArray
from ipmclab.strip_state.state_of_run import restated

_TURNS: Final = 5  # that the water of runs is followed along tangents (a limit)


def estimate(actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun]) -> Estimate:
    """Fit, and settle what belongs to each run by asking its readings.

    A sensor's zero is an unknown until the readings allow it to be zero; a run is at rest at its start until
    the readings contradict it.
    """
    # Before any numerics; starting states are counted when their number is known.
    need_as_many_readings(len(unknowns_of(names, actuator.parameters(), records)), records)
    problem, solution, minima, given_up = _least_squares(actuator, names, records)
    rivals = (*minima.rivals, *minima.along)
    stage("finding the noise in what the fit leaves", 0.5, 0.7, 1000)
    everywhere = Everywhere(minima.ends)

    def noisy(problem: Problem, solution: Solution) -> tuple[Correlated, Correlated | None]:
        """The noise of a fit, the fit under it where that predicts as well; and another fit that is as good."""
        least = with_noise(problem, solution, assumed_zeros(problem, names), everywhere.least)
        under, other = weighted(least, everywhere.lowest)
        return under.at(with_slow_poles_slow(under.problem, under.solution)), other

    under, other = noisy(problem, solution)
    # White noise is what the first fit assumes. Where it is autocorrelated that contradicts rest far too often.
    begun = {place: under.problem.places[place].starts for place in given_up if under.shapes}
    covariance = under.covariance_of_all
    resting = {place for place, there in begun.items() if there and could_be_zero(under.solution, there, covariance)}
    if resting:
        starts = {column for place in resting for column in problem.places[place].starts}
        problem, solution = with_less(problem, solution, starts, resting)
        given_up -= resting
        under, other = noisy(problem, solution)
    stage("asking what the readings do not show", 0.7, 0.75)
    unseen, smaller, there = without_unseen(under)
    with_unseen = under if unseen else None
    if unseen:
        problem, solution = _without_stages(problem, solution, unseen, smaller, there)
        under, other = noisy(problem, solution)
    at = settled_with_unfelt_held(under.problem, under.solution)
    if problem.unknowns and len(null_directions(at.evaluation)):
        at = settled_nearest(under.problem, at, _reference(under.problem, at))
    under = under.at(nearest_zero(under.problem, at))
    # Least squares may have gone far after a drift: what the model lacks is looked at where the noise has the strip.
    strip = other or under
    white = problem, _in_full(problem, strip.problem, strip.solution)
    findings = [start_not_at_rest(r) for r in problem.records if r.place in given_up and r.start == "free"]
    problem, solution = under.problem, under.solution
    offsets = [unknown for unknown in problem.unknowns if unknown.base.startswith("observation.offset.")]
    findings += [zero_kept(problem, unknown) for unknown in offsets if is_assumed_zero(unknown, names)]
    for record in problem.records:
        if "current" in record.readings:
            findings += contradicted_currents(problem, solution, record, under.of_sensor((record.place, "current")))
    findings += unshown_zeros(problem, solution)
    if under.shapes:
        rivals = _under_noise((under, with_unseen), other, minima, rivals, everywhere)
    if with_unseen is not None:
        rivals += tuple(with_usual_stages(with_unseen, unseen, Rival.of(problem, solution.theta)))
    return Estimate(
        actuator.parameters(), problem, solution, rivals, tuple(findings), under, unseen, with_unseen, white
    )


def _under_noise(
    fits: tuple[Correlated, Correlated | None],
    other: Correlated | None,
    minima: Minima,
    rivals: tuple[Rival, ...],
    everywhere: Everywhere,
) -> tuple[Rival, ...]:
    """Other fits as good under the noise, where the readings distinguish fewer minima: all of them are asked again.

    ``fits`` are the fit, and the one that still had the stages that do not show: one with much of them may be as good,
    where other stages take their part in the fit.
    """
    under, _ = fits
    problem, solution = under.problem, under.solution
    if under.is_weighted:
        rivals = minima.rivals  # the valley is walked again
        if not has_doublet(problem.values(solution.theta, problem.records[0].place)):
            # What stood beside a doublet of least squares is now asked for itself.
            rivals = tuple(replace(rival, reach=dict.fromkeys(rival.reach, 0.0)) for rival in rivals)
    others = [rival for rival in rivals if rival not in minima.ends]
    found: tuple[Rival, ...] = ()
    for fit in fits:
        if fit is not None:
            at = fit.problem, fit.solution
            ends, is_searched = everywhere.ended(*at)
            found += still_rivals(*at, others, fit.inflation)
            found += still_rivals(*at, ends, fit.inflation, is_searched=is_searched)
    if other is not None:
        reach = NORMAL_95 * entry_errors(other.solution.evaluation)
        found += (Rival.of(problem, other.solution.theta, reach),)
    # The ends of a coupling's valley would reach too far where noise inflates what it may cost.
    if under.is_weighted or problem.is_circuit:
        walked = minima.valley.under(problem, solution)
        valley = along_valleys(problem, solution) if walked is None else walked
        found += allowed_places(problem, solution, valley, under.inflation)
    return found


def _least_squares(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun]
) -> tuple[Problem, Solution, Minima, set[int]]:
    """The lowest minimum, the others, and the runs whose readings contradict a start from rest: theirs is free.

    So is the zero of a current that no row at 0 V shows, where its wave does.
    """
    given_up: set[int] = set()
    for turn in count():
        searched, near, minima = find_minima(actuator, names, records)
        problem, solution = without_idle(searched, near, names)
        branches = actuator.structure.branches
        if zeroed := {r.place for r in records if zero_of_wave(r, branches, problem.noise) is not None}:
            records = [record.with_zero() if record.place in zeroed else record for record in records]
            continue
        off = dict(zip((unknown.base for unknown in problem.unknowns), solution.theta.tolist(), strict=True))
        if turn < _TURNS and (states := restated(actuator, [(one.run, one.state) for one in records], off)):
            records = [replace(record, state=state) for record, state in zip(records, states, strict=True)]
            continue
        moving = not_at_rest(problem, solution) - given_up
        if not moving:
            break
        given_up |= moving
        records = [replace(record, start="free") if record.place in moving else record for record in records]
    if problem is not searched:
        # With fewer unknowns all is known better, at the other minima and along the valleys too.
        rivals, along = still_rivals(problem, solution, minima.rivals), minima.along
        if along:
            along = allowed_places(problem, solution, along_valleys(problem, solution))
        minima = replace(minima, rivals=rivals, along=along)
    return problem, solution, minima, given_up


def _without_stages(
    problem: Problem, solution: Solution, unseen: Sequence[Unseen], smaller: Problem, there: Solution
) -> tuple[Problem, Solution]:
    """Least squares without some stages: from where it was with them, and from where they were found not to show."""
    gone = {unknown.name for one in unseen for unknown in one.unknowns}
    off = {name: value for one in unseen for name, value in one.off.items()}
    columns = [column for column, unknown in enumerate(problem.unknowns) if unknown.name in gone]
    fewer = without_leak(problem.without(columns, off))
    starts = [start_with_fewer(problem, fewer, solution, columns), _in_full(fewer, smaller, there)]
    if not fewer.unknowns:
        return fewer, starts[0]
    tried = [minimum_from(fewer, start) for start in starts]
    return weigh(fewer, min(tried, key=lambda one: one.evaluation.cost))


def _in_full(problem: Problem, smaller: Problem, solution: Solution) -> Solution:
    """A point of a problem whose zeros and slopes were left to the noise, with the best of these in the whole one."""
    if problem is smaller:
        return solution
    theta = Rival.of(smaller, solution.theta).vector_of(problem.unknowns, np.zeros(len(problem.unknowns)))
    names = {unknown.name for unknown in smaller.unknowns}
    left = np.array([unknown.name not in names for unknown in problem.unknowns], dtype=bool)
    theta = solved_for(problem, theta, left)
    return replace(solution, theta=theta, evaluation=problem.evaluate(theta))


def _reference(problem: Problem, solution: Solution) -> FloatArray:
    """Where an open direction is closed: the values of the file, no delay, no offset."""
    reference = solution.theta.copy()
    for place, unknown in enumerate(problem.unknowns):
        if unknown.base in problem.base:
            reference[place] = unknown.entry(unknown.inside(problem.base[unknown.base]))
        elif not unknown.nuisance:
            reference[place] = 0.0
    return reference
