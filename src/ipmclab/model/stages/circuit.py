"""Circuit: what current the strip draws, and the voltage behind its electrodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model import geometry
from ipmclab.model.blocks import Block, Matrix, block
from ipmclab.model.parameters import Declaration, Measurement, Values
from ipmclab.model.stages.kind import CURRENT, LITTLE, Excitation, Numbers, StageKind, Trial, is_there, number_of
from ipmclab.model.stages.ladder import Node, ladder
from ipmclab.model.stages.membrane import membrane
from ipmclab.units import PERMITTIVITY, RESISTANCE, RESISTIVITY, SHEET_RESISTANCE

FloatArray = npt.NDArray[np.float64]

SHEET: Final = "circuit.sheet_resistance"
CONTACT: Final = "circuit.contact_resistance"
"""Whatever else lies in series with the strip, a shunt or a source, adds to it."""

SERIES: Final = (SHEET, CONTACT)
"""What lies in series with all branches."""

DC: Final = "circuit.dc_resistivity"


class Elements(NamedTuple):
    """The lumped elements of the circuit.

    ``series`` is 2 R_e plus the contact resistance [ohm], ``electrode`` R_e [ohm], ``dc`` R_dc [ohm];
    ``branch_resistances`` [ohm] and ``branch_capacitances`` [F] have one entry for each branch.
    """

    series: complex
    electrode: complex
    dc: complex
    branch_resistances: tuple[complex, ...]
    branch_capacitances: tuple[complex, ...]


@dataclass(frozen=True)
class Circuit:
    """Electrodes, R_dc and any number of RC branches behind them (Friend, eqs 4.1 to 4.6).

    The electrode resistance R_e is twice in series; a lumped contact resistance is
    in series with both.

    Parameters
    ----------
    branches : int
        Number of RC branches, at least 1.
    leak : bool
        Whether a current leaks past the branches; it then has the input port ``leak_current`` [A].
    clamp : bool
        Whether a share of the clamped section is fed at once, by the contacts that lie on it: it charges, and leaks,
        behind the contact resistance alone, and does not bend. The electrodes then feed the other part of the strip,
        and R_e = R_s (L_f + (1 - share) L_c)/w.
    """

    branches: int
    leak: bool = False
    clamp: bool = False

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""
        fixed = (
            Declaration(
                *("circuit.sheet_resistance", SHEET_RESISTANCE, "R_s", 1e-6, 1e6),
                in_group=False,
                measured=Measurement("measure the sheet resistance (four probes)", 0),
            ),
            Declaration(
                *("circuit.contact_resistance", RESISTANCE, "R_c", 0.0, 1e6, "linear"),
                default=0.0,
                in_group=False,
                measured=Measurement("measure the contact resistance (four wires, the clamp closed on bare metal)", 1),
            ),
            Declaration("circuit.dc_resistivity", RESISTIVITY, "ρ_dc", 1e-6, 1e9),
        )
        branches = (
            declaration
            for i in range(self.branches)
            for declaration in (
                Declaration(
                    f"circuit.branches.{i}.resistivity", RESISTIVITY, f"ρ_{i + 1}", 1e-6, 1e9, typical=0.4 * 30.0**i
                ),
                Declaration(
                    f"circuit.branches.{i}.permittivity", PERMITTIVITY, f"ε_{i + 1}", 1e-12, 1e6, typical=0.1 * 2.0**i
                ),
            )
        )
        return (*fixed, *branches, *((geometry.DIRECT_SHARE,) if self.clamp else ()))

    @property
    def state_names(self) -> tuple[str, ...]:
        """The capacitor voltages of the lumped circuit."""
        return tuple(f"circuit.branches.{i}.voltage" for i in range(self.branches))

    def law_ports(self, values: Values) -> tuple[tuple[str, str, complex], ...]:
        """Where it leaks: at the node, and at the contacts where they feed a part of the clamped section."""
        width = values["geometry.width"]
        node = ("node_voltage", "leak_current", geometry.line_length(values) * width)
        return (contact_port(values), node) if self.clamp else (node,)

    def profile(self, _values: Values, positions: FloatArray) -> tuple[tuple[str, ...], Matrix]:
        """How the voltage along the free length is made of ports: here it is the same everywhere.

        Returns
        -------
        ports : tuple of str
            Outputs of ``block(values, along=True)``.
        weights : matrix, shape (n_positions, n_ports)
        """
        return ("node_voltage",), np.ones((len(positions), 1))

    def elements(self, values: Values) -> Elements:
        """The lumped elements (Friend, eqs 4.1 to 4.6), the whole strip behind the electrodes."""
        scale = geometry.area_per_thickness(values)
        electrode = values["circuit.sheet_resistance"] * geometry.squares(values)
        indices = range(self.branches)
        return Elements(
            series=2.0 * electrode + values["circuit.contact_resistance"],
            electrode=electrode,
            dc=values["circuit.dc_resistivity"] / scale,
            branch_resistances=tuple(values[f"circuit.branches.{i}.resistivity"] / scale for i in indices),
            branch_capacitances=tuple(values[f"circuit.branches.{i}.permittivity"] * scale for i in indices),
        )

    def block(self, values: Values, *, along: bool = False) -> Block:
        """``voltage`` to ``current`` and ``node_voltage``; its states are the capacitor voltages.

        With ``along``, the ports of ``profile`` are outputs too; they are so anyway.
        """
        if self.clamp:
            return self._with_clamp(values, along=along)
        element = self.elements(values)
        resistances, capacitances = element.branch_resistances, element.branch_capacitances
        conductance = 1.0 / element.series + 1.0 / element.dc + sum(1.0 / r for r in resistances)
        # The node voltage is the mean of what pulls at the node, weighted by conductance.
        from_voltage = 1.0 / (element.series * conductance)
        from_state = [1.0 / (r * conductance) for r in resistances]
        indices = range(self.branches)
        # What leaks pulls at the node like a source of current: it lowers the node and loads the electrodes.
        drawn = [1.0 / conductance] if self.leak else []
        rates = [1.0 / (resistances[i] * capacitances[i]) for i in indices]
        return block(
            states=list(self.state_names),
            inputs=["voltage", "leak_current"] if self.leak else ["voltage"],
            outputs=["current", "node_voltage"],
            a=[[rates[i] * (from_state[j] - (1.0 if i == j else 0.0)) for j in indices] for i in indices],
            b=[[rates[i] * from_voltage, *(-rates[i] * drop for drop in drawn)] for i in indices],
            c=[[-weight / element.series for weight in from_state], from_state],
            d=[
                [(1.0 - from_voltage) / element.series, *(drop / element.series for drop in drawn)],
                [from_voltage, *(-drop for drop in drawn)],
            ],
        )

    def _with_clamp(self, values: Values, *, along: bool) -> Block:
        length = geometry.line_length(values)
        node = Node(
            name="circuit",
            membrane=membrane(values, self.branches, length),
            voltage="node_voltage",
            leak="leak_current" if self.leak else "",
            resistance=geometry.electrodes(values, length),
        )
        return ladder([contact(values, self.branches, leak=self.leak, along=along), node], {})


def branch_names(number: int) -> tuple[str, str]:
    """Names of the resistivity and the permittivity of a branch."""
    return f"circuit.branches.{number}.resistivity", f"circuit.branches.{number}.permittivity"


def slowest_branch(branches: int, values: Mapping[str, float]) -> tuple[str, str]:
    """Names of the resistivity and the permittivity of the branch with the largest time constant.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> slowest_branch(2, load_actuator("friend-2").parameter_values)
    ('circuit.branches.1.resistivity', 'circuit.branches.1.permittivity')
    """
    return max(map(branch_names, range(branches)), key=lambda names: values[names[0]] * values[names[1]])


def contact(values: Values, branches: int, *, leak: bool, along: bool = False) -> Node:
    """The part of the clamped section that the contacts feed at once, behind the contact resistance."""
    return Node(
        name="clamp",
        membrane=membrane(values, branches, geometry.direct_length(values)),
        voltage="contact_voltage" if leak or along else "",
        leak="contact_leak_current" if leak else "",
        resistance=values["circuit.contact_resistance"],
    )


def contact_port(values: Values) -> tuple[str, str, complex]:
    """Where that part leaks, and its area."""
    return "contact_voltage", "contact_leak_current", geometry.direct_length(values) * values["geometry.width"]


def _branch_trials(values: Numbers, excitation: Excitation) -> Iterator[Trial]:
    last = number_of(values, "circuit.branches.")
    resistivity = values["circuit.dc_resistivity"] / CURRENT
    for lag in excitation.lags:
        branch = {
            f"circuit.branches.{last}.resistivity": resistivity,
            f"circuit.branches.{last}.permittivity": lag / resistivity,  # their product is its time constant
        }
        yield Trial(f"branches={last + 1}", branch, lag=lag)


def _clamp_trials(values: Numbers, _excitation: Excitation) -> Iterator[Trial]:
    if not is_there(values, "clamp.") and not is_there(values, "line.") and values["geometry.clamped_length"] > 0.0:
        yield Trial("clamp", {"clamp.direct_share": LITTLE})


KIND = StageKind("circuit", "circuit.", group="electrical", outputs=("current",), electrical=True)
BRANCHES = StageKind(
    "branches",
    "circuit.branches.",
    group="electrical",
    counted=True,
    compared_as="circuit.branches.",
    outputs=("current",),
    electrical=True,
    grows={"permittivity": 1.0, "resistivity": -1.0},
    shows="a charge that comes with a time constant of its own",
    trials=_branch_trials,
    speed=lambda values, name: values[f"{name}.resistivity"] * values[f"{name}.permittivity"],
)
CLAMP = StageKind(
    "clamp",
    "clamp.",
    group="clamp",
    example=True,
    compared_as="clamp",
    outputs=("current",),
    electrical=True,
    several_minima=True,
    curved=True,
    off=("direct_share",),
    shows="an early current that the electrodes do not hold back",
    to_determine="record the first rows after a step faster",
    trials=_clamp_trials,
)
