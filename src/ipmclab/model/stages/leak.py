"""Leak: the current that electrolysis draws past the branches, a static monotone law at each node."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ipmclab.model.blocks import Block, Law, block
from ipmclab.model.parameters import Declaration, Values
from ipmclab.model.stages.kind import CURRENT, LITTLE, Excitation, Numbers, StageKind, Trial, is_there
from ipmclab.run import FloatArray
from ipmclab.units import CURRENT_DENSITY, NUMBER, TIME, VOLTAGE, Quantity

LEAK: Final = "leak."
FORMS: Final = ("cubic", "exponential", "butler_volmer")
"""Forms of the law, in the order of the numbers by which the compiled loops know them."""

ELECTROLYSIS: Final = 1.23
"""Water decomposes above this voltage [V]."""

_PER_V = Quantity("conductance per area", "S/m^2", "S/m^2")
_PER_V2 = Quantity("current density per squared voltage", "A/V^2/m^2", "A/V^2/m^2")
_PER_V3 = Quantity("current density per cubed voltage", "A/V^3/m^2", "A/V^3/m^2")

# A linear unit counts as about 0.1 mA at 2 V on the area of a usual strip, 1.5 cm^2.
_DECLARATIONS: Final = {
    "cubic": (
        # The linear part lies in parallel with R_dc: no reading distinguishes the two.
        Declaration("leak.cubic.linear", _PER_V, "a_1", 0.0, 1e9, "linear", typical=0.0, scale=0.5, in_group=False),
        Declaration("leak.cubic.quadratic", _PER_V2, "a_2", 0.0, 1e9, "linear", typical=0.0, scale=0.2),
        Declaration("leak.cubic.cubic", _PER_V3, "a_3", 0.0, 1e9, "linear", typical=3.0, scale=0.1),
    ),
    "exponential": (
        Declaration(
            *("leak.exponential.current_density", CURRENT_DENSITY, "j_0", 0.0, 1e9, "linear"), typical=10.0, least=1e-12
        ),
        Declaration("leak.exponential.threshold", VOLTAGE, "V_th", 0.0, 10.0, "linear", typical=1.23),
        Declaration("leak.exponential.voltage_scale", VOLTAGE, "V_s", 1e-3, 100.0, typical=0.5),
    ),
    "butler_volmer": (
        Declaration(
            *("leak.butler_volmer.current_density", CURRENT_DENSITY, "j_0", 0.0, 1e9, "linear"),
            typical=10.0,
            least=1e-12,
        ),
        Declaration("leak.butler_volmer.threshold", VOLTAGE, "V_rev", 0.0, 10.0, "linear", typical=1.23),
        Declaration("leak.butler_volmer.voltage_scale", VOLTAGE, "V_s", 1e-3, 100.0, typical=0.5),
    ),
}
SLOW_TIME: Final = "leak.slow.time_constant"
_SLOW: Final = (
    Declaration("leak.slow.growth", NUMBER, "g", 0.0, 1e3, "linear", typical=0.5, scale=0.1),
    Declaration(SLOW_TIME, TIME, "τ_g", 1e-3, 1e6, typical=60.0),
)


@dataclass(frozen=True)
class Leak:
    """An odd, monotone current density over the voltage behind the electrodes, in parallel with R_dc.

    Parameters
    ----------
    form : str
        One of ``FORMS``.
    slow : bool
        Whether a part of the current follows the law slowly: i + g (i behind a lag).
    """

    form: str
    slow: bool = False

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""
        return (*_DECLARATIONS[self.form], *(_SLOW if self.slow else ()))

    def onset(self, values: Mapping[str, float]) -> float:
        """The voltage [V] beyond which the law gives a current; infinite where it gives none at any.

        Examples
        --------
        >>> typical = {one.name: one.typical for one in Leak("exponential").declarations}
        >>> Leak("exponential").onset(typical)
        1.23
        """
        first, second, third = (values[declaration.name] for declaration in _DECLARATIONS[self.form])
        if self.form == "cubic":
            return 0.0 if max(first, second, third) > 0.0 else math.inf
        return second if first > 0.0 else math.inf

    def laws(self, values: Values, ports: Sequence[tuple[str, str, complex]]) -> tuple[Law, ...]:
        """The law at each place where the electrodes leak, its current density times the area there."""
        names = [declaration.name for declaration in _DECLARATIONS[self.form]]
        first, second, third = (values[name] for name in names)
        found = []
        for voltage, current, area in ports:
            port = f"static_{current}" if self.slow else current
            numbers = (
                (first * area, second * area, third * area) if self.form == "cubic" else (first * area, second, third)
            )
            found.append(Law(voltage, port, FORMS.index(self.form), numbers))
        return tuple(found)

    def blocks(self, values: Values, ports: Sequence[tuple[str, str, complex]]) -> tuple[Block, ...]:
        """The slow part of each leak: the static current, and it once more behind a lag."""
        if not self.slow:
            return ()
        growth, rate = values["leak.slow.growth"], 1.0 / values["leak.slow.time_constant"]
        return tuple(
            block(
                states=[f"leak.slow.{current}"],
                inputs=[f"static_{current}"],
                outputs=[current],
                a=[[-rate]],
                b=[[rate]],
                c=[[growth]],
                d=[[1.0]],
            )
            for _, current, _ in ports
        )


_SCALES: Final = (0.2, 1.0)
"""Voltage scales of an exponential leak that are tried [V]."""

_LEAST_VOLTAGE: Final = 1e-50
"""Voltage [V] whose cube is still far from the smallest number of a computer."""

_STEEPEST: Final = 700.0
"""Exponent beyond which an exponential is no number of a computer (it ends at 709)."""


def current_density(form: str, coefficients: Sequence[float], voltage: FloatArray) -> FloatArray:
    """What leaks through each area [A/m^2] at voltages behind the electrodes.

    Parameters
    ----------
    form : str
    coefficients : sequence of three floats
        In the order of the form's parameters.
    voltage : float array [V]
    """
    first, second, third = coefficients
    size = np.abs(voltage)
    if form == "cubic":
        return np.asarray(voltage * (first + size * (second + size * third)))
    above = np.clip((size - second) / third, 0.0, _STEEPEST)
    grown = np.expm1(above) if form == "exponential" else 2.0 * np.sinh(0.5 * above)
    return np.asarray(np.sign(voltage) * first * grown)


def _goes(values: Numbers) -> bool:
    """Whether a leak would be a new one: a line by modes has no place for it."""
    return not is_there(values, "leak.") and not is_there(values, "line.modes")


def _cubic_trials(values: Numbers, excitation: Excitation) -> Iterator[Trial]:
    if not _goes(values) or excitation.voltage <= _LEAST_VOLTAGE:
        return
    size = CURRENT * excitation.current_density / excitation.voltage**3
    yield Trial("leak.cubic", {"leak.cubic.cubic": size})


def _exponential_trials(values: Numbers, excitation: Excitation) -> Iterator[Trial]:
    if not _goes(values) or excitation.voltage <= ELECTROLYSIS:
        return
    for scale in _SCALES:
        steepness = (excitation.voltage - ELECTROLYSIS) / scale
        if steepness > _STEEPEST:
            continue
        above = math.expm1(steepness)
        yield Trial(
            "leak.exponential",
            {
                "leak.exponential.current_density": CURRENT * excitation.current_density / above,
                "leak.exponential.threshold": ELECTROLYSIS,
                "leak.exponential.voltage_scale": scale,
            },
        )


def _slow_trials(values: Numbers, excitation: Excitation) -> Iterator[Trial]:
    if is_there(values, "leak.") and not is_there(values, "leak.slow."):
        for lag in excitation.lags:
            growing = {"leak.slow.growth": LITTLE, "leak.slow.time_constant": lag}
            yield Trial("leak.slow", growing, both_ways=True, lag=lag)


def _kind(name: str) -> StageKind:
    return StageKind(
        f"leak.{name}",
        f"leak.{name}.",
        group="leak",
        one_of="leak",
        compared_as=f"leak.{name}",
        outputs=("current",),
        electrical=True,
        several_minima=True,
        curved=True,
        off=("current_density",),
        held=("threshold",),
        shows="a current that grows beyond 1.23 V",
        to_determine="record at several voltages above the threshold of the leak, by a slow sine or by steps",
        cure=("raise voltage", "record at several voltages above the threshold of the leak"),
        to_show="record above the threshold of the leak, 1.23 V behind the electrodes, and below it",
    )


KINDS: Final = (
    replace(
        _kind("cubic"),
        curved=False,
        off=("linear", "quadratic", "cubic"),
        held=("linear",),
        shows="a current that grows faster than the voltage",
        trials=_cubic_trials,
    ),
    replace(_kind("exponential"), example=True, trials=_exponential_trials),
    _kind("butler_volmer"),
    replace(
        _kind("slow"),
        one_of="",
        follows="leak",
        off=("growth",),
        held=(),
        shows="a leak that changes while the voltage is constant",
        to_show="record for longer at a voltage that leaks",
        trials=_slow_trials,
    ),
)
