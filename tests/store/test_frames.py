"""Frames: what is whole comes back exactly, and nothing else ever does."""

from __future__ import annotations

import io
from dataclasses import replace
from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.store.journal import frames as frames_module
from ipmclab.store.journal.frames import DATA, END, EVENT, HEADER, HEADER_SIZE, MAGIC, Damage, Frame, read_frames


@st.composite
def frames(draw: st.DrawFn) -> list[Frame]:
    """A journal's frames, numbered and placed as its writer would."""
    made: list[Frame] = []
    offset = 0
    for sequence in range(draw(st.integers(1, 6))):
        kind = draw(st.sampled_from([HEADER, DATA, EVENT, END]))
        columns, rows, first_row = 0, 0, 0
        if kind == DATA:
            columns, rows = draw(st.integers(1, 3)), draw(st.integers(1, 4))
            first_row = draw(st.integers(0, 2**63))
        size = columns * rows * 8
        payload = draw(st.binary(min_size=size, max_size=size) if kind == DATA else st.binary(max_size=60))
        made.append(Frame(kind, payload, sequence, columns, rows, first_row, offset))
        offset += len(made[-1])
    return made


def encoded(made: list[Frame]) -> bytes:
    return b"".join(frame.encode() for frame in made)


def read(content: bytes) -> tuple[list[Frame], list[Damage]]:
    found = list(islice(read_frames(io.BytesIO(content)), 30))
    return [item for item in found if isinstance(item, Frame)], [item for item in found if isinstance(item, Damage)]


@given(frames())
def test_what_is_written_is_read(made: list[Frame]) -> None:
    assert read(encoded(made)) == (made, [])


@given(frames(), st.binary(min_size=1, max_size=200) | st.just(MAGIC * 30) | st.just(b"\0" * 4096))
def test_what_is_no_frame_is_dropped_and_counted(made: list[Frame], rubbish: bytes) -> None:
    """Rubbish at the end, as a power cut leaves it, adds nothing and takes nothing away."""
    got, damage = read(encoded(made) + rubbish)
    assert got == made
    assert sum(len(one) for one in damage) == len(rubbish)


@given(frames(), st.data())
def test_a_hole_takes_only_the_frames_that_it_touches(made: list[Frame], data: st.DataObject) -> None:
    """Zeroed bytes in the middle, as a lost page leaves them: the frames before and behind come back."""
    content = bytearray(encoded(made))
    start = data.draw(st.integers(0, len(content) - 1))
    stop = data.draw(st.integers(start + 1, len(content)))
    before = bytes(content)
    content[start:stop] = bytes(stop - start)
    touched = {place for place in range(start, stop) if before[place]}
    whole = [frame for frame in made if not touched & set(range(frame.offset, frame.offset + len(frame)))]
    assert read(bytes(content))[0] == whole


def test_a_frame_that_stands_twice_counts_once() -> None:
    """What a copy of a part of a disk doubles is no second reading."""
    made = journal()
    for place, frame in enumerate(made):
        doubled = encoded(made[: place + 1]) + frame.encode() + encoded(made[place + 1 :])
        got, damage = read(doubled)
        assert [(one.sequence, one.payload) for one in got] == [(one.sequence, one.payload) for one in made]
        end = frame.offset + len(frame)
        assert [(one.start, one.stop, one.reason) for one in damage] == [
            (end, end + len(frame), "a frame is out of order")
        ]


def test_a_frame_is_found_wherever_the_pieces_meet_in_which_it_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind damage the next frame is looked for piece by piece: its first letters may stand in two of them."""
    monkeypatch.setattr(frames_module, "_WINDOW", 64)
    content = encoded(journal())
    for length in range(1, 200):
        got, damage = read(b"\0" * length + content)
        assert [replace(frame, offset=frame.offset - length) for frame in got] == journal()
        assert [(one.start, one.stop) for one in damage] == [(0, length)]


def journal() -> list[Frame]:
    rows = b"".join(bytes([number] * 8) for number in range(1, 7))
    made: list[Frame] = []
    for kind, payload, columns, count in ((HEADER, b"{}", 0, 0), (DATA, rows, 2, 3), (EVENT, b"{}", 0, 0)):
        offset = made[-1].offset + len(made[-1]) if made else 0
        made.append(Frame(kind, payload, len(made), columns, count, 0, offset))
    return made


def test_a_file_cut_at_any_byte_gives_its_whole_frames() -> None:
    made = journal()
    content = encoded(made)
    for length in range(len(content) + 1):
        got, damage = read(content[:length])
        assert got == [frame for frame in made if frame.offset + len(frame) <= length]
        assert sum(len(one) for one in damage) == length - sum(len(frame) for frame in got)
        rest = length - sum(len(frame) for frame in got)
        torn = "it ends inside the head of a frame" if rest < HEADER_SIZE else "it ends inside a frame"
        assert [one.reason for one in damage] == ([torn] if rest else [])


def test_a_flipped_bit_anywhere_costs_one_frame_and_never_a_wrong_value() -> None:
    made = journal()
    content = encoded(made)
    for place in range(len(content)):
        hit = next(frame for frame in made if frame.offset <= place < frame.offset + len(frame))
        for bit in range(8):
            flipped = bytearray(content)
            flipped[place] ^= 1 << bit
            got, damage = read(bytes(flipped))
            assert got == [frame for frame in made if frame is not hit]
            part = "head" if place - hit.offset < HEADER_SIZE else "content"
            assert damage == [Damage(hit.offset, hit.offset + len(hit), f"the {part} of a frame is damaged")]


@pytest.mark.parametrize(("rows", "columns"), [(2, 4), (4, 2), (6, 2), (0, 0), (0, 6)])
def test_rows_that_do_not_fill_their_frame_are_not_believed(rows: int, columns: int) -> None:
    """A whole frame of six numbers that says that it holds others: nobody knows which number is whose."""
    header, data, event = journal()
    claimed = replace(data, rows=rows, columns=columns)
    assert read(encoded([header, claimed, event])) == (
        [header, event],
        [Damage(data.offset, data.offset + len(data), "a frame is out of order")],
    )


def test_numbers_of_frames_may_have_gaps() -> None:
    """What a disk lost between two frames costs neither of them."""
    header, data, event = journal()
    made = [header, replace(data, sequence=5), replace(event, sequence=2**63)]
    assert read(encoded(made)) == (made, [])


def test_the_layout_is_what_the_docs_say() -> None:
    """Other programs read journals too: 40 bytes of head, little-endian; what is no rows has 0 of them."""
    assert (HEADER, DATA, EVENT, END) == (1, 0, 2, 4)
    note = Frame(EVENT, b"{}", 0)
    assert (note.encode()[6:12], note.encode()[24:32]) == (bytes(6), bytes(8))
    assert read(note.encode()) == ([note], [])
    head = Frame(DATA, b"x" * 16, 7, 2, 1, 1234567890123).encode()
    assert HEADER_SIZE == 40
    assert head[:4] == b"RUNF"
    assert [int.from_bytes(head[start:stop], "little") for start, stop in ((4, 6), (6, 8), (8, 12), (12, 16))] == [
        DATA,
        2,
        1,
        16,
    ]
    assert int.from_bytes(head[16:24], "little") == 7
    assert int.from_bytes(head[24:32], "little") == 1234567890123
