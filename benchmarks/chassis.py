"""The stand-in chassis through NI's client: the same data at every speed, sustained throughput, single points.

Run ``python -m benchmarks.chassis [--seconds 60] [--pairs 3000] [--gate] [--record]``. The server is a process of its
own. What must hold on every machine is gated: equal data, no sample lost, lock-step at least 40 times as fast as the
clock; the times of single points are recorded beside their limit, and depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import grpc
import nidaqmx
import numpy as np
import numpy.typing as npt
from nidaqmx.constants import AcquisitionType, TaskMode
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.stream_writers import AnalogSingleChannelWriter

from benchmarks.harness import Ratio, finish

SOURCES = ("src/virtual_cdaq",)

DURATION, RATE = 40.0, 50.0  # s, S/s: the experiment of the thesis
CHANNELS, FAST = 4, 60_000.0  # S/s each
BLOCK = 6_000  # samples per channel and read: 0.1 s
LIMIT = 2e-3  # s, of a single-point write and read, 99 % of them


@contextmanager
def chassis(clock: str) -> Iterator[nidaqmx.GrpcSessionOptions]:
    """NI's client's options for a new stand-in."""
    command = [sys.executable, "-m", "virtual_cdaq", "--clock", clock]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as served:
        assert served.stdout is not None
        address = served.stdout.readline().strip()
        try:
            with grpc.insecure_channel(address, options=[("grpc.max_receive_message_length", -1)]) as channel:
                nidaqmx.system.System.remote(nidaqmx.GrpcSessionOptions(channel, "")).driver_version  # noqa: B018
                yield nidaqmx.GrpcSessionOptions(channel, "")
        finally:
            served.terminate()


def experiment(options: nidaqmx.GrpcSessionOptions) -> tuple[npt.NDArray[np.float64], float]:
    """One output and three inputs on one clock for 40 s; the data, and the time that it took [s]."""
    rows = round(DURATION * RATE)
    volts = np.sin(2 * np.pi * 0.1 * np.arange(rows) / RATE)
    data = np.empty((3, rows))
    begin = time.perf_counter()
    with nidaqmx.Task(grpc_options=options) as reading, nidaqmx.Task(grpc_options=options) as writing:
        reading.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0:1, cDAQ1Mod1/ai3", min_val=-5.0, max_val=5.0)
        reading.timing.cfg_samp_clk_timing(RATE, sample_mode=AcquisitionType.FINITE, samps_per_chan=rows)
        reading.control(TaskMode.TASK_RESERVE)
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        writing.timing.cfg_samp_clk_timing(
            RATE, reading.timing.samp_clk_term, sample_mode=AcquisitionType.FINITE, samps_per_chan=rows
        )
        AnalogSingleChannelWriter(writing.out_stream).write_many_sample(volts)
        writing.start()
        reading.start()
        AnalogMultiChannelReader(reading.in_stream).read_many_sample(data, rows, timeout=DURATION + 10.0)
        reading.wait_until_done(5.0)
    return data, time.perf_counter() - begin


def throughput(options: nidaqmx.GrpcSessionOptions, seconds: float) -> tuple[int, float, float, float]:
    """Samples per channel read in real time, the time taken and the client's processor time [s], the rate [S/s]."""
    with nidaqmx.Task(grpc_options=options) as reading:
        reading.ai_channels.add_ai_voltage_chan(f"cDAQ1Mod1/ai0:{CHANNELS - 1}")
        reading.timing.cfg_samp_clk_timing(FAST, sample_mode=AcquisitionType.CONTINUOUS)
        rate = reading.timing.samp_clk_rate
        reader = AnalogMultiChannelReader(reading.in_stream)
        reader.verify_array_shape = False
        data = np.empty((CHANNELS, BLOCK))
        reading.start()
        begin, worked = time.perf_counter(), time.process_time()
        read = 0
        while read < seconds * rate:
            # A lost sample is an error here (-200279), never silent.
            read += reader.read_many_sample(data, BLOCK, timeout=10.0)
        taken, worked = time.perf_counter() - begin, time.process_time() - worked
        assert reading.in_stream.curr_read_pos == read
    return read, taken, worked, rate


def single_points(options: nidaqmx.GrpcSessionOptions, pairs: int) -> npt.NDArray[np.float64]:
    """Times of a write of one output and a read of three inputs, on demand [s]."""
    with nidaqmx.Task(grpc_options=options) as writing, nidaqmx.Task(grpc_options=options) as reading:
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        reading.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0:1, cDAQ1Mod1/ai3")
        writing.start()
        reading.start()
        writer = AnalogSingleChannelWriter(writing.out_stream, auto_start=False)
        reader = AnalogMultiChannelReader(reading.in_stream)
        writer.verify_array_shape = reader.verify_array_shape = False
        data = np.empty(3)
        times = np.empty(pairs)
        for k in range(pairs):
            begin = time.perf_counter()
            writer.write_one_sample(0.001 * (k % 1000))
            reader.read_one_sample(data)
            times[k] = time.perf_counter() - begin
        writer.write_one_sample(0.0)
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of the sustained acquisition")
    parser.add_argument("--pairs", type=int, default=3000, help="of single points")
    parser.add_argument("--gate", action="store_true", help="exit 1 when something does not hold")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/chassis.md")
    chosen = parser.parse_args()
    with chassis("real") as options:
        single_points(options, 200)
        times = single_points(options, chosen.pairs)
    runs = {}
    for clock in ("lock-step", "x10", "real"):
        with chassis(clock) as options:
            runs[clock] = experiment(options)
    for data, _ in runs.values():
        if data.tobytes() != runs["lock-step"][0].tobytes():
            sys.exit("the clocks give different data")
    with chassis("real") as options:
        read, taken, worked, rate = throughput(options, chosen.seconds)
    median, high, most = np.quantile(times, [0.5, 0.99, 1.0]) * 1e3
    lines = [
        "| what | measured |",
        "|---|---|",
        f"| {DURATION:g} s at {RATE:g} S/s, one output, three inputs: data at the three clocks | equal to the bit |",
        *(f"| ... wall time, clock {clock} | {wall:.3f} s |" for clock, (_, wall) in runs.items()),
        f"| {CHANNELS} channels x {rate:.1f} S/s in real time for {chosen.seconds:g} s: samples lost | 0 |",
        f"| ... samples read per channel, in time, client's processor time "
        f"| {read}, {taken:.2f} s, {100 * worked / taken:.1f} % |",
        f"| single-point write + read, {chosen.pairs} pairs: median, 99 % (limit {LIMIT * 1e3:g} ms), longest "
        f"| {median:.2f} ms, {high:.2f} ms, {most:.2f} ms |",
    ]
    ratios = [
        Ratio("lock-step over real time, 40 s experiment", np.array([runs["lock-step"][1] / runs["real"][1]]), 1 / 40),
        Ratio("real-time throughput over its clock", np.array([taken * rate / read]), at_most=1.02),
    ]
    finish("chassis", "The stand-in chassis", "\n".join(lines), ratios, record=chosen.record, gate=chosen.gate)


if __name__ == "__main__":
    main()
