"""What each signal gives at a time, against closed forms, exact integer arithmetic and SciPy."""

from __future__ import annotations

import math
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
import scipy.signal
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

import ipmclab
from ipmclab import signals
from ipmclab.errors import InputError
from ipmclab.signals.signal import shortened

SEED = 20261121
ROWS = np.arange(2000) / 50.0

EVERY_KIND = [
    signals.Step(0.7, delay=3.0),
    signals.Sine(1.0, 0.1, phase=0.3, offset=0.2, delay=1.0),
    signals.Cosine(1.0, 0.37),
    signals.Square(1.5, 0.1, phase=0.5),
    signals.Triangle(1.0, 0.1),
    signals.Chirp(1.0, 0.05, 5.0, delay=0.5),
    signals.Multisine(1.0, 0.05, 2.0),
    signals.Prbs(1.0, 0.3, seed=7),
    signals.Random(1.0, 0.14, seed=SEED),
    signals.Samples(np.arange(100) * 0.1, np.cos(np.arange(100.0))),
    signals.Sequence((signals.Sine(1.0, 0.1), signals.Random(0.5, 0.1)), (7.0, 12.0)),
]


@given(
    rate=st.integers(1, 5000),
    frequency=st.fractions(Fraction(1, 100), Fraction(50), max_denominator=100),
    quarter=st.integers(0, 3),
    start=st.integers(0, 10**7),
)
def test_square_edges_fall_on_the_right_row_at_every_rate(
    rate: int, frequency: Fraction, quarter: int, start: int
) -> None:
    rows = range(start, start + 300)
    square = signals.Square(1.0, float(frequency), phase=quarter * math.pi / 2)
    exact = [
        1.0 if math.floor(2 * (Fraction(k, rate) * frequency + Fraction(quarter, 4))) % 2 == 0 else -1.0 for k in rows
    ]
    assert square.voltage(np.array(rows) / rate).tolist() == exact


def test_square_of_the_thesis_switches_every_250_rows() -> None:
    voltage = signals.Square(1.0, 0.1).voltage(ROWS)
    assert (np.flatnonzero(np.diff(voltage)) + 1).tolist() == [250, 500, 750, 1000, 1250, 1500, 1750]
    assert voltage[0] == 1.0


@given(rate=st.integers(1, 2000), first=st.integers(1, 400), second=st.integers(1, 400), start=st.integers(0, 400))
def test_edges_that_are_meant_for_a_row_are_on_it(rate: int, first: int, second: int, start: int) -> None:
    # The same edges as a sequence, samples, a delay, bits of a PRBS and levels of a random signal.
    time = np.arange(start + first + second + 3) / rate
    lasts = (start / rate, first / rate, second / rate)
    exact = np.repeat([0.0, 1.0, -1.0, 0.0], [start, first, second, 3])
    parts = (signals.Step(0.0), signals.Step(1.0), signals.Step(-1.0))
    skip = 0 if start else 1
    assert np.array_equal(signals.Sequence(parts[skip:], lasts[skip:]).voltage(time), exact)
    edges = [start / rate, (start + first) / rate, (start + first + second) / rate]
    sampled = signals.Samples(edges, [1.0, -1.0, 0.0]).voltage(time)
    assert np.array_equal(sampled, exact)
    delayed = signals.Step(1.0, delay=edges[1]).voltage(time)
    assert np.array_equal(delayed, np.arange(len(time)) >= start + first)
    for kind in (signals.Prbs, signals.Random):
        at_bits = kind(1.0, 0.5).voltage((np.arange(len(time)) // first) * 0.5)  # type: ignore[call-arg]
        assert np.array_equal(kind(1.0, first / rate).voltage(time), at_bits)  # type: ignore[call-arg]


def test_sine_and_cosine_are_exact_periods() -> None:
    # The closed form, from the exact remainder of the row in its period of 500 rows.
    rows = np.arange(10**6, 10**6 + 1000)
    angle = 2.0 * np.pi * (rows % 500) / 500.0
    time = rows / 50.0
    assert np.allclose(signals.Sine(1.5, 0.1, offset=0.1).voltage(time), 0.1 + 1.5 * np.sin(angle), rtol=0, atol=1e-11)
    assert np.allclose(signals.Cosine(1.5, 0.1).voltage(time), 1.5 * np.cos(angle), rtol=0, atol=1e-11)
    shifted = signals.Sine(1.5, 0.1, phase=math.pi / 2).voltage(time)
    assert np.allclose(shifted, signals.Cosine(1.5, 0.1).voltage(time), rtol=0, atol=1e-11)


def test_triangle_is_in_phase_with_a_sine() -> None:
    angle = 2.0 * np.pi * 0.13 * ROWS
    ours = signals.Triangle(2.0, 0.13).voltage(ROWS)
    assert np.allclose(ours, 2.0 * scipy.signal.sawtooth(angle + np.pi / 2, 0.5), rtol=0, atol=1e-11)
    # The thesis's own form (appendix A.2) starts at its lowest point.
    theirs = scipy.signal.sawtooth(angle, 0.5)
    assert np.allclose(signals.Triangle(1.0, 0.13, phase=-np.pi / 2).voltage(ROWS), theirs, rtol=0, atol=1e-11)


@pytest.mark.parametrize(("start", "end"), [(0.05, 5.0), (5.0, 0.05), (1.0, 1.001), (0.4, 0.4)])
def test_chirp_sweeps_by_equal_ratios_and_then_stays(start: float, end: float) -> None:
    time = np.arange(4000) / 100.0
    ours = signals.Chirp(1.0, start, end).voltage(time)
    theirs = scipy.signal.chirp(time, start, 40.0, end, method="logarithmic", phi=-90)
    assert np.allclose(ours, theirs, rtol=0, atol=1e-6)
    after = signals.Chirp(1.0, start, end).voltage(np.linspace(40.0, 40.0 + 1.0 / end, 9))
    assert after[0] == pytest.approx(after[-1], abs=1e-9)
    assert after[0] == pytest.approx(theirs[-1], abs=2.1 * np.pi * end / 100.0)


@pytest.mark.parametrize(("harmonics", "numbers"), [("all", range(1, 101)), ("odd", range(1, 100, 2))])
def test_multisine_has_equal_lines_where_it_says_and_its_stated_peak(harmonics: str, numbers: range) -> None:
    signal = signals.Multisine(1.0, 0.05, 5.0, harmonics=harmonics)
    period = signal.voltage(np.arange(40_000) / 2000.0)
    lines = np.abs(np.fft.rfft(period)) * 2.0 / len(period)
    expected = np.zeros_like(lines)
    expected[list(numbers)] = lines[1]
    assert np.allclose(lines, expected, rtol=0, atol=1e-12)
    assert np.abs(period).max() == pytest.approx(1.0, abs=1e-3)
    assert np.abs(period).max() <= 1.0 + 1e-9
    # Schroeder's phases: a crest factor far below that of N sines in phase, sqrt(2 N) > 9.
    assert 1.0 / np.sqrt(np.mean(period**2)) < 2.0
    assert np.allclose(signal.voltage(ROWS + 20.0), signal.voltage(ROWS), rtol=0, atol=1e-9)


def test_multisine_with_random_phases_leaves_out_one_harmonic_of_each_group() -> None:
    """Which ones and which phases hang on the seed alone; the peak stays as stated."""
    signal = signals.Multisine(1.0, 0.05, 5.0, harmonics="odd", phases="random", left_out=4, seed=1)
    period = signal.voltage(np.arange(40_000) / 2000.0)
    lines = np.abs(np.fft.rfft(period)) * 2.0 / len(period)
    there = np.flatnonzero(lines > 0.5 * lines.max())
    assert np.array_equal(there, signal.numbers)
    missing = np.setdiff1d(np.arange(1, 100, 2), there)
    assert [number // 8 for number in missing] == list(range(12))  # 50 odd ones: 12 groups, and two left over
    assert np.abs(period).max() == pytest.approx(1.0, abs=1e-3)
    assert signal == signals.parse(str(signal))
    other = signals.Multisine(1.0, 0.05, 5.0, harmonics="odd", phases="random", left_out=4, seed=2)
    assert not np.array_equal(other.numbers, signal.numbers)
    with pytest.raises(InputError, match="one of each 1 harmonic is left out"):
        signals.Multisine(1.0, 0.05, 5.0, left_out=1)


def test_multisine_of_one_harmonic_is_a_sine() -> None:
    one = signals.Multisine(1.0, 0.1, 0.1).voltage(ROWS)
    assert np.allclose(one, signals.Sine(1.0, 0.1).voltage(ROWS), rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", range(2, 17))
def test_prbs_has_the_greatest_length_of_its_order(order: int) -> None:
    length = 2**order - 1
    bits = signals.Prbs(1.0, 0.25, order=order).voltage(np.arange(2 * length) * 0.25)
    assert set(np.unique(bits)) == {-1.0, 1.0}
    assert np.array_equal(bits[:length], bits[length:])
    # Every window of `order` bits but the one without ones occurs once in a period.
    ones = (bits[: length + order] > 0).astype(int)
    windows = sum(ones[k : k + length] << k for k in range(order))
    assert sorted(windows) == list(range(1, 2**order))
    seeded = signals.Prbs(1.0, 0.25, order=order, seed=5).voltage(np.arange(length) * 0.25)
    assert np.array_equal(seeded, np.roll(bits[:length], -5))


def test_random_levels_are_uniform_and_belong_to_their_time_alone() -> None:
    places = np.arange(20_000)
    levels = signals.Random(2.0, 0.1, seed=SEED).voltage(places * 0.1 + 0.05)
    # NumPy's own doubles from the same counter-based generator.
    expected = 2.0 * (2.0 * np.random.Generator(np.random.Philox(key=SEED)).random(len(places)) - 1.0)
    assert np.allclose(levels, expected, rtol=0, atol=1e-15)
    assert scipy.stats.kstest(levels, scipy.stats.uniform(-2.0, 4.0).cdf).pvalue > 0.01
    for start in (1, 2, 3, 4, 4567, 19_990):
        alone = signals.Random(2.0, 0.1, seed=SEED).voltage(places[start : start + 9] * 0.1)
        assert np.array_equal(alone, levels[start : start + 9])
    assert not np.array_equal(signals.Random(2.0, 0.1, seed=SEED + 1).voltage(places * 0.1), levels)


@pytest.mark.parametrize("signal", EVERY_KIND, ids=lambda signal: type(signal).__name__)
def test_a_voltage_depends_on_its_time_alone(signal: signals.Signal) -> None:
    whole = signal.voltage(ROWS)
    assert whole.shape == ROWS.shape
    assert whole.dtype == np.float64
    blocks = np.concatenate([signal.voltage(block) for block in np.array_split(ROWS, [1, 7, 350, 351, 1200])])
    order = np.random.default_rng(SEED).permutation(len(ROWS))
    assert np.array_equal(blocks, whole)
    assert np.array_equal(signal.voltage(ROWS[order]), whole[order])
    assert signal.voltage(ROWS.reshape(20, 100)).shape == (20, 100)
    assert float(signal.voltage(12.34)) == signal.voltage([12.34])[0]
    assert signal.voltage([]).shape == (0,)
    assert np.array_equal(signal.voltage([-1.0, -0.02]), [0.0, 0.0])


@pytest.mark.parametrize(
    "kind", [signals.Sine, signals.Cosine, signals.Square, signals.Triangle], ids=lambda kind: kind.__name__
)
def test_a_signal_and_its_offset_start_with_its_delay(kind: type[signals.Sine]) -> None:
    at_once = kind(1.0, 0.25, offset=0.5)
    delayed = kind(1.0, 0.25, offset=0.5, delay=3.0)
    assert np.all(delayed.voltage(ROWS[:150]) == 0.0)
    assert np.allclose(delayed.voltage(ROWS[150:]), at_once.voltage(ROWS[:-150]), rtol=0, atol=1e-12)


def test_signals_end_where_they_say() -> None:
    samples = signals.Samples(np.arange(2000) / 50.0, np.ones(2000), delay=1.0)
    assert samples.duration == pytest.approx(41.0)
    assert samples.voltage([0.98, 1.0, 40.98, 41.0]).tolist() == [0.0, 1.0, 1.0, 0.0]
    joined = signals.Sequence((signals.Sine(1.0, 0.1), samples), (20.0,))
    assert joined.duration == pytest.approx(61.0)
    assert joined.voltage([20.5, 60.98, 61.0]).tolist() == [0.0, 1.0, 0.0]
    assert signals.Step(1.0).duration == math.inf


@pytest.mark.parametrize(
    ("text", "reach"),
    [
        ("step 1 V", 0.0),
        ("samples 0 s 1 V 5 s 0 V 20 s 0 V delay=1 s", 21.0),
        ("sine 1 V 1 Hz for 20 s", 20.0),
        ("sine 1 V 1 Hz for 20 s then step 1 V", 20.0),
        ("sine 1 V 1 Hz for 20 s then samples 0 s 1 V 5 s 0 V", 25.0),
        ("sine 1 V 1 Hz for 0.1 s then step 1 V for 0.2 s", 0.3),
    ],
)
def test_a_record_that_would_lose_a_part_of_the_signal_is_refused(text: str, reach: float) -> None:
    signal = signals.parse(text)
    assert signal.reach == pytest.approx(reach, abs=1e-12)
    signal.check_fits(reach)
    if reach:
        with pytest.raises(InputError, match="it reaches to"):
            signal.check_fits(0.999 * reach)


@pytest.mark.parametrize("text", ["step 1 V delay=5 s", "sine 1 V 1 Hz for 3 s then step 1 V delay=2 s"])
def test_a_delay_ends_before_the_record_does(text: str) -> None:
    """A record that ends with it is one of 0 V from there on."""
    signal = signals.parse(text)
    assert signal.reach == 5.0
    signal.check_fits(5.02)
    for short in (5.0, 4.9):
        with pytest.raises(InputError, match=f"it reaches to 5 s, the record to {short:g} s; record longer"):
            signal.check_fits(short)


@pytest.mark.parametrize(
    ("text", "fastest"),
    [
        ("step 1 V", 0.0),
        ("sine 1 V 5 Hz", 5.0),
        ("square 1 V 2 Hz", 2.0),
        ("chirp 1 V 8 Hz 0.1 Hz", 8.0),
        ("multisine 1 V 0.5 Hz 6 Hz", 6.0),
        ("prbs 1 V 0.1 s", 5.0),
        ("random 1 V 0.25 s", 2.0),
        ("step 1 V for 1 s then sine 1 V 3 Hz", 3.0),
        ("samples 0 s 1 V 0.001 s 0 V", 0.0),
    ],
)
def test_a_signal_that_rows_cannot_follow_is_refused(text: str, fastest: float) -> None:
    signal = signals.parse(text)
    assert signal.fastest == pytest.approx(fastest)
    signal.check_fits(40.0, 2.0 * fastest + 1e-9)
    if fastest:
        with pytest.raises(InputError, match=f"give a rate of {2.0 * fastest:g}"):
            signal.check_fits(40.0, 1.9 * fastest)


def test_what_is_asked_too_fast_is_not_simulated_as_something_slower() -> None:
    """Rows at 50 Hz would show the zeros of this sine."""
    with pytest.raises(InputError, match="it goes up to 50 Hz, rows at 50 Hz follow it to 25 Hz"):
        ipmclab.simulate(ipmclab.load_actuator("friend-2"), "sine 1 V 50 Hz", duration=1.0, rate=50.0)


def test_a_chirp_that_its_record_cuts_says_how_far_it_gets() -> None:
    chirp = signals.parse("chirp 1 V 0.05 Hz 5 Hz sweep_time=40 s delay=10 s")
    chirp.check_fits(50.0, 50.0)
    with pytest.raises(InputError, match=r"to 50 s, the record to 30 s: it would get to 0\.5 Hz of 5 Hz; .*=20 s"):
        chirp.check_fits(30.0, 50.0)
    signals.parse("chirp 1 V 0.05 Hz 5 Hz sweep_time=20 s delay=10 s").check_fits(30.0, 50.0)
    signals.parse("chirp 1 V 0.05 Hz 5 Hz for 30 s").check_fits(30.0, 50.0)  # this says itself where it is cut
    with pytest.raises(InputError, match="the record to 50 s"):
        signals.parse("step 0 V for 30 s then chirp 1 V 0.05 Hz 5 Hz").check_fits(50.0, 50.0)


@pytest.mark.parametrize(
    "text", ["sine 1 V 5 Hz", "step 1 V for 1 s then triangle 1 V 5 Hz", "cosine 1 V 5 Hz for 2 s"]
)
def test_rows_at_twice_a_sine_show_only_its_zeros(text: str) -> None:
    """It would be applied as 0 V; a square, and bits as long as a row, are shown as they are."""
    with pytest.raises(InputError, match="only the zeros; give a rate above 10 Hz"):
        signals.parse(text).check_fits(40.0, 10.0)
    signals.parse(text).check_fits(40.0, 10.1)
    for shown in ("square 1 V 5 Hz", "prbs 1 V 0.1 s", "random 1 V 0.1 s", "chirp 1 V 0.1 Hz 5 Hz"):
        signals.parse(shown).check_fits(40.0, 10.0)


def test_a_signal_begins_at_once_and_has_no_offset_unless_it_says_so() -> None:
    for kind in (signals.Sine, signals.Cosine, signals.Square, signals.Triangle):
        assert kind(1.0, 0.1) == kind(1.0, 0.1, phase=0.0, offset=0.0, delay=0.0)
    assert signals.Chirp(1.0, 0.1, 1.0) == signals.Chirp(1.0, 0.1, 1.0, 40.0, phase=0.0, offset=0.0, delay=0.0)
    assert signals.Multisine(1.0, 0.1, 1.0) == signals.Multisine(1.0, 0.1, 1.0, "all", 0.0, 0.0, "schroeder", 0, 0)
    assert signals.Prbs(1.0) == signals.Prbs(1.0, 0.1, order=10, seed=0, offset=0.0, delay=0.0)
    assert signals.Random(1.0) == signals.Random(1.0, 0.1, seed=0, offset=0.0, delay=0.0)
    assert signals.Step(1.0) == signals.Step(1.0, delay=0.0)
    assert signals.Samples([0, 1], [1, 2], path="a.csv") == signals.Samples([0, 1], [1, 2], 0.0, "a.csv", 1.0)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (signals.Prbs, {"order": 3}),
        (signals.Random, {}),
        (signals.Chirp, {"start_frequency": 0.5, "end_frequency": 1.0}),
    ],
)
def test_amplitude_and_offset_are_volts(kind: type[signals.Signal], words: dict[str, float]) -> None:
    """Twice the amplitude is twice the voltage, and an offset is added to it."""
    plain = kind(amplitude=1.0, **words).voltage(ROWS)  # type: ignore[call-arg]
    moved = kind(amplitude=2.0, offset=0.25, **words).voltage(ROWS)  # type: ignore[call-arg]
    assert np.allclose(moved, 2.0 * plain + 0.25, rtol=0, atol=1e-12)


def test_a_phase_moves_a_chirp_from_its_start() -> None:
    quarter = signals.Chirp(1.0, 0.5, 0.5, phase=math.pi / 2).voltage(ROWS)
    assert np.allclose(quarter, signals.Cosine(1.0, 0.5).voltage(ROWS), rtol=0, atol=1e-9)


def test_what_may_be_given_at_most_and_at_least() -> None:
    """The ends of a range belong to it."""
    for time in (1e-9, 1e9):
        assert signals.Prbs(1.0, time).bit_time == time
    assert signals.Step(1.0, delay=0.0).delay == 0.0
    assert [signals.Prbs(1.0, 1.0, order=order).order for order in (2, 16)] == [2, 16]
    assert [signals.Random(1.0, 1.0, seed=seed).seed for seed in (0, 2**32 - 1)] == [0, 2**32 - 1]
    assert [signals.Multisine(1.0, 1.0, 5.0, left_out=gaps).left_out for gaps in (0, 2, 100)] == [0, 2, 100]
    assert signals.Random(1.0, 1.0, seed="3.0").seed == 3  # type: ignore[arg-type]
    for wrong in (
        lambda: signals.Prbs(1.0, 1.0, order=1),
        lambda: signals.Random(1.0, 1.0, seed=-1),
        lambda: signals.Random(1.0, 1.0, seed=2**32),
        lambda: signals.Multisine(1.0, 1.0, 5.0, left_out=101),
        lambda: signals.Multisine(1.0, 1.0, 10_001.0),
        lambda: signals.Sine(1.0, 1.9e-9 / 2),
        lambda: signals.Sine(1.0, 1.1e9),
    ):
        with pytest.raises(InputError):
            wrong()
    assert signals.Multisine(1.0, 1.0, 10_000.0).highest_frequency == 10_000.0


def test_samples_of_a_file_may_be_multiplied() -> None:
    assert signals.Samples([0, 1], [1, 3], path="a.csv", gain=2).values.tolist() == [2.0, 6.0]
    written_out = signals.Samples([0, 1], [1, 3], gain=2)
    assert (written_out.values.tolist(), written_out.gain) == ([2.0, 6.0], 1.0)
    assert signals.Samples([0, 1], [1, 3], delay=1.0).reversed() == signals.Samples([0, 1], [-1, -3], delay=1.0)


def test_before_the_first_sample_there_is_no_voltage() -> None:
    late = signals.Samples([2.0, 3.0], [1.0, 0.5])
    assert late.voltage([0.0, 1.99, 2.0, 3.0, 3.99, 4.0]).tolist() == [0.0, 0.0, 1.0, 0.5, 0.5, 0.0]


def test_a_long_text_of_a_signal_is_cut_for_people() -> None:
    assert shortened("a" * 100) == "a" * 100
    assert shortened("a" * 101) == "a" * 97 + "..."


def test_equal_values_make_equal_signals() -> None:
    assert signals.Step(1) == signals.Step(amplitude=1.0)
    assert signals.Samples([0, 1], [0, 1]) == signals.Samples([0.0, 1.0], [0.0, 1.0])
    assert hash(signals.Samples([0, 1], [0, 1])) == hash(signals.Samples([0.0, 1.0], [0.0, 1.0]))
    assert signals.Samples([0, 1], [0, 1]) != signals.Samples([0, 1], [0, 2])
    assert signals.Samples([0, 1], [0, 1]) != "samples"
    assert repr(signals.Samples([0, 1], [0, 1], path="a.csv")) == "<Samples: 2 to 1 s, a.csv>"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: signals.Step(float("nan")), "amplitude: the amplitude is nan V; give a finite number"),
        (lambda: signals.Step("1 V"), "amplitude: the amplitude is '1 V'; give a finite number"),  # type: ignore[arg-type]
        (
            lambda: signals.Sine(1.0, 0.0),
            "frequency: the frequency is 0 Hz, it must be above 0; give for example 0.1 Hz",
        ),
        (lambda: signals.Prbs(1.0, -1.0), "bit_time: the bit time is -1 s, it must be above 0; give for example 0.5 s"),
        (lambda: signals.Prbs(1.0, 1e-12), "bit_time: the bit time is 1e-12 s, outside 1e-09 to 1e+09 s; give for"),
        (lambda: signals.Sine(1.0, 1e307), "frequency: the frequency is 1e+307 Hz, outside 1e-09 to 1e+09 Hz; give"),
        (
            lambda: signals.Random(1.0, 1e-9).voltage([0.0, 40.0]),
            "hold_time: from 0 s to 40 s there are more than 50000000 levels of 1e-09 s each; hold each level longer",
        ),
        (lambda: signals.Prbs(1.0, 1.0, order=17), "order: the order is 17; give a whole number from 2 to 16"),
        (lambda: signals.Random(1.0, 1.0, seed=0.5), "seed: the seed is 0.5; give a whole number"),  # type: ignore[arg-type]
        (lambda: signals.Step(1.0, delay=-2.0), "delay: the delay is -2 s, before row 0"),
        (lambda: signals.Multisine(1.0, 1.0, 0.5), "the highest frequency, 0.5 Hz, is 0.5 times the lowest, 1 Hz"),
        (
            lambda: signals.Samples([0.0, 1.0], [1.0, 2.0, 3.0]),
            "voltage: there are 3 voltages and 2 times; give one voltage for each",
        ),
        (
            lambda: signals.Samples([0.0, 1.0], np.ma.array([1, 2], mask=[False, True])),
            "voltage: sample 1 is nan; every sample needs a number",
        ),
        (lambda: signals.Samples([0.0], [1.0]), "time: this is not a column of two or more numbers: [0.0]"),
        (lambda: signals.Samples([0.0, 1.0], [1.0, math.nan]), "voltage: sample 1 is nan"),
        (lambda: signals.Samples([0.0, 2.0, 1.0], [1, 1, 1]), "time: sample 2 is at 1 s, not after 2 s"),
        (lambda: signals.Samples([-1.0, 2.0], [1, 1]), "time: sample 0 is at -1 s, before row 0"),
        (lambda: signals.Sequence((signals.Step(1.0), signals.Step(2.0)), ()), "durations: 0 durations for 2 signals"),
        (lambda: signals.Sequence((), ()), "signals: a sequence is made of one or more signals"),
        (
            lambda: signals.Sequence((signals.Sequence((signals.Step(1.0),), (1.0,)), signals.Step(1.0)), (1.0,)),
            "that are no sequences themselves",
        ),
        (lambda: signals.Sequence(("step 1 V",), (1.0,)), "signals: a sequence is made of one or more signals"),  # type: ignore[arg-type]
        (lambda: signals.Sequence((signals.Step(1.0),), (1.0, 2.0)), "durations: 2 durations for 1 signals"),
        (lambda: signals.Sequence((signals.Step(1.0),), (0.0,)), "durations[0]: the duration is 0 s"),
        (
            lambda: signals.Sequence((signals.Step(1.0), signals.Step(1.0, delay=2.0)), (1.0, 2.0)),
            "signals[1]: the part lasts 2 s and begins to act at 2 s: it would be 0 V throughout; give a delay below 2",
        ),
        (
            lambda: signals.Sequence((signals.Samples([1.0, 2.0], [1.0, 1.0], delay=2.0),), (3.0,)),
            "signals[0]: the part lasts 3 s and begins to act at 3 s",
        ),
    ],
)
def test_wrong_values_are_refused_by_name(make: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        make()  # type: ignore[operator]
    assert message in str(caught.value)


def test_importing_signals_loads_nothing_heavier_than_numpy() -> None:
    heavy = "{'scipy', 'numba', 'xarray', 'h5netcdf', 'matplotlib', 'pydantic'}"
    code = f"import sys, ipmclab.signals; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
