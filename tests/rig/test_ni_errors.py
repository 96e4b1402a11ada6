"""What NI-DAQmx reports comes out with our code, the name of the rig file, and what to do."""

from __future__ import annotations

import re
from pathlib import Path

import grpc
import pytest
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, DaqReadError, RpcError

from ipmclab.errors import InputError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.daqmx.errors import MEANINGS, STATUSES, STATUSES_OF_LOSS, translate

NAMES = {"cDAQ1Mod1/ai0": "current", "cDAQ1Mod1/ai3": "voltage", "cDAQ1Mod2/ao0": "output"}
PAGE = Path(__file__).parents[2] / "docs" / "ni.md"


def told(error: Exception, address: str | None = None) -> str:
    return str(translate(error, names=NAMES, address=address))


def test_every_code_of_the_table_is_one_of_the_client() -> None:
    assert {number: meaning.name for number, meaning in MEANINGS.items()} == {
        number: DAQmxErrors(number).name for number in MEANINGS
    }


@pytest.mark.parametrize("number", sorted(MEANINGS))
def test_a_meaning_says_what_happened_with_the_code_and_what_to_do(number: int) -> None:
    error = translate(DaqError("Something.", number), names=NAMES, address=None)
    assert isinstance(error, InputError if MEANINGS[number].input else BenchError)
    assert error.code == (MEANINGS[number].code or f"daq{number}")
    assert f"(NI-DAQmx error {number})" in str(error)
    assert error.repair


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (
            DaqReadError("Attempted to read samples that are no longer available.\n\nProperty: x", -200279, 5),
            "daq-200279",
            "readings were overwritten before they were fetched: this computer did not keep up with the chassis "
            "(NI-DAQmx error -200279); "
            "end other programs, lower the rate, or record fewer channels",
        ),
        (
            DaqError("The specified resource is reserved.\n\nDevice: cDAQ1Mod2\nTask Name: t", -50103),
            "bench-in-use",
            "cDAQ1Mod2 (output): another program holds it (NI-DAQmx error -50103); end that program",
        ),
        (
            DaqError(
                "Requested value is not a supported value for this property.\n\nProperty: DAQmx_AI_Min\n"
                "Requested Value: -20.0\nValid Values Begin with: -10.0\nValid Values End with: 10.0\n\n"
                "Channel Name: cDAQ1Mod1/ai0\nTask Name: _unnamedTask<44B>",
                -200077,
            ),
            "not-supported",
            "current (cDAQ1Mod1/ai0): the module cannot do that, -20.0 was asked for, allowed are -10.0 to 10.0",
        ),
        (
            DaqError("No.\n\nProperty: SampClk.Rate\nRequested value: 3e5\nAllowed: at most 250000 S/s", -200077),
            "not-supported",
            "the module cannot do that, 3e5 was asked for, allowed is: at most 250000 S/s (NI-DAQmx error -200077)",
        ),
        (
            DaqError("Bad.\n\nChannel Name: voltage\nTask Name: t", -200431),
            "wrong-module",
            "voltage (cDAQ1Mod1/ai3): the",
        ),
        (DaqError("Device identifier is invalid.\n\nDevice Specified: cDAQ9Mod1", -200220), "no-device", "cDAQ9Mod1: "),
        (
            DaqError("The sky fell.\n\nMore.\n\nTask Name: t", -123456),
            "daq-123456",
            "The sky fell (NI-DAQmx error -123456); look the number up at ni.com",
        ),
    ],
)
def test_the_place_is_named_as_in_the_rig_file(error: DaqError, code: str, message: str) -> None:
    assert translate(error, names=NAMES, address=None).code == code
    assert told(error).startswith(message)


@pytest.mark.parametrize("status", sorted(STATUSES))
def test_a_status_of_the_connection_names_the_server(status: str) -> None:
    error = translate(RpcError(grpc.StatusCode[status], "details"), names=NAMES, address="host:1")
    assert isinstance(error, BenchError)
    assert str(error).startswith(f"host:1: {STATUSES[status][1]}; ")


def test_any_other_status_is_told_by_name() -> None:
    error = translate(RpcError(grpc.StatusCode.DATA_LOSS, "details"), names=NAMES, address="host:1")
    assert str(error) == "host:1: the server of the chassis reports DATA_LOSS; restart it, then start again"


def test_what_loses_the_connection_is_in_the_table() -> None:
    assert set(STATUSES) >= STATUSES_OF_LOSS


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (DaqNotFoundError("Could not find NI-DAQmx"), "no-driver", "driver: the NI-DAQmx driver is not installed"),
        (DaqNotSupportedError("darwin"), "no-driver", "driver: there is no NI-DAQmx driver for this system"),
        (ValueError("Cannot invoke RPC on closed channel!"), "daq-client", "the NI-DAQmx client failed: Cannot invoke"),
    ],
)
def test_what_is_no_report_of_a_driver(error: Exception, code: str, message: str) -> None:
    assert translate(error, names=NAMES, address=None).code == code
    assert told(error).startswith(message)


def test_the_page_lists_every_message() -> None:
    text = PAGE.read_text("utf-8")
    rows = {int(row[1]): row for row in re.finditer(r"^\| (-\d+) \| (.+?) \| (.+?) \| (.+?) \|$", text, re.M)}
    assert list(rows) == sorted(MEANINGS, reverse=True)
    for number, row in rows.items():
        meaning = MEANINGS[number]
        assert row.group(2, 3, 4) == (meaning.code or f"daq{number}", meaning.message, meaning.repair)
    for code, message, repair in STATUSES.values():
        assert f"| {code} | {message} | {repair} |" in text
