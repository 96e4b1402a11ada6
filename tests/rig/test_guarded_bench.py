"""The layer between whoever asks for voltages and the strip: what it refuses, clamps, watches and hands on."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import InputError, IpmclabError, signals
from ipmclab.rig.bench import Bench, BenchError, Block
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.rows import RowSource, SignalRows
from ipmclab.rig.safety.guard import Alarm
from ipmclab.rig.safety.guarded_bench import GuardedBench, LimitPassed
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from ipmclab.rig.virtual import VirtualBench
from ipmclab.signals import Signal
from tests.rig.scripted import ELECTRODES, NOTHING, Scripted

RATE = 50.0
TO_2_V = replace(NOTHING, voltage=Limit(2.0, 0.02))


class Played(Scripted):
    """A bench that keeps the rows it was handed, without looking at them."""

    def __init__(self, low: float = -10.0, high: float = 10.0) -> None:
        super().__init__(replace(THESIS_RIG, output=replace(THESIS_RIG.output, low=low, high=high)), {})
        self.rows: RowSource | None = None

    def open(self, measured: Collection[str], rate: float) -> None:
        self.rate = rate

    def apply(self, source: RowSource) -> Iterator[Block]:
        self.rows = source
        return iter(())

    def played(self) -> list[float]:
        """What it would give out."""
        assert self.rows is not None
        return self.rows.voltages(0, self.rows.length or 0, self.rate).tolist()


class Wild:
    """Voltages that nobody knows beforehand."""

    length = 4

    def voltages(self, first_row: int, count: int, rate: float) -> npt.NDArray[np.float64]:
        return np.array([35.0, -35.0, np.nan, 0.5])[first_row : first_row + count]

    def look(self, first_row: int, readings: object) -> None: ...


class Counted(Signal):
    """A signal that knows how often its voltages were looked at."""

    def __init__(self, signal: Signal) -> None:
        object.__setattr__(self, "signal", signal)
        object.__setattr__(self, "looks", 0)

    def voltage(self, time: npt.ArrayLike) -> npt.NDArray[np.float64]:
        object.__setattr__(self, "looks", self.looks + 1)  # type: ignore[attr-defined]
        return self.signal.voltage(time)  # type: ignore[attr-defined]

    def _shape(self, time: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return time


def opened(bench: Scripted, limits: Limits, rate: float = RATE) -> GuardedBench:
    guarded = GuardedBench(bench, limits)  # type: ignore[arg-type]
    guarded.open(list(bench.readings), rate)
    return guarded


@pytest.mark.parametrize(
    ("low", "high", "given"),
    [
        (-10.0, 10.0, [2.0, -2.0, 0.0, 0.5]),
        (-1.0, 10.0, [2.0, -1.0, 0.0, 0.5]),
        (-10.0, 1.5, [1.5, -2.0, 0.0, 0.5]),
    ],
)
def test_voltages_are_clamped_to_the_strip_and_to_the_output(low: float, high: float, given: list[float]) -> None:
    bench = Played(low, high)
    guarded = opened(bench, TO_2_V)
    guarded.apply(Wild())
    assert bench.played() == given
    guarded.apply(Wild(), more=2)
    assert bench.played() == [*given, 0.0, 0.0]


PLAYED = [
    ("step 2 V", 10, -10.0, 10.0, None),  # at the limit
    ("step -2.01 V", 10, -10.0, 10.0, "signal: it commands -2.01 V at 0 s, the limit is 2 V"),
    ("step 35 V", 10, -10.0, 10.0, "signal: it commands 35 V at 0 s, the limit is 2 V"),  # not what the output gives
    ("step -1.5 V", 10, -1.0, 10.0, "signal: the signal needs -1.5 V at 0 s, the output gives -1 V to 10 V"),
    ("step 1.5 V", 10, -10.0, 1.0, "signal: the signal needs 1.5 V at 0 s, the output gives -10 V to 1 V"),
    # What follows the last row is not given out, and is no reason to refuse.
    ("step 1 V for 2 s then step 3 V", 100, -10.0, 10.0, None),
    ("step 1 V for 2 s then step 3 V", 101, -10.0, 10.0, "signal: it commands 3 V at 2 s, the limit is 2 V"),
]


@pytest.mark.parametrize(("text", "rows", "low", "high", "message"), PLAYED)
@pytest.mark.parametrize("before", [True, False])
def test_a_signal_beyond_the_strip_or_the_output_is_refused_before_anything_moves(
    before: bool, text: str, rows: int, low: float, high: float, message: str | None
) -> None:
    bench = Played(low, high)
    guarded = opened(bench, TO_2_V)
    signal = signals.parse(text)

    def ask() -> None:
        if before:
            guarded.check(SignalRows(signal, rows), RATE)
        else:
            guarded.apply(signal, rows)

    if message is None:
        ask()
        guarded.apply(signal, rows)
        assert bench.played() == signal.voltage(np.arange(rows) / RATE).tolist()
        return
    with pytest.raises(InputError) as refused:
        ask()
    assert str(refused.value).startswith(message)
    assert bench.rows is None


def test_a_signal_that_was_checked_is_not_looked_at_again_and_any_other_is() -> None:
    """Hours of a signal take seconds to look at: not between the guardian's arming and the first row."""
    bench = Played()
    guarded = GuardedBench(bench, TO_2_V)  # type: ignore[arg-type]
    signal = Counted(signals.parse("step 1 V for 2 s then step 3 V"))
    checked = SignalRows(signal, 100)
    guarded.check(checked, RATE)
    looks = signal.looks  # type: ignore[attr-defined]
    assert looks
    guarded.open([], RATE)
    guarded.apply(signals.Step(0.0), 10)  # what is read at rest
    guarded.apply(checked)
    assert signal.looks == looks  # type: ignore[attr-defined]
    # Another source, and the same one at a rate at which its rows last for longer, may be beyond the limit.
    for rate, source in ((RATE, SignalRows(signals.Step(3.0), 100)), (25.0, checked)):
        guarded.open([], rate)
        with pytest.raises(InputError, match="it commands 3 V"):
            guarded.apply(source)


@pytest.mark.parametrize(("low", "high", "looks"), [(-10.0, 10.0, 1), (-2.0, 2.0, 1), (-1.9, 10.0, 2), (-10.0, 1.9, 2)])
def test_a_signal_is_looked_at_again_only_where_the_output_gives_less_than_the_strip_stands(
    low: float, high: float, looks: int
) -> None:
    signal = Counted(signals.Step(1.0))
    opened(Played(low, high), TO_2_V).check(SignalRows(signal, 10), RATE)
    assert signal.looks == looks  # type: ignore[attr-defined]


def test_a_bench_that_is_not_open_says_so() -> None:
    bench = Played()
    guarded = GuardedBench(bench, NOTHING)  # type: ignore[arg-type]
    for ask in (
        lambda: guarded.apply(signals.Step(1.0), 10),
        lambda: guarded.exchange(1.0),
        lambda: guarded.subtract({"voltage": 0.0}),
    ):
        with pytest.raises(InputError, match="bench: the bench is not open; call open first"):
            ask()
    assert (bench.rows, bench.output) == (None, [])
    # The output can be brought to 0 V at any time.
    guarded.zero()
    assert bench.output == [0.0]


def test_a_strip_behind_a_bench_is_let_go_of_and_told_as_by_the_bench() -> None:
    bench: Bench = VirtualBench()
    guarded = GuardedBench(bench, Limits())
    assert (guarded.origin, guarded.description, guarded.sample) == (bench.origin, bench.description, bench.sample)
    guarded.open(["displacement"], RATE)
    assert list(guarded.exchange(0.5)) == ["displacement", "voltage", "current"]  # most limits need these two
    assert len(np.concatenate([block.output for block in guarded.apply(signals.Step(1.0), 7)])) == 7
    guarded.close()
    with pytest.raises(InputError, match="the bench is not open"):
        guarded.exchange(0.5)


@pytest.mark.parametrize("voltage", [2.0, -2.0, np.nextafter(2.0, 3.0), np.nextafter(-2.0, -3.0), np.nan, np.inf])
def test_a_single_voltage_beyond_the_limit_is_not_given_out(voltage: float) -> None:
    bench = Scripted(ELECTRODES, {"voltage": np.zeros(1)})
    guarded = opened(bench, TO_2_V)
    if abs(voltage) == 2.0:
        guarded.exchange(voltage)
        assert bench.output == [voltage]
        return
    with pytest.raises(InputError, match=r"voltage: .* V is asked for, the limit of the strip is 2 V"):
        guarded.exchange(voltage)
    assert bench.output == []


def test_a_limit_that_was_passed_says_what_to_do() -> None:
    guarded = opened(
        Scripted(ELECTRODES, {"voltage": np.zeros(1), "current": np.full(1, 0.2)}), replace(NOTHING, current=Limit(0.1))
    )
    with pytest.raises(LimitPassed) as passed:
        guarded.exchange(0.5)
    assert passed.value.as_dict() == {
        "code": "limit-passed",
        "message": "the current is 200 mA, beyond its limit of 100 mA",
        "where": "current",
        "repair": "let the strip rest, then open the bench again and ask for less",
    }


def test_single_rows_that_were_missed_count_as_the_larger_of_their_neighbours() -> None:
    bench = Scripted(ELECTRODES, {"voltage": np.full(4, 2.0), "current": np.array([0.05, 0.05, 0.1, 0.1])})
    guarded = GuardedBench(bench, replace(NOTHING, charge=Limit(0.99)))  # type: ignore[arg-type]
    guarded.open(["voltage", "current"], 50.0)
    guarded.exchange(0.5)
    guarded.exchange(0.5)
    # 10 s are missed before a current of 0.1 A: 1 C.
    with pytest.raises(LimitPassed) as passed:
        guarded.exchange(0.5, row=502)
    assert (passed.value.alarm.limit, passed.value.alarm.row) == ("charge", 502)
    assert bench.output[-1] == 0.0


def test_a_clock_that_goes_back_ends_single_rows_at_0_v() -> None:
    bench = Scripted(ELECTRODES, {"voltage": np.zeros(4)})
    guarded = GuardedBench(bench, NOTHING)  # type: ignore[arg-type]
    guarded.open(["voltage"], 50.0)
    guarded.exchange(0.5, row=10)
    with pytest.raises(IpmclabError, match="a block begins at row 5, row 11 was expected"):
        guarded.exchange(0.5, row=5)
    assert bench.output == [0.5, 0.5, 0.0]


def test_what_is_read_at_rest_is_subtracted_from_single_rows() -> None:
    bench = Scripted(ELECTRODES, {"voltage": np.zeros(9), "displacement": np.full(9, 0.011)})
    guarded = GuardedBench(bench, replace(NOTHING, displacement=Limit(10e-3)))  # type: ignore[arg-type]
    guarded.open(["voltage", "displacement"], 50.0)
    guarded.subtract({"displacement": 5e-3})
    guarded.exchange(0.5)
    guarded.subtract({"displacement": -5e-3})
    with pytest.raises(LimitPassed, match="the displacement is 16 mm, beyond its limit of 10 mm"):
        guarded.exchange(0.5)


def test_after_0_v_nothing_else_is_given_out_until_the_bench_is_opened_again() -> None:
    """Whoever brings the output to 0 V: a loop in another thread must not drive the strip again."""
    bench = Scripted(ELECTRODES, {"voltage": np.r_[np.full(3, 0.05), np.full(40, 2.0)]})
    guarded = GuardedBench(bench, NOTHING)  # type: ignore[arg-type]
    guarded.open(["voltage"], 50.0)
    guarded.exchange(0.5)
    guarded.zero()
    with pytest.raises(IpmclabError, match="the output was brought to 0 V; open the bench again"):
        guarded.exchange(0.5)
    assert bench.output == [0.5, 0.0]
    # The discharge can be read, and an output that does not go to 0 V is told.
    for _ in range(12):
        guarded.exchange(0.0)
    with pytest.raises(BenchError, match="the output should be at 0 V and 2 V are read"):
        guarded.exchange(0.0)  # row 13, 0.2 s after the first of 2 V
    guarded.open(["voltage"], 50.0)
    guarded.exchange(0.5)
    assert bench.output[-1] == 0.5


def test_0_v_that_comes_in_the_middle_of_a_row_stays() -> None:
    """A handler of a signal of the system runs between the reading and the voltage that follows it."""

    class Interrupted(Scripted):
        def exchange(self, voltage: float) -> dict[str, float]:
            guarded.zero()
            return super().exchange(voltage)

    bench = Interrupted(ELECTRODES, {"voltage": np.zeros(4)})
    guarded = GuardedBench(bench, NOTHING)  # type: ignore[arg-type]
    guarded.open(["voltage"], 50.0)
    guarded.exchange(0.5)
    assert bench.output == [0.0, 0.5, 0.0]


def test_a_bench_that_fails_leaves_no_voltage_on_the_strip() -> None:
    class Failing(Scripted):
        def exchange(self, voltage: float) -> dict[str, float]:
            if self.row:
                raise BenchError("no answer", code="no-answer", where="bench", repair="look at the cable")
            return super().exchange(voltage)

    bench = Failing(ELECTRODES, {"voltage": np.zeros(4)})
    guarded = GuardedBench(bench, NOTHING)  # type: ignore[arg-type]
    guarded.open(["voltage"], 50.0)
    guarded.exchange(1.0)
    with pytest.raises(BenchError, match="no answer"):
        guarded.exchange(1.0)
    assert bench.output == [1.0, 0.0]
    with pytest.raises(IpmclabError, match="the output was brought to 0 V"):
        guarded.exchange(1.0)


def test_a_warning_is_told_and_what_ends_single_rows_is_raised() -> None:
    limits = replace(NOTHING, current=Limit(0.1), displacement=Limit(1e-3, action="warn"))
    readings = {"voltage": np.zeros(2), "current": np.array([0.0, 0.2]), "displacement": np.full(2, 2e-3)}
    told: list[Alarm] = []
    guarded = GuardedBench(Scripted(ELECTRODES, readings), limits, on_warning=told.append)  # type: ignore[arg-type]
    guarded.open(list(readings), RATE)
    guarded.exchange(0.5)
    with pytest.raises(LimitPassed, match="the current is 200 mA"):
        guarded.exchange(0.5)
    assert [(alarm.limit, alarm.row) for alarm in told] == [("displacement", 0)]


def test_a_listener_that_fails_does_not_keep_a_limit_from_acting() -> None:
    def fail(alarm: Alarm) -> None:
        assert bench.output[-1] == 0.0
        raise ZeroDivisionError

    limits = replace(NOTHING, current=Limit(0.1), displacement=Limit(1e-3, action="warn"))
    readings = {"voltage": np.full(4, 1.0), "current": np.full(4, 0.2), "displacement": np.full(4, 2e-3)}
    bench = Scripted(ELECTRODES, readings)
    guarded = GuardedBench(bench, limits, on_warning=fail)  # type: ignore[arg-type]
    guarded.open(list(readings), 50.0)
    with pytest.raises(ZeroDivisionError):
        guarded.exchange(1.0)
    with pytest.raises(LimitPassed):
        guarded.exchange(1.0)
    assert bench.output[0] == 1.0
    assert len(bench.output) > 1
    assert not any(bench.output[1:])


def test_0_v_that_comes_while_the_bench_is_being_opened_holds() -> None:
    class Slow(Scripted):
        def open(self, measured: Collection[str], rate: float) -> None:
            guarded.zero()

    bench = Slow(ELECTRODES, {"voltage": np.full(12, 2.0)})
    guarded = GuardedBench(bench, NOTHING)  # type: ignore[arg-type]
    guarded.open(["voltage"], 50.0)
    with pytest.raises(IpmclabError, match="the output was brought to 0 V"):
        guarded.exchange(1.0)
    assert bench.output == [0.0, 0.0]
    # An output that does not go there is told.
    for _ in range(10):
        guarded.exchange(0.0)
    with pytest.raises(BenchError, match="the output should be at 0 V and 2 V are read"):
        guarded.exchange(0.0)  # 0.2 s after the first row


def test_a_bench_that_fails_to_open_again_lets_no_voltage_through() -> None:
    class Gone(Scripted):
        def open(self, measured: Collection[str], rate: float) -> None:
            super().open(measured, rate)
            if self.row:
                raise BenchError("no answer", code="bench-lost", where="bench", repair="look at the cable")

    bench = Gone(ELECTRODES, {"voltage": np.zeros(4)})
    guarded = opened(bench, NOTHING)
    guarded.exchange(0.5)
    guarded.zero()
    with pytest.raises(BenchError, match="no answer"):
        guarded.open(["voltage"], RATE)
    with pytest.raises(IpmclabError, match="the output was brought to 0 V"):
        guarded.exchange(0.5)
    assert bench.output == [0.5, 0.0]


class Stubborn(Scripted):
    """Its output stays where it is, and the driver notices so only once."""

    def zero(self) -> None:
        super().zero()
        if self.output.count(0.0) == 1:
            raise BenchError("it stays", code="output-not-zero", where="voltage", repair="switch the amplifier off")


def test_an_output_that_could_not_be_brought_to_0_v_is_told_as_long_as_it_stays() -> None:
    guarded = opened(Stubborn(ELECTRODES, {"voltage": np.full(12, 2.0)}), NOTHING)
    guarded.exchange(0.5)
    with pytest.raises(BenchError, match="it stays"):
        guarded.zero()
    with pytest.raises(IpmclabError, match="the output was brought to 0 V"):
        guarded.exchange(0.5)
    for _ in range(10):
        guarded.exchange(0.0)
    with pytest.raises(BenchError, match="the output should be at 0 V and 2 V are read"):
        guarded.exchange(0.0)


def test_what_failed_first_is_what_is_told() -> None:
    bench = Stubborn(ELECTRODES, {"voltage": np.zeros(4)})
    guarded = opened(bench, NOTHING)
    guarded.exchange(0.5, row=10)
    with pytest.raises(IpmclabError, match="a block begins at row 5, row 11 was expected"):
        guarded.exchange(0.5, row=5)
    assert bench.output == [0.5, 0.5, 0.0]
