"""Line: electrodes whose resistance is distributed along the strip."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model import geometry
from ipmclab.model.blocks import Block, Matrix
from ipmclab.model.parameters import Declaration, Values
from ipmclab.model.stages import line_modes
from ipmclab.model.stages.circuit import Circuit, contact_port
from ipmclab.model.stages.kind import Excitation, Numbers, StageKind, Trial, is_there
from ipmclab.model.stages.line_segments import Segments
from ipmclab.units import NUMBER

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """The electrodes as a line: resistance and membrane distributed evenly from the contacts to the free end.

    The line has the free length and that part of the clamped section which the contacts do not feed at once,
    L = L_f + (1 - share) L_c, and the resistance 2 R_s L/w; the clamped part comes first. The contact resistance,
    and what is fed at once, stand before it.

    By segments it is a ladder, each segment with its node in its middle and, where there is one, its leak; the error
    falls with the square of their number. By modes it is exact but for a tail with a known bound; a leak at every
    place would couple the modes, so that it needs segments.

    Parameters
    ----------
    branches : int
        RC branches of the membrane.
    kind : "modes" or "segments"
    leak : bool
        Whether each segment leaks: segment j then reads and takes the ports ``node_voltage.j`` and ``leak_current.j``.
    clamp : bool
        Whether a share of the clamped section is fed at once.

    Raises
    ------
    InputError
        A line by modes that leaks.
    """

    branches: int
    kind: str
    leak: bool = False
    clamp: bool = False

    def __post_init__(self) -> None:
        if self.leak and self.kind == "modes":
            raise InputError(
                "a line by modes is linear, it cannot leak at every place by a law of the voltage there",
                code="leak-in-modes",
                where="line.modes",
                repair="give line.segments in its place, or leave the leak out",
            )

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""
        circuit = Circuit(self.branches, leak=self.leak, clamp=self.clamp).declarations
        typical, most = (6.0, 200.0) if self.kind == "modes" else (10.0, 200.0)
        count = Declaration(f"line.{self.kind}", NUMBER, "N", 1.0, most, "count", default=typical, typical=typical)
        return (*circuit, count)

    def law_ports(self, values: Values) -> tuple[tuple[str, str, complex], ...]:
        """Where it leaks: at the contacts where they feed a part of the clamped section, and at each segment."""
        return (*((contact_port(values),) if self.clamp else ()), *self._segments(values).ports(values))

    def block(self, values: Values, *, along: bool = False) -> Block:
        """``voltage`` to ``current`` and ``node_voltage``, the mean of the voltage that moves the sensing point.

        That mean is (2/L_s^2) int_0^Ls (L_s - x) u(x) dx over the free length, because the curvature at x moves the
        sensing point by its lever L_s - x. With ``along``, the ports of ``profile`` are outputs too.
        """
        if self.kind == "segments":
            return self._segments(values).block(values, along=along)
        return line_modes.block(values, self.branches, self._count(values), along=along)

    def profile(self, values: Values, positions: FloatArray) -> tuple[tuple[str, ...], Matrix]:
        """How the voltage between the electrodes at some places of the free length is made of ports.

        Parameters
        ----------
        values : mapping of dotted name to number [SI]
        positions : float array, shape (n_positions,) [m]
            From the clamp's edge.

        Returns
        -------
        ports : tuple of str
            ``voltage`` and outputs of ``block(values, along=True)``.
        weights : matrix, shape (n_positions, n_ports)
        """
        if self.kind == "segments":
            return self._segments(values).profile(values, positions)
        count = self._count(values)
        reading = line_modes.at(values, line_modes.spectrum(values, count), positions)
        ports = ("voltage", *(f"node_voltage.{i}" for i in range(count)), "tail_current")
        return ports, np.hstack([reading.direct[:, None], reading.modes, -reading.drop[:, None]])

    def _count(self, values: Values) -> int:
        return round(complex(values[f"line.{self.kind}"]).real)

    def _segments(self, values: Values) -> Segments:
        return Segments(self.branches, self._count(values), leak=self.leak, clamp=self.clamp)


_SPREAD = 0.3
"""Part of the electrodes' resistance that a trial of a line spreads; the rest comes before it."""


def _partly_distributed(values: Numbers) -> dict[str, float]:
    sheet = values["circuit.sheet_resistance"]
    lumped = float(2.0 * sheet * geometry.squares(values).real)
    before = values["circuit.contact_resistance"] + (1.0 - _SPREAD) * lumped
    return {"circuit.sheet_resistance": _SPREAD * sheet, "circuit.contact_resistance": before}


def _trials(values: Numbers, name: str) -> Iterator[Trial]:
    if not is_there(values, "line.") and values["circuit.sheet_resistance"] > 0.0:
        yield Trial(name, changes=_partly_distributed)


def _modes_trials(values: Numbers, _excitation: Excitation) -> Iterator[Trial]:
    return iter(()) if is_there(values, "leak.") else _trials(values, "line.modes")


def _segments_trials(values: Numbers, _excitation: Excitation) -> Iterator[Trial]:
    return _trials(values, "line.segments") if is_there(values, "leak.") else iter(())


_MODES = StageKind(
    "line.modes",
    "line.modes",
    one_of="line",
    outputs=("current",),
    electrical=True,
    shows="a charge that spreads along the electrodes",
    trials=_modes_trials,
)
KINDS = (_MODES, replace(_MODES, name="line.segments", prefix="line.segments", trials=_segments_trials))
