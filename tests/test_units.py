"""The table of units against an independent unit library, and the grammar of numbers."""

from __future__ import annotations

import math

import numpy as np
import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import units
from ipmclab.errors import InputError

QUANTITIES = [value for value in vars(units).values() if isinstance(value, units.Quantity) and value.unit]
UNITS = sorted({(quantity.unit, unit, factor) for quantity in QUANTITIES for unit, factor in quantity.units.items()})
# What our spelling means in pint's grammar; temperatures and per cent have one unit only and factor 1.
PINT = {"gf": "gram_force", "ohm/sq": "ohm", "S/s": "Hz", "kS/s": "kHz", "rad/s": "1/s", "rad^2/s^2": "1/s^2"}


def spelled_for_pint(unit: str) -> str:
    return PINT.get(unit, unit).replace(" ", "*")


def test_every_factor_agrees_with_pint() -> None:
    """Each accepted unit is worth what an independent library says it is worth."""
    registry = pint.UnitRegistry(cache_folder=None)
    for si_unit, unit, factor in UNITS:
        if si_unit in ("degC", "percent"):  # one unit only, taken as it is
            assert factor == 1.0
            continue
        ratio = registry.Quantity(1.0, spelled_for_pint(unit)) / registry.Quantity(1.0, spelled_for_pint(si_unit))
        assert ratio.to("dimensionless").magnitude == pytest.approx(factor, rel=1e-12), (unit, si_unit)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_written_quantity_reads_back_to_the_same_float(value: float) -> None:
    """format_quantity and parse_quantity are inverse to the last bit."""
    for quantity in (units.LENGTH, units.MODULUS, units.COUPLING_GAIN, units.NUMBER):
        assert units.parse_quantity(units.format_quantity(value, quantity), quantity, where="x") == value


@given(st.decimals(min_value="1e-6", max_value="1e6", places=6), st.sampled_from(["m", "cm", "mm", "um", "nm"]))
def test_a_decimal_multiple_is_the_nearest_float(number: object, unit: str) -> None:
    """'0.245 mm' is the float 0.000245 and not a neighbour of it."""
    exponent = {"m": 0, "cm": -2, "mm": -3, "um": -6, "nm": -9}[unit]
    assert units.parse_quantity(f"{number} {unit}", units.LENGTH, where="x") == float(f"{number}e{exponent}")


@given(
    st.text(max_size=30)
    | st.builds("{}e{} {}".format, st.integers(), st.integers(-(10**12), 10**12), st.sampled_from(["GPa", "Pa", "mm"]))
)
def test_any_text_is_a_number_or_a_message(text: str) -> None:
    """No text makes anything but a finite number or an InputError."""
    for quantity in (units.LENGTH, units.MODULUS):
        try:
            value = units.parse_quantity(text, quantity, where="x")
        except InputError:
            continue
        assert math.isfinite(value)


def test_a_number_that_its_unit_makes_too_large_is_refused() -> None:
    """1e300 is a float, 1e300 GPa in Pa is none; an exponent of thousands of digits is no number at all."""
    with pytest.raises(InputError, match="'1e300 GPa' is too large for a number in Pa; correct the number or its unit"):
        units.parse_quantity("1e300 GPa", units.MODULUS, where="beam.modulus")
    with pytest.raises(InputError, match="is not a number with a unit"):
        units.parse_quantity(f"1e-{'9' * 5000} mm", units.LENGTH, where="x")


def test_a_numpy_number_is_written_as_a_number() -> None:
    """What NumPy computed stands in a file like any other float."""
    assert units.format_quantity(np.float64(0.025), units.LENGTH) == "0.025 m"
    assert units.format_quantity(np.float64(0.05), units.NUMBER) == "0.05"


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("1,5 mm", "decimal-comma", "'1.5 mm'"),
        ("1.000,5 mm", "decimal-comma", "without a comma, and its unit: for example '2.5 mm'"),
        ("1,5e-3 mm", "decimal-comma", "write a decimal point and no thousands mark: '1.5e-3 mm'"),
        ("1,500 mm", "decimal-comma", "'1.500 mm' or '1500 mm'"),
        ("1 mm,", "decimal-comma", "without a comma"),
        ("1mm,2mm", "decimal-comma", "without a comma"),
        ("1,5 mm, 2", "decimal-comma", "without a comma"),
        ("25", "missing-unit", "'25 mm'"),
        ("25 V", "bad-unit", "not a length"),
        ("25 km", "bad-unit", "m, cm, mm, um, nm"),
        ("", "bad-number", "25 mm"),
        ("mm 25", "bad-number", "not a number"),
        ("1.2.3 mm", "bad-number", "not a number"),
        ("1e999 mm", "bad-number", "too large"),
        ("nan mm", "bad-number", "not a number"),
        ("inf mm", "bad-number", "not a number"),
        ("0x10 mm", "bad-number", "not a number"),
        ("1_000 mm", "bad-number", "not a number"),
    ],
)
def test_what_is_refused_and_how(text: str, code: str, words: str) -> None:
    """Each refusal names the offending text and the repair."""
    with pytest.raises(InputError) as caught:
        units.parse_quantity(text, units.LENGTH, where="geometry.free_length")
    assert caught.value.code == code
    assert words in str(caught.value)
    assert str(caught.value).startswith("geometry.free_length: ")


def test_where_there_is_one_unit_no_other_is_spoken_of() -> None:
    with pytest.raises(InputError) as caught:
        units.parse_quantity("22 C", units.TEMPERATURE, where="air")
    assert (
        str(caught.value) == "air: '22 C' is not a temperature: the unit 'C' is not degC; give the temperature in degC"
    )


def test_common_spellings() -> None:
    """Signs for micro, ohm and degrees and raised digits are read as the plain spelling."""
    assert units.parse_quantity("25 °C", units.TEMPERATURE, where="x") == 25.0
    assert units.parse_quantity("4.7 µm", units.LENGTH, where="x") == 4.7e-6
    assert units.parse_quantity("8 Ω", units.RESISTANCE, where="x") == 8.0
    assert units.parse_quantity("8 Ohm", units.RESISTANCE, where="x") == 8.0
    assert units.parse_quantity("3965 kg/m³", units.DENSITY, where="x") == 3965.0
    assert units.parse_quantity("50 S/s", units.FREQUENCY, where="x") == 50.0
    assert units.parse_quantity("90 deg", units.ANGLE, where="x") == pytest.approx(math.pi / 2)


def test_a_bare_number_takes_no_unit() -> None:
    """A dimensionless number with a unit is refused."""
    with pytest.raises(InputError, match="bare number"):
        units.parse_quantity("0.05 m", units.NUMBER, where="beam.damping_ratio")


def test_a_product_may_be_written_with_a_dot() -> None:
    for text in ("43.4 ohm·m", "43.4 Ω·m", "43.4 ohm m"):
        assert units.parse_quantity(text, units.RESISTIVITY, where="x") == 43.4


def test_a_value_is_shown_in_the_unit_that_people_read() -> None:
    assert units.LENGTH.to_display(0.025) == pytest.approx(25.0)
    assert units.MODULUS.to_display(1.45e9) == pytest.approx(1450.0)
    assert units.NUMBER.to_display(0.05) == 0.05


def test_so_many_digits_and_no_power_of_ten_up_to_a_million() -> None:
    texts = [units.significant(one, 3) for one in (-1442.3, 0.19, 1.2e-5, 999_499.0, 1e6, 2.5e7, 1.0, 0.0)]
    assert texts == ["-1440", "0.19", "1.2e-05", "999000", "1e+06", "2.5e+07", "1", "0"]


@pytest.mark.parametrize("text", ["2.5 gf", "2.5 min", "-2.5 deg"])
def test_a_unit_that_is_no_power_of_ten_multiplies(text: str) -> None:
    quantity = {"gf": units.FORCE, "min": units.TIME, "deg": units.ANGLE}[text.split()[1]]
    expected = {"gf": 2.5 * 9.80665e-3, "min": 150.0, "deg": -math.pi / 72.0}[text.split()[1]]
    assert units.parse_quantity(text, quantity, where="x") == pytest.approx(expected, rel=1e-15)
