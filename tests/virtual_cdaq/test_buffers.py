"""The rings against plain lists."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from virtual_cdaq.model.buffers import InputBuffer, OutputBuffer, default_input_size
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.names import expand


@given(st.integers(1, 20), st.lists(st.tuples(st.booleans(), st.integers(0, 30)), max_size=30))
def test_an_input_buffer_gives_every_sample_once_or_says_that_it_lost_some(size, steps):
    buffer = InputBuffer(2, size)
    waiting: list[int] = []
    made = 0
    for put, count in steps:
        if put:
            fresh = list(range(made, made + count))
            made += count
            waiting += fresh
            buffer.put(np.array([fresh, [-each for each in fresh]], dtype=np.int32).reshape(2, count))
            continue
        count = min(count, buffer.available)
        if len(waiting) > size:
            with pytest.raises(ChassisError) as caught:
                buffer.take(count)
            assert caught.value.code == -200279
            return
        expected, waiting = waiting[:count], waiting[count:]
        assert buffer.take(count).tolist() == [expected, [-each for each in expected]]


def test_a_full_input_buffer_has_lost_nothing_and_one_sample_more_is_lost():
    buffer = InputBuffer(1, 5)
    buffer.put(np.arange(5, dtype=np.int32)[None, :])
    assert not buffer.overwritten
    buffer.put(np.array([[5]], dtype=np.int32))
    assert buffer.overwritten
    with pytest.raises(ChassisError):
        buffer.take(1)
    buffer.skip_lost()
    assert buffer.take(5).tolist() == [[1, 2, 3, 4, 5]]


@given(st.integers(1, 20), st.lists(st.tuples(st.booleans(), st.integers(0, 30)), max_size=30))
def test_an_output_buffer_without_regeneration_is_a_queue(size, steps):
    buffer = OutputBuffer(1, size)
    queue: list[int] = []
    made = 0
    for put, count in steps:
        if put:
            count = min(count, buffer.space)
            queue += list(range(made, made + count))
            buffer.put(np.arange(made, made + count, dtype=np.int32)[None, :])
            made += count
        else:
            expected, queue = queue[:count], queue[count:]
            assert buffer.take(count, again=False).tolist() == [expected]
        assert buffer.space == size - len(queue)


def test_an_output_buffer_with_regeneration_goes_round():
    buffer = OutputBuffer(1, 3)
    buffer.put(np.array([[7, 8, 9]], dtype=np.int32))
    assert buffer.take(7, again=True).tolist() == [[7, 8, 9, 7, 8, 9, 7]]
    buffer.rewind()
    assert buffer.take(2, again=True).tolist() == [[7, 8]]


def test_a_buffer_beyond_all_memory_is_refused():
    with pytest.raises(ChassisError) as caught:
        InputBuffer(4, 10**9)
    assert caught.value.code == -50352


# NI-DAQmx's help, "How Is Buffer Size Determined?".
@pytest.mark.parametrize(("rate", "size"), [(100.0, 1_000), (101.0, 10_000), (10_000.0, 10_000), (10_001.0, 100_000)])
def test_the_driver_chooses_the_buffer_of_a_continuous_acquisition(rate, size):
    assert default_input_size(rate) == size


@given(st.integers(0, 31), st.integers(0, 31))
def test_a_range_of_channels_runs_both_ways_and_names_both_ends(first, last):
    names = expand(f"cDAQ1Mod1/ai{first}:{last}")
    assert (names[0], names[-1]) == (f"cDAQ1Mod1/ai{first}", f"cDAQ1Mod1/ai{last}")
    assert len(names) == abs(last - first) + 1
    assert expand(f"cDAQ1Mod1/ai{first}:cDAQ1Mod1/ai{last}") == names


def test_a_buffer_beyond_1_gib_is_refused():
    with pytest.raises(ChassisError) as caught:
        InputBuffer(2, 2**30 // 4 // 2 + 1)  # of 4 bytes a sample
    assert caught.value.code == -50352
