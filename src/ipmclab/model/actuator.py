"""Actuator: the model of a sample, as a frozen value with dotted parameter names."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.model import geometry
from ipmclab.model.assemble import System, assemble
from ipmclab.model.blocks import Block
from ipmclab.model.parameters import Parameter, Values
from ipmclab.model.stages.circuit import Circuit, Elements
from ipmclab.model.structure import Structure
from ipmclab.sample import Sample

if TYPE_CHECKING:
    import control
    import scipy.signal

    from ipmclab.model.stepping import Simulator
    from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

OUTPUTS: Final = ("current", "applied_voltage", "displacement", "force")
"""What an actuator gives out, always in this order."""

OUTPUT_PORTS: Final = tuple("node_voltage" if name == "applied_voltage" else name for name in OUTPUTS)
"""The port behind each output, in the same order."""


@dataclass(frozen=True, eq=False)
class Actuator:
    """The model of a sample: its dimensions and its stages; which stages it has, its parameters tell.

    Parameters
    ----------
    name : str
    parameter_values : mapping of dotted name to float [SI]
        Every parameter; ``load_actuator`` reads them from a file.
    standard_uncertainties : mapping of dotted name to float [SI], optional
        Stated standard uncertainties; a parameter without one is taken as exact.
    sample : Sample, optional
        What the strip is made of.
    fit_table : mapping, optional
        The ``[fit]`` table of a fitted actuator's file, as it stands there.

    Raises
    ------
    InputError
        A missing or unknown parameter, a value outside its allowed range, a sensing point beyond the free end.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> actuator = load_actuator("friend-2")
    >>> actuator["geometry.thickness"]
    0.000245
    >>> softer = actuator.replace(**{"beam.modulus": 2e8})
    >>> softer.parameters()["beam.modulus"].unit
    'Pa'
    """

    name: str
    parameter_values: Mapping[str, float]
    standard_uncertainties: Mapping[str, float] = field(default_factory=dict)
    sample: Sample | None = None
    fit_table: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        given = dict(self.parameter_values)
        known = Structure.of(given).declarations
        for name in (*given, *self.standard_uncertainties):
            if name not in known:
                raise unknown_parameter(name, known)
        for name, declaration in known.items():
            if name not in given:
                if declaration.default is None:
                    raise InputError("this parameter is missing", code="missing-key", where=name, repair="give it")
                given[name] = declaration.default
            try:
                given[name] = float(given[name])
            except (TypeError, ValueError):
                raise InputError(
                    f"{given[name]!r} is not a number",
                    code="bad-value",
                    where=name,
                    repair=f"give it as a number in {declaration.quantity.unit or 'no unit'}",
                ) from None
            declaration.check(given[name], where=name)
        for name, uncertainty in self.standard_uncertainties.items():
            if not (math.isfinite(uncertainty) and uncertainty >= 0):
                raise InputError(
                    f"the standard uncertainty {uncertainty:g} is not a number from 0 up",
                    code="out-of-range",
                    where=name,
                    repair="give one standard deviation, or none when the value is exact",
                )
        geometry.check(given)
        object.__setattr__(self, "parameter_values", {name: given[name] for name in known})

    def __getitem__(self, name: str) -> float:
        """The value [SI] of one parameter."""
        try:
            return self.parameter_values[name]
        except KeyError:
            raise unknown_parameter(name, self.parameter_values) from None

    def values(self, names: Iterable[str]) -> FloatArray:
        """The values [SI] of some parameters, shape (n_names,)."""
        return np.array([self[name] for name in names], dtype=np.float64)

    def parameters(self) -> dict[str, Parameter]:
        """Every parameter by dotted name, in the order of the file."""
        return dict(self._parameters)

    @cached_property
    def _parameters(self) -> dict[str, Parameter]:
        return {
            name: Parameter(
                name=name,
                value=self.parameter_values[name],
                unit=declaration.quantity.unit,
                symbol=declaration.symbol,
                quantity=declaration.quantity,
                lower=declaration.lower,
                upper=declaration.upper,
                transform=declaration.transform,
                standard_uncertainty=self.standard_uncertainties.get(name, 0.0),
            )
            for name, declaration in self.structure.declarations.items()
        }

    def replace(self, **changes: float) -> Actuator:
        """A copy with some parameters changed; it is no longer the fit that ``fit_table`` tells of.

        A changed parameter loses its stated uncertainty, which belonged to the old value.

        Parameters
        ----------
        **changes : float [SI]
            By dotted name: ``actuator.replace(**{"beam.modulus": 2e8})``.

        Raises
        ------
        InputError
            An unknown name or a value outside its allowed range.
        """
        for name in changes:
            if name not in self.parameter_values:
                raise unknown_parameter(name, self.parameter_values)
        kept = {name: value for name, value in self.standard_uncertainties.items() if name not in changes}
        values = {**self.parameter_values, **changes}
        return replace(self, parameter_values=values, standard_uncertainties=kept, fit_table=None)

    @cached_property
    def structure(self) -> Structure:
        """Which stages this actuator has."""
        return Structure.of(self.parameter_values)

    @cached_property
    def circuit(self) -> Circuit:
        """The lumped circuit of these branches, whatever else the electrodes and the leak do."""
        return Circuit(self.structure.branches)

    def circuit_elements(self) -> Elements:
        """The lumped elements R_e, R_dc, R_Ci and C_i (Friend, eqs 4.1 to 4.6).

        Examples
        --------
        >>> from ipmclab import load_actuator
        >>> round(load_actuator("friend-2").circuit_elements().electrode, 6)
        8.0
        """
        return self.circuit.elements(self.parameter_values)

    def blocks(self, values: Values | None = None) -> tuple[Block, ...]:
        """The linear blocks of the stages, for these or for other (also complex) parameter values."""
        at = self.parameter_values if values is None else values
        return self.structure.blocks(at)

    def assembled(self, values: Values | None = None) -> System:
        """The joined system, for these or for other (also complex) parameter values."""
        at = self.parameter_values if values is None else values
        return assemble(self.blocks(at), external="voltage", outputs=OUTPUT_PORTS, laws=self.structure.laws(at))

    @cached_property
    def system(self) -> System:
        """The joined system of this actuator."""
        return self.assembled()

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states: capacitor voltages [V], coupling states, displacement [m] and velocity [m/s]."""
        return self.system.states

    def simulator(
        self, rate: float, hold: Hold = "zero", *, initial_state: Mapping[str, float] | npt.ArrayLike | None = None
    ) -> Simulator:
        """The actuator as something that is stepped, sample by sample or block by block.

        Parameters
        ----------
        rate : float [Hz]
        hold : "zero", "zero-before" or "first"
        initial_state : mapping of state name to float, or array of shape (n_states,), optional
            Rest where it is left out.
        """
        from ipmclab.model.stepping import Simulator

        return Simulator(self, rate, hold, initial_state=initial_state)

    def frequency_response(
        self, frequency: npt.ArrayLike, outputs: Sequence[str] | None = None
    ) -> npt.NDArray[np.complex128]:
        """Output over voltage at some frequencies, ``c (2 pi j f - a)^-1 b + d``.

        Parameters
        ----------
        frequency : float array, shape (n_frequency,) [Hz]
        outputs : sequence of str, optional
            Some of ``OUTPUTS``; all of them where it is left out.

        Returns
        -------
        response : complex array, shape (n_outputs, n_frequency) [SI unit of the output per V]
        """
        from ipmclab.model.response import frequency_response

        return frequency_response(self, frequency, outputs)

    def to_scipy(self) -> scipy.signal.StateSpace:
        """The linear system as a ``scipy.signal.StateSpace``: voltage [V] to ``OUTPUTS`` [SI]."""
        from ipmclab.model.export import to_scipy

        return to_scipy(self)

    def to_control(self) -> control.StateSpace:
        """The linear system as a python-control ``StateSpace``: voltage [V] to ``OUTPUTS`` [SI].

        Raises
        ------
        InputError
            When python-control is not installed.
        """
        from ipmclab.model.export import to_control

        return to_control(self)


def unknown_parameter(name: str, known: Iterable[str]) -> InputError:
    """The error for a parameter name that an actuator does not have."""
    return InputError(f"unknown parameter {name!r}", code="unknown-parameter", where=name, repair=suggest(name, known))


def choose_outputs(outputs: Sequence[str] | None) -> list[int]:
    """The places in ``OUTPUTS`` of some output names.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if outputs is None:
        return list(range(len(OUTPUTS)))
    for name in outputs:
        if name not in OUTPUTS:
            raise InputError(
                f"unknown output {name!r}", code="unknown-output", where="outputs", repair=suggest(name, OUTPUTS)
            )
    return [OUTPUTS.index(name) for name in outputs]


def state_vector(actuator: Actuator, state: Mapping[str, float] | npt.ArrayLike | None) -> FloatArray:
    """A state as an array in the order of ``state_names``; rest for None, and for names left out.

    Raises
    ------
    InputError
        An unknown state name, a wrong number of values, or a value that is not finite.
    """
    names = actuator.state_names
    if state is None:
        return np.zeros(len(names))
    if isinstance(state, Mapping):
        for name in state:
            if name not in names:
                raise InputError(
                    f"unknown state {name!r}", code="unknown-state", where="initial_state", repair=suggest(name, names)
                )
        vector = np.array([float(state.get(name, 0.0)) for name in names])
    else:
        vector = np.array(state, dtype=np.float64)
    if vector.shape != (len(names),) or not np.all(np.isfinite(vector)):
        raise InputError(
            f"{vector.tolist()} is not one finite value for each of {', '.join(names)}",
            code="bad-state",
            where="initial_state",
            repair=f"give {len(names)} numbers, or a mapping from these names",
        )
    return vector
