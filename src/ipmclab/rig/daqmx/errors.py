"""What NI-DAQmx reports, in words that say what to do: one row of a table for each code.

Nothing of NI's is imported: errors are known by what they carry (a DAQmx code, a gRPC status).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.bench import BenchError


@dataclass(frozen=True)
class Meaning:
    """What a code of NI-DAQmx means here.

    Parameters
    ----------
    name : str
        Of ``nidaqmx.error_codes.DAQmxErrors``.
    message : str
        What happened, in the words of a rig.
    repair : str
        What the user can do.
    code : str
        Of our error; empty for ``"daq<code>"``.
    input : bool
        Whether it is about what the user gave (exit status 2), not about the hardware.
    """

    name: str
    message: str
    repair: str
    code: str = ""
    input: bool = False


_REPLUG: Final = "check its power and its cable, look whether NI MAX shows it, then start again"

MEANINGS: Final[Mapping[int, Meaning]] = {
    -200279: Meaning(
        "SAMPLES_NO_LONGER_AVAILABLE",
        "readings were overwritten before they were fetched: this computer did not keep up with the chassis",
        "end other programs, lower the rate, or record fewer channels",
    ),
    -200278: Meaning(
        "SAMPLES_WILL_NEVER_BE_AVAILABLE",
        "more readings were asked for than the chassis takes",
        "please report this: it is a fault of ipmclab",
    ),
    -200284: Meaning(
        "SAMPLES_NOT_YET_AVAILABLE",
        "the chassis gives no readings",
        "its sample clock has stopped: check its power and its cable; then start again",
        code="bench-frozen",
    ),
    -200290: Meaning(
        "GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES",
        "the output ran out of samples and holds its last voltage: this computer did not feed it in time",
        "end other programs or lower the rate",
    ),
    -200292: Meaning(
        "SAMPLES_CAN_NOT_YET_BE_WRITTEN",
        "the output takes no more samples: its clock has stopped",
        "check the power and the cable of the chassis; then start again",
        code="bench-frozen",
    ),
    -200561: Meaning(
        "INVALID_AO_DATA_WRITE",
        "the voltage is beyond what the output can give",
        "give a smaller amplitude, or mend `range` of the output in the rig file",
        code="out-of-range",
        input=True,
    ),
    -50103: Meaning(
        "PAL_RESOURCE_RESERVED",
        "another program holds it",
        "end that program (NI MAX test panels too); `ipmclab rig check` resets a chassis that a program left behind",
        code="bench-in-use",
    ),
    -200022: Meaning(
        "RESOURCE_ALREADY_RESERVED",
        "another task holds it",
        "end the other program that uses this chassis (NI MAX test panels too)",
        code="bench-in-use",
    ),
    -200088: Meaning(
        "INVALID_TASK",
        "the chassis no longer knows this run: its server was restarted, or another program reset it",
        "start the run again, and let no other program use this chassis meanwhile",
        code="bench-lost",
    ),
    -88710: Meaning(
        "RUNTIME_ABORTING_ROUTING",
        "the run was aborted from outside: another program reset the chassis, or the guardian did",
        "see what was reported before this; start again",
        code="bench-lost",
    ),
    -88709: Meaning(
        "RUNTIME_ABORTED_ROUTING",
        "the run was aborted from outside: another program reset the chassis, or the guardian did",
        "see what was reported before this; start again",
        code="bench-lost",
    ),
    -201420: Meaning(
        "NETWORK_DEVICE_RESERVED_BY_ANOTHER_HOST",
        "the network chassis is reserved by another computer",
        "release it there, or reserve it for this computer in NI MAX",
        code="bench-in-use",
    ),
    -200220: Meaning(
        "INVALID_DEVICE_ID",
        "the chassis has no module of that name",
        "compare the rig file with the names in NI MAX; `ipmclab rig check` lists what is there",
        code="no-device",
    ),
    -200170: Meaning(
        "PHYSICAL_CHAN_DOES_NOT_EXIST",
        "the module has no such input or output",
        "mend `physical` in the rig file; `ipmclab rig check` lists what is there",
        code="no-channel",
        input=True,
    ),
    -200431: Meaning(
        "PHYS_CHAN_MEAS_TYPE",
        "the module cannot measure that",
        "mend `physical` in the rig file: voltages belong on an NI 9205, thermometers on an NI 9217",
        code="wrong-module",
        input=True,
    ),
    -200077: Meaning(
        "INVALID_ATTRIBUTE_VALUE",
        "the module cannot do that",
        "mend the range, the terminal or the rate in the rig or experiment file",
        code="not-supported",
        input=True,
    ),
    -200452: Meaning(
        "ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT",
        "the module cannot do that",
        "mend the terminal in the rig file: `ipmclab rig check` says what the module can",
        code="not-supported",
        input=True,
    ),
    -200332: Meaning(
        "SAMP_RATE_TOO_HIGH",
        "the rate is above what the module can do",
        "give a lower rate, or record fewer channels",
        code="bad-rate",
        input=True,
    ),
    -200081: Meaning(
        "SAMPLE_RATE_NUM_CHANS_CONVERT_PERIOD_COMBO",
        "the rate is above what the module can do with so many channels",
        "give a lower rate, or record fewer channels",
        code="bad-rate",
        input=True,
    ),
    -200489: Meaning(
        "CHAN_ALREADY_IN_TASK",
        "two channels are on one input",
        "give each channel of the rig file its own input",
        code="duplicate-channel",
        input=True,
    ),
    -201003: Meaning(
        "DEV_CANNOT_BE_ACCESSED",
        "the module was unplugged, or lost its power",
        f"switch the amplifier off, {_REPLUG}",
        code="bench-lost",
    ),
    -88705: Meaning(
        "DRIVER_DEVICE_GUID_NOT_FOUND_ROUTING",
        "the chassis is not there, or has lost its power",
        f"switch the amplifier off, {_REPLUG}",
        code="bench-lost",
    ),
    -50405: Meaning(
        "PAL_TRANSFER_ABORTED",
        "the USB cable was unplugged, or the chassis lost its power",
        f"switch the amplifier off, {_REPLUG}",
        code="bench-lost",
    ),
    -50401: Meaning(
        "PAL_COMMUNICATIONS_FAULT",
        "the connection to the chassis is disturbed",
        f"switch the amplifier off, {_REPLUG}; use another USB port, without a hub",
        code="bench-lost",
    ),
    -200010: Meaning(
        "INPUT_FIFO_OVERFLOW",
        "the chassis lost readings: the bus did not carry them in time",
        "lower the rate, or use another USB port, without a hub",
    ),
    -200621: Meaning(
        "OUTPUT_FIFO_UNDERFLOW_2",
        "the output ran out of samples in the chassis: the bus did not carry them in time",
        "lower the rate, or use another USB port, without a hub",
    ),
    -200019: Meaning(
        "ADC_OVERRUN",
        "the converter was clocked faster than it can convert",
        "lower the rate, or record fewer channels",
    ),
    -200560: Meaning(
        "WAIT_UNTIL_DONE_DOES_NOT_INDICATE_DONE",
        "the chassis did not end in time",
        "its sample clock has stopped: check its power and its cable; then start again",
        code="bench-frozen",
    ),
}
"""By NI's code. ``docs/ni.md`` holds the same as a table."""

STATUSES: Final[Mapping[str, tuple[str, str, str]]] = {
    "UNAVAILABLE": (
        "bench-lost",
        "the connection to the server of the chassis is gone",
        "look whether the server still runs and the network is up; start it, then start again",
    ),
    "CANCELLED": (
        "bench-lost",
        "the connection to the server of the chassis was closed",
        "start again",
    ),
    "DEADLINE_EXCEEDED": (
        "bench-frozen",
        "the server of the chassis does not answer",
        "its program or its computer is stuck: switch the amplifier off, restart the server, then start again",
    ),
    "UNIMPLEMENTED": (
        "server-too-old",
        "the server of the chassis does not know a call that is needed",
        "install a newer NI gRPC Device Server",
    ),
    "RESOURCE_EXHAUSTED": (
        "server-overloaded",
        "the server of the chassis is overloaded",
        "lower the rate, or end its other clients",
    ),
}
"""What a status of gRPC without a code of NI-DAQmx means: our code, what happened, the repair."""

STATUSES_OF_LOSS: Final = frozenset({"UNAVAILABLE", "CANCELLED", "DEADLINE_EXCEEDED"})
"""After these, nothing more is to be expected of the same connection."""

_PLACES: Final = re.compile(
    r"^(?:Physical Channel Name|Channel Name|Channel|Module|Device|Device Specified): *(\S.*)$", re.M
)
_ADDED: Final = re.compile(r"^(?:Task Name|Status Code): .*$", re.M)


def translate(error: Exception, *, names: Mapping[str, str], address: str | None) -> IpmclabError:
    """An error of the official client as ours.

    Parameters
    ----------
    error : Exception
        A ``DaqError``, an ``RpcError``, a missing driver.
    names : mapping of str to str
        From a physical name to what the rig file calls it.
    address : str or None
        Of the gRPC server.

    Returns
    -------
    error : BenchError or InputError
    """
    number = getattr(error, "error_code", None)
    if isinstance(number, int):
        return _of_code(number, str(error), names)
    status = getattr(getattr(error, "rpc_code", None), "name", None)
    if status is not None:
        code, message, repair = STATUSES.get(
            status, ("server-error", f"the server of the chassis reports {status}", "restart it, then start again")
        )
        return BenchError(message, code=code, where=address or "", repair=repair)
    return _of_missing_driver(error)


def _of_code(number: int, text: str, names: Mapping[str, str]) -> IpmclabError:
    where = place(text, names)
    meaning = MEANINGS.get(number)
    if meaning is None:
        return BenchError(
            f"{_first_sentence(text)} (NI-DAQmx error {number})",
            code=f"daq{number}",
            where=where,
            repair="look the number up at ni.com; `ipmclab rig check` tests every channel",
        )
    kind = InputError if meaning.input else BenchError
    details = f", {wanted}" if (wanted := _asked_and_allowed(text)) else ""
    return kind(
        f"{meaning.message}{details} (NI-DAQmx error {number})",
        code=meaning.code or f"daq{number}",
        where=where,
        repair=meaning.repair,
    )


def _of_missing_driver(error: Exception) -> IpmclabError:
    kind = type(error).__name__
    if kind == "DaqNotSupportedError":
        return BenchError(
            "there is no NI-DAQmx driver for this system",
            code="no-driver",
            where="driver",
            repair="connect the chassis to a Windows or Linux computer, run NI's gRPC server there and give its "
            "`address` in the rig file",
        )
    if kind == "DaqNotFoundError":
        return BenchError(
            "the NI-DAQmx driver is not installed on this computer",
            code="no-driver",
            where="driver",
            repair="install it from ni.com; or give the `address` of a gRPC server in the rig file; or try everything "
            "without hardware: ipmclab rig serve",
        )
    return BenchError(
        f"the NI-DAQmx client failed: {_first_sentence(str(error)) or kind}",
        code="daq-client",
        repair="`ipmclab rig check` tests the connection",
    )


def place(text: str, names: Mapping[str, str]) -> str:
    """Where an error of NI-DAQmx happened, with the names of the rig file.

    Examples
    --------
    >>> place("Bad.\\nDevice: cDAQ1Mod1\\nChannel Name: cDAQ1Mod1/ai0", {"cDAQ1Mod1/ai0": "current"})
    'current (cDAQ1Mod1/ai0)'
    """
    found = [match.strip() for match in _PLACES.findall(text)]
    physical = {name: key for key, name in names.items()}
    for one in found:
        if one in names:
            return f"{names[one]} ({one})"
        if one in physical:
            return f"{one} ({physical[one]})"
    if not found:
        return ""
    wired = [name for key, name in names.items() if key.split("/")[0] == found[-1]]
    return f"{found[-1]} ({', '.join(wired)})" if wired else found[-1]


def _asked_and_allowed(text: str) -> str:
    """What was asked for and what is allowed, as far as NI-DAQmx says it."""
    said = {key.title(): value for key, value in re.findall(r"^([A-Z][A-Za-z ]*): *(\S.*)$", text, re.M)}
    asked = next((said[key] for key in ("Requested Value", "Value", "Attempted Value") if key in said), None)
    if asked is None:
        return ""
    low = next((said[key] for key in ("Minimum Value", "Valid Values Begin With") if key in said), None)
    high = next((said[key] for key in ("Maximum Value", "Valid Values End With") if key in said), None)
    allowed = f", allowed are {low} to {high}" if low and high else f", at most {high}" if high else ""
    if "Allowed" in said:
        allowed = f", allowed is: {said['Allowed']}"
    return f"{asked} was asked for{allowed}"


def _first_sentence(text: str) -> str:
    return _ADDED.sub("", text).strip().split("\n")[0].rstrip(".")
