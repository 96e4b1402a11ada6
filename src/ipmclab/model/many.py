"""Many simulations of one actuator: other parameters, other voltages, or both."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeVar, overload

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.kinds import tell_kinds
from ipmclab.model.actuator import Actuator
from ipmclab.model.batch import Batch, Record, Signals
from ipmclab.model.batch_lanes import lanes_of
from ipmclab.model.device import Device, on_gpu, worth
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.reductions import Reduced
from ipmclab.model.stages.laser import blank_lost
from ipmclab.platform import processors
from ipmclab.run import Hold

if TYPE_CHECKING:
    from concurrent.futures import Future

FloatArray = npt.NDArray[np.float64]
Outputs = Mapping[str, FloatArray]
Reduce = Callable[[Outputs], Mapping[str, npt.ArrayLike]]
_Made = TypeVar("_Made")

MOST_KEPT: Final = 100_000_000
"""Values that are kept where nothing reduces them: 800 MB."""

_BLOCK: Final = 512
"""Sets that are worked on at once: what is set up for all of them together costs each one little."""

_GPU_BLOCK, _GPU_ROWS = 8192, 1 << 33
"""Sets that a GPU is given at once, and their rows: enough for all its threads, and done within a second. A system that
shows its desktop with the same GPU may stop a longer one."""

_BLOCK_VALUES: Final = 4_000_000
"""Values of a block that a function is given: 32 MB."""


@dataclass(frozen=True, eq=False)
class Responses:
    """What an actuator answers with many parameter sets, or to many voltages.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    voltage : float array, shape (1 or n_sets, n_time) [V]
    outputs : mapping of output to float array, shape (n_sets, n_time) [SI]
    """

    time: FloatArray
    voltage: FloatArray
    outputs: Outputs

    def __len__(self) -> int:
        return len(next(iter(self.outputs.values())))

    def __getitem__(self, output: str) -> FloatArray:
        """One output of all sets."""
        try:
            return self.outputs[output]
        except KeyError:
            raise InputError(
                f"no output {output!r}", code="unknown-output", where="outputs", repair=suggest(output, self.outputs)
            ) from None


@overload
def simulate_many(
    actuator: Actuator,
    signals: Signals,
    parameters: Mapping[str, npt.ArrayLike] | None = None,
    *,
    duration: float | str,
    rate: float | str,
    hold: Hold = "zero",
    outputs: Sequence[str] | None = None,
    reduce: None = None,
    device: Device = "auto",
) -> Responses: ...


@overload
def simulate_many(
    actuator: Actuator,
    signals: Signals,
    parameters: Mapping[str, npt.ArrayLike] | None = None,
    *,
    duration: float | str,
    rate: float | str,
    hold: Hold = "zero",
    outputs: Sequence[str] | None = None,
    reduce: str | Sequence[str] | Reduce,
    device: Device = "auto",
) -> dict[str, FloatArray]: ...


@tell_kinds
def simulate_many(
    actuator: Actuator,
    signals: Signals,
    parameters: Mapping[str, npt.ArrayLike] | None = None,
    *,
    duration: float | str,
    rate: float | str,
    hold: Hold = "zero",
    outputs: Sequence[str] | None = None,
    reduce: str | Sequence[str] | Reduce | None = None,
    device: Device = "auto",
) -> Responses | dict[str, FloatArray]:
    """Simulate one actuator with many parameter sets, under one voltage or one for each set, from rest.

    The numbers are those of ``simulate`` for each set, to 1e-12 of the largest; where two poles are within 1 % of each
    other, to 1e-10. Linear actuators go side by side through one compiled loop, others one by one; both on all
    processors.

    Parameters
    ----------
    actuator : Actuator
    signals : Signal, its text, or float array of shape (n_time,) [V]; or one for each set
        A list of signals or texts, or an array of shape (n_sets, n_time), has one for each parameter set.
    parameters : mapping of dotted name to float array, shape (n_sets,) [SI], optional
        A single number holds for every set. Left out where only the voltages differ.
    duration : float [s], or a text such as "40 s"
    rate : float [Hz]
    hold : "zero", "zero-before" or "first"
    outputs : sequence of str, optional
        Some of ``OUTPUTS``; all where it is left out.
    reduce : str, sequence of str, or function, optional
        Names of metrics, such as ``displacement.peak`` or ``current.mean`` (``reductions.REDUCTIONS`` has them all),
        which are gathered along the way: no trajectory is kept. Or a function that is given the outputs of a block of
        sets by name, each of shape (n_block, n_time), and returns arrays with n_block rows by name.
    device : "auto", "cpu" or "gpu"
        Who carries the rows: a GPU (extra ``gpu``) gives the same numbers to 1e-12. ``auto`` takes one where it is
        there, for metrics of named reductions under one voltage, from 4 billion rows a processor on.

    Returns
    -------
    responses : Responses
        Or, reduced, a dict of arrays by name, with one row for each set.

    Raises
    ------
    InputError
        What ``simulate`` refuses, with the place of the set; unequal lengths; more values than a memory holds; a GPU
        that is not there, or not for this actuator.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate_many
    >>> strip = load_actuator("friend-2")
    >>> found = simulate_many(strip, "step 1 V", {"circuit.dc_resistivity": [30.0, 43.0, 60.0]},
    ...                       duration="40 s", rate="50 Hz", reduce=["current.final", "displacement.peak"])
    >>> (1e3 * found["current.final"]).round(2).tolist()
    [16.29, 12.69, 10.02]
    """
    record = Record.of(duration, rate, hold)
    if reduce is None or callable(reduce):
        batch = Batch.of(actuator, signals, parameters, record, outputs)
        # Outputs take as long to come back from a GPU as processors take to make them: one has to be asked for.
        gpu = _for_gpu(batch, worth(device, batch.sets, 0))
        return _kept(batch, gpu) if reduce is None else _by_function(batch, reduce, gpu)
    named = Reduced.of([reduce] if isinstance(reduce, str) else reduce)
    if outputs is not None:
        raise InputError(
            "metrics name the outputs that they need",
            code="needless-argument",
            where="outputs",
            repair="leave outputs out, or reduce by a function",
        )
    batch = Batch.of(actuator, signals, parameters, record, named.outputs)
    rows = batch.voltage.shape[1] if len(batch.voltage) == 1 else 0  # voltages take long on the way as well
    return reduce_batch(batch, named, worth(device, batch.sets, rows))


def reduce_batch(batch: Batch, reduction: Reduced, device: Device = "cpu") -> dict[str, FloatArray]:
    """The metrics of a batch by name, one value for each set.

    Parameters
    ----------
    batch : Batch
        With the outputs of the reduction, in their order.
    reduction : Reduced
    device : "auto", "cpu" or "gpu"
        ``auto`` takes a GPU where one is there, however little there is to do.

    Raises
    ------
    InputError
        An output that is not finite; a GPU that is not there, or not for this actuator.
    """
    gpu = _for_gpu(batch, device)

    def work(part: Batch, begin: int) -> dict[str, FloatArray]:
        period = 1.0 / batch.record.rate
        lanes = lanes_of(part, gpu=gpu)
        if lanes is None:
            return reduction.of_outputs(_one_by_one(part, begin), period)
        from ipmclab.model.numerics.lanes_loop import TALLIES

        gathered = reduction.gathered(tuple(TALLIES))
        numbers = dict(zip(gathered, lanes.gather(part.voltage, gathered), strict=True))
        for (place, _), found in numbers.items():
            _check_finite(found, begin, batch.outputs[place])
        return reduction.made(numbers, len(batch.record.time), period)

    if gpu:
        return _joined(_in_order(batch, max(1, min(_GPU_BLOCK, _GPU_ROWS // len(batch.record.time))), work))
    return _joined(_in_order(batch, _BLOCK if _side_by_side(batch) else _size(batch), work))


def _side_by_side(batch: Batch) -> bool:
    return lanes_of(batch.part(0, 1)) is not None


def _for_gpu(batch: Batch, device: Device) -> bool:
    """Whether a GPU carries the rows of this batch.

    Raises
    ------
    InputError
        A GPU was asked for, and is not there, or not for sets that go one by one.
    """
    if not on_gpu(device):
        return False
    taken = _side_by_side(batch)
    if not taken and device == "gpu":
        raise InputError(
            "sets with a leak, a laser, more than 16 states, or water that is followed go one by one, on processors",
            code="no-gpu",
            where="device",
            repair="leave the device out",
        )
    return taken


def _size(batch: Batch) -> int:
    """Sets of a block whose outputs are all there at once."""
    return max(1, min(_BLOCK, _BLOCK_VALUES // (len(batch.outputs) * len(batch.record.time))))


def _by_function(batch: Batch, function: Reduce, gpu: bool) -> dict[str, FloatArray]:
    size = _size(batch)
    found: list[dict[str, FloatArray]] = []
    for values in _in_order(batch, size, partial(_values, gpu=gpu)):
        given = {name: values[:, place] for place, name in enumerate(batch.outputs)}
        reduced: Any = function(given)  # which is not ours
        if not isinstance(reduced, Mapping) or (found and reduced.keys() != found[0].keys()):
            what = f"names {list(reduced)}" if isinstance(reduced, Mapping) else f"a {type(reduced).__name__}"
            raise InputError(
                f"the function returned {what}, not arrays by the same names for each block",
                code="bad-reduction",
                where="reduce",
                repair="return a dict, such as {'largest': outputs['force'].max(axis=1)}",
            )
        made = {name: np.asarray(array) for name, array in reduced.items()}
        for name, array in made.items():
            if not array.ndim or len(array) != len(values):
                raise InputError(
                    f"{name!r} has shape {array.shape} for a block of {len(values)} sets",
                    code="unequal-lengths",
                    where="reduce",
                    repair="return arrays that have one row for each set of the block",
                )
        found.append(made)
    return _joined(found)


def _kept(batch: Batch, gpu: bool) -> Responses:
    shape = batch.sets, len(batch.outputs), len(batch.record.time)
    if (count := int(np.prod(shape))) > MOST_KEPT:
        raise InputError(
            f"{shape[0]} sets of {shape[1]} outputs and {shape[2]} rows are {count} values, "
            f"{MOST_KEPT} are kept at most",
            code="too-many",
            where="reduce",
            repair="reduce them, by names such as displacement.peak or by a function",
        )
    every = np.empty(shape)

    def work(part: Batch, begin: int) -> None:
        _write(part, begin, every[begin : begin + part.sets], gpu)

    for _ in _in_order(batch, _BLOCK, work):
        pass
    outputs = {name: every[:, place] for place, name in enumerate(batch.outputs)}
    return Responses(batch.record.time, batch.voltage, outputs)


def _joined(parts: Iterator[dict[str, FloatArray]] | list[dict[str, FloatArray]]) -> dict[str, FloatArray]:
    found = list(parts)
    return {name: np.concatenate([one[name] for one in found]) for name in found[0]}


def _in_order(batch: Batch, size: int, work: Callable[[Batch, int], _Made]) -> Iterator[_Made]:
    """What work makes of each part of a batch, in their order; some parts are under way at once."""
    threads = processors()
    size = min(size, max(1, -(-batch.sets // threads)))
    parts = [(begin, min(begin + size, batch.sets)) for begin in range(0, batch.sets, size)]
    if len(parts) == 1:
        yield work(batch, 0)
        return
    from concurrent.futures import ThreadPoolExecutor  # of no use to whoever simulates one strip

    with ThreadPoolExecutor(threads) as pool:
        under_way: deque[Future[_Made]] = deque()
        try:
            for begin, end in parts:
                under_way.append(pool.submit(work, batch.part(begin, end), begin))
                if len(under_way) > 2 * threads:
                    yield under_way.popleft().result()
            while under_way:
                yield under_way.popleft().result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _values(batch: Batch, begin: int, gpu: bool) -> FloatArray:
    found = np.empty((batch.sets, len(batch.outputs), len(batch.record.time)))
    _write(batch, begin, found, gpu)
    return found


def _write(batch: Batch, begin: int, found: FloatArray, gpu: bool) -> None:
    """Write the outputs of a batch whose first set has this number."""
    lanes = lanes_of(batch, gpu=gpu)
    if lanes is None:
        found[:] = _one_by_one(batch, begin)
        return
    lanes.outputs(batch.voltage, found)
    for place, name in enumerate(batch.outputs):
        _check_finite(found[:, place].sum(axis=-1), begin, name)


def _one_by_one(batch: Batch, begin: int) -> FloatArray:
    found = np.empty((batch.sets, len(batch.outputs), len(batch.record.time)))
    for k, values in enumerate(found):
        strip, voltage = batch.of_set(k)
        values[:] = simulate_outputs(strip, batch.record.time, voltage, batch.record.hold, outputs=batch.outputs)
        for place, name in enumerate(batch.outputs):
            _check_finite(values[place].sum(keepdims=True), begin + k, name)
        blank_lost(values, batch.outputs, strip.parameter_values)
    return found


def _check_finite(numbers: FloatArray, begin: int, output: str) -> None:
    if not np.isfinite(numbers).all():
        raise InputError(
            f"the simulated {output} of set {begin + int(np.argmin(np.isfinite(numbers)))} is not finite",
            code="bad-output",
            where="simulate_many",
            repair="these numbers are beyond floating point: correct the voltage, the rate or the parameters",
        )
