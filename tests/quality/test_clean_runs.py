"""A good record raises no alarm."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ipmclab.model import load_actuator, validity
from ipmclab.quality import censored, check, measure, usable
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.virtual import VirtualBench
from ipmclab.run import Run

SIGNALS = (
    "step 1 V",
    "step -1 V",
    "step 3 V delay=5 s",
    "sine 1 V 0.1 Hz",
    "sine 1 V 0.1 Hz delay=1 s",
    "cosine 1 V 0.1 Hz",
    "square 1 V 0.1 Hz",
    "square 1 V 1 Hz",
    "triangle 1 V 0.1 Hz",
    "chirp 1 V 0.05 Hz 5 Hz",
    "multisine 1 V 0.05 Hz 2 Hz",
    "prbs 1 V 0.1 s",
    "prbs 1 V 0.5 s",
    "random 1 V 0.1 s",
    "sine 1 V 0.1 Hz for 20 s then step 0.5 V",
)


def alarms(run: Run) -> list[str]:
    return [f"{finding.channel}: {finding.message}" for finding in check(run) if finding.severity != "info"]


@pytest.mark.parametrize("signal", SIGNALS)
@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("noise", [0.0, 0.02, 1.0])
def test_no_warning_on_a_simulated_record(read: Callable[..., Run], signal: str, hold: str, noise: float) -> None:
    assert alarms(read(signal, hold=hold, noise=noise)) == []
    assert alarms(read(signal, hold=hold, noise=noise, round_off=False)) == []


@pytest.mark.parametrize("seed", range(12))
def test_no_warning_on_other_strips(read: Callable[..., Run], seed: int) -> None:
    rng = np.random.default_rng(20261121 + seed)
    change = {
        "circuit.branches.0.resistivity": 0.35734 * 10 ** rng.uniform(-0.5, 0.5),
        "circuit.branches.0.permittivity": 0.11998 * 10 ** rng.uniform(-0.5, 0.5),
        "circuit.branches.1.resistivity": 24.2415 * 10 ** rng.uniform(-0.5, 0.5),
        "circuit.branches.1.permittivity": 0.48106 * 10 ** rng.uniform(-0.5, 0.5),
        "circuit.dc_resistivity": 43.42 * 10 ** rng.uniform(-0.5, 0.5),
        "coupling.gain": 6.79e-9 * 10 ** rng.uniform(0.0, 0.8),
    }
    for signal in ("step 1 V delay=3 s", "sine 1 V 0.1 Hz", "square 1 V 0.1 Hz", "prbs 1 V 0.2 s"):
        assert alarms(read(signal, change=change, seed=20261121 + seed)) == []


@pytest.mark.parametrize("measured", ["force", "displacement"])
@pytest.mark.parametrize("signal", ["step 1 V", "square 1 V 0.1 Hz", "prbs 1 V 0.5 s", "chirp 1 V 0.05 Hz 5 Hz"])
def test_no_warning_on_the_virtual_bench(signal: str, measured: str) -> None:
    bench = VirtualBench(load_actuator("friend-2"), seed=20261121)
    run = record(bench, signal, duration=40.0, rate=50.0, measured=("current", measured), rest_before=1.0)
    assert alarms(run) == []


def test_the_bench_says_when_its_shunt_is_at_its_limit() -> None:
    bench = VirtualBench(load_actuator("friend-2"), seed=20261121)
    run = record(bench, "square 3 V 0.1 Hz", duration=20.0, rate=50.0, measured=("current",))
    assert run.current is not None
    bound = censored(run, check(run))["current"]
    assert np.array_equal(bound, np.where(run.current >= 0.196, 1, np.where(run.current <= -0.196, -1, 0)))
    assert {finding.code for finding in check(run)} == {"range-limit"}


def test_every_finding_is_explained_in_the_documentation() -> None:
    root = Path(__file__).parents[2]
    sources = "".join(path.read_text(encoding="utf-8") for path in (root / "src/ipmclab/quality").glob("*.py"))
    codes = set(re.findall(r'"([a-z]+(?:-[a-z]+)+)"', sources)) | {"spike", "slip", "stuck", "clipped", "smoothed"}
    codes -= {"utf-8", "no-pair"}  # an encoding, and the code of an error: no findings
    codes |= set(validity.CODES)  # which a simulated run carries along
    table = (root / "docs" / "checks.md").read_text(encoding="utf-8")
    explained = set(re.findall(r"^\| `([a-z-]+)` \|", table, flags=re.MULTILINE))
    assert codes == explained


def test_a_reading_that_nothing_is_known_of_is_used(read: Callable[..., Run]) -> None:
    run = read("step 1 V")
    findings = check(run)
    assert all(mask.all() for mask in usable(run, findings).values())
    assert not any(bound.any() for bound in censored(run, findings).values())


numbers = st.floats(-1e3, 1e3) | st.sampled_from([0.0, 1.0, -0.0999999, float("nan")])


@given(
    rows=st.integers(2, 80).flatmap(
        lambda n: st.tuples(
            st.lists(st.sampled_from([0.0, 1.0, -1.0]) | st.floats(-5.0, 5.0), min_size=n, max_size=n),
            st.lists(numbers, min_size=n, max_size=n),
            st.lists(numbers, min_size=n, max_size=n),
        )
    ),
    repeat=st.integers(1, 30),
)
@example(rows=([0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [5e-324, -1.0, 0.0]), repeat=1)  # a peak that is rounding
def test_any_record_can_be_checked_and_measured(
    rows: tuple[list[float], list[float], list[float]], repeat: int
) -> None:
    voltage, current, displacement = (np.repeat(np.array(column), repeat) for column in rows)
    run = Run.from_arrays(
        time=np.arange(len(voltage)) / 50.0, voltage=voltage, current=current, displacement=displacement
    )
    findings = check(run)
    for finding in findings:
        assert finding.message
        assert finding.repair
        assert all(0 <= start < stop <= len(run) for start, stop in finding.samples)
    usable(run, findings)
    censored(run, findings)
    for metric in measure(run):
        assert np.isfinite(metric.value)
        assert metric.definition


@pytest.mark.parametrize("text", ["sine 1 V 0.1 Hz", "triangle 1 V 0.1 Hz", "square 1 V 0.1 Hz", "step 1 V"])
@pytest.mark.parametrize("channel", ["force", "displacement"])
def test_a_signal_between_rests_is_clean(text: str, channel: str) -> None:
    """Where the signal gives way to the rest the current has a corner, which is no spike."""
    bench = VirtualBench(load_actuator("friend-2"))
    run = record(bench, text, duration=40.0, rate=50.0, measured=["current", channel], rest_before=5.0, rest_after=5.0)
    assert check(run) == ()
