"""A plugin of pytest that lets NI's own tests run on the stand-in: ``-p benchmarks.ni_suite.plugin``.

It stands in for NI's server, and where a test looks for a device of NI's X series it gets the disguised one, also
where NI has a real one in mind. ``NI_SUITE_DISGUISE`` says which device, ``NI_SUITE_RESULTS`` where the ends of the
tests are written, a line of JSON each.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import grpc
import nidaqmx
import nidaqmx.system
import pytest

import tests._grpc_utils as ni_server
import tests.conftest as ni_fixtures
from benchmarks.ni_suite import disguise, evidence
from virtual_cdaq.server import Server

CHASSIS = getattr(disguise, os.environ["NI_SUITE_DISGUISE"])


class GrpcServerProcess:
    """What NI's fixtures start: here a server in this process."""

    def __init__(self) -> None:
        self._server = Server(CHASSIS())
        self._server.start()
        self.server_port = self._server.port

    def __enter__(self) -> GrpcServerProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop()


ni_server.GrpcServerProcess = GrpcServerProcess
ni_fixtures.GrpcServerProcess = GrpcServerProcess
ni_fixtures._x_series_device = lambda _type, system, *_, **__: _first(system)
evidence.listen()


def _first(system: Any) -> Any:
    device = next(iter(system.devices))
    if device.product_type != disguise.Multifunction.product:
        pytest.skip("Could not detect an X Series device.")
    return device


# Some tests ask the driver of this computer while they are collected.
_asked = GrpcServerProcess()
_channel = grpc.insecure_channel(f"127.0.0.1:{_asked.server_port}")
nidaqmx.system.System.local = staticmethod(
    lambda: nidaqmx.system.System.remote(nidaqmx.GrpcSessionOptions(_channel, ""))
)


def pytest_runtest_logstart() -> None:
    """A test begins."""
    evidence.refused.clear()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Any:
    """Write the end of a test: of its call, or of the setup that did not come so far."""
    outcome = yield
    report = outcome.get_result()
    if report.when == "setup" and report.outcome == "passed":
        return
    if report.when == "teardown" and report.outcome == "passed":
        return
    text = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longreprtext
    line = {
        "name": item.nodeid,
        "end": "xfailed" if hasattr(report, "wasxfail") and report.skipped else report.outcome,
        "when": report.when,
        "text": text,
        "refused": list(evidence.refused),
        "fixtures": list(getattr(item, "fixturenames", [])),
        "marks": [mark.args[0] for mark in item.iter_markers("device_name")],
    }
    with Path(os.environ["NI_SUITE_RESULTS"]).open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(line) + "\n")
