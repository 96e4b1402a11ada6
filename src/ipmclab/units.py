"""Quantities: their SI unit, their symbol, and the units in which people write them.

Inside ipmclab every number is an SI float. Units live at the border: files, the
command line, plots and tables. The table below is the whole list of accepted
units, so that no text can be read as something that nobody meant.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeVar

from ipmclab.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

Number = TypeVar("Number", float, "npt.NDArray[np.float64]")

_MULTIPLES: Final[dict[str, dict[str, float]]] = {
    "": {},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0, "d": 86400.0},
    "V": {"V": 1.0, "mV": 1e-3, "uV": 1e-6},
    "A": {"A": 1.0, "mA": 1e-3, "uA": 1e-6},
    "N": {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "gf": 9.80665e-3},
    "A/s": {"A/s": 1.0, "mA/s": 1e-3, "uA/s": 1e-6},
    "N/s": {"N/s": 1.0, "mN/s": 1e-3, "uN/s": 1e-6},
    "N/m": {"N/m": 1.0, "mN/mm": 1.0, "gf/mm": 9.80665},
    "C": {"C": 1.0, "mC": 1e-3, "uC": 1e-6},
    "W": {"W": 1.0, "mW": 1e-3, "uW": 1e-6},
    "J": {"J": 1.0, "mJ": 1e-3, "kJ": 1e3},
    "V/s": {"V/s": 1.0, "mV/s": 1e-3},
    "ohm": {"ohm": 1.0, "mohm": 1e-3, "kohm": 1e3, "Mohm": 1e6},
    "ohm/sq": {"ohm/sq": 1.0, "ohm": 1.0, "mohm": 1e-3, "kohm": 1e3},
    "ohm m": {"ohm m": 1.0, "ohm cm": 1e-2, "ohm mm": 1e-3, "kohm m": 1e3},
    "F/m": {"F/m": 1.0, "mF/m": 1e-3, "uF/m": 1e-6},
    "F": {"F": 1.0, "mF": 1e-3, "uF": 1e-6},
    "m/V/s": {"m/V/s": 1.0, "mm/V/s": 1e-3, "um/V/s": 1e-6, "nm/V/s": 1e-9},
    "N/V": {"N/V": 1.0, "mN/V": 1e-3, "uN/V": 1e-6},
    "m/V": {"m/V": 1.0, "mm/V": 1e-3, "um/V": 1e-6, "nm/V": 1e-9},
    "1/s": {"1/s": 1.0, "rad/s": 1.0, "1/ms": 1e3},
    "1/s^2": {"1/s^2": 1.0, "rad^2/s^2": 1.0},
    "kg/m^3": {"kg/m^3": 1.0, "g/cm^3": 1e3, "g/m^3": 1e-3},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5, "mbar": 1e2},
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
    "kg/m^2": {"kg/m^2": 1.0, "g/m^2": 1e-3, "mg/cm^2": 1e-2},
    "Hz": {"Hz": 1.0, "mHz": 1e-3, "kHz": 1e3, "S/s": 1.0, "kS/s": 1e3, "1/s": 1.0},
    "rad": {"rad": 1.0, "deg": math.pi / 180.0},
    "A/m^2": {"A/m^2": 1.0, "mA/cm^2": 10.0, "mA/m^2": 1e-3},
    "S/m^2": {"S/m^2": 1.0},
    "A/V^2/m^2": {"A/V^2/m^2": 1.0},
    "A/V^3/m^2": {"A/V^3/m^2": 1.0},
    "degC": {"degC": 1.0},
    "percent": {"percent": 1.0, "%": 1.0, "%RH": 1.0},
    "J/mol": {"J/mol": 1.0, "kJ/mol": 1e3},
    "1/K": {"1/K": 1.0},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6},
    "m^2/s": {"m^2/s": 1.0, "cm^2/s": 1e-4, "mm^2/s": 1e-6, "um^2/s": 1e-12},
    "mol/m^3": {"mol/m^3": 1.0, "mol/l": 1e3},
}


@dataclass(frozen=True)
class Quantity:
    """A kind of number: what it is called, its SI unit, and how people read it.

    Parameters
    ----------
    name : str
        What it is, such as ``"length"``.
    unit : str
        The SI unit that floats of this quantity have inside ipmclab.
    display_unit : str
        The unit of plots, tables and reports.
    symbol : str
        The symbol on plots.
    """

    name: str
    unit: str
    display_unit: str
    symbol: str = ""

    @property
    def units(self) -> dict[str, float]:
        """Every accepted unit with its factor to the SI unit."""
        return _MULTIPLES[self.unit]

    def to_display(self, value: Number) -> Number:
        """An SI value, or an array of them, in the display unit."""
        return value / self.units[self.display_unit] if self.unit else value

    def text(self, value: float, digits: int = 2) -> str:
        """An SI value in the display unit, with the unit behind it.

        Examples
        --------
        >>> CURRENT.text(0.0123), NUMBER.text(3.0)
        ('12 mA', '3')
        """
        return f"{self.to_display(value):.{digits}g} {self.display_unit}".rstrip()


NUMBER = Quantity("number", "", "")
LENGTH = Quantity("length", "m", "mm", "L")
TIME = Quantity("time", "s", "s", "t")
VOLTAGE = Quantity("voltage", "V", "V", "V")
CURRENT = Quantity("current", "A", "mA", "I")
DISPLACEMENT = Quantity("displacement", "m", "mm", "δ")
FORCE = Quantity("force", "N", "mN", "f")
APPLIED_VOLTAGE = Quantity("applied voltage", "V", "V", "V_appl")
TEMPERATURE = Quantity("temperature", "degC", "degC", "T")
RELATIVE_HUMIDITY = Quantity("relative humidity", "percent", "percent", "RH")
CHAMBER_TEMPERATURE = Quantity("chamber temperature", "degC", "degC", "T_c")
CHAMBER_HUMIDITY = Quantity("chamber humidity", "percent", "percent", "RH_c")
RESISTANCE = Quantity("resistance", "ohm", "ohm", "R")
SHEET_RESISTANCE = Quantity("sheet resistance", "ohm/sq", "ohm/sq", "R_s")
RESISTIVITY = Quantity("resistivity", "ohm m", "ohm m", "ρ")
PERMITTIVITY = Quantity("permittivity", "F/m", "F/m", "ε")
COUPLING_GAIN = Quantity("coupling gain", "m/V/s", "m/V/s", "K_d")
ANGULAR_RATE = Quantity("angular rate", "1/s", "1/s")
SQUARED_ANGULAR_RATE = Quantity("squared angular rate", "1/s^2", "1/s^2")
DENSITY = Quantity("density", "kg/m^3", "kg/m^3", "ρ_m")
MODULUS = Quantity("Young's modulus", "Pa", "MPa", "Y")
STRAIN_COEFFICIENT = Quantity("coupling at rest", "m/V", "nm/V", "d(0)")
DISPLACEMENT_PER_VOLT = Quantity("displacement per volt", "m/V", "mm/V")
FORCE_PER_VOLT = Quantity("force per volt", "N/V", "mN/V")
STIFFNESS = Quantity("stiffness", "N/m", "N/m", "k")
MASS = Quantity("mass", "kg", "mg", "m")
AREAL_MASS = Quantity("mass per area", "kg/m^2", "mg/cm^2")
PRESSURE = Quantity("pressure", "Pa", "kPa", "p")
CAPACITANCE = Quantity("capacitance", "F", "mF", "C")
FREQUENCY = Quantity("frequency", "Hz", "Hz", "f")
ANGLE = Quantity("angle", "rad", "deg", "φ")
CHARGE = Quantity("charge", "C", "C", "Q")
POWER = Quantity("power", "W", "W", "P")
ENERGY = Quantity("energy", "J", "J", "E")
CURRENT_DENSITY = Quantity("current density", "A/m^2", "A/m^2", "j")
SLEW_RATE = Quantity("slew rate", "V/s", "V/s")
ACTIVATION_ENERGY = Quantity("activation energy", "J/mol", "kJ/mol", "E")
PER_KELVIN = Quantity("temperature coefficient", "1/K", "1/K")
MASS_TRANSFER = Quantity("mass transfer coefficient", "m/s", "mm/s", "k")
DIFFUSIVITY = Quantity("diffusivity", "m^2/s", "um^2/s", "D")
CONCENTRATION = Quantity("concentration", "mol/m^3", "mol/m^3", "c")

CHANNELS: Final[dict[str, Quantity]] = {
    "voltage": VOLTAGE,
    "current": CURRENT,
    "displacement": DISPLACEMENT,
    "force": FORCE,
    "applied_voltage": APPLIED_VOLTAGE,
    "temperature": TEMPERATURE,
    "relative_humidity": RELATIVE_HUMIDITY,
    "chamber_temperature": CHAMBER_TEMPERATURE,
    "chamber_relative_humidity": CHAMBER_HUMIDITY,
}
"""The channels of a run and the quantity of each, declared once."""

_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,9})?")
_SPELLINGS = (
    ("°C", "degC"),
    ("℃", "degC"),
    ("µ", "u"),
    ("μ", "u"),
    ("Ω", "ohm"),
    ("Ω", "ohm"),
    ("Ohm", "ohm"),
    ("²", "^2"),
    ("³", "^3"),
    ("·", " "),
)


def significant(value: float, digits: int) -> str:
    """A number with so many significant digits, without a power of ten where it has few places.

    Examples
    --------
    >>> significant(1442.3, 3), significant(6.79e-9, 3)
    ('1440', '6.79e-09')
    """
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


def spell_unit(unit: str) -> str:
    """A unit in the spelling of the tables above.

    Examples
    --------
    >>> spell_unit("µm"), spell_unit(" kg/m³ ")
    ('um', 'kg/m^3')
    """
    for written, spelled in _SPELLINGS:
        unit = unit.replace(written, spelled)
    return " ".join(unit.split())


def parse_number(text: str, *, where: str, unit: str = "mm") -> tuple[float, str]:
    """Split ``"25 mm"`` into its number and the rest.

    Parameters
    ----------
    text : str
        A number with a decimal point, then perhaps a unit.
    where : str
        Where the text is, for the message.
    unit : str
        Of the example in the message.

    Returns
    -------
    number : float
    unit : str
        What follows the number, normalised (``"µm"`` to ``"um"``); may be empty.

    Raises
    ------
    InputError
        When the text does not start with a finite number, or has a decimal comma.
    """
    stripped = text.strip()
    match = _NUMBER.match(stripped)
    rest = stripped[match.end() :] if match else stripped
    if "," in stripped:
        raise InputError(
            f"{text!r} has a comma",
            code="decimal-comma",
            where=where,
            repair=_without_comma(stripped, unit),
        )
    if match is None or re.match(r"[\w.+-]*\d", rest.split(" ")[0]):
        raise InputError(
            f"{text!r} is not a number with a unit",
            code="bad-number",
            where=where,
            repair=f"write for example '25 {unit}'",
        )
    number = float(match.group())
    if not math.isfinite(number):
        raise InputError(
            f"{text!r} is too large for a number", code="bad-number", where=where, repair="correct the number"
        )
    return number, spell_unit(rest)


def _without_comma(text: str, unit: str) -> str:
    """What to write in the place of a number with a comma."""
    number = re.match(r"[+-]?[0-9]*,[0-9]+(?![0-9.])", text)
    if number is None or text.count(",") > 1:
        return f"write one number without a comma, and its unit: for example '2.5 {unit}'"
    with_point = f"write a decimal point and no thousands mark: {text.replace(',', '.', 1)!r}"
    is_open = re.fullmatch(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}", number.group())
    return f"{with_point} or {text.replace(',', '', 1)!r}" if is_open else with_point


def parse_quantity(text: str, quantity: Quantity, *, where: str, example: str = "") -> float:
    """Read a number with its unit as an SI float.

    Parameters
    ----------
    text : str
        For example ``"25 mm"``.
    quantity : Quantity
        What it must be.
    where : str
        Where the text is, for the message.
    example : str
        What to write, where a number alone does not show which unit was meant; else that number in the unit that people
        read.

    Returns
    -------
    value : float [SI unit of the quantity]

    Raises
    ------
    InputError
        Not a number, no unit, a unit of something else, or too large a number in the SI unit.

    Examples
    --------
    >>> parse_quantity("25 mm", LENGTH, where="geometry.free_length")
    0.025
    """
    number, unit = parse_number(text, where=where, unit=quantity.display_unit or "mm")
    if not quantity.unit:
        if unit:
            raise InputError(
                f"{text!r} has the unit {unit!r}, this is a bare number",
                code="bad-unit",
                where=where,
                repair=f"write {number!r}",
            )
        return number
    if not unit:
        raise InputError(
            f"{text!r} has no unit",
            code="missing-unit",
            where=where,
            repair=f"write for example '{example or f'{number:g} {quantity.display_unit}'}'",
        )
    if unit not in quantity.units:
        only = len(quantity.units) == 1
        raise InputError(
            f"{text!r} is not a {quantity.name}: the unit {unit!r} is not "
            f"{'' if only else 'one of '}{', '.join(quantity.units)}",
            code="bad-unit",
            where=where,
            repair=f"give the {quantity.name} in {quantity.display_unit}{'' if only else ' or another of these'}",
        )
    factor = quantity.units[unit]
    # A decimal multiple is applied in decimal, so that "0.245 mm" is the float 0.000245.
    exponent = round(math.log10(factor))
    if factor == float(f"1e{exponent}"):
        mantissa = _NUMBER.match(text.strip())
        assert mantissa is not None
        base, _, power = mantissa.group().lower().partition("e")
        value = float(f"{base}e{int(power or 0) + exponent}")
    else:
        value = number * factor
    if not math.isfinite(value):
        raise InputError(
            f"{text!r} is too large for a number in {quantity.unit}",
            code="bad-number",
            where=where,
            repair="correct the number or its unit",
        )
    return value


def format_quantity(value: float, quantity: Quantity) -> str:
    """Write an SI float with its SI unit, so that reading it back gives the same float.

    Examples
    --------
    >>> format_quantity(0.025, LENGTH)
    '0.025 m'
    """
    number = repr(float(value))  # a NumPy scalar would write its type too
    return f"{number} {quantity.unit}" if quantity.unit else number


def readable_quantity(value: float, quantity: Quantity) -> str:
    """Write an SI float in the unit that people read where reading that back gives the same float, else in SI.

    Examples
    --------
    >>> readable_quantity(0.025, LENGTH), readable_quantity(1.0 / 3.0, LENGTH)
    ('25 mm', '0.3333333333333333 m')
    """
    readable = f"{quantity.to_display(value):.15g} {quantity.display_unit}"
    return readable if parse_quantity(readable, quantity, where="") == value else format_quantity(value, quantity)
