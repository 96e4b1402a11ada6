"""The electrodes as a line, against the transmission line's own formulas, published values and ngspice."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq

from ipmclab import InputError, Run, load_actuator, simulate
from ipmclab.model import Actuator, line_error_bound, sensitivities, simulate_outputs
from ipmclab.model.stages import line_modes
from tests.independent.thesis import FRIEND_2, OUTPUTS, Strip
from tests.model.conftest import actuator_of
from tests.model.test_clamp import RATE, ROWS, assert_same, responses, rough

Complex = npt.NDArray[np.complex128]

STEPS = {  # tau: u(L)/V and I(0) r'L/V of a line of resistance and capacitance alone
    0.05: (0.003131, 2.523133),
    0.1: (0.050695, 1.783962),
    0.5: (0.629223, 0.582456),
    1.0: (0.892023, 0.169610),
    2.0: (0.990843, 0.014384),
}


def lined(strip: Strip, *, share: float | None = None, **count: float) -> Actuator:
    """A strip with ``modes=12`` or ``segments=10``."""
    values = {**strip.dotted(), **{f"line.{kind}": float(number) for kind, number in count.items()}}
    if share is not None:
        values["clamp.direct_share"] = share
    return Actuator(name="lined", parameter_values=values)


def transmission_line(strip: Strip, share: float, s: Complex) -> tuple[Complex, Complex]:
    """Current and moment-weighted node voltage of the line itself, in closed form."""
    length = strip.total_length - share * strip.clamped_length
    of_whole = 1.0 / strip.dc_resistance + sum(
        s * c / (1.0 + s * r * c) for r, c in zip(strip.branch_resistances, strip.branch_capacitances, strict=True)
    )
    along, at_contact = of_whole * length / strip.total_length, of_whole * (1.0 - length / strip.total_length)
    resistance = 2.0 * strip.sheet_resistance * length / strip.width
    gamma = np.sqrt(resistance * along)
    load = gamma / resistance * np.tanh(gamma) + at_contact
    current = load / (1.0 + strip.contact_resistance * load)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    x = 0.5 * (nodes + 1.0) * strip.sensing_length
    place = (length - strip.free_length + x) / length
    voltage = (1.0 - strip.contact_resistance * current) * np.cosh(gamma * (1.0 - place[:, None])) / np.cosh(gamma)
    lever = 2.0 / strip.sensing_length**2 * (strip.sensing_length - x) * 0.5 * weights * strip.sensing_length
    return current, lever @ voltage


def capacitive(**count: float) -> Actuator:
    """A line of 1 kohm and 1 mF in all: the membrane's own resistances so far away that they do not show."""
    strip = FRIEND_2.changed(electrode_resistance=500.0, resistivities=(1e-6,), permittivities=(0.245e-3 / 0.15,))
    return lined(strip, **count).replace(**{"circuit.dc_resistivity": 1e9})


def step_response(actuator: Actuator, times: list[float]) -> dict[float, tuple[float, float]]:
    """Voltage at the free end and current after a step of 1 V, from the stage's own block by ``scipy.linalg.expm``."""
    stage, values = actuator.structure.electrical, actuator.parameter_values
    block = stage.block(values, along=True)
    ports, weights = stage.profile(values, np.array([actuator["geometry.free_length"]]))
    rest = np.linalg.solve(block.a, block.b)
    found = {}
    for time in times:
        state = (expm(block.a * time) - np.eye(len(block.a))) @ rest
        read = dict(zip(block.outputs, (block.c @ state + block.d)[:, 0].tolist(), strict=True))
        end = sum(weight * {"voltage": 1.0, **read}[port] for port, weight in zip(ports, weights[0], strict=True))
        found[time] = end, 1e3 * read["current"]
    return found


@pytest.mark.parametrize("count", [6, 12, 40])
def test_the_published_step_of_a_line_of_resistance_and_capacitance_by_modes(count: int) -> None:
    for tau, (end, current) in step_response(capacitive(modes=count), list(STEPS)).items():
        assert end == pytest.approx(STEPS[tau][0], abs=1e-5), tau
        assert current == pytest.approx(STEPS[tau][1], abs=1e-5), tau


def test_the_published_step_of_a_line_of_resistance_and_capacitance_by_segments() -> None:
    """200 segments, and 100 with 200 extrapolated to none: the error falls with the square of the number."""
    coarse, fine = (step_response(capacitive(segments=count), list(STEPS)) for count in (100, 200))
    for tau, expected in STEPS.items():
        for number, published in enumerate(expected):
            ours, half = fine[tau][number], coarse[tau][number]
            assert ours == pytest.approx(published, abs=1e-4), tau
            assert ours + (ours - half) / 3.0 == pytest.approx(published, abs=1e-5), tau


FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 25)])


@pytest.mark.parametrize("count", [1, 2, 3, 6, 12, 24])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("contact", [0.0, 1e-3, 1.0, 50.0, 1e5])
def test_modes_against_the_line_itself_within_their_bound(contact: float, share: float, count: int) -> None:
    strip = FRIEND_2.changed(contact_resistance=contact)
    actuator = lined(strip, share=share, modes=count)
    current, voltage = transmission_line(strip, share, 2j * np.pi * FREQUENCIES)
    ours = actuator.frequency_response(FREQUENCIES, ["current", "applied_voltage"])
    bound = line_error_bound(actuator)
    rounding = 1e-12
    assert np.max(np.abs(ours[0] - current)) <= bound.current + rounding * np.max(np.abs(current))
    assert np.max(np.abs(ours[1] - voltage)) <= bound.node_voltage + rounding
    assert np.allclose(ours[:, 0], [current[0], voltage[0]], rtol=1e-4 if count == 1 else 2e-6)


def test_the_bound_says_something() -> None:
    """Twelve modes: 1e-5 A of 0.33 A and 2e-5 of the voltage; twice as many modes, 32 times less current."""
    bounds = {count: line_error_bound(lined(FRIEND_2, modes=count)) for count in (6, 12, 24)}
    assert bounds[12].current < 1e-5
    assert bounds[12].node_voltage < 2e-5
    for less, more in ((6, 12), (12, 24)):
        assert bounds[less].current > 25.0 * bounds[more].current
    strip = FRIEND_2.changed()
    actuator = lined(strip, modes=6)
    current, _ = transmission_line(strip, 0.0, 2j * np.pi * FREQUENCIES)
    error = np.max(np.abs(actuator.frequency_response(FREQUENCIES, ["current"])[0] - current))
    assert error > bounds[6].current / 20.0


@pytest.mark.parametrize("share", [None, 1.0])
@pytest.mark.parametrize("hold", ["zero", "first"])
def test_the_bound_holds_at_every_row_of_a_rough_record(hold: str, share: float | None) -> None:
    largest = np.max(np.abs(rough()))
    fine = responses(lined(FRIEND_2, share=share, modes=60), hold)
    for count in (2, 4, 8):
        actuator = lined(FRIEND_2, share=share, modes=count)
        bound, ours = line_error_bound(actuator), responses(actuator, hold)
        assert np.max(np.abs(ours[0] - fine[0])) <= bound.current * largest
        assert np.max(np.abs(ours[1] - fine[1])) <= bound.node_voltage * largest


@given(
    sheet=st.floats(1e-3, 1e3),
    contact=st.one_of(st.just(0.0), st.floats(1e-4, 1e5)),
    share=st.floats(0.0, 1.0),
    count=st.integers(1, 60),
)
def test_modes_are_the_roots_and_their_weights_add_up(sheet: float, contact: float, share: float, count: int) -> None:
    """Roots by ``scipy.optimize.brentq``, one in each interval; the tail keeps a weight and a resistance of its own."""
    strip = FRIEND_2.changed(electrode_resistance=6.0 * sheet, contact_resistance=contact)
    actuator = lined(strip, share=share, modes=count)
    found = line_modes.spectrum(actuator.parameter_values, count)
    mass = share * strip.clamped_length / (strip.total_length - share * strip.clamped_length)
    line = 2.0 * sheet * (strip.total_length - share * strip.clamped_length) / strip.width

    def boundary(k: float) -> float:
        return contact * (k * np.sin(k) + mass * k * k * np.cos(k)) - line * np.cos(k)

    for n in range(count):
        low, high = max(n - 0.5, 0.0) * np.pi, (n + 0.5) * np.pi
        expected = high if contact == 0.0 else brentq(boundary, low, high, xtol=1e-15, rtol=1e-14)
        assert np.sqrt(found.squares[n]) == pytest.approx(expected, rel=1e-9)
        assert found.resistances[n] == pytest.approx(line / expected**2, rel=1e-8)
    assert np.all(found.weights[:-1] >= 0.0)
    assert np.sum(found.weights) == pytest.approx(1.0 + mass, rel=1e-12)
    assert 0.0 < found.resistances[-1] <= line / ((count - 0.5) * np.pi) ** 2 * (1.0 + 1e-3)
    system = actuator.system
    assert np.max(np.linalg.eigvals(system.a).real) < 0.0


def test_segments_converge_with_the_square_of_their_number() -> None:
    frequency = np.array([0.01, 0.1, 1.0, 10.0])
    for share, contact in ((0.0, 0.0), (0.5, 1.0)):
        strip = FRIEND_2.changed(contact_resistance=contact)
        exact = np.array(transmission_line(strip, share, 2j * np.pi * frequency))
        errors = [
            np.max(
                np.abs(
                    lined(strip, share=share, segments=count).frequency_response(
                        frequency, ["current", "applied_voltage"]
                    )
                    - exact
                ),
                axis=1,
            )
            for count in (20, 40, 80)
        ]
        assert np.all(errors[0] / errors[2] > 10.0)  # 16 where the kinks at the nodes fell alike
        assert np.all(errors[2] < 4e-4)


def test_the_current_of_one_segment_is_that_of_the_lumped_strip_with_half_the_electrodes() -> None:
    """One segment has its membrane in its middle, so that half of the electrodes' resistance lies before it."""
    doubled = FRIEND_2.changed(electrode_resistance=2.0 * FRIEND_2.electrode_resistance)
    for hold in ("zero", "zero-before", "first"):
        ours, expected = responses(lined(doubled, segments=1), hold), responses(actuator_of(FRIEND_2), hold)
        assert_same(ours[:1], expected[:1])


@pytest.mark.parametrize("count", [{"modes": 4}, {"segments": 7}])
@pytest.mark.parametrize("share", [None, 0.0, 0.8])
def test_electrodes_of_no_resistance_are_lumped_ones(count: dict[str, float], share: float | None) -> None:
    """All resistance in the contacts: the line goes over into the strip of the thesis, in proportion to its own."""
    differences = []
    for sheet in (1e-5, 1e-6):
        strip = FRIEND_2.changed(electrode_resistance=6.0 * sheet, contact_resistance=16.0)
        ours, lumped = responses(lined(strip, share=share, **count)), responses(actuator_of(strip))
        if share:
            section = {**strip.dotted(), "clamp.direct_share": share}
            lumped = responses(Actuator(name="lumped", parameter_values=section))
        differences.append(np.max(np.abs(ours - lumped) / np.max(np.abs(lumped), axis=1, keepdims=True)))
    assert differences[0] < 1e-4
    assert differences[1] < 0.11 * differences[0]


@pytest.mark.parametrize("kind", ["modes", "segments"])
def test_a_share_of_0_is_no_clamp(kind: str) -> None:
    strip = FRIEND_2.changed(contact_resistance=0.7)
    with_stage = responses(lined(strip, share=0.0, **{kind: 5}))
    assert_same(with_stage, responses(lined(strip, **{kind: 5})), of_peak=1e-11)


def test_few_modes_are_enough_for_the_displacement() -> None:
    """Against sixty: three modes to 1e-3 of the peak, six to 1e-5; twenty segments to 1e-3."""
    fine = simulate(lined(FRIEND_2, modes=60), rough(), duration=ROWS / RATE, rate=RATE).displacement
    assert fine is not None
    for count, allowed in (({"modes": 3}, 1e-3), ({"modes": 6}, 1e-5), ({"segments": 20}, 1e-3)):
        ours = simulate(lined(FRIEND_2, **count), rough(), duration=ROWS / RATE, rate=RATE).displacement
        assert ours is not None
        assert np.max(np.abs(ours - fine)) < allowed * np.max(np.abs(fine)), count


def test_the_peak_may_exceed_what_the_electrodes_let_through() -> None:
    """At once it is that of an endless line: sqrt(conductance/resistance) per length, far above V/2R_e."""
    run = simulate(load_actuator("friend-2+line.modes=24"), "step 1 V", duration=1.0, rate=RATE)
    assert run.current is not None
    resistance = 2.0 * FRIEND_2.electrode_resistance
    membrane = 1.0 / FRIEND_2.dc_resistance + np.sum(1.0 / FRIEND_2.branch_resistances)
    root = np.sqrt(membrane * resistance)
    assert run.current[0] == pytest.approx(root / resistance * np.tanh(root), rel=1e-6)
    assert run.current[0] > 5.0 / resistance


@pytest.mark.parametrize("count", [{"modes": 5}, {"segments": 6}])
@pytest.mark.parametrize("contact", [0.0, 0.5])
def test_derivatives(count: dict[str, float], contact: float) -> None:
    actuator = lined(FRIEND_2.changed(contact_resistance=contact), share=0.6, **count)
    names = ["clamp.direct_share", "circuit.sheet_resistance", "circuit.branches.0.resistivity", "geometry.free_length"]
    names += ["circuit.contact_resistance"] if contact else []
    time = np.arange(60) / RATE
    exact = sensitivities(actuator, names, time, rough(60), "zero").parameters
    for index, name in enumerate(names):
        step = 1e-5 * actuator[name]
        ahead, behind = (
            simulate_outputs(actuator.replace(**{name: actuator[name] + sign * step}), time, rough(60), "zero")
            for sign in (1.0, -1.0)
        )
        difference = (ahead - behind) / (2.0 * step)
        worst = np.max(np.abs(exact[:, :, index] - difference), axis=1) / np.max(np.abs(difference), axis=1)
        assert np.all(worst < 1e-6), (name, dict(zip(OUTPUTS, worst, strict=True)))


def test_derivative_by_the_contact_resistance_where_it_is_0() -> None:
    time = np.arange(60) / RATE
    actuator = lined(FRIEND_2, modes=5)
    exact = sensitivities(actuator, ["circuit.contact_resistance"], time, rough(60), "zero")
    small = 1e-6
    ahead = simulate_outputs(actuator.replace(**{"circuit.contact_resistance": small}), time, rough(60), "zero")
    difference = (ahead - exact.values) / small
    worst = np.max(np.abs(exact.parameters[:, :, 0] - difference), axis=1) / np.max(np.abs(difference), axis=1)
    assert np.all(worst < 1e-4)


LEAK = (2.0, 1.0, 30.0)
"""Current densities of a cubic leak [A/m^2 for V, V^2 and V^3]."""


def netlist(
    strip: Strip, share: float, segments: int, run: Run, table: Path, *, leak: tuple[float, float, float] | None
) -> str:
    """A ladder of T-sections behind the contact resistance, fed with straight lines through the rows."""
    rest = strip.total_length - share * strip.clamped_length
    each = 2.0 * strip.sheet_resistance * rest / strip.width / segments
    lines = ["* electrodes of an ipmc as a line", "Vin in 0 pwl("]
    lines += [f"+ {t:.10g} {v:.15g}" for t, v in zip(run.time, run.voltage, strict=True)]
    lines += ["+ )", f"Rcontact in c {strip.contact_resistance:.15g}"]
    before, pieces = "c", [("c", share * strip.clamped_length / strip.total_length)]
    for j in range(segments):
        lines.append(f"Rline{j} {before} n{j} {each if j else 0.5 * each:.15g}")
        before = f"n{j}"
        pieces.append((before, rest / strip.total_length / segments))
    for node, part in pieces:
        lines.append(f"Rdc{node} {node} 0 {strip.dc_resistance / part:.15g}")
        if leak:
            area = part * strip.total_length * strip.width
            linear, quadratic, cubic = (f"{area * number:.15g}" for number in leak)
            v = f"v({node})"
            lines.append(f"Bleak{node} {node} 0 i = {linear}*{v} + {quadratic}*{v}*abs({v}) + {cubic}*{v}*{v}*{v}")
        for i, (r, c) in enumerate(zip(strip.branch_resistances, strip.branch_capacitances, strict=True)):
            lines += [
                f"R{node}x{i} {node} {node}m{i} {r / part:.15g}",
                f"C{node}x{i} {node}m{i} 0 {c * part:.15g} ic=0",
            ]
    nodes = " ".join(f"v(n{j})" for j in range(segments))
    lines += [
        ".options method=gear reltol=1e-8 abstol=1e-15 vntol=1e-12 chgtol=1e-18",
        ".control",
        f"tran 1m {run.time[-1]:.10g} 0 1m uic",
        "set wr_singlescale",
        "set numdgt=14",
        f"wrdata {table} i(Vin) v(c) {nodes}",
        "quit 0",
        ".endc",
        ".end",
    ]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("leak", [None, LEAK], ids=["linear", "leaking"])
def test_segments_agree_with_ngspice(
    leak: tuple[float, float, float] | None, tmp_path: Path, require: Callable[[str, object], None]
) -> None:
    program = shutil.which("ngspice")
    require("ngspice", program)
    assert program is not None
    share, segments, strip = 0.6, 5, FRIEND_2.changed(contact_resistance=0.8)
    actuator = lined(strip, share=share, segments=segments)
    if leak:
        names = ("leak.cubic.linear", "leak.cubic.quadratic", "leak.cubic.cubic")
        values = {**actuator.parameter_values, **dict(zip(names, leak, strict=True))}
        actuator = Actuator(name="leaking", parameter_values=values)
    run = simulate(actuator, "sine 2 V 0.1 Hz", duration=12.0, rate=RATE, hold="first")
    table, circuit = tmp_path / "out.txt", tmp_path / "line.cir"
    circuit.write_text(netlist(strip, share, segments, run, table, leak=leak), encoding="utf-8")
    subprocess.run([program, "-b", str(circuit)], check=True, capture_output=True, timeout=300, cwd=tmp_path)
    columns = np.loadtxt(table)
    time, current, nodes = columns[:, 0], -columns[:, 1], columns[:, 2:]
    # The mean with which the strip bends: straight lines through contacts, nodes and the open end.
    rest = strip.total_length - share * strip.clamped_length
    knots = np.array([0.0, *((np.arange(segments) + 0.5) / segments), 1.0]) * rest - (rest - strip.free_length)
    x, width = np.linspace(0.0, strip.sensing_length, 20001, retstep=True)
    middle = 0.5 * (x[1:] + x[:-1])
    lever = 2.0 / strip.sensing_length**2 * (strip.sensing_length - middle) * width
    hats = np.array([np.interp(middle, knots, row) for row in np.eye(len(knots))])
    mean = np.column_stack([nodes, nodes[:, -1]]) @ (hats @ lever)
    for ours, spice in ((run.current, current), (run.applied_voltage, mean)):
        assert ours is not None
        difference = np.abs(ours - np.interp(run.time, time, spice))[2:]
        worst = np.max(difference) / np.max(np.abs(ours))
        assert worst < 1e-5, f"{worst:.1e} of peak at row {int(np.argmax(difference)) + 2}"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("friend-2+leak.cubic+line.modes=4", r"line\.modes: a line by modes is linear.*give line\.segments"),
        ("friend-2+line.modes=4+leak.exponential", r"line\.modes: a line by modes is linear.*give line\.segments"),
        ("friend-2+line.modes=201", r"line\.modes: the value 201 is outside the allowed 1 to 200"),
        ("friend-2+line.segments=999", r"line\.segments: the value 999 is outside the allowed 1 to 200"),
    ],
)
def test_lines_that_cannot_be_are_refused(name: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_actuator(name)


@pytest.mark.parametrize(("count", "said"), [(0.0, "outside the allowed"), (2.5, "not a whole number")])
@pytest.mark.parametrize("kind", ["modes", "segments"])
def test_a_count_is_a_whole_number_from_1(kind: str, count: float, said: str) -> None:
    with pytest.raises(InputError, match=said) as raised:
        lined(FRIEND_2, **{kind: count})
    assert raised.value.where == f"line.{kind}"


def test_a_line_has_one_form() -> None:
    with pytest.raises(InputError, match=r"line: there are line\.modes and line\.segments, a strip has one of them"):
        lined(FRIEND_2, modes=3, segments=3)


@pytest.mark.parametrize("name", ["friend-2", "friend-2+line.segments=5"])
def test_no_modes_have_no_bound(name: str) -> None:
    with pytest.raises(InputError, match="are no line by modes"):
        line_error_bound(load_actuator(name))
