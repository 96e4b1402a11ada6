"""What a recorder and its clients say to each other: JSON with arrays behind it, never code.

A message is a kind, values that JSON can hold, and float64 arrays. On the wire it is the length of the JSON text
(4 bytes, little-endian), the text, then the arrays one after the other.

===============  =================================================================================
to the recorder
===============  =================================================================================
``start``        the plan is agreed to: go
``stop``         end the run now and keep it, and do nothing more
``abort``        end the run and the experiment; what was recorded is kept, marked ``aborted``
``zero``         emergency: output to 0 V now, then as ``abort``
``mark``         ``text``: note it at this moment of the run
``answer``       ``number`` (of the question) and ``value``
``subscribe``    ``blocks``: whether to send what is being read; ``answers``: whether somebody here can answer
===============  =================================================================================

===============  =================================================================================
to the clients
===============  =================================================================================
``plan``         what is going to happen, as ``Plan.as_dict`` gives it
``step``         a step began: ``name``, ``text``, ``seconds``, ``asks`` (whether it asks something)
``question``     ``number``, ``step``, ``text``, ``choices``, ``default``, and where a number with its unit is an answer
                 too an ``example`` of one; open until ``answered``
``answered``     ``number``, ``step``, ``value``, ``by``
``begun``        rows go to a journal from now on: ``uuid``, ``journal``
``run``          a recording began: ``uuid``, ``signal``, ``purpose``, ``rate``, ``rows``, ``place``, ``of``
``block``        ``first_row`` and an array for each channel [SI]
``air``          ``time``, and those of ``SLOW_CHANNELS`` that are read
``condition``    the chamber is brought to another condition: ``number``, ``of``, ``name``
``chamber``      what the chamber reports of itself: ``temperature``, ``relative_humidity``, their set points, ``mode``,
                 ``is_still``, ``alarms``
``equilibrium``  how far the waiting for it has come: ``waited``, ``longest``, ``settled_for``, ``settle``, ``is_over``
``progress``     ``rows`` read and ``acknowledged`` (on disk), ``of`` as many as the run will have
``event``        something happened in a run: ``event``, ``time``, ``text``; with ``ending`` the output is at 0 V, as an
                 operator wanted (``stop``, ``abort`` or ``zero``) or because a limit was passed (``limit``), and only
                 what follows it is still recorded
``note``         something to know: ``text``
``recorded``     a run is on disk: ``path``, ``state``, ``state_reason``, ``purpose``, ``findings``
``ended``        the last message: ``status``, and ``error`` where it failed
===============  =================================================================================
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError

FloatArray = npt.NDArray[np.float64]

REQUESTS: Final = ("start", "stop", "abort", "zero", "mark", "answer", "subscribe")
"""What a client may ask for."""

LONGEST_REQUEST: Final = 64 * 1024
"""Bytes that a client may send at once."""

_LENGTH: Final = struct.Struct("<I")


@dataclass(frozen=True)
class Message:
    """One message.

    Parameters
    ----------
    kind : str
    values : mapping
        What JSON can hold.
    arrays : mapping of name to float array, shape (n,)
    at : float, optional [s since 1970]
        When it was sent first: who comes later gets it again.
    """

    kind: str
    values: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)
    at: float | None = field(default=None, compare=False)

    def __getitem__(self, name: str) -> Any:
        return self.values[name]


def encode(message: Message) -> bytes:
    """A message as it goes over the wire.

    Examples
    --------
    >>> decode(encode(Message("mark", {"text": "fan on"}))).values["text"]
    'fan on'
    """
    arrays = {name: np.ascontiguousarray(array, dtype="<f8") for name, array in message.arrays.items()}
    head: dict[str, Any] = {
        "kind": message.kind,
        "values": message.values,
        "arrays": {name: len(one) for name, one in arrays.items()},
    }
    if message.at is not None:
        head["at"] = message.at
    text = json.dumps(head).encode()
    return b"".join([_LENGTH.pack(len(text)), text, *(array.tobytes() for array in arrays.values())])


def decode(payload: bytes) -> Message:
    """A message from what came over the wire.

    Raises
    ------
    IpmclabError
        Anything that is no message.
    """
    try:
        (length,) = _LENGTH.unpack_from(payload)
        head = json.loads(payload[_LENGTH.size : _LENGTH.size + length])
        kind, values, lengths = head["kind"], head["values"], head["arrays"]
        sent_at = head.get("at")
        sent_at = float(sent_at) if isinstance(sent_at, int | float) else None
        if not (isinstance(kind, str) and isinstance(values, dict) and isinstance(lengths, dict)):
            raise TypeError("a field of another kind")
        at = _LENGTH.size + length
        arrays = {}
        for name, count in lengths.items():
            if type(count) is not int or count < 0:
                raise TypeError("no length")
            arrays[str(name)] = np.frombuffer(payload, dtype="<f8", count=count, offset=at).astype(np.float64)
            at += 8 * count
        if at != len(payload):
            raise ValueError("bytes left over")
    except (struct.error, ValueError, KeyError, TypeError, RecursionError) as error:
        raise IpmclabError(
            f"what came is no message: {error}",
            code="bad-message",
            where="recorder",
            repair="use the same version of ipmclab at both ends",
        ) from error
    return Message(kind, values, arrays, sent_at)
