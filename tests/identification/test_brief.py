"""A fit that a test makes without what it does not look at is that of ``identify``, number by number."""

from __future__ import annotations

import numpy as np

from ipmclab import Run, identify, load_actuator, simulate
from tests.identification.brief import brief

FRIEND = load_actuator("friend-2")


def test_what_is_left_out_moves_nothing_else() -> None:
    """Of a current that the circuit does not explain, and that is too short for its slow branch."""
    clean = simulate(FRIEND, "step 1 V delay=1 s", duration=8.0, rate=10.0)
    assert clean.current is not None
    noise = 1e-4 * np.random.default_rng(20261127).standard_normal(len(clean))
    read = clean.current + noise + 1e-3 * np.sin(2.0 * np.pi * 0.7 * clean.time)
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, hold="zero", current=read)
    whole, undiagnosed, alone = identify(FRIEND, run), brief(FRIEND, run), brief(FRIEND, run, followed=False)
    assert whole.diagnoses
    assert undiagnosed.parameters == whole.parameters
    assert alone.parameters != whole.parameters  # some interval is bent
    for part in (undiagnosed, alone):
        assert {one.code for one in part.findings} == {one.code for one in whole.findings} - {"model-incomplete"}
        assert part.observations[0] == whole.observations[0]
        np.testing.assert_array_equal(part.residuals[0]["current"], whole.residuals[0]["current"])
        assert {name: one.value for name, one in part.parameters.items()} == {
            name: one.value for name, one in whole.parameters.items()
        }
