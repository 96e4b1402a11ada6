"""What goes over the wire between a recorder and its clients."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ipmclab.errors import IpmclabError
from ipmclab.rig.process.messages import Message, decode, encode

TEXT = st.text(max_size=20)
VALUES = st.dictionaries(
    TEXT, st.none() | st.booleans() | st.integers() | TEXT | st.lists(TEXT, max_size=3), max_size=4
)
ARRAYS = st.dictionaries(TEXT, arrays.arrays(np.float64, st.integers(0, 50)), max_size=4)


@given(st.builds(Message, TEXT, VALUES, ARRAYS))
def test_a_message_comes_back(message: Message) -> None:
    again = decode(encode(message))
    assert (again.kind, dict(again.values)) == (message.kind, dict(message.values))
    assert list(again.arrays) == list(message.arrays)
    for name, values in message.arrays.items():
        np.testing.assert_array_equal(again.arrays[name], values)


@given(st.binary(max_size=30))
def test_what_is_shorter_than_any_message_is_refused(payload: bytes) -> None:
    with pytest.raises(IpmclabError, match="what came is no message"):
        decode(payload)


@given(st.builds(Message, TEXT, VALUES, ARRAYS), st.data())
def test_a_message_that_lost_its_end_or_has_more_behind_it_is_refused(message: Message, data: st.DataObject) -> None:
    whole = encode(message)
    for payload in (whole[: data.draw(st.integers(0, len(whole) - 1))], whole + data.draw(st.binary(min_size=1))):
        with pytest.raises(IpmclabError, match="what came is no message"):
            decode(payload)


@pytest.mark.parametrize(
    "text",
    [
        b"[]",
        b'{"kind": 1, "values": {}, "arrays": {}}',
        b'{"kind": "a", "values": {}, "arrays": {"x": -1}}',
        b"[" * 9999,
    ],
)
def test_json_of_another_shape(text: bytes) -> None:
    with pytest.raises(IpmclabError, match="no message"):
        decode(len(text).to_bytes(4, "little") + text)
