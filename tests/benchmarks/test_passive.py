"""Which published currents no model of a class can join: closed forms, models that must pass, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.printed import passive
from benchmarks.printed.passive import Joined, linear_one_port
from benchmarks.printed.passive_steps import leaking_one_port, one_strip
from ipmclab import InputError, load_actuator
from ipmclab.data import PublishedMeasurement
from ipmclab.model import simulate
from ipmclab.model.variants import with_stages
from ipmclab.prediction.headline import DURATION, RATE, HeadlineRun, compare, headline_runs
from tests.profiles import costly

NAMES = ((0, "peak_current"), (0, "steady_current"), (1, "peak_current"), (1, "half_period_end_current"))


def printed(waveform: str, volts: float, **milliamperes: float) -> HeadlineRun:
    """A run of which these currents were printed."""
    frequency = None if waveform == "step" else 0.1
    rows = tuple(
        PublishedMeasurement(
            9,
            f"{waveform} {volts:g}",
            "force",
            waveform,
            volts,
            frequency,
            "room",
            metric,
            f"{float(value)!r} mA",
            "stated",
        )
        for metric, value in milliamperes.items()
    )
    return HeadlineRun(f"{waveform} {volts:g}", "force", waveform, volts, rows)


def pair(sample: int, measured: str) -> list[HeadlineRun]:
    runs = {run.waveform: run for run in headline_runs(sample, measured) if run.amplitude == 1.0}
    return [runs["step"], runs["square"]]


@pytest.mark.parametrize(
    ("sample", "measured"), [(1, "displacement"), (3, "displacement"), (5, "force"), (7, "displacement")]
)
def test_a_square_with_too_small_a_peak_is_as_far_off_as_by_hand(sample: int, measured: str) -> None:
    """2 P (1 - e) - H (1 + e) = Q (1 + e): the step's peak, what flows before the reversal, and the square's peak.

    H is read a row before the reversal, from which it falls a little: the error is a little larger.
    """
    runs = pair(sample, measured)
    peak, _, largest, held = (runs[i].value(name) for i, name in NAMES)
    joined = linear_one_port(runs)
    by_hand = (2 * peak - held - largest) / (2 * peak + held + largest)
    assert by_hand <= joined.error <= 1.0002 * by_hand
    assert not joined.possible
    assert max(abs(row.difference) for row in joined.nearest) == pytest.approx(joined.error, rel=1e-6)


@pytest.mark.parametrize(("sample", "measured"), [(2, "force"), (5, "displacement"), (6, "displacement")])
def test_where_the_reversal_fits_the_first_edge_does_not(sample: int, measured: str) -> None:
    """Read at the first edge the square's peak is the step's, so that each is off by half of what they differ."""
    runs = pair(sample, measured)
    assert linear_one_port(runs).possible
    at_edge = linear_one_port(runs, square_peak="at the first edge")
    peak, square = runs[0].value("peak_current"), runs[1].value("peak_current")
    assert at_edge.error == pytest.approx((square - peak) / (square + peak), rel=1e-6)
    assert not at_edge.possible


def test_a_clipped_peak_only_bounds_from_below() -> None:
    runs = pair(2, "displacement")
    joined = linear_one_port(runs)
    (peak,) = (row for row in joined.nearest if row.lower_bound)
    assert peak.published == pytest.approx(0.2048)
    # As by hand, but the step's peak may be larger still: the program has no use for that here.
    held, largest = runs[1].value("half_period_end_current"), runs[1].value("peak_current")
    by_hand = (2 * 0.2048 - held - largest) / (2 * 0.2048 + held + largest)
    assert by_hand <= joined.error <= 1.0002 * by_hand
    free = linear_one_port([runs[0]])
    assert free.error == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("metric", "of_step", "of_sine"), [("peak_current", 50.0, 80.0), ("steady_current", 12.0, 5.0)]
)
def test_a_sine_lies_between_the_ends_of_the_step(metric: str, of_step: float, of_sine: float) -> None:
    """|Y(jw)| is at most G_0 + sum a_k and at least G_0: outside, each number is off by half of what is missing."""
    runs = [printed("step", 1.0, **{metric: of_step}), printed("sine", 1.0, peak_current=of_sine)]
    by_hand = abs(of_step - of_sine) / (of_step + of_sine)
    assert linear_one_port(runs).error == pytest.approx(by_hand, rel=1e-3)


@costly()
@given(
    amplitudes=st.lists(st.floats(1e-4, 0.1), min_size=1, max_size=4),
    spans=st.lists(st.floats(np.log(5e-3), np.log(1e3)), min_size=4, max_size=4),
    leak=st.floats(1e-4, 0.02),
)
def test_currents_of_relaxations_join(amplitudes: list[float], spans: list[float], leak: float) -> None:
    """Time constants between those of the grid: its finest errors are far below any tolerance."""

    def step(time: float) -> float:
        return leak + sum(a * np.exp(-time / np.exp(s)) for a, s in zip(amplitudes, spans, strict=False))

    last = DURATION - 1.0 / RATE
    runs = [
        printed("step", 1.0, peak_current=1e3 * step(0.0), steady_current=1e3 * step(last)),
        printed(
            "square",
            1.0,
            peak_current=1e3 * (2.0 * step(0.0) - step(5.0)),
            half_period_end_current=1e3 * step(5.0 - 1.0 / RATE),
        ),
    ]
    assert linear_one_port(runs).error < 2e-3


@pytest.mark.parametrize("stages", [(), ("clamp",), ("line.segments=4",), ("branches=3", "clamp")])
def test_every_linear_circuit_of_the_package_passes(stages: tuple[str, ...]) -> None:
    """Step, sine and square of lumped circuits, fed clamps and lines are joined, as by a network that exists."""
    strip = with_stages(load_actuator("friend-2"), *stages) if stages else load_actuator("friend-2")
    runs = []
    for run in headline_runs(2, "force"):
        of_model = {row.metric: 1e3 * row.model for row in compare(strip, run) if row.metric.endswith("current")}
        runs.append(printed(run.waveform, 1.0, **of_model))
    joined = linear_one_port(runs)
    assert joined.error < 2e-3
    assert joined.possible


def test_a_finer_grid_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [run for run in headline_runs(6, "displacement") if run.waveform != "sine"]
    coarse = linear_one_port(runs).error
    monkeypatch.setattr(passive, "TIME_CONSTANTS", np.geomspace(1e-4, 1e6, 401))
    passive._responses.cache_clear()
    try:
        assert linear_one_port(runs).error == pytest.approx(coarse, abs=2e-4)
    finally:
        passive._responses.cache_clear()


@pytest.mark.parametrize(("sample", "figures"), [(1, (0, 3)), (3, (0, 4)), (3, (3, 4)), (4, (0, 3)), (7, (0, 3))])
def test_three_volts_are_as_far_off_as_by_hand(sample: int, figures: tuple[int, int]) -> None:
    """v P_1 (1 - e) - (v - 1) S_1 (1 + e) = P_2 (1 + e)."""
    low, high = (headline_runs(sample)[i] for i in figures)
    joined = leaking_one_port(low, high)
    peak, steady, above = low.value("peak_current"), low.value("steady_current"), high.value("peak_current")
    by_hand = (3 * peak - 2 * steady - above) / (3 * peak + 2 * steady + above)
    assert joined.error == pytest.approx(by_hand, rel=1e-9)
    assert joined.possible == (joined.worst <= 1.0) is False


@costly()
@given(
    law=st.sampled_from(
        [
            {"leak.cubic.linear": 30.0, "leak.cubic.quadratic": 10.0, "leak.cubic.cubic": 20.0},
            {"leak.exponential.current_density": 80.0, "leak.exponential.threshold": 0.4},
            {"leak.butler_volmer.current_density": 200.0, "leak.butler_volmer.threshold": 0.2},
        ]
    ),
    contact=st.floats(0.0, 40.0),
    voltage=st.floats(1.2, 4.0),
)
def test_every_leak_of_the_package_keeps_to_the_inequality(
    law: dict[str, float], contact: float, voltage: float
) -> None:
    form = next(iter(law)).rpartition(".")[0]
    strip = with_stages(load_actuator("friend-2"), form).replace(**law, **{"circuit.contact_resistance": contact})
    low, high = (simulate(strip, f"step {volts!r} V", duration=DURATION, rate=RATE).current for volts in (1.0, voltage))
    assert low is not None
    assert high is not None
    assert high[0] >= voltage * low[0] - (voltage - 1.0) * low[-1] - 1e-12
    runs = [
        printed("step", volts, peak_current=1e3 * current[0], steady_current=1e3 * current[-1])
        for volts, current in ((1.0, low), (voltage, high))
    ]
    assert leaking_one_port(runs[0], runs[1]).error < 1e-9


def test_the_contact_does_not_matter_where_steady_is_steady() -> None:
    """Two clampings of one strip, each read when its current stands."""
    strip = load_actuator("friend-2")
    runs = []
    for contact in (0.0, 7.0):
        clamped = strip.replace(**{"circuit.contact_resistance": contact})
        elements = clamped.circuit_elements()
        start = simulate(clamped, "step 1 V", duration=1.0, rate=RATE).current
        assert start is not None
        steady = 1e3 / (elements.series.real + elements.dc.real)
        runs.append(printed("step", 1.0, peak_current=1e3 * float(start[0]), steady_current=steady))
    assert one_strip(runs).error < 1e-9
    half = printed("step", 1.0, peak_current=1e3 * 0.5 * float(start[0]), steady_current=3.0 * steady)
    assert not one_strip([runs[0], half]).possible


def test_sample_2_was_in_two_states_and_samples_3_and_5_in_one() -> None:
    def of(sample: int) -> Joined:
        return one_strip([run for run in headline_runs(sample) if run.waveform == "step" and run.amplitude == 1.0])

    assert [of(sample).possible for sample in (2, 3, 5)] == [False, True, True]
    # Sample 3 by hand: V/S - V/P, each at the end of what an error e allows.
    error = of(3).error
    most = 1.0 / 0.007 / (1.0 - error) - 1.0 / 0.088 / (1.0 + error)
    least = 1.0 / 0.006 / (1.0 + error) - 1.0 / 0.0907 / (1.0 - error)
    assert most == pytest.approx(least)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (lambda: linear_one_port([]), "runs: no runs; give one published run or more"),
        (lambda: one_strip([headline_runs(6)[1]]), "runs: figure 5.55 is a sine; give runs with a step, such as"),
        (
            lambda: leaking_one_port(headline_runs(3)[4], headline_runs(3)[0]),
            "high: 1 V is not above 3 V; give the step of the lower voltage first",
        ),
    ],
)
def test_what_cannot_be_joined_is_refused(asked, message: str) -> None:
    with pytest.raises(InputError, match=message):
        asked()


def test_numbers_that_agree_leave_no_error() -> None:
    step = printed("step", 1.0, peak_current=60.0, steady_current=12.0)
    joined = linear_one_port([step])
    assert joined.error == pytest.approx(0.0, abs=1e-9)
    assert [replace(row).difference for row in joined.nearest] == pytest.approx([0.0, 0.0], abs=1e-9)
