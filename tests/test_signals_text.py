"""Signals from text: everything reads back, and every error points at the word that is wrong."""

from __future__ import annotations

import contextlib
import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import Run, signals, write_run
from ipmclab.errors import InputError

volts = st.floats(-1e3, 1e3)
positive = st.floats(1e-6, 1e6)
delays = st.floats(0.0, 1e6)
seeds = st.integers(0, 2**32 - 1)
phases = st.floats(-10.0, 10.0)
periodic = {"amplitude": volts, "frequency": positive, "phase": phases, "offset": volts, "delay": delays}


@st.composite
def multisines(draw: st.DrawFn) -> signals.Multisine:
    lowest = draw(st.floats(1e-3, 1.0))
    highest = lowest * draw(st.floats(1.0, 100.0))
    harmonics = draw(st.sampled_from(["all", "odd"]))
    kind = draw(st.sampled_from(["schroeder", "random"]))
    gaps = draw(st.sampled_from([0, 2, 4]))
    return signals.Multisine(
        draw(volts), lowest, highest, harmonics, draw(volts), draw(delays), kind, draw(seeds), gaps
    )


@st.composite
def samples(draw: st.DrawFn) -> signals.Samples:
    steps = draw(st.lists(st.floats(1e-6, 1e3), min_size=2, max_size=20))
    return signals.Samples(np.cumsum(steps), [draw(volts) for _ in steps], delay=draw(delays))


single_signals = st.one_of(
    st.builds(signals.Step, amplitude=volts, delay=delays),
    *(st.builds(kind, **periodic) for kind in (signals.Sine, signals.Cosine, signals.Square, signals.Triangle)),
    st.builds(
        signals.Chirp,
        amplitude=volts,
        start_frequency=positive,
        end_frequency=positive,
        sweep_time=positive,
        phase=st.floats(-10.0, 10.0),
        offset=volts,
        delay=delays,
    ),
    multisines(),
    st.builds(signals.Prbs, amplitude=volts, bit_time=positive, order=st.integers(2, 16), seed=seeds, delay=delays),
    st.builds(signals.Random, amplitude=volts, hold_time=positive, seed=seeds, offset=volts),
    samples(),
)


@st.composite
def sequences(draw: st.DrawFn) -> signals.Sequence:
    parts = draw(st.lists(single_signals, min_size=1, max_size=4))
    count = len(parts) - (draw(st.booleans()) and len(parts) > 1)
    return signals.Sequence(tuple(parts), tuple(one.start + draw(positive) for one in parts[:count]))


@given(st.one_of(single_signals, sequences()))
def test_text_reads_back_to_an_equal_signal(signal: signals.Signal) -> None:
    again = signals.parse(str(signal))
    assert again == signal
    assert type(again) is type(signal)


@given(
    st.text(max_size=60)
    | st.lists(st.sampled_from(["sine", "step", "samples", "1", "V", "0.1", "Hz", "for", "then", "phase=", "s"])).map(
        " ".join
    )
)
def test_any_other_text_is_refused_with_a_message(text: str) -> None:
    try:
        signal = signals.parse(text)
    except InputError as error:
        refusal = error
    else:
        assert signals.parse(str(signal)) == signal
        return
    assert repr(text) in refusal.where
    assert refusal.code
    assert refusal.message
    assert refusal.repair


@pytest.mark.parametrize(
    ("text", "signal"),
    [
        ("step 1 V", signals.Step(1.0)),
        ("dc -500 mV", signals.Step(-0.5)),
        ("sine 1 V 0.1 Hz", signals.Sine(1.0, 0.1)),
        ("sine 1V 100mHz", signals.Sine(1.0, 0.1)),
        ("sine 1 V 0.1 1/s", signals.Sine(1.0, 0.1)),
        ("  sine 1 V  0.1 Hz\tphase = 90 deg  ", signals.Sine(1.0, 0.1, phase=math.pi / 2)),
        (
            "cosine 1 V 0.1 Hz delay=1 s phase=1 rad offset=0.2 V",
            signals.Cosine(1.0, 0.1, phase=1.0, offset=0.2, delay=1.0),
        ),
        ("chirp 1 V 0.05 Hz 5 Hz sweep_time=2 min", signals.Chirp(1.0, 0.05, 5.0, sweep_time=120.0)),
        ("multisine 1 V 0.05 Hz 5 Hz harmonics=odd", signals.Multisine(1.0, 0.05, 5.0, "odd")),
        ("prbs 1 V 0.5 s order=7 seed=3", signals.Prbs(1.0, 0.5, order=7, seed=3)),
        ("random 1 V", signals.Random(1.0)),
        ("random 1 V hold_time=0.5 s", signals.Random(1.0, 0.5)),
        ("prbs 1 V seed=4 for 5 s", signals.Sequence((signals.Prbs(1.0, seed=4),), (5.0,))),
        ("random 1 V 100 ms seed=3", signals.Random(1.0, 0.1, seed=3)),
        ("samples 0 s 1 V 20 ms -1 V delay=1 s", signals.Samples([0.0, 0.02], [1.0, -1.0], delay=1.0)),
        ("step 1 V for 1 min", signals.Sequence((signals.Step(1.0),), (60.0,))),
        (
            "sine 1 V 0.1 Hz for 20 s then step 0.5 V for 5 s then square 1 V 1 Hz delay=2 s",
            signals.Sequence(
                (signals.Sine(1.0, 0.1), signals.Step(0.5), signals.Square(1.0, 1.0, delay=2.0)), (20.0, 5.0)
            ),
        ),
    ],
)
def test_the_documented_forms(text: str, signal: signals.Signal) -> None:
    assert signals.parse(text) == signal


@pytest.mark.parametrize(
    ("text", "at", "says"),
    [
        ("sien 1 V 0.1 Hz", "at 'sien' (character 1)", "unknown waveform 'sien'; did you mean 'sine'?"),
        ("1 V", "at '1' (character 1)", "unknown waveform '1'; known: 'step', 'dc', 'sine'"),
        ("", "at its end", "a waveform is missing; write for example 'step 1 V'"),
        ("sine 1 Hz 0.1 Hz", "at '1 Hz' (character 6)", "'1 Hz' is not a voltage"),
        ("sine 1 V 0.1 V", "at '0.1 V' (character 10)", "'0.1 V' is not a frequency"),
        ("sine 1 0.1 Hz", "at '1' (character 6)", "'1' has no unit; write for example '1 V'"),
        ("step 1 volt", "at '1 volt' (character 6)", "the unit 'volt' is not one of V, mV, uV"),
        (
            "sine 1 V",
            "at '1 V' (character 6)",
            "the frequency of 'sine' is missing; write for example 'sine 1 V 0.1 Hz'",
        ),
        ("sine 1 V delay=2 s", "at 'delay=' (character 10)", "the frequency of 'sine' is missing"),
        ("step", "at 'step' (character 1)", "the amplitude of 'step' is missing"),
        (
            "step 1 V delay=5 s for 3 s then step 1 V",
            "at 'for 3 s' (character 20)",
            "the part lasts 3 s and begins to act at 5 s: it would be 0 V throughout; give a delay below 3 s",
        ),
        ("chirp 1 V 0.05 Hz", "at '0.05 Hz' (character 11)", "the end frequency of 'chirp' is missing"),
        ("sine 1,5 V 0.1 Hz", "at '1,5 V' (character 6)", "'1,5 V' has a comma; write a decimal point"),
        ("sine 1 V -0.1 Hz", "at '-0.1 Hz' (character 10)", "the frequency is -0.1 Hz, it must be above 0"),
        ("sine 1 V 0 Hz", "at '0 Hz' (character 10)", "the frequency is 0 Hz, it must be above 0"),
        ("step nan V", "at 'nan V' (character 6)", "'nan V' is not a finite number; write for example '1 V'"),
        ("step inf V", "at 'inf V' (character 6)", "'inf V' is not a finite number"),
        ("step 1e999 V", "at '1e999 V' (character 6)", "'1e999 V' is too large for a number"),
        ("step V", "at 'V' (character 6)", "'V' is not a number with a unit; write for example '1 V'"),
        ("step 1 V phase=90 deg", "at 'phase=' (character 10)", "'step' has no option 'phase'; known: 'amplitude'"),
        ("sine 1 V 0.1 Hz fase=90 deg", "at 'fase=' (character 17)", "did you mean 'phase'?"),
        ("sine 1 V 0.1 Hz phase=90", "at 'phase=90' (character 17)", "'90' has no unit; write for example '90 deg'"),
        ("sine 1 V 0.1 Hz phase=", "at its end", "the phase is missing; write for example '90 deg'"),
        ("sine 1 V 0.1 Hz phase 90 deg", "at 'phase' (character 17)", "unexpected 'phase'; write 'phase=...'"),
        ("step 1 V delay=1 s delay=2 s", "at 'delay=' (character 20)", "'delay' is given twice"),
        ("step 1 V delay=-1 s", "at 'delay=-1 s' (character 10)", "the delay is -1 s, before row 0; give 0 s or more"),
        ("step 1 V hello", "at 'hello' (character 10)", "unexpected 'hello'; known: 'for', 'then', 'delay='"),
        ("step 1 V fro 2 s", "at 'fro' (character 10)", "unexpected 'fro'; did you mean 'for'?"),
        ("step 1 V then step 2 V", "at 'then' (character 10)", "how long does the signal before 'then' last?"),
        ("step 1 V for 2 s then", "at its end", "a waveform is missing"),
        ("step 1 V for", "at its end", "the duration is missing; write for example '0.5 s'"),
        ("step 1 V for 0 s", "at '0 s' (character 14)", "the duration is 0 s, it must be above 0"),
        ("step 1 V for 1 s then sine 1 V 0,1 Hz", "at '0,1 Hz' (character 32)", "has a comma"),
        ("prbs 1 V 2 Hz", "at '2 Hz' (character 10)", "'2 Hz' is not a time"),
        ("prbs 1 V 1 s order=40", "at 'order=40' (character 14)", "the order is 40; give a whole number from 2 to 16"),
        ("random 1 V 1 s seed=1.5", "at 'seed=1.5' (character 16)", "the seed is 1.5; give a whole number"),
        ("multisine 1 V 1 Hz 5 Hz harmonics=even", "at 'harmonics=even' (character 25)", "known: 'all', 'odd'"),
        ("multisine 1 V 5 Hz 1 Hz", "at '1 Hz' (character 20)", "the highest frequency, 1 Hz, is 0.2 times the lowest"),
        ("samples 0 s 1 V 0 s 2 V", "at 'samples 0 s 1 V 0 s 2 V' (character 1)", "sample 1 is at 0 s, not after 0 s"),
        ("samples 0 s", "at its end", "the voltage is missing"),
        ("samples 0 s 1 V 1 s 1 V delay 1 s", "at 'delay' (character 25)", "'delay' is not a number"),
        ("file", "at its end", "the path of the file is missing"),
        (f"file {'a' * 300}", f"at '{'a' * 300}' (character 6), {'a' * 300}", "there is no such file; check the path"),
        ("file nowhere.csv", "at 'nowhere.csv' (character 6), nowhere.csv", "there is no such file"),
        ("file aa", "at 'aa' (character 6), aa", "there is no such file"),
        ("file 'aa", "at \"'aa\" (character 6), 'aa", "there is no such file"),
        ("file '", "at \"'\" (character 6), '", "there is no such file"),
    ],
)
def test_errors_point_at_the_words_that_are_wrong(text: str, at: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        signals.parse(text)
    assert caught.value.where == f"signal {text!r}, {at}"
    assert says in str(caught.value)


def test_what_is_not_a_text_is_refused() -> None:
    with pytest.raises(InputError, match="text: this is an int, not a text"):
        signals.parse(5)  # type: ignore[arg-type]


@given(values=st.lists(st.tuples(st.floats(1e-3, 10.0), volts), min_size=2, max_size=30), semicolon=st.booleans())
def test_a_csv_file_reads_back(tmp_path: Path, values: list[tuple[float, float]], semicolon: bool) -> None:
    time = np.cumsum([step for step, _ in values])
    voltage = np.array([value for _, value in values])
    path = tmp_path / "my signal.csv"
    with path.open("w", newline="") as file:
        csv.writer(file, delimiter=";" if semicolon else ",").writerows(
            zip(time.tolist(), voltage.tolist(), strict=True)
        )
    signal = signals.parse(f"file '{path}' delay=1 s for 15 s").signals[0]  # type: ignore[attr-defined]
    assert np.array_equal(signal.times, time)
    assert np.array_equal(signal.values, voltage)
    assert signals.parse(str(signal)) == signal


def test_a_heading_names_columns_and_units(tmp_path: Path) -> None:
    path = tmp_path / "signal.csv"
    path.write_text("# by hand\nVoltage [mV]\tcurrent (mA)\ttime (ms)\n\n500\t3\t0\n-500\t\t20\n", encoding="utf-8-sig")
    signal = signals.parse(f"file {path}")
    assert signal == signals.Samples([0.0, 0.02], [0.5, -0.5], path=str(path))
    assert signals.parse(f"file {path.name}", folder=path.parent) == signal
    assert isinstance(signal, signals.Samples)
    other = signal.reversed()
    assert other.values.tolist() == [-0.5, 0.5]
    assert str(other) == f"{signal} gain=-1"
    assert signals.parse(str(other)) == other
    assert other.reversed() == signal
    assert signals.parse(f"{signal} gain=-0.5 delay=1 s").voltage([1.0, 1.02]).tolist() == [-0.25, 0.25]
    assert str(signal) == f"file {path}"
    with pytest.raises(InputError, match="before row 0") as caught:
        signals.parse(f"{signal} delay=-1 s")
    assert caught.value.where == f"signal '{signal} delay=-1 s', at 'delay=-1 s' (character {len(str(signal)) + 2})"


@pytest.mark.parametrize(
    "name", ["my\N{NO-BREAK SPACE}file.csv", "a=b.csv", "a b.csv", "it's.csv", 'a"b.csv', "then", "for"]
)
def test_every_path_reads_back(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("0,1\n1,2\n", encoding="utf-8")
    signal = signals.Samples([0.0, 1.0], [1.0, 2.0], path=str(path))
    assert signals.parse(str(signal)) == signal


def test_a_heading_may_have_a_number_among_its_names(tmp_path: Path) -> None:
    path = tmp_path / "signal.csv"
    path.write_text("1,voltage,time\n7,1,0\n7,2,1\n", encoding="utf-8")
    assert signals.parse(f"file {path}").values.tolist() == [1.0, 2.0]  # type: ignore[attr-defined]


def test_blank_cells_at_the_end_of_a_line_are_no_columns(tmp_path: Path) -> None:
    path = tmp_path / "signal.csv"
    path.write_text("time;voltage\n0;1;\n1;2; ;\n", encoding="utf-8")
    assert signals.parse(f"file {path}").values.tolist() == [1.0, 2.0]  # type: ignore[attr-defined]


def test_a_run_gives_its_voltage(tmp_path: Path) -> None:
    import h5netcdf

    path = tmp_path / "run.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"time": 3}
        for name, values in {"time": [0.0, 0.02, 0.04], "voltage": [0.0, 1.0, -1.0]}.items():
            file.create_variable(name, ("time",), data=np.array(values))
    assert signals.parse(f"file {path}") == signals.Samples([0.0, 0.02, 0.04], [0.0, 1.0, -1.0], path=str(path))


@given(data=st.data())
def test_no_damage_of_a_run_gives_a_traceback(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory, capfd: pytest.CaptureFixture[str]
) -> None:
    whole, path = (tmp_path_factory.getbasetemp() / f"{name}.nc" for name in ("whole_signal", "damaged_signal"))
    if not whole.exists():
        write_run(Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[0.0, 1.0, 1.0]), whole)
    content = bytearray(whole.read_bytes())
    del content[data.draw(st.just(len(content)) | st.integers(0, len(content))) :]
    for _ in range(data.draw(st.integers(0, 3)) if content else 0):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with contextlib.suppress(InputError):
        signals.parse(f"file {path}")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.csv", b"", "the file is empty"),
        ("a.csv", b"0,1\n0.02,x\n", "line 2, voltage: 'x V' is not a number with a unit"),
        ("a.csv", b"0;0,5\n1;0,5\n", "line 1, voltage: '0,5 V' has a comma"),
        ("a.csv", b"0,0,1,0\n", "4 columns without a heading"),
        ("a.csv", b"time,volts\n0,1\n", "no column is called 'voltage'"),
        ("a.csv", b"time (V),voltage\n0,1\n", "'0 V' is not a time"),
        ("a.csv", b"time,voltage\n0,1\n", "not a column of two or more numbers"),
        ("a.csv", b"time,voltage\n0,1\n1,nan\n", "line 3, voltage"),
        ("a.csv", b"time,voltage,time\n0,1,0\n", "two columns are called 'time'"),
        ("a.csv", b"0,1\n1,1\n1,2\n", "sample 2 is at 1 s, not after 1 s"),
        ("a.csv", b"0,1\n1\n", "line 2, voltage"),
        ("a.csv", b"0,1\n1,5,2\n", "line 2: 3 cells, the first line has 2; write numbers with a decimal point"),
        ("a.csv", b"time,voltage\n0,1\n\n1,5,2\n", "line 4: 3 cells, the first line has 2"),
        ("a.csv", b'0,1\n1,"2\n', "line 2: it cannot be read as cells: unexpected end of data"),
        ("a.csv", b"0,1\n1," + b"1" * 200_000 + b"\n", "line 2: it cannot be read as cells: field larger than"),
        ("a.csv", b"\xff\xfe\x00", "cannot be read as text: 'utf-8' codec"),
        ("a.nc", b"CDF", "this is no run with a time and a voltage"),
    ],
)
def test_a_file_that_is_no_signal_is_refused(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        signals.parse(f"file {path}")
    assert str(path) in caught.value.where
    assert says in str(caught.value)
