"""From which reading and row on, and how surely: the bounds of the metrics, and their intervals by closed forms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from ipmclab.quality import Metric, measure, shows_zero
from ipmclab.quality.steady import settle
from ipmclab.run import FloatArray, Run, RunMetadata

TIME = np.arange(1000) / 50.0
SINE = np.sin(2.0 * math.pi * 0.25 * TIME)


def stepped(displacement: FloatArray, edge: int = 100, before: float = 0.0) -> Run:
    voltage = np.where(np.arange(len(displacement)) >= edge, 2.0, before)
    return Run.from_arrays(time=np.arange(len(displacement)) / 50.0, voltage=voltage, displacement=displacement)


def found(run: Run, channel: str = "displacement") -> dict[str, Metric]:
    """Metrics of the readings as they stand: nothing is masked."""
    return {metric.name: metric for metric in measure(run, ()) if metric.channel == channel}


def half(metric: Metric) -> float:
    """Half the interval, which is even about the value."""
    assert metric.interval is not None
    assert metric.interval[1] - metric.value == pytest.approx(metric.value - metric.interval[0], rel=1e-9)
    return metric.interval[1] - metric.value


def white(scale: float, count: int = 1000, seed: int = 1) -> FloatArray:
    return scale * np.random.default_rng([20261121, seed]).standard_normal(count)


@pytest.mark.parametrize(("before", "rest"), [(0.0, 1e-3), (0.015, 1e-3), (0.03, 0.0)])
def test_the_zero_is_that_of_25_rows_up_to_three_rows_before_the_voltage(before: float, rest: float) -> None:
    """A voltage of more than a hundredth of the largest one is no rest."""
    moved = np.full(1000, 3e-3)
    moved[:72], moved[72:97], moved[97:100] = 5e-3, 1e-3, 2e-3
    assert found(stepped(moved, before=before))["mean_of_last_tenth"].value == pytest.approx(3e-3 - rest)


@pytest.mark.parametrize(("edge", "shown"), [(8, True), (7, False), (3, False), (0, False)])
def test_five_readings_show_the_zero(edge: int, shown: bool) -> None:
    moved = np.where(np.arange(1000) >= edge, 3e-3, 1e-3)
    run = stepped(moved, edge)
    assert found(run)["mean_of_last_tenth"].value == pytest.approx(2e-3 if shown else 3e-3)
    assert shows_zero(run, "displacement") is shown


def test_what_a_rest_does_not_tell_of_a_mean_is_in_its_interval() -> None:
    moved = white(1e-5) + np.where(np.arange(1000) >= 100, 1e-3, 0.0)
    expected = 1.96 * 1e-5 * math.sqrt(1.0 / 100 + 1.0 / 25)
    assert half(found(stepped(moved))["mean_of_last_tenth"]) == pytest.approx(expected, rel=0.1)
    at_once = found(stepped(moved, 0))["mean_of_last_tenth"]
    assert half(at_once) == pytest.approx(1.96 * 1e-5 / 10.0, rel=0.1)
    moved[900:] = np.where(np.arange(100) < 75, np.nan, moved[900:])
    expected = 1.96 * 1e-5 * math.sqrt(1.0 / 25 + 1.0 / 25)
    assert half(found(stepped(moved))["mean_of_last_tenth"]) == pytest.approx(expected, rel=0.1)


def test_the_interval_of_a_steady_value_has_that_of_the_zero_in_it() -> None:
    moved = white(1e-5) + np.where(np.arange(1000) >= 100, 1e-3 - 1e-3 * np.exp(-(TIME - 2.0) / 4.0), 0.0)
    steady = found(stepped(moved))["steady_value"]
    limit, (low, high) = settle(TIME[325:], moved[325:] - moved[72:97].mean())
    rest = 1.96 * 1e-5 / 5.0
    assert steady.value == pytest.approx(limit, rel=1e-9)
    expected = (limit - math.hypot(limit - low, rest), limit + math.hypot(high - limit, rest))
    assert steady.interval == pytest.approx(expected, abs=0.1 * rest)


@pytest.mark.parametrize(
    ("rows", "edge", "there"),
    [(166, 100, True), (165, 100, False), (1000, 899, True), (1000, 900, False), (5, 2, False)],
)
def test_a_steady_value_needs_50_readings_and_more_than_a_tenth_of_the_record(
    rows: int, edge: int, there: bool
) -> None:
    moved = np.where(np.arange(rows) >= edge, 1e-3, 0.0)
    assert ({"steady_value", "mean_of_last_tenth"} <= found(stepped(moved, edge)).keys()) is there


def test_without_a_reading_in_the_last_tenth_nothing_is_said_of_the_end() -> None:
    moved = np.where(np.arange(1000) >= 100, 1e-3, 0.0)
    moved[900:] = np.nan
    assert not {"steady_value", "mean_of_last_tenth", "back_relaxation"} & found(stepped(moved)).keys()


def test_a_voltage_that_does_not_stand_to_the_end_has_no_steady_value() -> None:
    moved = np.where(np.arange(1000) >= 100, 1e-3, 0.0)
    ramp = np.where(np.arange(1000) >= 100, 1.0 + np.arange(1000) / 1000.0, 0.0)
    told = found(Run.from_arrays(time=TIME, voltage=ramp, displacement=moved))
    assert not {"steady_value", "mean_of_last_tenth", "peak_at_first_edge"} & told.keys()
    assert told["largest"].value == pytest.approx(1e-3)


@pytest.mark.parametrize(("rest", "noise"), [(0.0, 0.0), (0.01, 0.0), (0.0, 0.01)])
def test_a_rest_at_the_end_is_no_steady_state(rest: float, noise: float) -> None:
    """A recording ends with one: what the strip settles to is what it did before."""
    rows = np.arange(1000)
    scatter = noise * np.random.default_rng(20261128).standard_normal(1000)
    moved = np.where(rows >= 100, 1e-3 - 1e-3 * np.exp(-(TIME - 2.0) / 4.0), 0.0)
    held = found(stepped(moved[:800]))
    moved[800:] = -2e-3
    voltage = np.where((rows >= 100) & (rows < 800), 2.0, rest)
    told = found(Run.from_arrays(time=TIME, voltage=voltage + scatter, displacement=moved))
    for name in ("steady_value", "mean_of_last_tenth"):
        assert told[name].value == pytest.approx(held[name].value, rel=1e-9)
    ramp = np.where((rows >= 100) & (rows < 800), 1.0 + rows / 1000.0, rest)
    told = found(Run.from_arrays(time=TIME, voltage=ramp, displacement=moved))
    assert not {"steady_value", "mean_of_last_tenth"} & told.keys()


@pytest.mark.parametrize("fall", [[1.0], [1.2, 0.4]])
def test_a_fall_over_some_rows_to_the_rest_hides_no_steady_state(fall: list[float]) -> None:
    """A measured voltage has a row or two within its jump, which are no stretch of their own."""
    rows = np.arange(1000)
    moved = np.where(rows >= 100, 1e-3 - 1e-3 * np.exp(-(TIME - 2.0) / 4.0), 0.0)
    held = found(stepped(moved[:800]))
    moved[800:] = -2e-3
    voltage = np.where((rows >= 100) & (rows < 800), 2.0, 0.0)
    voltage[800 : 800 + len(fall)] = fall
    told = found(Run.from_arrays(time=TIME, voltage=voltage, displacement=moved))
    for name in ("steady_value", "mean_of_last_tenth"):
        assert told[name].value == pytest.approx(held[name].value, rel=1e-9)


def test_a_voltage_that_falls_and_stays_is_held_there() -> None:
    """From 2 V to 0.03 V, which is more than a hundredth of it."""
    rows = np.arange(1000)
    moved = np.where(rows >= 100, 1e-3, 0.0)
    moved[600:] = 2e-4
    voltage = np.select([rows < 100, rows < 600], [0.0, 2.0], 0.03)
    told = found(Run.from_arrays(time=TIME, voltage=voltage, displacement=moved))
    assert told["mean_of_last_tenth"].value == pytest.approx(2e-4)


@pytest.mark.parametrize(("sign", "expected"), [(1.0, 1e-3), (-1.0, -1e-3)])
def test_the_largest_has_the_sign_of_its_side(sign: float, expected: float) -> None:
    moved = np.zeros(1000)
    moved[300:400], moved[600:700] = sign * 1e-3, sign * -0.9e-3
    assert found(stepped(moved))["largest"].value == pytest.approx(expected)
    even = np.zeros(1000)
    even[300:400], even[600:700] = -1e-3, 1e-3
    assert found(stepped(even))["largest"].value == pytest.approx(1e-3)


def humps(dip: float, sign: float = 1.0) -> FloatArray:
    """A first maximum of 1 mm, back by a share of it, and a second one of 1.5 mm."""
    return sign * 1e-3 * np.interp(np.arange(1000), [100, 300, 400, 700, 999], [0.0, 1.0, 1.0 - dip, 1.5, 1.5])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("dip", "peak"), [(0.015, 1.5e-3), (0.03, 1e-3)])
def test_a_response_has_come_back_when_2_percent_are_lost(dip: float, peak: float, sign: float) -> None:
    assert found(stepped(humps(dip, sign)))["peak_at_first_edge"].value == pytest.approx(sign * peak, rel=1e-6)


@pytest.mark.parametrize(("noise", "peak"), [(0.10 / 11.5, 1e-3), (0.10 / 4.0, 1.5e-3)])
def test_and_eight_standard_deviations_of_the_noise(noise: float, peak: float) -> None:
    moved = humps(0.10) + white(1e-3 * noise)
    assert found(stepped(moved))["peak_at_first_edge"].value == pytest.approx(peak, rel=0.04)


@pytest.mark.parametrize(("height", "starts"), [(-13.0, -1.0), (-4.0, 1.0), (4.0, 1.0)])
def test_a_response_goes_where_it_is_clear_of_the_noise_else_where_the_voltage_goes(
    height: float, starts: float
) -> None:
    moved = white(1e-5) + np.where(np.arange(1000) >= 100, 1e-5 * height * np.exp(-np.maximum(TIME - 2.0, 0.0)), 0.0)
    assert math.copysign(1.0, found(stepped(moved))["peak_at_first_edge"].value) == starts


def test_a_back_relaxation_is_as_sure_as_its_peak_its_end_and_its_zero() -> None:
    after = np.maximum(TIME - 2.0, 0.0)
    moved = 1e-3 * (np.exp(-0.1 * after) - np.exp(-after)) + white(1e-5)
    told = found(stepped(moved))
    peak, share = told["peak_at_first_edge"], told["back_relaxation"]
    rest, end = 1e-5 / 5.0, 1e-5 / math.sqrt(90)
    of_peak = math.sqrt((half(peak) / 1.96) ** 2 - rest**2)
    remains = 1.0 - share.value
    assert remains * peak.value == pytest.approx(moved[910:].mean() - moved[72:97].mean())
    expected = math.sqrt(end**2 + (of_peak * remains) ** 2 + (rest * share.value) ** 2) / peak.value
    assert half(share) == pytest.approx(1.96 * expected, rel=0.1)


@pytest.mark.parametrize(("height", "there"), [(7.0, True), (3.5, False)])
def test_a_fundamental_has_a_phase_when_it_is_five_times_its_error(height: float, there: bool) -> None:
    error = 1e-5 * math.sqrt(2.0 / 200)
    moved = height * error * SINE + white(1e-5)
    moved[800:] = height * error * SINE[800:] + white(1e-5)[800:]
    told = found(Run.from_arrays(time=TIME, voltage=SINE, displacement=moved))
    assert ("phase" in told) is there


def test_the_intervals_of_a_periodic_response() -> None:
    moved = 1e-3 * SINE + white(1e-5)
    told = found(Run.from_arrays(time=TIME, voltage=SINE, displacement=moved))
    error = 1.96 * 1e-5 * math.sqrt(2.0 / 200)
    assert half(told["phase"]) == pytest.approx(error / 1e-3, rel=0.1)
    for order in range(2, 6):
        harmonic = told[f"harmonic_{order}"]
        assert harmonic.interval is not None
        # Above it as far as above the amplitude from which the power of the noise was taken.
        with_noise = math.hypot(harmonic.value, math.sqrt(2.0) / 1.96 * error / 1e-3)
        assert harmonic.interval[1] - error / 1e-3 <= with_noise + 0.1 * error / 1e-3
        if harmonic.value:
            assert harmonic.interval[1] == pytest.approx(with_noise + error / 1e-3, abs=0.1 * error / 1e-3)
        assert harmonic.interval[0] == pytest.approx(max(0.0, harmonic.value - error / 1e-3), abs=0.1 * error / 1e-3)
        assert harmonic.interval[0] >= 0.0
    assert "harmonic_6" not in told
    assert half(told["amplitude"]) < 1.96 * 1e-5 / math.sqrt(2.0)  # of two single readings


@pytest.mark.parametrize(("per_period", "orders"), [(3, None), (4, 1), (6, 2), (10, 4), (12, 5)])
def test_as_many_harmonics_as_the_rows_of_a_period_tell(per_period: int, orders: int | None) -> None:
    time = np.arange(20 * per_period) / 50.0
    named = RunMetadata(signal=f"sine 1 V {50.0 / per_period:.12g} Hz")
    wave = np.sin(2.0 * math.pi * np.arange(len(time)) / per_period + 0.4)
    told = found(Run.from_arrays(time=time, voltage=wave, displacement=1e-3 * wave, metadata=named))
    names = {"phase", *(f"harmonic_{order}" for order in range(2, (orders or 0) + 1))} if orders else set()
    assert {name for name in told if name == "phase" or name.startswith("harmonic")} == names


def test_an_output_that_gave_nothing_has_no_phase() -> None:
    named = RunMetadata(signal="sine 1 V 0.25 Hz")
    told = found(Run.from_arrays(time=TIME, voltage=0.0 * SINE, displacement=1e-3 * SINE, metadata=named))
    assert told["amplitude"].value == pytest.approx(1e-3)
    assert "phase" not in told


def square(lengths: Sequence[int], ends: Sequence[float]) -> Run:
    """Half periods of so many rows; the current is 10 mA, and in the last five rows of each what ``ends`` say."""
    signs = [1.0 if place % 2 == 0 else -1.0 for place in range(len(lengths))]
    voltage = np.concatenate([np.full(length, sign) for length, sign in zip(lengths, signs, strict=True)])
    current = 0.01 * voltage
    for stop, sign, end in zip(np.cumsum(lengths), signs, ends, strict=True):
        current[stop - 5 : stop] = sign * end
    named = RunMetadata(signal="square 1 V 0.1 Hz")
    return Run.from_arrays(time=np.arange(len(voltage)) / 50.0, voltage=voltage, current=current, metadata=named)


@pytest.mark.parametrize(
    ("lengths", "last"),
    [
        ([250] * 6, 0.5 * (6e-3 + 7e-3)),
        ([250, 250, 250, 251, 249, 250], 0.5 * (6e-3 + 7e-3)),  # the edges a row early or late
        ([250, 250, 250, 250, 250, 247], 0.5 * (5e-3 + 6e-3)),  # the last one is not whole
        ([250, 250], 0.5 * (2e-3 + 3e-3)),
        ([250, 250, 250, 250, 260, 250], 0.5 * (4e-3 + 5e-3)),  # the last one stands alone
        ([252, 248, 250, 250], None),
        ([250, 252], None),
    ],
)
def test_half_periods_count_where_they_are_whole(lengths: list[int], last: float | None) -> None:
    run = square(lengths, [2e-3, 3e-3, 4e-3, 5e-3, 6e-3, 7e-3][: len(lengths)])
    told = found(run, "current")
    if last is None:
        assert "half_period_end" not in told
        return
    assert told["half_period_end"].value == pytest.approx(2e-3)
    assert told["half_period_end_last"].value == pytest.approx(last)


def test_the_end_of_a_half_period_is_as_sure_as_the_readings_of_it_that_are_there() -> None:
    """Medians: each is sqrt(pi / 2) times as unsure as a mean of as many readings."""
    run = square([250] * 6, [0.01] * 6)
    current = np.asarray(run.current) + white(1e-5, 1500)
    whole = found(
        Run.from_arrays(time=run.time, voltage=run.voltage, current=current, metadata=run.metadata), "current"
    )
    error = 1.96 * 1e-5 * math.sqrt(math.pi / 2.0)
    assert half(whole["half_period_end"]) == pytest.approx(error / math.sqrt(5), rel=0.1)
    assert half(whole["half_period_end_last"]) == pytest.approx(error / math.sqrt(10), rel=0.1)
    current[245:249] = np.nan
    part = found(Run.from_arrays(time=run.time, voltage=run.voltage, current=current, metadata=run.metadata), "current")
    assert half(part["half_period_end"]) == pytest.approx(error, rel=0.1)
