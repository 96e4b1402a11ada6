"""A stand-in in this process, and NI's client for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import grpc
import nidaqmx
import pytest

from virtual_cdaq.model.chassis import Chassis
from virtual_cdaq.model.clock import make_clock
from virtual_cdaq.model.faults import parse_fault
from virtual_cdaq.model.plant import RcPlant
from virtual_cdaq.server import Server


class Bench:
    """A chassis, its server, and what NI's client needs to reach it."""

    def __init__(self, server: Server, channel: grpc.Channel) -> None:
        self.server = server
        self.chassis = server.chassis
        self.options = nidaqmx.GrpcSessionOptions(channel, "")

    def task(self, name: str = "") -> nidaqmx.Task:
        options = self.options
        if name:
            options = nidaqmx.GrpcSessionOptions(options.grpc_channel, name)
        return nidaqmx.Task(name, grpc_options=options)

    @property
    def system(self) -> nidaqmx.system.System:
        return nidaqmx.system.System.remote(self.options)


@contextmanager
def serving(clock: str = "lock-step", *faults: str, **more: object) -> Iterator[Bench]:
    chassis = Chassis(RcPlant(), make_clock(clock), faults=[parse_fault(text) for text in faults], **more)
    server = Server(chassis)
    address = server.start()
    try:
        with grpc.insecure_channel(address, options=[("grpc.max_receive_message_length", -1)]) as channel:
            yield Bench(server, channel)
    finally:
        server.stop()


@pytest.fixture
def bench() -> Iterator[Bench]:
    with serving() as made:
        yield made


@pytest.fixture
def make_bench() -> Iterator[Callable[..., Bench]]:
    with ExitStack() as stack:
        yield lambda *arguments, **more: stack.enter_context(serving(*arguments, **more))
