"""At constant voltage the current behind a static leak only falls; with the slow leak it may rise."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import load_actuator, simulate

FORMS = ("leak.cubic", "leak.exponential", "leak.butler_volmer")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("volts", [1.0, 3.0])
def test_a_static_leak_never_makes_the_current_rise(form: str, volts: float) -> None:
    generator = np.random.default_rng(20261121)
    for _ in range(5):
        strip = load_actuator(f"friend-2+{form}")
        changes = {
            name: strip[name] * 10.0 ** generator.uniform(-1.0, 1.0)
            for name in strip.parameter_values
            if name.startswith(("circuit.", "leak.")) and strip[name] > 0.0 and "threshold" not in name
        }
        run = simulate(strip.replace(**changes), f"step {volts:g} V", duration=300.0, rate=5.0)
        assert run.current is not None
        assert np.diff(run.current).max() <= 1e-9 * run.current[0]


@pytest.mark.parametrize("form", FORMS)
def test_the_slow_leak_lets_it_rise_to_its_share(form: str) -> None:
    strip = load_actuator(f"friend-2+{form}+leak.slow").replace(
        **{"leak.slow.growth": 0.5, "leak.slow.time_constant": 60.0, "circuit.sheet_resistance": 1e-3}
    )
    static = strip.replace(**{"leak.slow.growth": 0.0})
    run, before = (simulate(one, "step 3 V", duration=600.0, rate=2.0) for one in (strip, static))
    assert run.current is not None
    assert before.current is not None
    # Behind hardly any electrode resistance the node stays at 3 V, so that the leak alone grows, by half.
    leak = before.current[-1] - 3.0 / strip.circuit_elements().dc
    assert run.current[-1] - before.current[-1] == pytest.approx(0.5 * leak, rel=0.02)
    assert run.current[-1] > run.current[200:400].min()
