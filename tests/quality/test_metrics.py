"""Metrics against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import load_actuator, simulate
from ipmclab.comparison.run_metrics import metrics_of_run
from ipmclab.quality import Metric, measure, period_of
from ipmclab.quality.metrics import shows_zero
from ipmclab.quality.period import periodic_part
from ipmclab.quality.steady import settle
from ipmclab.run import Run, RunMetadata

TIME = np.arange(2000) / 50.0
OMEGA = 2 * math.pi * 0.1


def metrics(run: Run, channel: str = "current") -> dict[str, Metric]:
    return {metric.name: metric for metric in measure(run) if metric.channel == channel}


def stepped(**responses: npt.NDArray[np.float64]) -> Run:
    """A step of 1 V at row 100 (2 s)."""
    return Run.from_arrays(time=TIME, voltage=np.where(TIME >= 2.0, 1.0, 0.0), **responses)


def after(shape: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    return np.where(TIME >= 2.0, shape(np.maximum(TIME - 2.0, 0.0)), 0.0)


def test_a_decaying_current() -> None:
    found = metrics(stepped(current=after(lambda t: 0.01 + 0.05 * np.exp(-t / 6.0))))
    assert found["peak_at_first_edge"].value == pytest.approx(0.06)
    assert found["time_to_peak"].value == 0.0
    assert found["largest"].value == pytest.approx(0.06)
    assert found["steady_value"].value == pytest.approx(0.01, rel=1e-3)
    mean = 0.01 + 0.05 * 6.0 / 4.0 * (math.exp(-33.99 / 6.0) - math.exp(-37.99 / 6.0))
    assert found["mean_of_last_tenth"].value == pytest.approx(mean, rel=1e-4)
    assert "back_relaxation" not in found
    assert found["peak_at_first_edge"].unit == "A"


def test_a_bending_that_still_grows_has_its_peak_later() -> None:
    run = stepped(displacement=after(lambda t: 1e-3 * (1.0 - np.exp(-t / 20.0))))
    found = metrics(run, "displacement")
    assert found["time_to_peak"].value == pytest.approx(37.98)
    assert found["time_to_peak"].interval == (found["time_to_peak"].value, math.inf)
    # How long the voltage was held is none of what runs are compared by.
    assert "time_to_peak" not in [one.name for one in metrics_of_run(run)]


def test_a_bending_that_relaxes_back_through_rest() -> None:
    """y = A (exp(-a t) - exp(-b t)) - c t: its peak where the derivative vanishes."""
    a, b, height, drift, rest = 0.1, 1.0, 1.2e-3, 2e-5, 9e-3

    def shape(t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return height * (np.exp(-a * t) - np.exp(-b * t)) - drift * t

    fine = np.linspace(0.0, 10.0, 200_001)
    peak = int(shape(fine).argmax())
    noise = np.random.default_rng(20261121).normal(0.0, 1e-7, 2000)
    found = metrics(stepped(displacement=rest + after(shape) + noise), "displacement")
    assert found["peak_at_first_edge"].value == pytest.approx(float(shape(fine)[peak]), abs=5e-7)
    assert found["time_to_peak"].value == pytest.approx(float(fine[peak]), abs=0.15)
    assert found["time_to_peak"].interval is None
    end = float(shape(np.arange(1710, 1900) / 50.0).mean())
    assert found["back_relaxation"].value == pytest.approx(1.0 - end / float(shape(fine)[peak]), abs=2e-3)
    assert found["back_relaxation"].value > 1.0
    later = stepped(displacement=rest + after(lambda t: shape(t) - 1e-3 * np.maximum(t - 20.0, 0.0)))
    assert metrics(later, "displacement")["largest"].value < -0.01
    assert metrics(later, "displacement")["peak_at_first_edge"].value > 0.0


# Three rows before an edge are the edge's own.
@pytest.mark.parametrize(("edge", "at_rest"), [(0, 0), (7, 4), (8, 5), (9, 6), (28, 25), (60, 25)])
def test_the_zero_is_what_at_least_five_rows_at_rest_read(edge: int, at_rest: int) -> None:
    rows = np.arange(2000)
    force = 2e-3 + 1e-6 * rows + np.where(rows >= edge, 5e-3, 0.0)
    about = RunMetadata(origin="measured")
    run = Run.from_arrays(time=TIME, voltage=np.where(rows >= edge, 1.0, 0.0), force=force, metadata=about)
    assert shows_zero(run, "force") is (at_rest >= 5)
    zero = float(force[edge - 3 - at_rest : edge - 3].mean()) if at_rest >= 5 else 0.0
    assert metrics(run, "force")["largest"].value == pytest.approx(float(force[-1]) - zero, rel=1e-9)
    assert shows_zero(replace(run, metadata=RunMetadata(origin="simulated")), "force")


@pytest.mark.parametrize(
    ("before", "after", "is_rest"),
    [
        (0.01, 0.5, True),  # up to 10 mV nothing is driven
        (0.011, 0.5, False),
        (0.029, 3.0, True),  # nor up to a hundredth of the voltage that follows
        (0.031, 3.0, False),
    ],
)
def test_little_voltage_is_rest(before: float, after: float, is_rest: bool) -> None:
    voltage = np.where(TIME >= 2.0, after, before)
    run = Run.from_arrays(time=TIME, voltage=voltage, force=1e-3 * voltage, metadata=RunMetadata(origin="measured"))
    assert shows_zero(run, "force") is is_rest


@pytest.mark.parametrize(("edge", "error"), [(0, 0.0), (8, 1.96 / math.sqrt(5.0)), (60, 1.96 / 5.0)])
def test_the_error_of_the_zero_is_in_the_steady_value(edge: int, error: float) -> None:
    """Two thousand rows after the edge know it much better, in standard deviations of the noise."""
    rows = np.arange(2000)
    noise = np.random.default_rng(20261123).normal(0.0, 1e-4, 2000)
    force = np.where(rows >= edge, 5e-3, 0.0) + noise
    run = Run.from_arrays(time=TIME, voltage=np.where(rows >= edge, 1.0, 0.0), force=force)
    # From row 0 on a constant force and noise cannot be told apart: what `check` says of it is not asked here.
    (steady,) = [one for one in measure(run, ()) if one.name == "steady_value"]
    low, high = steady.interval or (0.0, 0.0)
    assert 0.5 * (high - low) / 1e-4 == pytest.approx(error, abs=0.15)


def test_a_channel_of_noise_alone_has_no_metrics() -> None:
    """Its largest reading is that of the noise, however long the record: no force of any strip."""
    noise = np.random.default_rng(20261126).normal(0.0, 1e-4, 2000)
    run = stepped(current=after(lambda t: 0.01 * np.exp(-t)) + 1e-3 * noise, force=noise)
    assert {metric.channel for metric in measure(run)} == {"current"}
    assert "largest" in {metric.name for metric in measure(run, ()) if metric.channel == "force"}


def test_a_response_that_does_not_come_back_has_no_back_relaxation() -> None:
    noise = np.random.default_rng(20261121).normal(0.0, 1e-6, 2000)
    found = metrics(stepped(displacement=after(lambda t: 1e-3 * (1 - np.exp(-t))) + noise), "displacement")
    assert "back_relaxation" not in found


def test_a_sine_through_an_rc_circuit() -> None:
    """Current of R = 20 ohm in series with C = 50 mF: admittance j w C / (1 + j w R C), with its transient."""
    resistance, capacitance = 20.0, 0.05
    admittance = 1j * OMEGA * capacitance / (1 + 1j * OMEGA * resistance * capacitance)
    steady = (admittance * np.exp(1j * OMEGA * TIME)).imag
    current = steady - steady[0] * np.exp(-TIME / (resistance * capacitance))
    run = Run.from_arrays(time=TIME, voltage=np.sin(OMEGA * TIME), current=current)
    found = metrics(run)
    assert found["amplitude"].value == pytest.approx(abs(admittance), rel=1e-4)
    assert found["phase"].value == pytest.approx(float(np.angle(admittance)), abs=1e-6)
    assert found["largest"].value == pytest.approx(float(current[np.abs(current).argmax()]))
    for order in (2, 3, 4, 5):
        assert found[f"harmonic_{order}"].value < 1e-6
    assert "steady_value" not in found


def test_harmonics_of_a_polynomial() -> None:
    """sin x has fundamental 1; a T_k(sin x) adds only harmonic k."""
    sine = np.sin(OMEGA * TIME)
    chebyshev = [np.polynomial.chebyshev.chebval(sine, [0.0] * order + [1.0]) for order in range(2, 6)]
    levels = (0.1, 0.05, 0.02, 0.01)
    force = sine + sum(level * shape for level, shape in zip(levels, chebyshev, strict=True))
    found = metrics(Run.from_arrays(time=TIME, voltage=sine, force=1e-3 * force), "force")
    for order, level in zip(range(2, 6), levels, strict=True):
        assert found[f"harmonic_{order}"].value == pytest.approx(level, abs=1e-9)
    assert found["phase"].value == pytest.approx(0.0, abs=1e-9)


def test_the_intervals_of_phase_and_harmonics_hold_the_truth() -> None:
    rng = np.random.default_rng(20261121)
    inside: list[bool] = []
    for _ in range(60):
        current = 0.03 * np.sin(OMEGA * TIME + 0.4) + 0.003 * np.sin(2 * OMEGA * TIME) + rng.normal(0.0, 1e-3, 2000)
        found = metrics(Run.from_arrays(time=TIME, voltage=np.sin(OMEGA * TIME), current=current))
        for name, truth in (("phase", 0.4), ("harmonic_2", 0.1)):
            interval = found[name].interval
            assert interval is not None
            inside.append(interval[0] <= truth <= interval[1])
    assert 0.88 <= np.mean(inside) <= 0.99


@pytest.mark.parametrize("rate", [50.0, 37.0])
def test_the_current_at_the_end_of_a_half_period(rate: float) -> None:
    """R and C in series under a square, settled: I = I0 exp(-t / tau) in every half period."""
    tau = 2.0
    time = np.arange(int(40 * rate)) / rate
    phase = np.mod(time + 1e-9, 5.0)
    sign = np.where(np.mod(time + 1e-9, 10.0) < 5.0, 1.0, -1.0)
    current = 0.05 * sign * np.exp(-phase / tau)
    found = metrics(Run.from_arrays(time=time, voltage=sign, current=current))
    end = 0.05 * math.exp(-5.0 / tau)
    assert found["half_period_end"].value == pytest.approx(end, rel=0.05)
    assert found["half_period_end_last"].value == pytest.approx(end, rel=0.05)
    assert found["amplitude"].value == pytest.approx(0.05, rel=1e-3)


@pytest.mark.parametrize("unread", [245, 1995, 1745])
def test_a_half_period_whose_end_nobody_read_gives_no_current_there(unread: int) -> None:
    time = np.arange(2000) / 50.0
    sign = np.where(np.arange(2000) // 250 % 2, -1.0, 1.0)
    current = 0.05 * sign * np.exp(-np.mod(time, 5.0) / 2.0)
    current[unread : unread + 5] = np.nan
    found = metrics(Run.from_arrays(time=time, voltage=sign, current=current))
    assert "largest" in found
    assert not {"half_period_end", "half_period_end_last"} & found.keys()


def test_the_published_square_response_of_the_model(read: Callable[..., Run]) -> None:
    run = read("square 1 V 0.1 Hz")
    assert metrics(run)["half_period_end"].value == pytest.approx(21.66e-3, rel=0.01)  # I(5 s) of the 1 V step
    step = metrics(read("step 1 V"))
    assert step["peak_at_first_edge"].value == pytest.approx(60.35e-3, rel=0.01)
    interval = step["steady_value"].interval
    assert interval is not None
    assert interval[0] < 11.505e-3 < interval[1]
    assert step["mean_of_last_tenth"].value > 12.5e-3  # far from settled: the reason for extrapolating
    sine = metrics(read("sine 1 V 0.1 Hz"))
    assert sine["amplitude"].value == pytest.approx(34.955e-3, rel=0.01)
    bend = metrics(read("sine 1 V 0.1 Hz"), "displacement")
    assert math.degrees(bend["phase"].value) == pytest.approx(-39.4, abs=0.5)


@pytest.mark.parametrize("tau", [2.0, 12.0, 30.0])
def test_the_interval_of_the_steady_value_holds_the_truth(tau: float) -> None:
    rng = np.random.default_rng(20261121)
    time = np.arange(1500) / 50.0
    held = 0
    for _ in range(120):
        _, (low, high) = settle(time, 2.0 + np.exp(-time / tau) + rng.normal(0.0, 0.01, 1500))
        held += low <= 2.0 <= high
    assert held / 120 >= 0.88


def test_a_steady_value_that_the_record_is_too_short_for_is_open() -> None:
    time = np.arange(1500) / 50.0
    noise = np.random.default_rng(20261121).normal(0.0, 0.01, 1500)
    _, (low, high) = settle(time, 2.0 + np.exp(-time / 300.0) + noise)
    assert low == -math.inf
    assert math.isfinite(high)
    _, (low, high) = settle(time, 2.0 - np.exp(-time / 300.0) + noise)
    assert high == math.inf
    limit, (low, high) = settle(time, 2.0 + noise)
    assert low < 2.0 < high
    assert high - low < 4e-3
    assert limit == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize("hertz", [0.1, 0.37, 2.0])
@pytest.mark.parametrize("shape", [np.sin, lambda x: np.sign(np.sin(x + 1e-6)), lambda x: np.arcsin(np.sin(x))])
def test_the_period_is_found_in_the_voltage(hertz: float, shape: Callable[..., npt.NDArray[np.float64]]) -> None:
    noise = np.random.default_rng(20261121).normal(0.0, 1e-3, 2000)
    voltage = shape(2 * math.pi * hertz * TIME) + noise
    period = period_of(Run.from_arrays(time=TIME, voltage=voltage))
    assert period == pytest.approx(1.0 / hertz, abs=0.04 / (40.0 * hertz - 1.0))


def test_the_period_is_taken_from_the_name_of_the_signal(read: Callable[..., Run]) -> None:
    assert period_of(read("square 1 V 0.07 Hz")) == pytest.approx(1.0 / 0.07)
    assert period_of(read("multisine 1 V 0.05 Hz 1 Hz")) == pytest.approx(20.0)
    assert period_of(read("sine 1 V 0.01 Hz")) is None  # less than one period
    small = Run.from_arrays(time=TIME, voltage=4e-6 * np.sign(np.sin(np.pi * TIME + 1e-6)))
    assert period_of(small) is None  # no voltage is read as one
    # A rest before it, as recorders give it out: 40 s in all, two periods of 0.05 Hz do not fit after 5 s.
    assert period_of(read("step 0 V for 5 s then sine 1 V 0.05 Hz for 35 s")) == pytest.approx(20.0)
    assert period_of(read("step 0 V for 5 s then multisine 1 V 0.05 Hz 1 Hz")) == pytest.approx(20.0)
    assert period_of(read("step 0 V for 25 s then sine 1 V 0.05 Hz")) is None
    assert period_of(read("sine 1 V 0.1 Hz for 35 s then step 0 V")) == pytest.approx(10.0)
    named = Run.from_arrays(
        time=TIME, voltage=np.sin(OMEGA * TIME), metadata=RunMetadata(signal="what the operator typed")
    )
    assert period_of(named) == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize("signal", ["step 1 V", "chirp 1 V 0.05 Hz 5 Hz", "prbs 1 V 0.5 s", "random 1 V 0.5 s"])
def test_no_period_where_there_is_none(read: Callable[..., Run], signal: str) -> None:
    assert period_of(read(signal)) is None


def test_masked_rows_do_not_count(read: Callable[..., Run]) -> None:
    current = after(lambda t: 0.01 + 0.05 * np.exp(-t / 6.0)) + 1e-5 * np.random.default_rng(1).normal(size=2000)
    current[1000] = 0.4
    run = stepped(current=current)
    assert metrics(run)["largest"].value == pytest.approx(0.06, rel=1e-2)


def test_every_metric_says_what_it_is(read: Callable[..., Run]) -> None:
    for signal in ("step 1 V delay=2 s", "square 1 V 0.1 Hz"):
        found = measure(read(signal))
        assert all(len(metric.definition) > 40 for metric in found)
        assert all(type(number) is float for metric in found for number in (metric.value, *(metric.interval or ())))
        assert len({(metric.channel, metric.name) for metric in found}) == len(found)


@pytest.mark.parametrize("is_named", [True, False])
@pytest.mark.parametrize("shape", ["sine 1 V 0.1 Hz", "square 1 V 0.1 Hz", "square 1 V 0.25 Hz"])
def test_a_rest_at_the_end_does_not_belong_to_the_last_period(shape: str, is_named: bool) -> None:
    """As recorders give it out: 5 s at 0 V before and, unless stated, after: also half a period of the square."""
    strip = load_actuator("friend-2")
    found = []
    for rest, length in (("", 45.0), (" for 40 s then step 0 V", 50.0), (" for 40 s then step 0 V", 55.0)):
        run = simulate(strip, f"step 0 V for 5 s then {shape}{rest}", duration=length, rate=50.0)
        run = run if is_named else replace(run, metadata=replace(run.metadata, signal=None))
        found.append({(one.channel, one.name): one.value for one in measure(run)})
    own = {"amplitude", "phase", "half_period_end", "half_period_end_last"}
    keys = [key for key in found[0] if key[1] in own]
    assert len(keys) == (8 if shape.startswith("square") else 6)
    for key in keys:
        assert found[1][key] == pytest.approx(found[0][key], rel=1e-3), key
        assert found[2][key] == pytest.approx(found[0][key], rel=1e-3), key


@pytest.mark.parametrize(("rest", "end"), [(0, 2000), (1, 2001), (2, 1750), (100, 1750)])
def test_a_square_of_0_and_1_v_ends_with_its_low_half_unless_that_is_longer(rest: int, end: int) -> None:
    voltage = np.append(np.where(np.arange(2000) // 250 % 2, 0.0, 1.0), np.zeros(rest))
    part = periodic_part(Run.from_arrays(time=np.arange(2000 + rest) / 50.0, voltage=voltage))
    assert part == (pytest.approx(10.0), end)


@pytest.mark.parametrize(("rows", "found"), [(499, None), (500, (10.0, 500)), (501, (10.0, 501))])
def test_a_record_holds_a_period_when_its_rows_last_as_long(rows: int, found: tuple[float, int] | None) -> None:
    named = RunMetadata(signal="sine 1 V 0.1 Hz")
    time = 7.0 + np.arange(rows) / 50.0
    assert periodic_part(Run.from_arrays(time=time, voltage=np.sin(OMEGA * time), metadata=named)) == found


@pytest.mark.parametrize(("late", "found"), [(2, True), (3, False)])
def test_a_voltage_whose_periods_differ_by_more_than_2_percent_has_none(late: int, found: bool) -> None:
    """A square of 200 rows that goes up late once: one period is longer, the next one shorter by as much."""
    voltage = np.where(np.arange(2000) // 100 % 2, 1.0, -1.0)
    voltage[700 : 700 + late] = -1.0
    assert (period_of(Run.from_arrays(time=TIME, voltage=voltage)) is not None) is found


def test_a_signal_that_begins_late_has_its_period_from_then_on(read: Callable[..., Run]) -> None:
    assert period_of(read("sine 1 V 0.1 Hz delay=30 s")) == pytest.approx(10.0)
    assert period_of(read("sine 1 V 0.1 Hz delay=31 s")) is None
    assert period_of(read("step 0 V for 20 s then square 1 V 0.1 Hz delay=11 s")) is None


def test_a_back_relaxation_whose_end_is_hardly_read_is_less_certain() -> None:
    """Ten readings of the last tenth, of 190: its mean is known 4.4 times worse."""
    noise = 2e-5 * np.random.default_rng(20261121).normal(size=2000)
    bent = after(lambda t: 1e-3 * (np.exp(-0.1 * t) - np.exp(-t))) + noise
    found = []
    for lost in (0, 180):
        bent[2000 - lost :] = np.nan
        found.append(metrics(stepped(displacement=bent), "displacement")["back_relaxation"])
    error, peak = 2e-5 / math.sqrt(10), float(np.nanmax(bent))
    assert found[1].interval is not None
    assert found[0].interval is not None
    half, whole = (0.5 * (one.interval[1] - one.interval[0]) for one in reversed(found) if one.interval)
    assert 1.0 < half / (1.96 * error / peak) < 1.5  # the peak has an error as well
    assert whole < 0.75 * half
