"""Line by segments: equal pieces of electrode, each with its piece of membrane in the middle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.model import geometry
from ipmclab.model.blocks import Block, Matrix
from ipmclab.model.parameters import Values
from ipmclab.model.stages.circuit import contact
from ipmclab.model.stages.ladder import Node, ladder
from ipmclab.model.stages.membrane import membrane

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Segments:
    """The ladder of a line: half a piece of electrode, membrane, half a piece; and so on to the open end.

    Parameters
    ----------
    branches, count : int
    leak, clamp : bool
    """

    branches: int
    count: int
    leak: bool
    clamp: bool

    def ports(self, values: Values) -> tuple[tuple[str, str, complex], ...]:
        """Where each segment leaks, and its area [m^2]."""
        area = geometry.line_length(values) * values["geometry.width"] / self.count
        return tuple((f"node_voltage.{j}", f"leak_current.{j}", area) for j in range(self.count))

    def block(self, values: Values, *, along: bool = False) -> Block:
        """``voltage`` to ``current``, to ``node_voltage`` and to the voltage of each segment where one is asked for."""
        piece = geometry.line_length(values) / self.count
        each = geometry.electrodes(values, piece)
        own = membrane(values, self.branches, piece)
        front = 0.5 * each + (0.0 if self.clamp else values["circuit.contact_resistance"])
        nodes = [contact(values, self.branches, leak=self.leak, along=along)] if self.clamp else []
        nodes += [
            Node(
                name=f"line.segments.{j}",
                membrane=own,
                voltage=f"node_voltage.{j}" if self.leak or along else "",
                leak=f"leak_current.{j}" if self.leak else "",
                resistance=each if j else front,
            )
            for j in range(self.count)
        ]
        return ladder(nodes, {"node_voltage": self._mean(values)})

    def profile(self, values: Values, positions: FloatArray) -> tuple[tuple[str, ...], Matrix]:
        """Straight lines through the voltages of the segments, from the contacts on; level behind the last."""
        knots = self._knots(values).real
        hats = np.array([np.interp(positions, knots, row) for row in np.eye(len(knots))]).T
        first = "contact_voltage" if self.clamp else "voltage"
        return (first, *(f"node_voltage.{j}" for j in range(self.count))), self._of_sources(values, hats)

    def _knots(self, values: Values) -> Matrix:
        """Where the voltage is known [m from the clamp's edge]: contacts, middles of the segments, free end."""
        length = geometry.line_length(values)
        places = (np.arange(self.count) + 0.5) / self.count
        return np.array([0.0, *places, 1.0]) * length - (length - values["geometry.free_length"])

    def _mean(self, values: Values) -> Matrix:
        """What the source and each node add to the mean that moves the sensing point.

        The voltage is straight between the knots; the mean of such a hat is the second difference of the weight's
        second integral.
        """
        knots, sensing = self._knots(values), values["geometry.sensing_length"]
        bent = knots**2 / sensing - knots**3 / (3.0 * sensing**2)
        integral = np.where(knots.real < 0.0, 0.0, np.where(knots.real < sensing.real, bent, knots - sensing / 3.0))
        slopes = np.concatenate([[0.0], np.diff(integral) / np.diff(knots), [1.0]])
        weights = self._of_sources(values, np.diff(slopes)[None])[0]
        return np.insert(weights, 0, 0.0) if self.clamp else weights

    def _of_sources(self, values: Values, hats: Matrix) -> Matrix:
        """Weights of knots as weights of what comes first (the clamped part, or the voltage) and of segments."""
        weights: Matrix = hats[:, :-1].copy()
        weights[:, -1] += hats[:, -1]
        if not self.clamp:
            half = 0.5 * geometry.electrodes(values, geometry.line_length(values) / self.count)
            from_source = half / (half + values["circuit.contact_resistance"])
            weights = weights.astype(np.result_type(weights, type(from_source)))
            weights[:, 1] += (1.0 - from_source) * weights[:, 0]
            weights[:, 0] *= from_source
        return weights
