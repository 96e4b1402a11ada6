"""The Python surface, name by name and signature by signature."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ipmclab
from ipmclab import signals
from tests.independent.thesis import FRIEND_2

NAMES = [
    "load_actuator",
    "write_actuator",
    "simulate",
    "Run",
    "read_run",
    "write_run",
    "import_run",
    "export_run",
    "check",
    "measure",
    "identify",
    "read_fit",
    "write_fit",
    "validate",
    "report",
    "signals",
    "Finding",
    "Mark",
    "RunMetadata",
    "Sample",
    "InputError",
    "IpmclabError",
]


@pytest.mark.parametrize("name", NAMES)
def test_name_is_there_and_documented(name: str) -> None:
    value = getattr(ipmclab, name)
    assert value.__doc__
    assert name in dir(ipmclab)


@pytest.mark.parametrize("order", [("identify", "read_fit"), ("read_fit", "identify"), ("report", "report")])
def test_functions_keep_their_names_whatever_is_imported(order: tuple[str, ...]) -> None:
    code = (
        "import ipmclab\n"
        + "".join(f"ipmclab.{name}\n" for name in order)
        + "import ipmclab.reporting, ipmclab.identification.identify\n"
        + "assert callable(ipmclab.identify) and callable(ipmclab.report)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300)


def test_import_is_light() -> None:
    code = (
        "import sys, ipmclab\n"
        "heavy = {'numpy', 'scipy', 'numba', 'xarray', 'matplotlib', 'pydantic', 'openpyxl', 'typer', 'pandas'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300)


def test_actuator_surface() -> None:
    actuator = ipmclab.load_actuator("friend-2")
    assert actuator.name == "friend-2"
    parameters = actuator.parameters()
    # The order of the file (design, section 4).
    assert list(parameters) == [
        "geometry.free_length",
        "geometry.clamped_length",
        "geometry.width",
        "geometry.thickness",
        "geometry.sensing_length",
        "circuit.sheet_resistance",
        "circuit.contact_resistance",
        "circuit.dc_resistivity",
        "circuit.branches.0.resistivity",
        "circuit.branches.0.permittivity",
        "circuit.branches.1.resistivity",
        "circuit.branches.1.permittivity",
        "coupling.gain",
        "coupling.zero",
        "coupling.p1",
        "coupling.p2",
        "beam.density",
        "beam.modulus",
        "beam.damping_ratio",
    ]
    for name, value in FRIEND_2.dotted().items():
        assert parameters[name].value == pytest.approx(value, rel=1e-15), name
        assert parameters[name].standard_uncertainty == 0.0
    assert parameters["circuit.dc_resistivity"].unit == "ohm m"
    assert parameters["circuit.dc_resistivity"].symbol
    changed = actuator.replace(**{"beam.modulus": 2e8})
    assert changed.parameters()["beam.modulus"].value == 2e8
    assert actuator.parameters()["beam.modulus"].value == 1.45e9
    with pytest.raises(dataclasses.FrozenInstanceError):
        actuator.name = "other"  # type: ignore[misc]


def test_unknown_names_suggest_the_right_one() -> None:
    actuator = ipmclab.load_actuator("friend-2")
    with pytest.raises(ipmclab.InputError, match=r"beam\.modulus"):
        actuator.replace(**{"beam.modulos": 1e9})
    with pytest.raises(ipmclab.InputError, match="friend-2"):
        ipmclab.load_actuator("freind-2")
    with pytest.raises(ipmclab.InputError):
        actuator.replace(**{"geometry.width": -5e-3})
    with pytest.raises(ipmclab.InputError):
        actuator.replace(**{"beam.modulus": float("nan")})


def test_every_signal_has_its_class_and_its_text() -> None:
    time = np.arange(400) / 50.0
    made = [
        signals.Step(amplitude=1.0),
        signals.Sine(amplitude=1.0, frequency=0.1, phase=0.3, offset=0.2, delay=1.0),
        signals.Cosine(amplitude=1.0, frequency=0.1),
        signals.Square(amplitude=1.0, frequency=0.1),
        signals.Triangle(amplitude=1.0, frequency=0.1),
        signals.parse("chirp 1 V 0.05 Hz 5 Hz"),
        signals.parse("step 1 V"),
        signals.parse("sine 1 V 0.1 Hz phase=90 deg delay=1 s"),
        signals.parse("random 1 V 0.5 s"),
        signals.parse("prbs 1 V 0.5 s"),
    ]
    for signal in made:
        voltage = signal.voltage(time)
        assert voltage.shape == time.shape
        assert np.all(np.isfinite(voltage))
        np.testing.assert_allclose(signals.parse(str(signal)).voltage(time), voltage, rtol=0, atol=1e-12)
    for name in ("Chirp", "Multisine", "Prbs", "Random", "Samples"):
        assert getattr(signals, name).__doc__


def test_signal_values_by_hand() -> None:
    time = np.arange(1000) / 50.0
    sine = signals.Sine(amplitude=2.0, frequency=0.25, phase=np.pi / 6, offset=0.5).voltage(time)
    np.testing.assert_allclose(sine, 0.5 + 2.0 * np.sin(2 * np.pi * 0.25 * time + np.pi / 6), atol=1e-12)
    delayed = signals.Sine(amplitude=1.0, frequency=0.25, delay=2.0).voltage(time)
    np.testing.assert_array_equal(delayed[:100], 0.0)
    np.testing.assert_allclose(delayed[100:], np.sin(2 * np.pi * 0.25 * (time[100:] - 2.0)), atol=1e-12)
    np.testing.assert_allclose(
        signals.parse("sine 1 V 0.25 Hz phase=90 deg").voltage(time),
        signals.parse("cosine 1 V 0.25 Hz").voltage(time),
        atol=1e-12,
    )
    square = signals.parse("square 1 V 0.1 Hz").voltage(time)
    # 50 S/s and half periods of 5 s: 250 rows each, on the dot.
    np.testing.assert_array_equal(square, np.repeat([1.0, -1.0, 1.0, -1.0], 250))
    triangle = signals.parse("triangle 1 V 0.1 Hz").voltage(time)
    assert np.max(np.abs(triangle)) == pytest.approx(1.0, abs=1e-9)
    assert np.max(np.abs(np.diff(triangle))) == pytest.approx(4.0 * 0.1 / 50.0, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("sine 1 V 0,1 Hz", "0,1"),
        ("sine 1 A 0.1 Hz", "A"),
        ("sinus 1 V 0.1 Hz", "sine"),
        ("sine 1 V", "frequency"),
        ("sine 1 V 0.1 Hz fase=90 deg", "phase"),
        ("", "signal"),
    ],
)
def test_a_wrong_word_is_pointed_at(text: str, word: str) -> None:
    with pytest.raises(ipmclab.InputError) as caught:
        signals.parse(text)
    assert word in str(caught.value)


def test_simulate_takes_a_signal_its_text_an_array_or_a_run() -> None:
    actuator = ipmclab.load_actuator("friend-2")
    by_text = ipmclab.simulate(actuator, "sine 1 V 0.1 Hz", duration=10.0, rate=50.0, hold="first")
    by_class = ipmclab.simulate(
        actuator, signals.Sine(amplitude=1.0, frequency=0.1), duration=10.0, rate=50.0, hold="first"
    )
    by_array = ipmclab.simulate(actuator, by_text.voltage, duration=10.0, rate=50.0, hold="first")
    by_run = ipmclab.simulate(actuator, by_text)
    for other in (by_class, by_array, by_run):
        assert other.hold == "first"
        np.testing.assert_array_equal(other.time, by_text.time)
        np.testing.assert_allclose(other.current, by_text.current, rtol=1e-12, atol=1e-16)
        np.testing.assert_allclose(other.displacement, by_text.displacement, rtol=1e-12, atol=1e-18)
    assert ipmclab.simulate(actuator, "step 1 V", duration=1.0, rate=50.0).hold == "zero"
    with pytest.raises(ipmclab.InputError, match="500"):
        ipmclab.simulate(actuator, np.ones(499), duration=10.0, rate=50.0)


def test_simulation_carries_on_from_a_state() -> None:
    actuator = ipmclab.load_actuator("friend-2")
    voltage = np.sin(np.arange(1000) / 17.0)
    voltage[0] = 0.0
    whole = ipmclab.simulate(actuator, voltage, duration=20.0, rate=50.0)
    simulator = actuator.simulator(rate=50.0, hold="zero")
    simulator.block(voltage[:400])
    state = simulator.state
    rest = ipmclab.simulate(actuator, voltage[400:], duration=12.0, rate=50.0, initial_state=state)
    for output in ("current", "applied_voltage", "displacement", "force"):
        expected = getattr(whole, output)
        error = np.max(np.abs(getattr(rest, output) - expected[400:]))
        assert error < 1e-12 * np.max(np.abs(expected)), output


def test_run_arrays_and_dataset() -> None:
    run = ipmclab.Run.from_arrays(time=[0.0, 0.02, 0.04], voltage=[0.0, 1.0, 1.0], current=[0.0, 0.06, 0.05])
    assert run.hold == "zero"
    assert run.data["current"].attrs["units"] == "A"
    assert run.data["current"].dims == ("time",)


def test_write_and_load_an_actuator(tmp_path: Path) -> None:
    actuator = ipmclab.load_actuator("friend-2").replace(**{"beam.modulus": 2.345678901234567e8})
    path = tmp_path / "mine.toml"
    ipmclab.write_actuator(actuator, path)
    back = ipmclab.load_actuator(path)
    for name, parameter in actuator.parameters().items():
        assert back.parameters()[name].value == parameter.value, name
    with pytest.raises(ipmclab.InputError, match=r"mine\.toml"):
        ipmclab.write_actuator(actuator, path)


def test_actuator_file_of_the_design_with_its_spellings(tmp_path: Path) -> None:
    text = FRIEND_2.toml().replace('"8.0 ohm"', '"8.0 ohm"').replace("damping_ratio = 0.05", 'damping_ratio = "0.05"')
    text = text.replace(
        f'sheet_resistance = "{FRIEND_2.sheet_resistance!r} ohm"',
        'sheet_resistance = { value = "1.3333333333333333 ohm/sq", standard_uncertainty = "0.0133 ohm/sq" }',
    ).replace('contact_resistance = "0.0 ohm"\n', "")
    path = tmp_path / "strip.toml"
    path.write_text(text, encoding="utf-8")
    parameters = ipmclab.load_actuator(path).parameters()
    assert parameters["beam.damping_ratio"].value == 0.05
    assert parameters["circuit.sheet_resistance"].standard_uncertainty == pytest.approx(0.0133)
    assert parameters["circuit.contact_resistance"].value == 0.0
    for wrong, right, message in (
        ("dc_resistivity", "dc_resistivty", "dc_resistivity"),
        ('"0.025 m"', '"0.025 s"', "m"),
        ('"0.025 m"', '"0,025 m"', "comma"),
        ('"0.025 m"', '"-0.025 m"', "free_length"),
        ('"0.025 m"', "0.025", "free_length"),
        ('"0.025 m"', '"nan m"', "free_length"),
        ("[coupling]", "[cuopling]", "coupling"),
    ):
        path.write_text(text.replace(wrong, right, 1), encoding="utf-8")
        with pytest.raises(ipmclab.InputError) as caught:
            ipmclab.load_actuator(path)
        assert message in str(caught.value), str(caught.value)
