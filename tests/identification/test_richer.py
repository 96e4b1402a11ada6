"""Richer models from no start: recovery, stages that do not show, starts, order, hints, and messages.

The full counts are benchmarks/recovery.py.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.recovery import CASES, NOISE, recover
from ipmclab import InputError, Run, RunMetadata, identify, load_actuator, simulate
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_file import read_fit, write_fit
from ipmclab.model import Actuator
from ipmclab.model.variants import with_stages

SEED = 20261121
FRIEND = load_actuator("friend-2")
LEAKING = with_stages(FRIEND, "leak.exponential").replace(**{"leak.exponential.threshold": 1.1})
ABOVE = ("step 2 V", "sine 2.5 V 0.1 Hz")


def record(
    strip: Actuator, signal: str, keep: tuple[str, ...] = ("current",), seed: int = 0, rate: float = 50.0
) -> Run:
    """A noisy measured run of 2,000 rows that starts from rest."""
    generator = np.random.default_rng([SEED, seed, len(signal)])
    clean = simulate(strip, signal, duration=2000.0 / rate, rate=rate)
    noisy = {name: getattr(clean, name) + NOISE[name] * generator.standard_normal(len(clean)) for name in keep}
    return Run.from_arrays(
        time=clean.time, voltage=clean.voltage, metadata=RunMetadata(starts_from_rest=True), hold="zero", **noisy
    )


def codes(fit: Fit) -> list[str]:
    """Codes of a fit's findings."""
    return [finding.code for finding in fit.findings]


# Only the benchmark has those whose fits take seconds.
DEAR = {"leak, exponential and slow", "line of 6 segments that leak", "relaxation of both", "leak below its threshold"}


@pytest.mark.parametrize("name", [name for name in CASES if name not in DEAR])
def test_every_model_is_recovered_from_no_start(name: str) -> None:
    tally = recover(CASES[name], 1, (SEED, 1))
    assert tally.at_floor == tally.trials, "not at the noise floor"
    # One fit: its parameters move together, so that a whole fit may lie outside; the rate is the benchmark's.
    assert tally.inside >= 0.5 * tally.counted
    assert not tally.falsely_sure


@pytest.fixture(scope="module")
def leaking() -> Fit:
    """A leak identified beside its circuit."""
    return identify(LEAKING, [record(LEAKING, signal) for signal in ABOVE], free="electrical,leak")


def test_the_file_values_of_a_leak_do_not_matter(leaking: Fit) -> None:
    wrong = LEAKING.replace(
        **{
            "leak.exponential.current_density": 4000.0,
            "leak.exponential.threshold": 0.2,
            "leak.exponential.voltage_scale": 9.0,
            "circuit.dc_resistivity": 2.0,
            "circuit.branches.0.resistivity": 80.0,
        }
    )
    there = identify(wrong, [record(LEAKING, signal) for signal in ABOVE], free="electrical,leak")
    for name, parameter in leaking.parameters.items():
        assert abs(there.parameters[name].value - parameter.value) < 0.05 * parameter.standard_error, name


def test_a_leak_below_its_threshold_is_named_and_never_a_number(leaking: Fit) -> None:
    runs = [record(LEAKING, "step 1 V"), record(LEAKING, "sine 1 V 0.1 Hz")]
    for free in ("electrical,leak", "leak"):
        fit = identify(LEAKING, runs, free=free)
        of_leak = {name: p for name, p in fit.parameters.items() if name.startswith("leak.")}
        assert len(of_leak) == 3
        for name, parameter in of_leak.items():
            assert not parameter.determined
            assert parameter.standard_error == np.inf
            assert parameter.interval == (0.0, np.inf)
            assert any(direction.coefficients[name] > 0.1 for direction in fit.undetermined)
        assert fit.actuator["leak.exponential.current_density"] == 0.0
        assert "without leak.exponential" in fit.undetermined[0].sentence
        assert "1.23 V" in fit.undetermined[0].sentence
        assert all(p.determined for name, p in fit.parameters.items() if name not in of_leak)
    # The same circuit, with what leaks above the threshold, is known as well as that leak.
    assert leaking.parameters["leak.exponential.threshold"].determined


def test_a_relaxation_that_is_not_there_is_named() -> None:
    still = with_stages(FRIEND, "relaxation.displacement")
    none = still.replace(**{"relaxation.displacement.0.ratio": 0.0})
    fit = identify(still, [record(none, "step 1 V", ("displacement",))], free="relaxation")
    assert not any(parameter.determined for parameter in fit.parameters.values())
    assert fit.parameters["relaxation.displacement.0.ratio"].interval == (-np.inf, np.inf)
    assert fit.actuator["relaxation.displacement.0.ratio"] == 0.0


def test_slow_modes_come_back_fastest_first() -> None:
    names = [f"relaxation.displacement.{i}." for i in (0, 1)]
    slow_first = with_stages(FRIEND, "relaxation.displacement=2").replace(
        **{
            f"{names[0]}ratio": 0.6,
            f"{names[0]}time_constant": 20.0,
            f"{names[1]}ratio": 0.4,
            f"{names[1]}time_constant": 2.0,
        }
    )
    fit = identify(slow_first, [record(slow_first, "square 1 V 0.03 Hz", ("displacement",))], free="relaxation")
    assert fit.parameters[f"{names[0]}time_constant"].value == pytest.approx(2.0, rel=0.1)
    assert fit.parameters[f"{names[0]}ratio"].value == pytest.approx(0.4, rel=0.1)
    assert fit.actuator[f"{names[1]}time_constant"] == pytest.approx(20.0, rel=0.1)


def test_a_leak_from_the_middle_of_a_longer_record() -> None:
    long = record(LEAKING, "sine 2.5 V 0.11 Hz")
    assert long.current is not None
    cut = Run.from_arrays(time=long.time[1017:], voltage=long.voltage[1017:], current=long.current[1017:], hold="zero")
    fit = identify(LEAKING, cut, free="leak,circuit.dc_resistivity")
    assert fit.observations[0].start == "free"
    assert fit.parameters["circuit.dc_resistivity"].determined
    for name, parameter in fit.parameters.items():
        low, high = parameter.interval
        assert low <= LEAKING[name] <= high, name


@pytest.mark.parametrize(
    ("stage", "change", "signals", "channel", "free"),
    [
        ("leak.exponential", {}, ("step 2 V", "sine 2.5 V 0.1 Hz"), "current", "electrical"),
        ("relaxation.displacement", {}, ("step 1 V",), "displacement", "coupling"),
        ("clamp", {"clamp.direct_share": 0.5}, ("step 1 V",), "current", "electrical"),
    ],
)
def test_a_fit_says_which_stage_would_explain_what_it_leaves(
    stage: str, change: dict[str, float], signals: tuple[str, ...], channel: str, free: str
) -> None:
    strip = with_stages(FRIEND, stage).replace(**change)
    fit = identify(FRIEND, [record(strip, signal, (channel,)) for signal in signals], free=free)
    said = next(finding for finding in fit.findings if finding.code == "stage-missing")
    assert f"friend-2+{stage}" in said.repair
    assert said.channel == channel
    assert float(said.values["explained"]) > 0.2  # type: ignore[arg-type]
    richer = identify(
        strip, [record(strip, signal, (channel,)) for signal in signals], free=f"{free},{stage.split('.')[0]}"
    )
    assert "stage-missing" not in codes(richer)


def test_a_fit_that_leaves_noise_names_no_stage() -> None:
    fit = identify(FRIEND, [record(FRIEND, "step 1 V"), record(FRIEND, "sine 2 V 0.1 Hz")])
    assert "stage-missing" not in codes(fit)


def test_a_bound_at_zero_leaves_a_one_sided_interval() -> None:
    cubic = with_stages(FRIEND, "leak.cubic").replace(**{"leak.cubic.quadratic": 0.0, "leak.cubic.cubic": 5.0})
    fit = identify(cubic, [record(cubic, signal) for signal in ABOVE], free="electrical,leak")
    assert "leak.cubic.linear" not in fit.parameters
    low, high = fit.parameters["leak.cubic.quadratic"].interval
    assert low == 0.0 < high < np.inf
    low, high = fit.parameters["leak.cubic.cubic"].interval
    assert low <= 5.0 <= high


def test_a_fitted_leak_is_written_and_read(leaking: Fit, tmp_path: Path) -> None:
    write_fit(leaking, tmp_path / "fitted.toml")
    again = read_fit(tmp_path / "fitted.toml")
    for name, parameter in leaking.parameters.items():
        assert again.parameters[name].value == pytest.approx(parameter.value, rel=1e-12)
        assert again.parameters[name].interval == pytest.approx(parameter.interval, rel=1e-12)


@pytest.mark.parametrize(
    ("actuator", "keep", "free", "code", "words"),
    [
        (FRIEND, ("current",), "leak", "unknown-parameter", r"friend-2\+leak.exponential"),
        (FRIEND, ("displacement",), "relaxation", "unknown-parameter", r"friend-2\+relaxation.displacement"),
        (with_stages(FRIEND, "line.modes=4"), ("current",), "line.modes", "count-not-fitted", "ipmclab choose"),
        (LEAKING, ("displacement",), "leak", "no-readings", "no usable current"),
        (
            with_stages(FRIEND, "relaxation.force"),
            ("displacement",),
            "relaxation",
            "no-readings",
            "force",
        ),
    ],
)
def test_requests_that_cannot_be_met(
    actuator: Actuator, keep: tuple[str, ...], free: str, code: str, words: str
) -> None:
    with pytest.raises(InputError, match=words) as caught:
        identify(actuator, [record(actuator, "step 1 V", keep)], free=free)
    assert caught.value.code == code
    assert caught.value.repair
