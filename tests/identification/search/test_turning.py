"""Slow modes with complex or merging poles, identified from no start."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.identification.search.searched_run import SearchedRun
from ipmclab.identification.search.varpro import pair_minima
from ipmclab.model.numerics.drive import Drive

PAIR = "relaxation.displacement_pair.0"


def series(time: np.ndarray, readings: np.ndarray, voltage: np.ndarray) -> SearchedRun:
    durations, kind = np.unique(np.diff(time), return_inverse=True)
    drive = Drive(durations, kind.astype(np.int64), voltage[:-1], voltage[1:], voltage)
    return SearchedRun(drive, time, readings, np.full(len(time), 1e3))


def test_the_search_finds_a_pair_that_an_integrator_made() -> None:
    fast, tau, zeta, ratio, lead = (-4.0, -1.0), 9.0, 0.4, 0.6, -2.0
    time = np.linspace(0.0, 60.0, 301)
    voltage = np.interp(time, [0.0, 2.0, 30.0, 33.0, 60.0], [0.0, 1.0, 0.7, -0.5, 0.2])

    def rates(t: float, x: np.ndarray) -> list[float]:
        v = float(np.interp(t, time, voltage))
        turned = (v - x[2] - 2.0 * zeta * tau * x[3]) / tau**2
        return [fast[0] * x[0] + v, fast[1] * x[1] + v, x[3], turned]

    solved = solve_ivp(rates, (0.0, 60.0), [0.0] * 4, t_eval=time, rtol=1e-10, atol=1e-12, max_step=0.1).y
    readings = 2.0 * solved[0] - 0.5 * solved[1] - ratio * solved[2] - lead * solved[3] + 0.3
    kept = np.delete(np.arange(len(time)), [50, 51, 140, 250])  # the voltage bends at none of these
    for rows in (slice(None), kept):
        run = series(time[rows], readings[rows], voltage[rows])
        found = pair_minima([run], 2, np.ones((1, len(run.time))))[0]
        assert found.pair is not None
        pole, residue = found.pair
        # (constant + lead s)/(1 + 2 zeta tau s + tau^2 s^2) = Re residue/(s - pole), as partial fractions
        constant, lead_found = -(residue * pole.conjugate()).real / abs(pole) ** 2, residue.real / abs(pole) ** 2
        assert 1.0 / abs(pole) == pytest.approx(tau, rel=1e-5)
        assert -pole.real / abs(pole) == pytest.approx(zeta, rel=1e-5)
        assert (constant, lead_found) == pytest.approx((-ratio, -lead), rel=1e-4)
        np.testing.assert_allclose(found.poles, fast, rtol=1e-4)
        np.testing.assert_allclose(found.residues, (2.0, -0.5), rtol=1e-4)


@pytest.mark.parametrize(("damping", "lead"), [(0.5, -4.0), (1.0, 3.0)])
def test_complex_and_merging_slow_modes_from_no_start(damping: float, lead: float) -> None:
    true = {"ratio": 0.7, "lead": lead, "time_constant": 12.0, "damping_ratio": damping}
    strip = load_actuator("friend-2+relaxation.displacement_pair").replace(
        **{f"{PAIR}.{n}": v for n, v in true.items()}
    )
    run = simulate(strip, "step 1 V delay=1 s", duration=90.0, rate=10.0)
    assert run.displacement is not None
    readings = run.displacement + np.random.default_rng(20261121).normal(0.0, 1e-6, len(run))
    measured = Run.from_arrays(time=run.time, voltage=run.voltage, displacement=readings)
    names = ["coupling.gain", "coupling.p1", "coupling.p2", *(f"{PAIR}.{name}" for name in true)]
    fit = identify(load_actuator("friend-2+relaxation.displacement_pair"), measured, free=names)
    assert fit.converged
    for name in names:
        parameter = fit.parameters[name]
        assert parameter.determined
        assert abs(parameter.value - strip[name]) < 3.0 * parameter.standard_error
