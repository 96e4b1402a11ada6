"""What was measured by hand is read as it was written, however it is written."""

from __future__ import annotations

import math

import pytest

from ipmclab import InputError, follow_procedure
from ipmclab.measurement.amount import Amount, beyond, how_sure, sigmas_between
from ipmclab.measurement.uncertain import Uncertain, exact, weighted_mean
from ipmclab.procedure import follow
from ipmclab.procedure.four_probe import FourProbes
from ipmclab.procedure.hand import read_hand, taken
from ipmclab.procedure.procedure_file import procedure_from_text
from ipmclab.procedure.step import Step
from ipmclab.units import FORCE, LENGTH

FILE = """
name = "strip-7"
[geometry]
free_length = "25 mm"
clamped_length = "5 mm"
width = "5 mm"
thickness = "0.245 mm"
sensing_length = "21 mm"
[sheet_resistance]
spacing = "10 mm"
resistance = {read}
zero = {zero}
[dc_resistance]
value = "70.9 ohm"
[density]
mass = "145.7 mg"
"""


def width(raw: object) -> Uncertain:
    return read_hand(raw, LENGTH, name="geometry.width", source="width", where="w")


def probes(read: str, zero: str = '"0.01 ohm"') -> FourProbes:
    found = procedure_from_text(FILE.format(read=read, zero=zero)).sheet_resistance
    assert isinstance(found, FourProbes)
    return found


@pytest.mark.parametrize("texts", ['["2.66 ohm", "2.67 ohm"]', '"2.667 ohm"'])
def test_readings_of_a_meter_say_the_same_in_a_list_and_in_a_table(texts: str) -> None:
    """What the meter may read wrong is its offset or its zero: nothing is assumed beside their scatter."""
    key = "readings" if texts.startswith("[") else "value"
    plain, table = probes(texts), probes(f"{{ {key} = {texts} }}")
    assert (table.resistance.value, table.resistance.parts) == (plain.resistance.value, plain.resistance.parts)
    assert not table.resistance.assumed
    plain, table = probes('"2.667 ohm"', texts), probes('"2.667 ohm"', f"{{ {key} = {texts} }}")
    assert plain.zero is not None
    assert table.zero is not None
    assert (table.zero.value, table.zero.parts) == (plain.zero.value, plain.zero.parts)


def test_what_is_stated_counts_beside_the_scatter() -> None:
    stated = probes('{ value = "2.667 ohm", standard_uncertainty = "0.01 ohm" }')
    assert stated.resistance.parts == {"meter": 0.01}


def test_each_form_of_a_number() -> None:
    assert width("5 mm") == Uncertain(5e-3, {"width": 1e-4}, frozenset({"width"}))
    assert width({"value": "5 mm"}) == width("5 mm") == width(["5 mm"])
    assert width({"value": "5 mm", "standard_uncertainty": "0 mm"}) == exact(5e-3)
    assert width({"value": "5 mm", "standard_uncertainty": "0.2 mm"}) == Uncertain(5e-3, {"width": 2e-4})
    both = width(["4.9 mm", "5.1 mm"])
    assert set(both.parts) == {"width", "scatter of the readings of the width"}
    assert both.value == pytest.approx(5e-3)


@pytest.mark.parametrize(
    ("raw", "code", "where"),
    [
        (5.0, "bad-value", "w"),
        (["5 mm", 5.0], "bad-value", "w[1]"),
        ([], "out-of-range", "w"),
        ({"readings": []}, "out-of-range", "w.readings"),
        ("0 mm", "out-of-range", "w"),
        ("-5 mm", "out-of-range", "w"),
        ({"value": "5 mm", "readings": ["5 mm"]}, "missing-key", "w"),
        ({}, "missing-key", "w"),
        ({"value": "5 mm", "standard_uncertainty": "-0.1 mm"}, "out-of-range", "w.standard_uncertainty"),
        ({"value": "5 mm", "uncertainty": "0.1 mm"}, "unknown-key", "w.uncertainty"),
        ({"value": "5 V"}, "bad-unit", "w.value"),
    ],
)
def test_what_is_no_measured_number(raw: object, code: str, where: str) -> None:
    with pytest.raises(InputError) as caught:
        width(raw)
    assert (caught.value.code, caught.value.where) == (code, where)


def test_what_is_taken_where_nobody_states_it() -> None:
    """A ruler, contacts placed by hand, a balance, a micrometer; of a push test a part of its value."""
    names = ("position", "geometry.free_length", "spacing", "mass", "geometry.thickness")
    assert [taken(name, 0.2) for name in names] == [5e-4, 5e-4, 1e-4, 1e-6, 5e-6]
    assert taken("beam.modulus", 2e9) == pytest.approx(2e8)


def test_what_may_be_zero() -> None:
    assert read_hand("0 mm", LENGTH, name="zero", source="zero", where="w", positive=False, assume=False) == exact(0.0)


def test_a_dc_resistance_that_the_other_face_makes_impossible_does_not_end_the_other_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first step is made better by the second, which is then made again, and may fail."""
    carried_out = follow._dc
    times: list[int] = []

    def fails_again(*given: object) -> Step:
        times.append(1)
        if len(times) == 2:
            raise InputError("less than the electrodes alone have", code="no-dc-resistance", where="r", repair="-")
        return carried_out(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(follow, "_dc", fails_again)
    told: dict[str, Step] = {}
    procedure = procedure_from_text(FILE.format(read='"2.667 ohm"', zero='"0 ohm"'))
    with pytest.raises(InputError, match="less than the electrodes alone have"):
        follow_procedure(procedure, step_done=lambda step: told.update({step.name: step}))
    assert told["density"].done
    assert told["dc_resistance"].how == "cannot be used"
    assert set(told) == set(follow.TO_DO)


def test_how_far_two_amounts_are_apart() -> None:
    one, other = Amount(1.0, 0.3, "V"), Amount(3.0, 0.4, "V")
    assert sigmas_between(one, other) == sigmas_between(other, one) == pytest.approx(4.0)
    assert sigmas_between(Amount(1.0, 0.0, "V"), Amount(1.0, 0.0, "V")) == 0.0
    assert sigmas_between(Amount(1.0, 0.0, "V"), Amount(1.0 + 1e-12, 0.0, "V")) == 0.0
    assert sigmas_between(Amount(-1.0, 0.0, "V"), Amount(-1.1, 0.0, "V")) == math.inf
    assert sigmas_between(Amount(1e-6, 0.0, "m"), Amount(1.001e-6, 0.0, "m")) == math.inf
    assert sigmas_between(one, Amount(3.0, math.inf, "V")) == 0.0
    assert how_sure(math.inf) == "no uncertainty is stated and they differ"


def test_how_far_an_amount_lies_outside_a_range() -> None:
    low, high = Amount(2.0, 0.0, "V"), Amount(3.0, 0.4, "V")
    assert beyond(Amount(1.0, 0.5, "V"), low, high) == pytest.approx(2.0)
    assert beyond(Amount(4.0, 0.3, "V"), low, high) == pytest.approx(2.0)
    assert [beyond(Amount(value, 0.1, "V"), low, high) for value in (2.0, 2.5, 3.0)] == [0.0, 0.0, 0.0]


def test_an_amount_is_said_in_its_unit() -> None:
    assert str(Amount.of(0.245e-3, 0.005e-3, LENGTH)) == "0.245 ± 0.005 mm"
    assert str(Amount.of(0.245e-3, 0.0, LENGTH)) == "0.245 mm"
    assert str(Amount.of(0.0245, math.inf, FORCE)) == "24.5 mN"
    assert str(Amount(0.5, 0.1, "")) == "0.5 ± 0.1"
    assert Amount(2.0, 0.5, "V").times(3.0, "W") == Amount(6.0, 1.5, "W")


def test_the_mean_of_numbers_of_which_one_is_exact_gives_all_the_same_weight() -> None:
    assert weighted_mean([exact(1.0), Uncertain(2.0, {"a": 0.1})]).value == pytest.approx(1.5)
    alone = Uncertain(2.0, {"a": 0.1}, frozenset({"a"}))
    assert weighted_mean([alone]) is alone
