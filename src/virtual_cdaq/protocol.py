"""NI's messages and the names of the service's calls: the only module that imports NI's client.

``nidaqmx._stubs`` is private to the client. Two copies of one .proto cannot live in one process, so the stand-in uses
the client's own; a client whose stubs lie elsewhere is named here and nowhere else.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as messages

try:
    from session_pb2 import Session
except ImportError:  # clients before 1.1 keep it among their own stubs
    from nidaqmx._stubs.session_pb2 import Session  # type: ignore[no-redef]

__all__ = ["SERVICE", "AttributeCall", "Method", "Session", "attribute_call", "message", "methods", "packed_doubles"]

_DESCRIPTOR = messages.DESCRIPTOR.services_by_name["NiDAQmx"]
SERVICE: str = _DESCRIPTOR.full_name

_ATTRIBUTE = re.compile(r"(?P<verb>Get|Set|Reset)(?P<scope>[A-Z]\w*?)Attribute(?P<ex>Ex)?(?P<type>[A-Z]\w*)?")
# The word that the enumerations of a scope use in place of the scope's own.
_SCOPE_WORD = {
    "CalInfo": "CalibrationInfo",
    "Chan": "Channel",
    "ExportedSignal": "ExportSignal",
    "PersistedChan": "PersistedChannel",
    "PhysicalChan": "PhysicalChannel",
    "SystemInfo": "System",
    "Trig": "Trigger",
}
_TYPE_ENDING = re.compile(r"^[A-Z0-9]+(?:_[A-Z0-9]+)*?_ATTRIBUTE_")
# What the client asks for and the .proto does not list.
_UNLISTED = {12776: "DEFAULT_NUMBER_OF_SAMPLES_TO_READ"}


@dataclass(frozen=True)
class Method:
    """One call of the service."""

    name: str
    request: Any
    response: Any
    streams: bool


@dataclass(frozen=True)
class AttributeCall:
    """One of the calls that get, set or reset a property.

    Parameters
    ----------
    verb : {"Get", "Set", "Reset"}
    scope : str
        Such as ``Chan`` or ``Timing``.
    type : str
        Such as ``Double``; empty for a reset.
    names : dict of int to str
        Symbolic names of the properties by number, without the prefix of their scope.
    """

    verb: str
    scope: str
    type: str
    names: dict[int, str]


def message(name: str) -> Any:
    """The class of a message."""
    return getattr(messages, name)


@functools.cache
def methods() -> tuple[Method, ...]:
    """All calls of NI's service."""
    found = []
    for method in _DESCRIPTOR.methods:
        name = method.name
        found.append(Method(name, message(method.input_type.name), message(method.output_type.name), _streams(name)))
    return tuple(found)


def _streams(name: str) -> bool:
    return name in ("RegisterDoneEvent", "RegisterEveryNSamplesEvent", "RegisterSignalEvent")


@functools.cache
def attribute_call(name: str) -> AttributeCall | None:
    """What a call does with a property; None for other calls.

    Examples
    --------
    >>> call = attribute_call("GetChanAttributeDouble")
    >>> call.scope, call.names[6109]
    ('Chan', 'AI_MAX')
    """
    match = _ATTRIBUTE.fullmatch(name)
    if match is None:
        return None
    scope = match["scope"]
    kind = match["type"] or ""
    word = _SCOPE_WORD.get(scope, scope)
    enumeration = f"{word}{kind or 'Reset'}Attribute"
    listed = messages.DESCRIPTOR.enum_types_by_name.get(enumeration)
    names = dict(_UNLISTED)
    if listed is not None:
        names.update((value.number, _TYPE_ENDING.sub("", value.name)) for value in listed.values)
    return AttributeCall(match["verb"], scope, kind, names)


def packed_doubles(number: int, data: bytes) -> bytes:
    """A field of repeated doubles on the wire, from their little-endian bytes.

    A message would take every number through Python; at 240,000 samples a second that is most of the work.
    """
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
