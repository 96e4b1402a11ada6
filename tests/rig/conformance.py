"""What every bench does, whatever stands behind it: a bench passes by a subclass of ``Conformance`` that makes it.

Each test takes a bench that was never opened, in front of a strip of ``friend-2`` at rest on the rig of the thesis.
What is read is held against what was given out and against ``simulate``, not against another bench.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import load_actuator, signals, simulate
from ipmclab.errors import InputError
from ipmclab.rig.bench import Bench, Block, block_rows
from ipmclab.rig.channels import THESIS_RIG

FloatArray = npt.NDArray[np.float64]

RATE = 50.0
ELECTRICAL = ("voltage", "current")


def joined(blocks: Sequence[Block], name: str) -> FloatArray:
    """A channel of some blocks in one piece [V]; ``"output"`` for what was given out."""
    return np.concatenate([block.output if name == "output" else block.readings[name] for block in blocks])


def tolerance(name: str) -> float:
    """By how much [V] a reading may be off: 6 standard deviations of the noise, 2 steps, and the module's offset."""
    converter = THESIS_RIG[name].converter
    return 6.0 * converter.noise + 2.0 * converter.step + 20e-6 * converter.high


def expected(signal: str, rows: int, rate: float = RATE) -> dict[str, FloatArray]:
    """What the channels of the rig read [V], from the model of the strip alone."""
    strip = load_actuator("friend-2")
    in_series = strip.replace(**{"circuit.contact_resistance": strip["circuit.contact_resistance"] + 1.0})
    given = signals.parse(signal).voltage(np.arange(rows) / rate)
    run = simulate(in_series, np.concatenate([[0.0], given[:-1]]), duration=rows / rate, rate=rate, hold="zero-before")
    volts = {name: THESIS_RIG[name].to_volts(run.channels[name]) for name in ("voltage", "current", "force")}
    rest = THESIS_RIG["force"].to_volts(np.array(THESIS_RIG["force"].rest))
    return {**volts, "force": volts["force"] + rest}


class Conformance:
    """Everything that ``Bench`` promises."""

    @pytest.fixture
    def make(self) -> Callable[[], Bench]:
        """A function that makes a bench; the strip is at rest when the first one is opened."""
        raise NotImplementedError

    @pytest.fixture
    def bench(self, make: Callable[[], Bench]) -> Iterator[Bench]:
        """A bench that is closed when the test ends."""
        bench = make()
        yield bench
        bench.close()

    def test_rows_come_in_blocks_of_40_ms_without_a_gap(self, bench: Bench) -> None:
        for rate, rows in ((50.0, 25), (1000.0, 250), (4.0, 3)):
            bench.open(ELECTRICAL, rate)
            blocks = list(bench.apply(signals.Step(0.1), rows))
            length = block_rows(rate)
            assert [block.first_row for block in blocks] == list(range(0, rows, length))
            assert sum(len(block) for block in blocks) == rows
            assert {len(block) for block in blocks[:-1]} <= {length}
            for block in blocks:
                assert set(block.readings) == set(ELECTRICAL)
                assert all(values.shape == (len(block),) for values in block.readings.values())
                assert block.output.shape == (len(block),)
                assert block.output.dtype == np.float64

    def test_no_rows_are_no_blocks(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        assert list(bench.apply(signals.Step(1.0), 0)) == []
        assert bench.exchange(0.0)["voltage"] == pytest.approx(0.0, abs=tolerance("voltage"))

    def test_a_row_is_read_before_the_output_changes(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        (block,) = bench.apply(signals.parse("step 1 V for 0.02 s then step -1 V"), 2)
        assert block.output.tolist() == [0.0, 1.0]
        assert block.readings["voltage"] == pytest.approx([0.0, 1.0], abs=tolerance("voltage"))
        # The last row was given out, and stays.
        assert bench.exchange(0.0)["voltage"] == pytest.approx(-1.0, abs=tolerance("voltage"))

    @pytest.mark.parametrize("signal", ["step 1 V", "random 1 V 0.1 s", "sine 0.5 V 0.7 Hz"])
    def test_the_strip_reads_as_its_model(self, bench: Bench, signal: str) -> None:
        rows = 500
        names = ("voltage", "current", "force")
        bench.open(names, RATE)
        blocks = list(bench.apply(signals.parse(signal), rows))
        given = signals.parse(signal).voltage(np.arange(rows) / RATE)
        assert np.array_equal(joined(blocks, "output"), np.concatenate([[0.0], given[:-1]]))
        model = expected(signal, rows)
        for name in ELECTRICAL:
            # The output has 16 bits too: 0.33 mV, and through the strip 0.05 of that at the shunt.
            off = 0.33e-3 if name == "voltage" else 0.02e-3
            assert np.abs(joined(blocks, name) - model[name]).max() < tolerance(name) + off
        sensor = THESIS_RIG["force"].sensor_noise / THESIS_RIG["force"].gain
        assert np.abs(joined(blocks, "force") - model["force"]).max() < tolerance("force") + 6.0 * sensor

    def test_the_thermometer_reads_once_a_second(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        blocks = list(bench.apply(signals.Step(0.0), 500))
        temperatures = np.concatenate([block.temperature for block in blocks])
        assert 8 <= len(temperatures) <= 11
        assert temperatures == pytest.approx(THESIS_RIG.virtual.temperature, abs=0.1)

    def test_zero_between_blocks_ends_the_voltage_and_not_the_record(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        blocks = []
        for block in bench.apply(signals.Step(2.0), 100):
            blocks.append(block)
            if block.first_row == 20:
                bench.zero()
                bench.zero()
        assert sum(len(block) for block in blocks) == 100
        output, voltage, current = (joined(blocks, name) for name in ("output", *ELECTRICAL))
        first = int(np.flatnonzero(output[1:] == 0.0)[0]) + 1
        # In real time some rows are sampled while the output is on its way to 0 V.
        assert 22 <= first <= 30
        assert np.all(output[1:first] == 2.0)
        assert np.all(output[first:] == 0.0)
        off = tolerance("voltage") + 0.33e-3
        assert voltage[1:22] == pytest.approx(np.full(21, 2.0), abs=off)
        assert voltage[first:] == pytest.approx(np.zeros(100 - first), abs=off)
        # The strip discharges through the shunt: the current turns round.
        assert current[1:22].min() > 0.05
        assert current[first : first + 10].max() < -0.02

    def test_zero_may_come_at_any_time(self, bench: Bench) -> None:
        bench.zero()
        bench.open(ELECTRICAL, RATE)
        bench.zero()
        bench.exchange(1.0)
        bench.zero()
        bench.zero()
        assert bench.exchange(0.0)["voltage"] == pytest.approx(0.0, abs=tolerance("voltage"))
        list(bench.apply(signals.Step(1.0), 4))
        bench.zero()
        assert bench.exchange(0.0)["voltage"] == pytest.approx(0.0, abs=tolerance("voltage"))
        bench.close()
        bench.zero()

    def test_zero_before_the_first_block_holds_for_what_was_handed_over(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        blocks = bench.apply(signals.Step(2.0), 10)
        bench.zero()
        got = list(blocks)
        assert joined(got, "output").tolist() == [0.0] * 10
        assert joined(got, "voltage") == pytest.approx(np.zeros(10), abs=tolerance("voltage"))
        # What is handed over afterwards is given out.
        (block,) = bench.apply(signals.Step(1.0), 2)
        assert block.output.tolist() == [0.0, 1.0]

    def test_a_signal_may_follow_another(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        for first, given in ((0.0, 1.0), (1.0, -1.0), (-1.0, 0.5)):
            blocks = list(bench.apply(signals.Step(given), 10))
            assert joined(blocks, "output").tolist() == [first] + [given] * 9
            off = tolerance("voltage") + 0.33e-3
            assert joined(blocks, "voltage") == pytest.approx([first] + [given] * 9, abs=off)

    def test_a_step_of_a_control_loop_reads_and_then_gives_out(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        given = [0.5, -0.5, 1.0, 0.0, 0.0]
        read = [bench.exchange(voltage) for voltage in given]
        assert [set(readings) for readings in read] == [set(ELECTRICAL)] * 5
        off = tolerance("voltage") + 0.33e-3
        assert [readings["voltage"] for readings in read] == pytest.approx([0.0, *given[:-1]], abs=off)
        assert read[1]["current"] > 0.02
        # A signal and a loop may follow each other.
        (block,) = bench.apply(signals.Step(1.0), 2)
        assert block.readings["voltage"] == pytest.approx([0.0, 1.0], abs=off)
        assert bench.exchange(0.0)["voltage"] == pytest.approx(1.0, abs=off)

    def test_an_iterator_that_is_closed_early_stops_the_clock(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        blocks = bench.apply(signals.Step(1.5), 10_000)
        assert len(next(blocks)) == 2
        blocks.close()  # type: ignore[attr-defined]
        off = tolerance("voltage") + 0.33e-3
        assert bench.exchange(1.5)["voltage"] == pytest.approx(1.5, abs=off)
        bench.zero()
        (block,) = bench.apply(signals.Step(1.0), 2)
        assert block.first_row == 0
        assert block.readings["voltage"] == pytest.approx([0.0, 1.0], abs=off)

    def test_a_bench_is_closed_and_opened_again(self, make: Callable[[], Bench]) -> None:
        bench = make()
        bench.close()
        bench.open(ELECTRICAL, RATE)
        bench.exchange(1.0)
        bench.close()
        bench.close()
        with pytest.raises(InputError, match="bench: the bench is not open; call open first"):
            bench.exchange(0.0)
        with pytest.raises(InputError, match="bench: the bench is not open; call open first"):
            bench.apply(signals.Step(0.0), 2)
        again = make()
        again.open(["voltage"], 100.0)
        assert set(again.exchange(1.0)) == {"voltage"}
        # Opened once more without being closed: the output is reset.
        again.open(["voltage"], 100.0)
        assert again.exchange(0.0)["voltage"] == pytest.approx(0.0, abs=tolerance("voltage"))
        again.close()

    @pytest.mark.parametrize(
        ("measured", "rate", "message"),
        [
            (("voltage", "curent"), 50.0, "measured: the bench has no channel 'curent'; did you mean 'current'?"),
            (
                ("voltage", "displacement", "force"),
                50.0,
                "measured: displacement and force cannot be measured in one run: the load cell holds the tip; "
                "record two runs, one with each",
            ),
            (ELECTRICAL, 0.0, "rate: the rate is 0.0, it must be a number above 0; give it in Hz, such as 50"),
            (ELECTRICAL, float("nan"), "rate: the rate is nan, it must be a number above 0; give it in Hz, such as 50"),
        ],
    )
    def test_what_cannot_be_opened(self, bench: Bench, measured: tuple[str, ...], rate: float, message: str) -> None:
        with pytest.raises(InputError) as caught:
            bench.open(measured, rate)
        assert str(caught.value) == message
        with pytest.raises(InputError, match="the bench is not open"):
            bench.exchange(0.0)

    def test_nothing_is_given_out_of_a_signal_that_does_not_fit(self, bench: Bench) -> None:
        bench.open(ELECTRICAL, RATE)
        with pytest.raises(InputError) as caught:
            bench.apply(signals.parse("step 1 V for 1 s then step 11 V"), 100)
        assert str(caught.value) == (
            "signal: the signal needs 11 V at 1 s, the output gives -10 V to 10 V; give a smaller amplitude or offset"
        )
        with pytest.raises(InputError) as caught:
            bench.exchange(-10.5)
        assert str(caught.value) == (
            "voltage: -10.5 V is asked for, the output gives -10 V to 10 V; give a smaller voltage"
        )
        with pytest.raises(InputError, match="voltage: nan V is asked for"):
            bench.exchange(float("nan"))
        assert bench.exchange(0.0)["voltage"] == pytest.approx(0.0, abs=tolerance("voltage"))

    def test_a_bench_says_what_it_is(self, bench: Bench) -> None:
        assert bench.rig.name == THESIS_RIG.name
        bench.open(ELECTRICAL, RATE)
        assert bench.origin == "virtual bench"  # also the stand-in: its runs are no measurements
        assert THESIS_RIG.name in bench.description
