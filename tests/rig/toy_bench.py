"""A bench without a strip that costs no time, and runs at it: what it reads, loses and refuses is said by a test."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import BenchError, Block, block_rows
from ipmclab.rig.channels import THESIS_RIG, Rig
from ipmclab.rig.recording.recording import Outcome
from ipmclab.rig.rows import RowSource, as_rows
from ipmclab.run import Mark, Run
from ipmclab.signals import Signal
from tests.rig.captured import captured

FloatArray = npt.NDArray[np.float64]
Reader = Callable[[FloatArray, FloatArray], FloatArray]

AT_REST: Mapping[str, Reader] = {
    "voltage": lambda _, output: output,
    "current": lambda _, output: output / 50.0,
    "displacement": lambda rows, _: np.full(len(rows), 12e-3),
    "force": lambda rows, _: np.full(len(rows), 5e-3),
    "relative_humidity": lambda rows, _: np.full(len(rows), 45.0),
}
"""What each channel tells [SI], from the row numbers since the bench was opened and the output [V]: 50 ohm."""


class NotZeroed(BenchError):
    """That the output could not be brought to 0 V."""

    def __init__(self, code: str = "output-not-zero") -> None:
        super().__init__("no answer", code=code, where="chassis", repair="switch the amplifier off")


class ToyBench:
    """Rows come as fast as they are asked for.

    Parameters
    ----------
    reads : mapping of channel to Reader
        In the place of ``AT_REST``.
    change : callable of Block
        What becomes of each block of a signal; None loses it.
    rig : Rig

    From the row ``stuck_from`` on, counted since it was opened, the strip has 1 V.
    """

    origin: Literal["virtual bench"] = "virtual bench"
    description = "a toy"
    sample = None

    def __init__(
        self,
        reads: Mapping[str, Reader] | None = None,
        change: Callable[[Block], Block | None] = lambda block: block,
        rig: Rig = THESIS_RIG,
    ) -> None:
        self.rig = rig
        self.change = change
        self.said: list[str] = []
        self.refuses_zero: IpmclabError | None = None
        self.refuses_close: IpmclabError | None = None
        self.stuck_from: int | None = None
        self._reads = {**AT_REST, **(reads or {})}
        self._row = 0
        self._output = 0.0
        self._is_zeroed = False
        self._rate = 1.0
        self._names: tuple[str, ...] = ()

    def open(self, measured: Collection[str], rate: float) -> None:
        self.said.append("open")
        self._names, self._rate, self._row = tuple(measured), rate, 0

    def apply(self, source: Signal | RowSource, rows: int | None = None) -> Iterator[Block]:
        self._is_zeroed = False
        return self._blocks(as_rows(source, rows))

    def _blocks(self, played: RowSource) -> Iterator[Block]:
        assert played.length is not None
        step, is_signal = block_rows(self._rate), bool(played.voltages(0, played.length, self._rate).any())
        try:
            for first in range(0, played.length, step):
                given = played.voltages(first, min(step, played.length - first), self._rate)
                given = np.zeros(len(given)) if self._is_zeroed else given
                block = self._block(first, np.concatenate([[self._output], given[:-1]]))
                self._output = float(given[-1])
                changed = self.change(block) if is_signal else block
                if changed is not None:
                    yield changed
        finally:
            self.said.append("clock stopped")

    def _block(self, first: int, output: FloatArray) -> Block:
        rows = np.arange(self._row, self._row + len(output), dtype=np.float64)
        self._row += len(output)
        read = output if self.stuck_from is None else np.where(rows >= self.stuck_from, 1.0, output)
        readings = {name: self.rig[name].to_volts(self._reads[name](rows, read)) for name in self._names}
        return Block(first, readings, output)

    def exchange(self, voltage: float) -> dict[str, float]:
        raise NotImplementedError

    def zero(self) -> None:
        self.said.append("zero")
        self._is_zeroed, self._output = True, 0.0
        if self.refuses_zero is not None:
            raise self.refuses_zero

    def close(self) -> None:
        self.said.append("close")
        if self.refuses_close is not None:
            raise self.refuses_close


RATE = 50.0
"""Of the runs [Hz]: blocks of 2 rows."""


class Heart:
    """A guardian that notes what it is told."""

    status = None

    def __init__(self, lost: bool = False) -> None:
        self.told: list[Any] = []
        self.lost = lost

    def arm(self, block_time: float) -> None:
        self.told.append(("arm", block_time))

    def beat(self) -> None:
        self.told.append("beat")

    def explain(self, failure: IpmclabError) -> None:
        self.told.append("explain")
        if self.lost:
            failure.message = "the guardian is gone"

    def hold(self, seconds: float) -> None:
        self.told.append(("hold", seconds))

    def disarm(self) -> None:
        self.told.append("disarm")


class Ends:
    """Who is told: marks, and what ended the signal with the rows that the run will have."""

    def __init__(self) -> None:
        self.marks: list[Mark] = []
        self.ends: list[tuple[str, str, int]] = []

    def on_end(self, mark: Mark, rows: int) -> None:
        self.ends.append((mark.kind, mark.text, rows))

    @property
    def listeners(self) -> dict[str, Any]:
        return {"on_mark": self.marks.append, "on_end": self.on_end}


def done(bench: ToyBench | None = None, duration: float = 2.0, **asked: Any) -> Outcome:
    given = {"rate": RATE, "zero_time": 0.2, "zero_after": 0.0, "rest_before": 0.0, "discharge": 0.4, **asked}
    return captured(bench or ToyBench(), given.pop("source", "step 1 V"), duration=duration, **given)


def kept(outcome: Outcome) -> Run:
    assert outcome.run is not None
    return outcome.run


def marks(outcome: Outcome) -> list[tuple[str, str]]:
    return [(mark.kind, mark.text) for mark in kept(outcome).metadata.marks]
