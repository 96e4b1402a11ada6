"""Actuator: the model of a sample, as a frozen value with dotted parameter names."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.kinds import tell_kinds
from ipmclab.model import geometry
from ipmclab.model.assemble import System, assemble
from ipmclab.model.blocks import Block
from ipmclab.model.environment import Environment, EnvironmentLaw, WaterState, equilibrium, sorption, values_in
from ipmclab.model.export import to_control, to_scipy
from ipmclab.model.parameters import Declaration, Parameter, Values
from ipmclab.model.ports import OUTPUT_PORTS, left_at_rest
from ipmclab.model.response import frequency_response
from ipmclab.model.stages.circuit import Circuit, Elements
from ipmclab.model.stepping import Simulator
from ipmclab.model.structure import Structure
from ipmclab.sample import Sample
from ipmclab.shown import Shown

if TYPE_CHECKING:
    import control
    import scipy.signal

    from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

_Kept = TypeVar("_Kept")

_MOST_KEPT: Final = 32
"""Results kept with an actuator: a session meets a few rates and holds, a sweep of rates must not fill the memory."""


@dataclass(frozen=True, eq=False)
class Actuator(Shown):
    """The model of a sample: its dimensions and its stages; which stages it has, its parameters show.

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
        The ``[fit]`` table of a fitted actuator's file, as it is there.
    environment_laws : tuple of EnvironmentLaw
        How parameters follow the environment by functions of your own, for ``at``. A file does not hold them; the laws
        of the literature are parameters (``environment.laws``).
    loaded_as : str
        What ``load_actuator`` was given for it, with the stages added since, so that messages can name it; no part of
        its file.

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
    fit_table: Mapping[str, Any] | None = None
    environment_laws: tuple[EnvironmentLaw, ...] = ()
    loaded_as: str = ""

    def __post_init__(self) -> None:
        given = dict(self.parameter_values)
        known = Structure.of(given).declarations
        for name in (*given, *self.standard_uncertainties, *(law.parameter for law in self.environment_laws)):
            if name not in known:
                raise unknown_parameter(name, known)
        for name, declaration in known.items():
            if name not in given:
                if declaration.default is None:
                    raise InputError("this parameter is missing", code="missing-key", where=name, repair="give it")
                given[name] = declaration.default
            given[name] = _checked(declaration, given[name])
        for name, uncertainty in self.standard_uncertainties.items():
            if not (math.isfinite(uncertainty) and uncertainty >= 0):
                raise InputError(
                    f"the standard uncertainty {uncertainty:g} is not a number from 0 up",
                    code="out-of-range",
                    where=name,
                    repair="give one standard deviation, or none when the value is exact",
                )
        geometry.check(given)
        sorption.check(given)
        object.__setattr__(self, "parameter_values", {name: given[name] for name in known})

    def __getstate__(self) -> dict[str, Any]:
        """What a copy and a pickle take along: the fields; what was worked out from them is worked out again."""
        return {name: getattr(self, name) for name in _FIELDS}

    def keep(self, key: Hashable, make: Callable[[], _Kept]) -> _Kept:
        """What a computation works out of this actuator once, under a key of its own; the latest few are kept."""
        kept: dict[Hashable, Any] = self.__dict__.setdefault("_kept", {})
        try:  # and not "if key in kept": another thread may clear it in between
            found: _Kept = kept[key]
        except KeyError:
            pass
        else:
            return found
        if len(kept) >= _MOST_KEPT:
            kept.clear()
        kept[key] = made = make()
        return made

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
        """A copy with some parameters changed; it is no longer the fit that ``fit_table`` describes.

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
        known = self.structure.declarations
        values = {**self.parameter_values, **{name: _checked(known[name], value) for name, value in changes.items()}}
        geometry.check(values)
        sorption.check(values)
        kept = {name: value for name, value in self.standard_uncertainties.items() if name not in changes}
        return self._with(parameter_values=values, standard_uncertainties=kept, fit_table=None)

    def with_fit_table(self, table: Mapping[str, Any] | None) -> Actuator:
        """The same, said to come of the fit that a table describes, or of none."""
        return self._with(fit_table=table)

    def _with(self, **changes: Any) -> Actuator:
        """A copy with other fields; whoever makes them does so often: what was checked before is not checked again."""
        changed: Actuator = object.__new__(type(self))
        changed.__dict__.update(self.__getstate__(), structure=self.structure)
        changed.__dict__.update(changes)
        return changed

    def at(self, environment: Environment | WaterState) -> Actuator:
        """The actuator in a constant environment: its parameters as its laws say, and no laws left.

        Parameters
        ----------
        environment : Environment or WaterState
            Of an environment it is the state in which the strip is after a long time (``environment.equilibrium``).

        Returns
        -------
        actuator : Actuator
            This one where it has no laws.

        Raises
        ------
        InputError
            A law gives a value outside the parameter's allowed range.

        Examples
        --------
        >>> from ipmclab import load_actuator
        >>> from ipmclab.model.environment import Environment
        >>> strip = load_actuator("friend-2")
        >>> strip.at(Environment(temperature=25.0, relative_humidity=50.0)) is strip
        True
        >>> from ipmclab.model import with_stages
        >>> wetter = with_stages(strip, "environment.coupling_gain").at(Environment(20.0, 90.0))
        >>> round(wetter["coupling.gain"] / strip["coupling.gain"], 4)
        1.3904
        """
        if not (self.environment_laws or self.structure.hydration):
            return self
        there = dict(self.parameter_values)
        if self.structure.hydration:
            state = equilibrium(there, environment) if isinstance(environment, Environment) else environment
            there = values_in(there, state)
        if self.environment_laws:
            around = self._around(environment)
            there |= {law.parameter: law.value(there[law.parameter], around) for law in self.environment_laws}
        kept = {name: self.standard_uncertainties[name] for name in there if name in self.standard_uncertainties}
        same = {name: value for name, value in kept.items() if there[name] == self[name]}
        return replace(self, parameter_values=there, standard_uncertainties=same, fit_table=None, environment_laws=())

    def _around(self, environment: Environment | WaterState) -> Environment:
        """The environment that laws of one's own are asked with."""
        if isinstance(environment, Environment):
            return environment
        humidity = environment.relative_humidity
        if humidity is None:
            if not self.structure.hydration:
                raise InputError(
                    "a law of your own needs the humidity, and this state does not state it",
                    code="bad-environment",
                    where="relative_humidity",
                    repair="give the state its relative_humidity, or the actuator a table [hydration]",
                )
            humidity = 100.0 * float(sorption.activity(self.parameter_values, environment.water_content))
        return Environment(environment.temperature, humidity)

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

    def assembled(self, values: Values | None = None, *, inputs: Sequence[str] = ("voltage",)) -> System:
        """The joined system, for these or for other (also complex) parameter values.

        Parameters
        ----------
        values : mapping of dotted name to number [SI], optional
        inputs : sequence of str
            Some of ``ports.INPUTS``; the others stay at 0.

        Raises
        ------
        InputError
            An unknown input.
        """
        at = self.parameter_values if values is None else values
        return assemble(
            self.blocks(at),
            inputs=inputs,
            outputs=OUTPUT_PORTS,
            laws=self.structure.laws(at),
            at_rest=left_at_rest(inputs),
        )

    @cached_property
    def system(self) -> System:
        """The joined system of this actuator, driven by the voltage alone."""
        return self.assembled()

    def driven_by(self, inputs: Sequence[str]) -> System:
        """The joined system of this actuator, driven by some of ``ports.INPUTS``."""
        if tuple(inputs) == ("voltage",):
            return self.system
        return self.keep(("driven by", *inputs), lambda: self.assembled(inputs=inputs))

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states: capacitor voltages [V], coupling states, displacement [m] and velocity [m/s]."""
        return self.system.states

    @tell_kinds
    def simulator(
        self,
        rate: float | str,
        hold: Hold = "zero",
        *,
        initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
        inputs: Sequence[str] = ("voltage",),
    ) -> Simulator:
        """The actuator as something that is stepped, sample by sample or block by block.

        Parameters
        ----------
        rate : float [Hz], or a text such as "50 Hz"
        hold : "zero", "zero-before" or "first"
        initial_state : mapping of state name to float, or array of shape (n_states,), optional
            Rest where it is left out.
        inputs : sequence of str
            What drives it: the voltage alone, or ``("voltage", "external_force")``.
        """
        return Simulator(self.driven_by(inputs), self.parameter_values, rate, hold, initial_state=initial_state)

    @tell_kinds
    def frequency_response(
        self, frequency: npt.ArrayLike, outputs: Sequence[str] | None = None, *, driven_by: str = "voltage"
    ) -> npt.NDArray[np.complex128]:
        """Output over an input at some frequencies, ``c (2 pi j f - a)^-1 b + d``.

        Parameters
        ----------
        frequency : float array, shape (n_frequency,) [Hz]
        outputs : sequence of str, optional
            Some of ``OUTPUTS``; all of them where it is left out.
        driven_by : "voltage" or "external_force"

        Returns
        -------
        response : complex array, shape (n_outputs, n_frequency) [SI unit of the output per V, or per N]
        """
        return frequency_response(self.driven_by([driven_by]), frequency, outputs)

    def to_scipy(self) -> scipy.signal.StateSpace:
        """The linear system as a ``scipy.signal.StateSpace``: voltage [V] to ``OUTPUTS`` [SI]."""
        return to_scipy(self.system)

    def to_control(self) -> control.StateSpace:
        """The linear system as a python-control ``StateSpace``: voltage [V] to ``OUTPUTS`` [SI].

        Raises
        ------
        InputError
            When python-control is not installed.
        """
        return to_control(self.system, self.name)


_FIELDS: Final = tuple(one.name for one in fields(Actuator))


def _checked(declaration: Declaration, value: Any) -> float:
    """A value as a number within its allowed range."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(
            f"{value!r} is not a number",
            code="bad-value",
            where=declaration.name,
            repair=f"give it as a number in {declaration.quantity.unit or 'no unit'}",
        ) from None
    declaration.check(number, where=declaration.name)
    return number


def unknown_parameter(name: str, known: Iterable[str]) -> InputError:
    """The error for a parameter name that an actuator does not have."""
    written = str(name)  # a dict of parameters may have any key
    return InputError(
        f"unknown parameter {name!r}", code="unknown-parameter", where=written, repair=suggest(written, known)
    )
