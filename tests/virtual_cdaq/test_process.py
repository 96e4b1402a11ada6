"""The stand-in as a process of its own."""

import re
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

import grpc
import nidaqmx
import pytest
from nidaqmx import DaqError

from virtual_cdaq.levels import read_levels

CAPTURED = {"capture_output": True, "text": True, "timeout": 300}
COMMAND = [sys.executable, "-m", "virtual_cdaq"]


@contextmanager
def process(*arguments):
    with subprocess.Popen(
        [*COMMAND, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as served:
        try:
            yield served, served.stdout.readline()
        finally:
            served.kill()


def test_stdout_carries_the_address_and_nothing_else():
    with process("--port", 0, "--clock", "lock-step") as (served, line):
        assert re.fullmatch(r"127\.0\.0\.1:\d+\n", line)
        port = int(line.split(":")[1])
        with grpc.insecure_channel(line.strip()) as channel:
            options = nidaqmx.GrpcSessionOptions(channel, "")
            assert "cDAQ1" in nidaqmx.system.System.remote(options).devices
        # Another address of this computer is not listened on.
        with socket.socket() as other:
            other.settimeout(1.0)
            assert other.connect_ex(("127.0.0.2", port)) != 0
        served.terminate()
        rest, _ = served.communicate(timeout=300)
        assert rest == ""
        if sys.platform != "win32":
            assert served.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "text"),
    [(("--clock", "fast"), "lock-step"), (("--fault", "explode"), "freeze, drop"), (("--port", "99999"), "99999")],
)
def test_what_cannot_be_served_is_said_and_exits_with_2(arguments, text):
    done = subprocess.run([*COMMAND, *arguments], check=False, **CAPTURED)
    assert (done.returncode, done.stdout) == (2, "")
    assert text in done.stderr
    assert "Traceback" not in done.stderr


def test_a_port_in_use_is_said():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = subprocess.run([*COMMAND, "--port", str(port)], check=False, **CAPTURED)
    assert done.returncode == 2
    assert str(port) in done.stderr


CLIENT = """
import grpc, nidaqmx, sys, time
task = nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(grpc.insecure_channel(sys.argv[1]), ""))
task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
task.start()
task.write(3.0)
print("written", flush=True)
time.sleep(60)
"""


def test_a_dead_clients_output_holds_until_the_device_is_reset(tmp_path):
    levels = tmp_path / "levels.json"
    with process("--levels", levels) as (_, line):
        with subprocess.Popen(
            [sys.executable, "-c", CLIENT, line.strip()], stdout=subprocess.PIPE, text=True
        ) as client:
            assert client.stdout.readline() == "written\n"
            client.kill()
        time.sleep(0.3)
        held = read_levels(levels)["cDAQ1Mod2/ao0"]
        assert held.volts == pytest.approx(3.0, abs=2e-4)
        with grpc.insecure_channel(line.strip()) as channel:
            options = nidaqmx.GrpcSessionOptions(channel, "")
            with nidaqmx.Task(grpc_options=options) as task:
                task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
                with pytest.raises(DaqError) as caught:
                    task.write(0.0)
                assert caught.value.error_code == -50103
                nidaqmx.system.System.remote(options).devices["cDAQ1"].reset_device()
                level = read_levels(levels)["cDAQ1Mod2/ao0"]
                assert (level.volts, level.since > held.since) == (0.0, True)
                task.write(1.0)
        assert read_levels(levels)["cDAQ1Mod2/ao0"].volts == pytest.approx(1.0, abs=2e-4)


def test_an_old_handle_finds_nothing_after_a_restart():
    with process("--clock", "lock-step") as (_, line), grpc.insecure_channel(line.strip()) as channel:
        task = nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(channel, ""))
        handle = task._handle
        port = line.strip().split(":")[1]
    with ExitStack() as stack:
        _, line = stack.enter_context(process("--clock", "lock-step", "--port", port))
        channel = stack.enter_context(grpc.insecure_channel(line.strip()))
        other = stack.enter_context(nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(channel, "")))
        with pytest.raises(DaqError) as caught:
            other._interpreter.start_task(handle)
        assert caught.value.error_code == -200088
    task._handle = None
