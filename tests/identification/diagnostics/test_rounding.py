"""What rounding leaves of a slow answer is autocorrelated and follows the voltage: it asks for no stage."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Run, load_actuator, simulate
from ipmclab.model import Actuator
from tests.identification.brief import brief

STRIP = load_actuator("friend-2")
RELAXING = load_actuator("friend-2+relaxation.displacement=1")


def rounded(strip: Actuator, step: float) -> Run:
    """A step of 1 V over 35 s, the displacement rounded to steps of a converter [m], the current to 1 mA."""
    clean = simulate(strip, "step 1 V delay=5 s", duration=40.0, rate=20.0)
    assert clean.current is not None
    assert clean.displacement is not None
    noise = np.random.default_rng(5).standard_normal((2, len(clean)))
    current, displacement = clean.current + 3e-5 * noise[0], clean.displacement + 2e-6 * noise[1]
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=np.round(current, 3),
        displacement=np.round(displacement / step) * step,
        hold="zero",
    )


@pytest.mark.parametrize(
    ("strip", "step", "is_missing"), [(STRIP, 1e-4, False), (STRIP, 1e-5, False), (RELAXING, 1e-5, True)]
)
def test_only_what_is_more_than_rounding_asks_for_a_stage(strip: Actuator, step: float, is_missing: bool) -> None:
    fit = brief(STRIP, rounded(strip, step), "electrical,coupling", diagnosed=True, followed=False)
    codes = {finding.code for finding in fit.findings}
    assert bool(codes & {"stage-missing", "model-incomplete"}) == is_missing
