"""Which loop takes the sets of a batch side by side: that of their modes, or that of their joined systems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import System
from ipmclab.model.batch import Batch
from ipmclab.model.numerics.cascade import Wiring
from ipmclab.model.numerics.reduce import reduced, seen_states
from ipmclab.model.outputs import set_up
from ipmclab.model.ports import choose_outputs

if TYPE_CHECKING:
    from ipmclab.model.numerics.lanes import Gathered, Lanes

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]


class BatchLanes:
    """The loops of a batch.

    Parameters
    ----------
    sets : int
    loops : sequence of pair of int array and Lanes
        Which sets each takes; None where it takes all.
    """

    def __init__(self, sets: int, loops: Sequence[tuple[IndexArray | None, Lanes]]) -> None:
        self._sets, self._loops = sets, loops

    def outputs(self, voltage: FloatArray, found: FloatArray) -> None:
        """Write the outputs of all sets; arguments as ``Lanes.outputs``."""
        for places, lanes in self._loops:
            if places is None:
                lanes.outputs(voltage, found)
                continue
            own = np.empty((len(places), *found.shape[1:]))
            lanes.outputs(_of_sets(voltage, places), own)
            found[places] = own

    def gather(self, voltage: FloatArray, gathered: Gathered) -> FloatArray:
        """What is gathered along the way, shape (n_gathered, n_sets)."""
        found = np.empty((len(gathered), self._sets))
        for places, lanes in self._loops:
            if places is None:
                return lanes.gather(voltage, gathered)
            found[:, places] = lanes.gather(_of_sets(voltage, places), gathered)
        return found


def _of_sets(voltage: FloatArray, places: IndexArray) -> FloatArray:
    return voltage if len(voltage) == 1 else voltage[places]


def lanes_of(batch: Batch, *, gpu: bool = False) -> BatchLanes | None:
    """The loops in which the sets go side by side; None for an actuator that needs others.

    A cascade whose poles have a closed form goes by its modes, which take the fewest products. Where two poles of a set
    nearly meet, that set goes by its joined system.

    Parameters
    ----------
    batch : Batch
    gpu : bool
        Whether a GPU carries the rows.
    """
    structure = batch.actuator.structure
    if structure.leak or structure.laser or any(_changes_the_loop(batch, name) for name in batch.changes):
        return None
    wiring, numbers, found = _modal(batch)
    if wiring is None or not found.any():
        joined = _joined(batch, gpu)
        return None if joined is None else BatchLanes(batch.sets, [(None, joined)])
    chosen, kind = choose_outputs(batch.outputs), _kind(gpu)
    if found.all():
        return BatchLanes(batch.sets, [(None, kind.modal(numbers, wiring, chosen))])
    modal, others = np.flatnonzero(found), np.flatnonzero(~found)
    joined = _joined(batch.of_sets(others), gpu)
    loops = [(modal, kind.modal(numbers[modal], wiring, chosen))]
    return None if joined is None else BatchLanes(batch.sets, [*loops, (others, joined)])


def _kind(gpu: bool) -> type[Lanes]:
    if gpu:
        from ipmclab.model.numerics.device_lanes import DeviceLanes

        return DeviceLanes
    from ipmclab.model.numerics.lanes import Lanes

    return Lanes


def _modal(batch: Batch) -> tuple[Wiring | None, FloatArray, npt.NDArray[np.bool_]]:
    """Which block drives which, the numbers of the modes of each set, and which sets have them."""
    written, wiring = set_up(batch.actuator.structure)
    if written is None or wiring is None:
        return None, np.zeros((batch.sets, 0)), np.zeros(batch.sets, dtype=bool)
    every: Any = {**batch.actuator.parameter_values, **batch.changes}
    entries = written.entries_of_many(every, batch.sets)
    return wiring, *wiring.sections_of_many(entries, 1.0 / batch.record.rate, batch.record.hold)


def _joined(batch: Batch, gpu: bool) -> Lanes | None:
    """The loop of the joined systems; None where they have too many states."""
    from ipmclab.model.numerics.lanes import MOST_STATES

    actuator, chosen = batch.actuator, choose_outputs(batch.outputs)
    own = _stacked(batch)
    anywhere = replace(own, a=np.any(own.a != 0.0, axis=0), c=np.any(own.c != 0.0, axis=0))
    seen = seen_states([actuator.system, anywhere], chosen)
    if len(seen) > MOST_STATES:
        return None
    like = reduced(actuator.system, chosen, seen)
    return _kind(gpu).joined(reduced(own, chosen, seen), like, 1.0 / batch.record.rate, batch.record.hold)


def _changes_the_loop(batch: Batch, name: str) -> bool:
    """Whether sets that differ in this parameter have no loop in common: other states, or water that is followed."""
    counted = batch.actuator.structure.declarations[name].transform == "count"
    return counted or name.startswith("hydration.")


def _stacked(batch: Batch) -> System:
    """The joined systems of all sets, with an axis of sets first in every matrix."""
    actuator, structure = batch.actuator, batch.actuator.structure
    if structure.takes_arrays:
        every: Any = {**actuator.parameter_values, **batch.changes}
        joined = actuator.assembled(every)
        matrices = {
            name: np.broadcast_to(matrix, (batch.sets, *matrix.shape[-2:]))
            for name in ("a", "b", "c", "d")
            for matrix in (getattr(joined, name),)
        }
    else:
        systems = [batch.of_set(k)[0].system for k in range(batch.sets)]
        joined = systems[0]
        matrices = {name: np.stack([getattr(one, name) for one in systems]) for name in ("a", "b", "c", "d")}
    return replace(joined, a=matrices["a"], b=matrices["b"], c=matrices["c"], d=matrices["d"])
