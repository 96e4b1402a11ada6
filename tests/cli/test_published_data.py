"""The published facts: readable, complete, and as the thesis states them."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import load_actuator
from ipmclab.consistency.facts import published_of
from ipmclab.data import SOURCE, published_in_words, published_measurements, published_sample
from ipmclab.procedure.two_sets import read_set, two_sets
from ipmclab.units import CURRENT, DISPLACEMENT, FORCE
from tests.independent.thesis import FRIEND_2, Strip, respond


def test_the_source_is_named() -> None:
    assert "Friend" in SOURCE
    assert "chapter 5" in SOURCE


@pytest.mark.parametrize(
    ("sample", "figure", "metric", "quantity", "value"),
    [
        (2, "5.15", "max_displacement", DISPLACEMENT, 3.7e-3),
        (2, "5.20", "half_period_end_current", CURRENT, 15e-3),
        (5, "5.47", "max_force", FORCE, 3.7e-3),
        (7, "5.60", "peak_current", CURRENT, 57.96e-3),
    ],
)
def test_a_number_is_as_the_thesis_states_it(sample, figure, metric, quantity, value) -> None:
    conditions = "room" if sample == 2 else "20 degC, 80 %RH"
    rows = published_measurements(sample, conditions=conditions)
    (row,) = (row for row in rows if (row.figure, row.metric) == (figure, metric))
    assert row.value(quantity) == pytest.approx(value, rel=1e-12)


def test_a_run_has_its_voltage() -> None:
    of_figure = {
        row.figure: (row.amplitude, row.frequency) for row in published_measurements(1, conditions="20 degC, 80 %RH")
    }
    assert of_figure == {"5.6": (1.0, None), "5.7": (1.0, 0.1), "5.8": (1.0, 0.1), "5.9": (3.0, None)}


def test_the_clipped_current_is_a_lower_bound() -> None:
    bounds = [row for row in published_measurements(2) if row.qualifier == "lower_bound"]
    assert [(row.figure, row.number) for row in bounds] == [("5.15", "204.8 mA")]


def test_every_sample_gained_water() -> None:
    for number in range(1, 8):
        sample = published_sample(number)
        assert sample.dry_mass is not None
        assert sample.hydrated_mass is not None
        assert sample.dry_mass < sample.hydrated_mass


def test_the_script_of_the_appendix_is_to_the_digit() -> None:
    strip = load_actuator("friend-2-appendix")
    expected = {
        "coupling.gain": 2.144e-7,
        "coupling.zero": 141.66,
        "coupling.p1": 94.56,
        "coupling.p2": 101.89,
        "circuit.branches.0.permittivity": 0.1694,
        "circuit.branches.0.resistivity": 104.0542,
        "circuit.branches.1.permittivity": 0.0285,
        "circuit.branches.1.resistivity": 23.9488,
        "circuit.dc_resistivity": 43.862,
        "beam.modulus": 1.45e9,
        "beam.density": 3965.0,
    }
    assert {name: strip[name] for name in expected} == expected
    elements = strip.circuit_elements()
    assert elements.electrode == pytest.approx(8.0, rel=1e-12)
    # R1 = pdc h/(b (Lt + Lc)), as the script has it.
    assert elements.dc == pytest.approx(43.862 * 0.245e-3 / (5e-3 * 30e-3), rel=1e-12)
    assert published_of("friend-2-appendix") == published_of("friend-2") != ()


APPENDIX = {"gain": 2.144e-7, "zero": 141.66, "p1": 94.56, "p2": 101.89}
OF_THE_CIRCUIT = {
    "resistivities": (104.0542, 23.9488),
    "permittivities": (0.1694, 0.0285),
    "dc_resistance": 43.862 * 0.245e-3 / (5e-3 * 30e-3),
}


@pytest.mark.parametrize(
    ("name", "strip"),
    [
        ("tables", FRIEND_2),
        ("script", FRIEND_2.changed(**APPENDIX)),
        ("soft", FRIEND_2.changed(**APPENDIX, modulus=9.9e7)),
        ("whole script", FRIEND_2.changed(**APPENDIX, **OF_THE_CIRCUIT)),
    ],
)
def test_the_two_sets_of_sample_2_by_dense_matrices_of_the_equations(name: str, strip: Strip) -> None:
    """Up to 5 s of a step, and the last period of a sine, from a computation that knows nothing of the package."""
    whole = read_set(load_actuator("friend-2-appendix"))
    found = dict(zip(("tables", "script", "soft"), two_sets(), strict=True)) | {"whole script": whole}
    time = np.arange(2000) / 50.0
    step = respond(strip, np.ones(2000), 50.0, hold="zero")
    sine = respond(strip, np.sin(0.2 * np.pi * time), 50.0, hold="zero")
    displacement, force = step["displacement"], step["force"]
    one = found[name]
    assert one.displacement == pytest.approx(displacement[:251].max(), rel=1e-6)
    assert one.force == pytest.approx(force[:251].max(), rel=1e-6)
    assert one.drift == pytest.approx(displacement[-1] / displacement[:251].max() - 1.0, rel=1e-6)
    assert one.sine == pytest.approx(np.ptp(sine["displacement"][1500:]) / 2.0, rel=1e-6)


def test_the_numbers_of_both_sets() -> None:
    """What the docs and the demo print of them."""
    tables, script, soft = two_sets()
    assert script.dc_coupling / tables.dc_coupling == pytest.approx(
        (2.144e-7 * 141.66 / 101.89) / (6.79e-9 * 210.5 / 41.097), rel=1e-12
    )
    assert script.dc_coupling / tables.dc_coupling == pytest.approx(8.6, abs=0.05)
    assert [1e3 * one.displacement for one in (tables, script)] == pytest.approx([0.50, 4.16], rel=6e-3)
    assert 1e3 * soft.force == pytest.approx(0.82, abs=5e-3)
    # Quasi-static: f/delta = Y w h^3/(4 L_s^3), eqs 4.7 to 4.9.
    stiffness = 9.9e7 * 5e-3 * 0.245e-3**3 / (4.0 * 21e-3**3)
    assert soft.force / soft.displacement == pytest.approx(stiffness, rel=1e-3)
    # Section 5.2: the sine is predicted well above 1.43 mm, which the tables do not do.
    assert tables.sine < 1.43e-3 < 0.5 * script.sine


def test_what_is_said_in_words_holds_for_the_numbers() -> None:
    words = {row.figure: row for row in published_in_words()}
    assert {"5.40", "5.64", "5.65", "5.66", "5.67", "5.68", "5.69"} <= set(words)
    assert len(published_in_words("baseline_drift")) == 14
    step = {}
    for sample in range(1, 8):
        rows = published_measurements(sample, conditions="room" if sample == 2 else "20 degC, 80 %RH")
        step |= {
            (sample, row.metric): float(row.number.split()[0])
            for row in rows
            if row.waveform == "step" and row.amplitude == 1.0
        }
    tips = [step[sample, "max_displacement"] for sample in words["5.66"].samples]
    assert words["5.66"].samples == (1, 2, 3, 4)
    assert tips[0] < tips[3] < tips[2] < tips[1]  # 2, 5, 7 and 10 mg/cm^2
    thin, thick = words["5.64"].samples
    assert step[thin, "max_displacement"] > step[thick, "max_displacement"]
    assert step[thin, "max_force"] < step[thick, "max_force"]
