"""Membrane: what lies between the electrodes along a length of the strip, the same everywhere."""

from __future__ import annotations

from typing import NamedTuple

from ipmclab.model.parameters import Values


class Membrane(NamedTuple):
    """R_dc and the RC branches of a length of strip, as conductances: a length of 0 has none of them.

    ``dc`` is 1/R_dc [S], ``branches`` 1/R_Ci [S], ``rates`` 1/(R_Ci C_i) [1/s], which no length changes.
    """

    dc: complex
    branches: tuple[complex, ...]
    rates: tuple[complex, ...]

    @property
    def at_once(self) -> complex:
        """The conductance before any capacitor is charged [S]: the largest that there is at any frequency."""
        return self.dc + sum(self.branches)


def membrane(values: Values, branches: int, length: complex) -> Membrane:
    """The membrane of a length of strip (Friend, eqs 4.2 to 4.6 with ``length`` for L_f + L_c).

    Parameters
    ----------
    values : mapping of dotted name to number [SI]
    branches : int
    length : number [m]

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> round(1.0 / membrane(load_actuator("friend-2").parameter_values, 2, 0.030).dc, 2)
    70.92
    """
    scale = length * values["geometry.width"] / values["geometry.thickness"]
    resistivities = [values[f"circuit.branches.{i}.resistivity"] for i in range(branches)]
    permittivities = [values[f"circuit.branches.{i}.permittivity"] for i in range(branches)]
    return Membrane(
        dc=scale / values["circuit.dc_resistivity"],
        branches=tuple(scale / resistivity for resistivity in resistivities),
        rates=tuple(
            1.0 / (resistivity * permittivity)
            for resistivity, permittivity in zip(resistivities, permittivities, strict=True)
        ),
    )
