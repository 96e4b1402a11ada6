"""How a fit's predictions move with its parameters, against the model and the definitions of the sensor's zero."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import Actuator, InputError, Run, RunMetadata, identify, load_actuator
from ipmclab.choosing import spread
from ipmclab.choosing.noise import FadingNoise, ResidualSeries
from ipmclab.choosing.spread import directions, slopes
from ipmclab.identification.problem.record import prepare
from ipmclab.model.environment import Environment
from ipmclab.model.outputs import simulate_outputs
from ipmclab.strip_state.in_state import strip_in_state
from ipmclab.strip_state.run_state import RunState

STRIP = load_actuator("friend-2+branches=1")
DC = "circuit.dc_resistivity"
ROW, LATE = 0.05, 0.02
TIME = ROW * np.arange(160)
VOLTAGE = np.sin(np.pi * TIME)


def current(dc: float, later: float = LATE) -> npt.NDArray[np.float64]:
    strip = STRIP.replace(**{DC: dc})
    return np.asarray(simulate_outputs(strip, TIME, VOLTAGE, "zero", outputs=["current"], delay=later))[0]


def test_slopes_are_those_of_the_strip_as_wet_as_it_was() -> None:
    """Of a run that the fit saw and of one that it did not: the law makes the capacitance another one there."""
    strip = load_actuator("friend-2+branches=1+environment.permittivity")
    free = ["circuit.branches.0.permittivity"]
    runs = []
    for number, humidity in enumerate((80.0, 40.0)):
        there = strip.at(Environment(20.0, humidity))
        values = np.asarray(simulate_outputs(there, TIME, VOLTAGE, "zero", outputs=["current"]))[0]
        values = values + 1e-5 * np.random.default_rng(number).standard_normal(len(TIME))
        about = RunMetadata(temperature=20.0, relative_humidity=humidity, run_number=number)
        runs.append(Run.from_arrays(time=TIME, voltage=VOLTAGE, current=values, metadata=about))
    fit = identify(strip, runs, free=free)
    for place, observed in ((1, 1), (1, None)):
        found = slopes(fit, prepare(runs[place], 0, ["current"], ()), ["current"], in_fit=observed, delay=None)[
            "current"
        ]
        state = fit.observations[place].state
        assert state is not None

        def at(name: str, factor: float, state: RunState = state) -> npt.NDArray[np.float64]:
            moved = strip_in_state(fit.actuator.replace(**{name: factor * fit.actuator[name]}), state, {})
            return np.asarray(simulate_outputs(moved, TIME, VOLTAGE, "zero", outputs=["current"]))[0]

        for column, name in enumerate(fit.parameters):
            expected = (at(name, 1.001) - at(name, 0.999)) / 2e-3
            assert found[:, column] == pytest.approx(expected, abs=0.01 * float(np.max(np.abs(expected)))), name
            assert np.max(np.abs(expected)) > 0.0


def test_slopes_are_those_of_the_model_and_of_the_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a run that the fit saw; one that it did not see has a zero and an edge of its own, which are not the fit's."""
    noise = 1e-4 * np.random.default_rng(20261121).standard_normal(len(TIME))
    run = Run.from_arrays(time=TIME + 3.0, voltage=VOLTAGE, current=current(STRIP[DC]) + noise, hold="unknown")
    zero = ["observation.drift.current", "observation.offset.current"]
    fit = identify(STRIP, run, free=[DC, *zero])
    record = prepare(run, 0, ["current"], ())
    assert list(fit.parameters) == [DC, "observation.delay[0]", *(f"{name}[0]" for name in zero)]
    observed = slopes(fit, record, ["current"], in_fit=0, delay=None)["current"]
    here = fit.actuator[DC]
    for column, moved in (
        (0, (current(1.001 * here) - current(0.999 * here)) / 2e-3),  # of its own size
        (1, (current(here, LATE + 1e-4) - current(here, LATE - 1e-4)) * ROW / 2e-4),  # of a row
    ):
        assert observed[:, column] == pytest.approx(moved, abs=0.02 * float(np.max(np.abs(moved))))
    assert observed[:, 2] == pytest.approx(TIME)
    assert np.all(observed[:, 3] == 1.0)
    unseen = slopes(fit, record, ["current"], in_fit=None, delay=fit.observations[0].delay)["current"]
    assert unseen[:, 0] == pytest.approx(observed[:, 0], abs=1e-9)
    assert not np.any(unseen[:, 1:])

    def bounded(strip: Actuator, *given: Any, **more: Any) -> npt.NDArray[np.float64]:
        if strip[DC] > here:
            raise InputError("beyond its bound", code="out-of-range", where=DC, repair="give less")
        return simulate_outputs(strip, *given, **more)

    monkeypatch.setattr(spread, "simulate_outputs", bounded)
    at_bound = slopes(fit, record, ["current"], in_fit=0, delay=None)["current"]
    assert at_bound[:, 0] == pytest.approx(observed[:, 0], abs=0.01 * float(np.max(np.abs(observed[:, 0]))))


@pytest.mark.parametrize("large", [1.0, 1e100, 1e140])
def test_a_noise_beyond_all_bounds_beside_a_parameter_that_moves_nothing_is_no_fault(large: float) -> None:
    """As where a fold without the only run at a high voltage leaves a leak open, and predicts any current there."""
    time = np.arange(50.0)
    slope = np.column_stack([np.cos(time), np.zeros(50), 1e-9 * np.cos(2.0 * time)])
    series = ResidualSeries(time, np.zeros(50), np.ones(50, dtype=bool), 1.0, 10.0)
    one, other = (directions([(series, slope, 1.0, FadingNoise(white))]) for white in (1.0, large))
    assert np.isfinite(other).all()
    assert np.abs(other) / large == pytest.approx(np.abs(one), rel=1e-6, abs=1e-6)
