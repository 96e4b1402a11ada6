"""What is proposed for a combination of which readings say nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.identification.problem.record import prepare
from ipmclab.identification.problem.unknowns import actuator_unknown
from ipmclab.identification.uncertainty.covariance import Uncertainty
from ipmclab.identification.undetermined.cures import fast_modes
from ipmclab.identification.undetermined.diagnosis import direction_of_one, directions
from tests.identification.brief import brief
from tests.identification.many import noisy

FRIEND = load_actuator("friend-2")
SHEET = "circuit.sheet_resistance"
DC = "circuit.dc_resistivity"
RHO_1 = "circuit.branches.0.resistivity"
NAMES = (SHEET, RHO_1, DC)
PARAMETERS = FRIEND.parameters()


@pytest.mark.parametrize(
    ("name", "value", "is_cured"),
    [
        (SHEET, FRIEND[SHEET], True),
        (SHEET, PARAMETERS[SHEET].lower, False),
        (SHEET, PARAMETERS[SHEET].upper, False),
        (RHO_1, PARAMETERS[RHO_1].lower, False),
        (RHO_1, PARAMETERS[RHO_1].upper, False),
        (DC, PARAMETERS[DC].upper, True),  # which the combination does not move
    ],
)
def test_a_measurement_is_proposed_where_nothing_went_to_the_end_of_its_range(
    name: str, value: float, is_cured: bool
) -> None:
    strip = FRIEND.replace(**{name: value})
    unknowns = [actuator_unknown(PARAMETERS[one], None) for one in NAMES]
    known = np.diag([0.0, 0.0, 1e-4])
    null = np.array([[1.0, -1.0, 0.0]]) / np.sqrt(2.0)
    found = Uncertainty(known, known.diagonal(), known, null, np.array([1.0, 1.0, 0.0]), {}, (), np.full(3, 100.0))
    run = simulate(FRIEND, "step 1 V", duration=2.0, rate=20.0)
    records = [prepare(run, 0, ["current"], ())]
    (direction,) = directions(unknowns, np.array([strip[one] for one in NAMES]), found, found, records, strip)
    assert direction.coefficients == pytest.approx({SHEET: null[0, 0], RHO_1: null[0, 1], DC: 0.0})
    assert (f"measure {SHEET}" in direction.cures) == ("measure the sheet resistance" in direction.sentence) == is_cured
    if not is_cured:
        assert direction.cures == ()


@pytest.mark.parametrize(
    ("lacks", "cures"),
    [
        (("displacement", "force"), (f"measure {SHEET}", "record force", "record displacement")),
        (("force",), (f"measure {SHEET}", "record force")),
        ((), (f"measure {SHEET}",)),
    ],
)
def test_no_run_is_asked_for_with_what_the_runs_have(lacks: tuple[str, ...], cures: tuple[str, ...]) -> None:
    unknowns = [actuator_unknown(PARAMETERS[one], None) for one in NAMES]
    null = np.array([[1.0, -1.0, 0.0]]) / np.sqrt(2.0)
    known = np.diag([0.0, 0.0, 1e-4])
    found = Uncertainty(known, known.diagonal(), known, null, np.array([1.0, 1.0, 0.0]), {}, (), np.full(3, 100.0))
    run = replace(simulate(FRIEND, "step 1 V", duration=2.0, rate=20.0), **dict.fromkeys(lacks))  # type: ignore[arg-type]
    records = [prepare(run, 0, ["current"], ())]
    (direction,) = directions(unknowns, np.array([FRIEND[one] for one in NAMES]), found, found, records, FRIEND)
    assert direction.cures == cures
    assert ("with a known coupling" in direction.sentence) == bool(lacks)


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize(("error", "is_known"), [(0.1, True), (3.0, False)])
def test_only_a_static_coupling_that_is_known_is_called_known(error: float, is_known: bool, fixed: bool) -> None:
    """Gain and zero are free against each other; d(0) has an error of its own."""
    names: tuple[str, ...] = ("coupling.gain", "coupling.zero", "coupling.p2")
    strip = FRIEND.replace(**{"coupling.zero": 1.0})
    unknowns = [actuator_unknown(PARAMETERS[one], None) for one in names]
    against, together = np.array([1.0, -1.0, 0.0]), np.array([1.0, 1.0, 0.0])
    known = 4.0 * np.outer(against, against) + 0.25 * error**2 * np.outer(together, together) + np.diag([0, 0, 1e-6])
    count = 2 if fixed else 3  # p2 is given, or free and known well
    names, unknowns, known = names[:count], unknowns[:count], known[:count, :count]
    null, freedom = np.zeros((0, count)), np.full(count, 100.0)
    found = Uncertainty(known, known.diagonal(), known, null, np.ones(count), {}, (), freedom)
    records = [prepare(simulate(FRIEND, "step 1 V", duration=2.0, rate=20.0), 0, ["force"], ())]
    told = directions(unknowns, np.array([strip[one] for one in names]), found, found, records, strip)
    assert any("only d(0) = K_d Z_d/P_2d" in one.sentence for one in told) == is_known
    assert {name for one in told for name, part in one.coefficients.items() if abs(part) > 0.1} == set(names[:2])


def test_a_zero_that_does_not_show_is_no_reason_for_a_circuit_that_is_open() -> None:
    """A combination of the circuit and the coupling asks for other signals, not for a faster record."""
    names = ("coupling.gain", "coupling.zero", DC)
    unknowns = [actuator_unknown(PARAMETERS[one], None) for one in names]
    values = np.array([FRIEND["coupling.gain"], 1.0, FRIEND[DC]])
    records = [prepare(simulate(FRIEND, "step 1 V", duration=2.0, rate=20.0), 0, ["current", "force"], ())]
    row = np.array([0.6, 0.6, 0.5])
    known = 4.0 * np.outer(row, row) + 1e-6 * np.eye(3)
    found = Uncertainty(known, known.diagonal(), known, np.zeros((0, 3)), np.ones(3), {}, (), np.full(3, 100.0))
    of_circuit = [one for one in directions(unknowns, values, found, found, records, FRIEND) if one.coefficients[DC]]
    assert of_circuit
    for one in of_circuit:
        assert "record longer, with steps and slow and fast signals" in one.sentence


@pytest.mark.parametrize(("uncertainty", "is_open"), [(1.0, True), (1e-3, False)])
def test_what_a_fixed_value_of_little_worth_leaves_open_asks_for_that_value(uncertainty: float, is_open: bool) -> None:
    """Longer records say nothing of it: the readings know the combination, and not how much of it is the sheet's."""
    strip = replace(FRIEND, standard_uncertainties={"circuit.sheet_resistance": uncertainty})
    clean = simulate(FRIEND, "step 1 V delay=2 s", duration=40.0, rate=20.0)
    assert clean.current is not None
    noise = 1e-5 * np.random.default_rng(20261126).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold="zero")
    fit = identify(strip, run, free="electrical")
    name = "circuit.branches.0.resistivity"
    assert fit.parameters[name].determined is not is_open
    open_ones = [one for one in fit.undetermined if abs(one.coefficients[name]) > 0.5]
    assert [one.cures for one in open_ones] == ([("measure circuit.sheet_resistance",)] if is_open else [])
    assert all("the stated uncertainty of circuit.sheet_resistance leaves it open" in one.sentence for one in open_ones)
    assert not any("record longer" in one.sentence for one in open_ones)


@pytest.mark.parametrize(
    ("moved", "duration", "cure"),
    [
        ("circuit.branches.0.permittivity", 60.0, "record more edges, at a higher rate, or with less noise"),
        ("circuit.branches.1.permittivity", 60.0, "record longer, with steps and slow and fast signals"),
        ("circuit.branches.1.permittivity", 600.0, "record more edges, at a higher rate, or with less noise"),
        (DC, 600.0, "record longer, with steps and slow and fast signals"),
        ("observation.delay[0]", 60.0, "state hold in the import map if you know it"),
    ],
)
def test_a_fast_branch_asks_for_rows_and_a_slow_one_for_time(moved: str, duration: float, cure: str) -> None:
    """The branches of this strip take 0.04 and 12 s: of what is over early a longer record shows no more."""
    records = [prepare(simulate(FRIEND, "step 1 V", duration=duration, rate=5.0), 0, ["current"], ())]
    told = direction_of_one([moved], moved, "other values fit as well", records, fast_modes(FRIEND, records))
    assert told.sentence.startswith(f"{moved} is not determined: other values fit as well; {cure}")
    # The short answer takes the cure from behind the last semicolon.
    assert told.sentence.count("; ") == 1


def test_a_fixed_value_is_not_said_to_move_what_the_readings_leave_open() -> None:
    """A third branch that is not there: its parameters have a leverage that hangs on where a search ended."""
    run = noisy(np.random.default_rng(2), "step 1 V delay=1 s", duration=8.0)
    fit = brief(load_actuator("friend-2+branches=3"), run, followed=False)
    open_ones = {name for name, one in fit.parameters.items() if not one.determined}
    told = [finding.message for finding in fit.findings if finding.code == "exact-fixed-value"]
    assert open_ones
    assert not [name for name in open_ones for message in told if f"{name} by" in message]
