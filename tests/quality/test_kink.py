"""A rate that jumps while the voltage stands, in the real record that has it and in a twin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ipmclab.quality import check, usable
from ipmclab.run import Finding, Run
from ipmclab.store.importing import import_run

MAPS = Path(__file__).parents[2] / "docs" / "import_maps"


def jumps(run: Run) -> list[Finding]:
    return [finding for finding in check(run) if finding.code == "rate-jump"]


def wandering(extra: float, *, stays: bool = False, seed: int = 20261121) -> Run:
    """A step response that wanders about, with a new rise of the rate [m/s] at row 700, which fades or stays."""
    generator = np.random.default_rng(seed)
    time = 0.04 * np.arange(1600)
    since, again = np.maximum(time - 5.32, 0.0), np.maximum(time - 28.0, 0.0)
    walk = np.cumsum(1e-6 * np.convolve(generator.standard_normal(1600), np.ones(10) / 10.0, mode="same"))
    rise = again if stays else 1.0 - np.exp(-again)
    clean = 1.3e-3 * (1.0 - np.exp(-since)) - 0.5e-3 * (1.0 - np.exp(-since / 15.0)) + extra * rise
    return Run.from_arrays(
        time=time,
        voltage=np.where(np.arange(1600) >= 133, 0.988, 0.0),
        displacement=clean + walk + 2e-7 * generator.standard_normal(1600),
        hold="unknown",
    )


def test_a_rate_that_jumps_and_fades_is_left_out() -> None:
    (finding,) = jumps(wandering(0.4e-3))
    ((start, stop),) = finding.samples
    assert abs(start - 700) <= 3
    assert 740 <= stop <= 800  # a tenth is left after 2.3 s, 58 rows, at windows of ten rows
    assert finding.effect == "mask"
    assert not usable(wandering(0.4e-3), [finding])["displacement"][start:stop].any()
    assert finding.values["after"] == pytest.approx(0.34e-3, rel=0.15)
    assert "no smooth model" in finding.message


def test_a_rate_that_stays_is_told_and_used() -> None:
    (finding,) = jumps(wandering(0.4e-3, stays=True))
    assert finding.effect == "none"


@pytest.mark.parametrize("seed", range(20))
def test_what_bends_smoothly_has_none(seed: int) -> None:
    assert jumps(wandering(0.0, seed=seed)) == []
    assert jumps(wandering(3e-5, seed=seed)) == []


@pytest.mark.parametrize(("deviations", "found"), [(15.0, True), (6.0, False)])
def test_a_rate_jumps_by_ten_standard_deviations_of_its_noise_or_more(deviations: float, found: bool) -> None:
    """The slope of a line through ten rows with white noise s has the standard deviation s/sqrt(82.5 rows^2)."""
    noise, time = 1e-6, 0.04 * np.arange(1600)
    jump = deviations * noise * np.sqrt(2.0 / 82.5) / 0.04
    quiet = Run.from_arrays(
        time=time,
        voltage=np.where(np.arange(1600) >= 133, 1.0, 0.0),
        displacement=jump * np.maximum(time - 28.0, 0.0)
        + noise * np.random.default_rng(20261121).standard_normal(1600),
    )
    assert bool(jumps(quiet)) is found


def test_the_real_record(real_runs: Path) -> None:
    found = {
        name: jumps(import_run(real_runs / f"{name}.csv.gz", MAPS / f"{name}.toml"))
        for name in ("step_1V", "step_2V", "step_2V_poor", "step_3V")
    }
    assert {name for name, findings in found.items() if findings} == {"step_1V"}
    (finding,) = found["step_1V"]
    # Row 677 is where the current comes back; rates are told by ten rows before and after.
    assert abs(finding.samples[0][0] - 677) <= 5
    assert finding.effect == "mask"


def test_the_rounding_of_a_reading_that_stands_is_no_jump() -> None:
    time = 0.02 * np.arange(2000)
    standing = np.full(2000, 1e-3)
    standing[1500:] += np.spacing(1e-3) * np.arange(500)
    assert jumps(Run.from_arrays(time=time, voltage=np.where(time >= 1.0, 1.0, 0.0), displacement=standing)) == []
