"""What channels tell at rest, where readings are few, drift, or are lost."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import IpmclabError
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.recording import zeroing
from ipmclab.rig.recording.zeroing import (
    Rest,
    contact_levels,
    is_discharged,
    read_rest,
    read_tare,
    subtracted,
    uncertainties,
    wait_for_preload,
)
from ipmclab.run import ZeroReading
from tests.rig.toy_bench import ToyBench

FloatArray = npt.NDArray[np.float64]

RATE = 50.0
MN = 1e-3
NAMES = ("voltage", "force")


def drifting(rows: FloatArray, _: FloatArray) -> FloatArray:
    """5 mN and 0.5 mN/s more."""
    return 5 * MN + 0.5 * MN * rows / RATE


def opened(bench: ToyBench, names: tuple[str, ...] = NAMES, rate: float = RATE) -> ToyBench:
    bench.open(names, rate)
    return bench


def test_a_drift_is_told_apart_from_noise() -> None:
    def noisy(rows: FloatArray, output: FloatArray) -> FloatArray:
        return drifting(rows, output) + 0.01 * MN * np.where(rows % 2, 1.0, -1.0)

    rest = read_rest(opened(ToyBench({"force": noisy})), NAMES, RATE, when="after", duration=4.0, force="tare")
    force = rest["force"]
    assert (force.channel, force.kind, force.when, rest["voltage"].kind) == ("force", "tare", "after", "zero")
    assert force.value == pytest.approx(5 * MN + 0.5 * MN * 199 / 2 / RATE, rel=1e-9)
    assert force.drift == pytest.approx(0.5 * MN, rel=2e-4)
    assert rest.noise["force"] == pytest.approx(0.01 * MN * np.sqrt(200 / 198), rel=1e-3)
    assert force.standard_uncertainty == pytest.approx(rest.noise["force"] / np.sqrt(200))
    first, last, deviation = rest.ends["force"]
    assert first == pytest.approx(5 * MN + 0.5 * MN * 39 / 2 / RATE, rel=1e-9)
    assert last == pytest.approx(5 * MN + 0.5 * MN * (160 + 39 / 2) / RATE, rel=1e-9)
    # Of differences of neighbours, 0.03 and -0.01 mN here, over 40 readings.
    assert deviation == pytest.approx(np.sqrt((0.02**2 + 0.01**2) / 2 / 40) * MN, rel=0.02)


def test_each_block_at_rest_is_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer that paused before a block came did not hold up those that came after it."""
    done: list[str] = []

    @contextmanager
    def told(when: str) -> Iterator[SimpleNamespace]:
        yield SimpleNamespace(progress=lambda: done.append(when))

    monkeypatch.setattr(zeroing, "own_pauses_reported", told)
    read_rest(opened(ToyBench()), NAMES, RATE, when="before", duration=0.2)
    assert done == ["while the channels were read at 0 V"] * 5


def test_the_offset_of_a_sensor_is_in_what_it_tells_at_rest() -> None:
    rest = read_rest(opened(ToyBench(), ("voltage", "displacement")), ["displacement"], RATE, when="before", duration=1)
    assert rest["displacement"].value == pytest.approx(12e-3)
    assert rest.ends["displacement"][:2] == pytest.approx((12e-3, 12e-3))


@pytest.mark.parametrize("duration", [0.0, 0.02, 0.04, 0.06])
def test_however_short_it_is_a_reading_tells_its_noise_and_drift(duration: float) -> None:
    """Of one row it would be said to be known exactly, and to have settled."""

    def bent(rows: FloatArray, _: FloatArray) -> FloatArray:
        return np.choose(rows.astype(int), [5 * MN, 6 * MN, 6 * MN])

    rest = read_rest(opened(ToyBench({"force": bent})), NAMES, RATE, when="before", duration=duration)
    force = rest["force"]
    assert rest.ends["force"] == pytest.approx((5 * MN, 6 * MN, 0.0))
    assert force.drift == pytest.approx(0.5 * MN * RATE)
    assert force.standard_uncertainty == pytest.approx(MN * np.sqrt(1 / 6 / 3))


def test_a_reading_of_which_too_few_rows_came_is_refused() -> None:
    bench = opened(ToyBench())
    whole = bench.apply
    bench.apply = lambda *asked: list(whole(*asked))[:1]  # type: ignore[method-assign, assignment, return-value]
    with pytest.raises(IpmclabError, match="2 rows were read at rest, 3 are needed"):
        read_rest(bench, NAMES, RATE, when="before", duration=0.1)


def test_one_reading_without_a_strip_spoils_the_reading_at_rest() -> None:
    def lost_once(rows: FloatArray, _: FloatArray) -> FloatArray:
        lost = THESIS_RIG["displacement"].gain * 1.5 + THESIS_RIG["displacement"].offset
        return np.where(rows == 7, lost, 12e-3)

    names = ("voltage", "displacement")
    with pytest.raises(IpmclabError, match="the strip at rest is not in the range of the sensor") as caught:
        read_rest(opened(ToyBench({"displacement": lost_once}), names), names, RATE, when="before", duration=1.0)
    assert caught.value.where == "displacement"


def test_a_tare_closes_the_bench_also_when_it_fails() -> None:
    bench = ToyBench()
    assert read_tare(bench, RATE, when="after", duration=0.2).when == "after"
    assert (bench.said[0], bench.said[-1]) == ("open", "close")
    stuck = ToyBench({"voltage": lambda rows, _: np.ones(len(rows))})
    with pytest.raises(IpmclabError, match="the output should be at 0 V and 1 V are read"):
        read_tare(stuck, RATE, when="before", duration=1.0)
    assert stuck.said[-1] == "close"


def settling(rows: FloatArray, output: FloatArray) -> FloatArray:
    """The drift stops after 0.8 s."""
    return drifting(np.minimum(rows, 40.0), output)


@pytest.mark.parametrize(
    ("duration", "longest", "readings"),
    [(0.4, 2.0, 3), (0.4, 1.2, 3), (0.4, 0.8, None), (0.4, 1.19, None), (0.2, 1.0, 5), (0.1, 0.9, 9), (0.0, 0.6, None)],
)
def test_a_preload_may_take_as_long_as_it_is_given_to_settle(
    duration: float, longest: float, readings: int | None
) -> None:
    """A sum of times that is rounded takes no reading away: 0.1 s nine times are 0.9 s."""
    bench, seen = opened(ToyBench({"force": settling})), list[ZeroReading]()

    def wait() -> Rest:
        return wait_for_preload(
            bench, NAMES, RATE, most_drift=1e-6, duration=duration, longest_wait=longest, on_reading=seen.append
        )

    if readings is None:
        with pytest.raises(IpmclabError, match=r"the preload still drifts by 500 uN/s after .* 1 uN/s are allowed"):
            wait()
        each = max(duration, 3 / RATE)
        assert len(seen) == int(longest / each + 1e-9)
    else:
        assert wait()["force"] == seen[-1]
        assert len(seen) == readings


@pytest.mark.parametrize(
    ("sign", "most", "settles"), [(1, 0.6, True), (-1, 0.6, True), (1, 0.4, False), (-1, 0.4, False)]
)
def test_a_preload_drifts_up_or_down(sign: int, most: float, settles: bool) -> None:
    bench = opened(ToyBench({"force": lambda rows, _: 5 * MN + sign * 0.5 * MN * rows / RATE}))

    def wait() -> Rest:
        return wait_for_preload(bench, NAMES, RATE, most_drift=most * MN, duration=0.2, longest_wait=0.2)

    if settles:
        assert wait()["force"].drift == pytest.approx(sign * 0.5 * MN)
    else:
        with pytest.raises(IpmclabError, match="still drifts"):
            wait()


STEP = THESIS_RIG["current"].converter.step * THESIS_RIG["current"].gain


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("first", "last", "deviation", "discharged"),
    [
        (9.0, 1.0, 0.0, True),  # it ended within a step of its converter
        (9.0, 1.1, 0.0, False),
        (2.0, 1.1, 0.0, None),  # it stands still beside zero
        (0.0, 1.1, 0.0, None),  # it grew: that is no discharge
        (9.0, 4.9, 1.0, True),  # four deviations and a step
        (11.0, 5.1, 1.0, False),
        (10.0, 5.1, 1.0, None),
    ],
)
def test_a_discharge_is_told_from_an_offset(
    sign: float, first: float, last: float, deviation: float, discharged: bool | None
) -> None:
    ends = {"current": (sign * first * STEP, sign * last * STEP, deviation * STEP)}
    current = replace(THESIS_RIG["current"], gain=-0.5)
    halved = {"current": (-0.5 * ends["current"][0], -0.5 * ends["current"][1], 0.5 * ends["current"][2])}
    assert is_discharged(THESIS_RIG, Rest((), {}, ends)) is discharged
    assert is_discharged(replace(THESIS_RIG, channels=(current,)), Rest((), {}, halved)) is discharged
    assert is_discharged(THESIS_RIG, Rest((), {})) is None


def preload(value: float, noise: float) -> Rest:
    return Rest((ZeroReading("force", "preload", "before", value, 0.0),), {"force": noise})


def test_contact_is_told_by_the_last_tare_of_the_load_cell() -> None:
    tares = [
        ZeroReading("force", "tare", "before", 9.0, 0.0),
        ZeroReading("force", "tare", "before", 6.0, 0.0),
        ZeroReading("force", "tare", "before", 1.0, 0.0),
        ZeroReading("force", "preload", "before", 8.0, 0.0),
        ZeroReading("voltage", "tare", "before", 7.0, 0.0),
    ]
    assert contact_levels(THESIS_RIG, preload(2.01, 0.25), tares) == {"force": 2.0}
    with pytest.raises(IpmclabError, match="the tip does not press"):
        contact_levels(THESIS_RIG, preload(2.0, 0.25), tares)
    assert contact_levels(THESIS_RIG, Rest((), {}), tares) == {}


def test_without_a_tare_contact_is_told_by_the_end_of_the_sensor_where_the_preload_is_clear_of_it() -> None:
    force = replace(THESIS_RIG["force"], sensor_range=(1.0, 100.0))
    rig = replace(THESIS_RIG, channels=(*(one for one in THESIS_RIG.channels if one.name != "force"), force))
    assert contact_levels(rig, preload(3.01, 0.25), []) == {"force": 2.0}
    assert contact_levels(rig, preload(3.0, 0.25), []) == {}
    endless = replace(rig, channels=(*rig.channels[:-1], replace(force, sensor_range=None)))
    assert contact_levels(endless, preload(3.01, 0.25), []) == {}


def test_only_the_reading_of_a_zeroed_channel_is_subtracted() -> None:
    rest = Rest(tuple(ZeroReading(name, "zero", "before", 0.5, 0.0) for name in ("current", "displacement")), {})
    assert subtracted(THESIS_RIG, rest) == {"current": 0.0, "displacement": 0.5}


def test_the_last_reading_of_each_kind_counts_in_an_uncertainty() -> None:
    zeros = [
        ZeroReading("force", "preload", "before", 9.0, 5.0),
        ZeroReading("force", "preload", "before", 8.0, 5.0),
        ZeroReading("force", "preload", "before", 2.0, 0.3),
        ZeroReading("force", "preload", "after", 7.0, 4.0),
        ZeroReading("force", "preload", "after", 6.0, 4.0),
        ZeroReading("force", "preload", "after", 3.0, 4.0),
        ZeroReading("displacement", "zero", "after", 3.0, 4.0),
    ]
    channels = [THESIS_RIG["force"], THESIS_RIG["displacement"]]
    assert uncertainties(channels, zeros) == pytest.approx({"force": np.sqrt(0.3**2 + 1.0 / 3.0)})
    assert uncertainties(channels, zeros[:3]) == {"force": 0.3}
    assert uncertainties(channels, zeros[3:]) == {}
