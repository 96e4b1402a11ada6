"""Numbers in words: the digits shown are the digits known."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.reporting.wording import estimate, interval, plain, spelled_unit, with_error, with_unit
from ipmclab.units import CURRENT, DISPLACEMENT, FORCE

POWERS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")


def read(text: str) -> list[float]:
    """The numbers of a text, its common power of ten applied."""
    power = re.search(r"\) × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)$", text)
    factor = 10.0 ** int(power.group(1).translate(POWERS)) if power else 1.0
    body = text[: power.start()] if power else text
    body = re.sub(
        r" × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda m: "e" + m.group(1).translate(POWERS), body.translate(str.maketrans("−", "-"))
    )
    return [float(number) * factor for number in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", body)]


VALUES = st.floats(1e-12, 1e12) | st.floats(-1e12, -1e-12)


@given(VALUES, st.floats(1e-5, 3.0))
def test_value_and_error_read_back_to_what_the_error_allows(value: float, relative: float) -> None:
    error = abs(value) * relative
    shown = read(with_error(value, error))
    assert len(shown) == 2
    assert shown[1] == pytest.approx(error, rel=0.051)
    assert abs(shown[0] - value) <= 0.051 * error


@given(VALUES, st.floats(1e-5, 3.0))
def test_an_interval_reads_back_to_a_percent_of_its_width(middle: float, relative: float) -> None:
    half = abs(middle) * relative
    low, high = middle - half, middle + half
    if low == 0.0:
        return
    shown = read(interval(low, high))
    assert len(shown) == 2
    assert shown == pytest.approx([low, high], abs=0.011 * (high - low))


@given(VALUES, st.floats(1e-5, 3.0), st.floats(-0.89, 0.89))
def test_an_estimate_reads_as_lying_in_its_interval(value: float, relative: float, place: float) -> None:
    half = abs(value) * relative
    ends = value - half * (1.0 + place), value + half * (1.0 - place)
    (shown,) = read(estimate(value, ends))
    assert shown == pytest.approx(value, abs=0.051 * (ends[1] - ends[0]) + 1e-6 * abs(value))
    assert ends[0] < shown < ends[1]


@given(VALUES, st.integers(1, 8))
def test_plain_numbers_keep_their_digits(value: float, digits: int) -> None:
    (shown,) = read(plain(value, digits))
    assert shown == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ((0.0, math.inf), "any positive value"),
        ((-math.inf, math.inf), "any value"),
        ((0.0, 12.345), "below 12.3"),
        ((7.4812, math.inf), "above 7.48"),
        ((2.0, 2.0), "2.00000"),
    ],
)
def test_open_intervals_are_words(ends: tuple[float, float], words: str) -> None:
    assert interval(*ends) == words


def test_units_are_those_that_people_read() -> None:
    assert with_unit(-0.0155, CURRENT) == "−15.5\xa0mA"
    assert with_unit(1.3e-3, FORCE, 2) == "1.3\xa0mN"
    assert with_unit(3.7e-3, DISPLACEMENT, 6, trim=True) == "3.7\xa0mm"
    assert with_unit(math.nan, FORCE) == "–"
    assert spelled_unit("ohm/sq") == "Ω/sq"
