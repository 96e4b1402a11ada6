"""Every driver against an emulated instrument on a real socket or pseudo-terminal: what it does where all is well."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from ipmclab.errors import InputError
from ipmclab.rig.chambers.chamber import ChamberError
from tests.rig.chambers.benches_of_chambers import (
    BY_CONVERTER,
    KINDS,
    WANTED,
    Kind,
    Pair,
    Quick,
    at_once,
    paired,
    set_by_another,
)
from tests.rig.chambers.devices import EspecDevice


@pytest.mark.parametrize("kind", [*KINDS, *BY_CONVERTER], ids=str)
def test_a_driver_sets_reads_is_still_and_goes_to_standby(kind: Kind, tmp_path: Path) -> None:
    with paired(kind, tmp_path) as pair:
        chamber, room = pair.chamber, pair.room
        before = chamber.read()
        assert (before.mode, before.temperature_set_point, before.alarms) == ("standby", None, ())
        chamber.set(*WANTED)
        now = chamber.read()
        assert (now.mode, now.temperature) == ("constant", WANTED[0])
        assert now.relative_humidity == pytest.approx(WANTED[1], abs=0.1)
        assert now.temperature_set_point == pytest.approx(WANTED[0], abs=0.05)
        assert now.humidity_set_point == pytest.approx(WANTED[1], abs=0.1)
        assert chamber.still(60.0).longest == 60.0
        assert room.mode == "STANDBY"
        assert chamber.read().mode == "standby"
        chamber.resume()
        assert room.mode == "CONSTANT"
        chamber.safe()
        chamber.safe()
        assert room.mode == "STANDBY"
        assert all(one == pytest.approx(WANTED, abs=0.1) for one in room.regulated)
        chamber.close()
        assert chamber.read().mode == "standby", "a closed line opens again"


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.driver not in ("dew-point", "modbus")], ids=str)
def test_no_humidity_is_regulated_where_none_is_asked_for(kind: Kind, tmp_path: Path) -> None:
    with paired(kind, tmp_path) as pair:
        pair.chamber.set(40.0, None)
        assert pair.chamber.read().humidity_set_point is None
        assert pair.room.regulated == [(40.0, None)]


def test_no_humidity_is_refused_where_a_table_has_no_word_for_it(tmp_path: Path) -> None:
    for kind in (kind for kind in KINDS if kind.driver == "modbus"):
        with paired(kind, tmp_path) as pair:
            with pytest.raises(InputError, match="cannot switch the humidity off"):
                pair.chamber.set(40.0, None)
            assert (pair.emulator.asked, pair.room.regulated) == (0, [])


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_set_points_outside_the_range_of_the_rig_file_are_never_sent(kind: Kind, tmp_path: Path) -> None:
    with paired(kind, tmp_path) as pair:
        for asked in ((80.0, 50.0), (25.0, 99.0), (float("nan"), 50.0)):
            with pytest.raises(InputError):
                pair.chamber.set(*asked)
        assert pair.emulator.asked == 0


def test_degrees_fahrenheit_are_understood_or_refused(tmp_path: Path) -> None:
    for kind in KINDS:
        if kind.driver in ("dew-point", "modbus"):
            continue
        with paired(kind, tmp_path) as pair:
            pair.room.fahrenheit = True
            if kind.driver == "watlow-f4t":  # as it leaves the factory
                pair.chamber.set(*WANTED)
                assert pair.room.regulated == [WANTED]
                assert pair.chamber.read().temperature == pytest.approx(WANTED[0], abs=1e-4)
                continue
            with pytest.raises(ChamberError) as caught:
                pair.chamber.set(*WANTED)
            assert caught.value.code == "chamber-unit"
            assert pair.room.regulated == []


def test_a_unit_that_no_table_knows_of_shows_in_the_set_point(tmp_path: Path) -> None:
    kind = next(kind for kind in KINDS if kind.driver == "modbus")
    with paired(kind, tmp_path) as pair:
        pair.chamber.set(*WANTED)
        pair.room.fahrenheit = True  # somebody at its panel
        assert pair.chamber.read().temperature_set_point == pytest.approx(77.0)
        pair.chamber.safe()
        pair.room.fahrenheit = False
        pair.room.shown = lambda value: 1.8 * value + 32.0  # type: ignore[method-assign]
        with pytest.raises(ChamberError, match="degrees Fahrenheit; it was brought to standby"):
            pair.chamber.set(*WANTED)
        assert pair.room.mode == "STANDBY"


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_a_second_client_is_noticed(kind: Kind, tmp_path: Path) -> None:
    with paired(kind, tmp_path) as pair:
        pair.chamber.set(*WANTED)
        set_by_another(pair, kind)
        stated = pair.chamber.read()
        assert (stated.mode, stated.humidity_set_point) == ("constant", pytest.approx(42.0, abs=6.0))
        assert stated.humidity_set_point != pytest.approx(WANTED[1], abs=5.0)
        pair.chamber.safe()
        assert pair.room.mode == "STANDBY"


def test_a_chamber_that_follows_a_program_is_left_to_it(tmp_path: Path) -> None:
    with paired(KINDS[0], tmp_path) as pair:
        pair.room.mode = "RUN"
        with pytest.raises(ChamberError) as caught:
            pair.chamber.set(*WANTED)
        assert (caught.value.code, pair.room.mode) == ("chamber-in-use", "RUN")


def test_an_alarm_is_told_and_nothing_is_set_over_it(tmp_path: Path, quick: Quick) -> None:
    def trip(pair: Pair) -> None:
        pair.chamber.set(*WANTED)
        pair.room.trip()
        stated = pair.chamber.read()
        assert (stated.mode, len(stated.alarms)) == ("standby", 1)

    def be_refused(pair: Pair) -> None:
        with pytest.raises(ChamberError, match="brought to standby"):
            pair.chamber.set(*WANTED)

    def clear(pair: Pair) -> None:
        pair.chamber.safe()
        pair.room.alarms = []
        assert pair.chamber.read().alarms == ()

    with ExitStack() as stack:
        pairs = [stack.enter_context(paired(kind, tmp_path)) for kind in KINDS]
        at_once(trip, pairs)
        with quick():
            at_once(be_refused, pairs)
        at_once(clear, pairs)


@pytest.mark.real_time
@pytest.mark.parametrize("trouble", ["deaf", "locked"])
def test_a_chamber_that_does_not_do_what_it_is_told(trouble: str, tmp_path: Path, quick: Quick) -> None:
    def be_refused(pair: Pair) -> None:
        setattr(pair.room, trouble, True)
        for _ in range(5):  # on a busy machine the emulator may be silent, too
            with pytest.raises(ChamberError) as caught:
                pair.chamber.set(*WANTED)
            if caught.value.code != "chamber-silent":
                break
        assert caught.value.code == "chamber-refused"
        assert pair.room.regulated == []

    def be_set(pair: Pair) -> None:
        setattr(pair.room, trouble, False)
        pair.chamber.set(*WANTED)
        assert pair.room.mode == "CONSTANT"

    def stay(pair: Pair) -> None:
        setattr(pair.room, trouble, True)
        with pytest.raises(ChamberError) as caught:
            pair.chamber.safe()
        assert (caught.value.code, pair.room.mode) == ("chamber-not-safe", "CONSTANT")
        assert "panel" in caught.value.repair

    with ExitStack() as stack:
        pairs = [stack.enter_context(paired(kind, tmp_path)) for kind in KINDS[::3]]
        with quick():
            at_once(be_refused, pairs)
        at_once(be_set, pairs)
        with quick():
            at_once(stay, pairs)


def test_an_old_controller_without_modes_and_alarms(tmp_path: Path) -> None:
    serial = next((kind for kind in KINDS if kind.driver == "espec-sh"), None)
    if serial is None:
        pytest.skip("no pseudo-terminals")
    kind = Kind("espec-sh", True, lambda: EspecDevice(sh=True, knows_mode=False))
    with paired(kind, tmp_path) as pair:
        pair.chamber.set(*WANTED)
        now = pair.chamber.read()
        assert (now.mode, now.alarms, now.temperature_set_point) == ("unknown", (), 25.0)
        pair.chamber.safe()
        assert pair.room.mode == "STANDBY"


@pytest.mark.real_time
def test_a_chamber_that_is_not_there(tmp_path: Path) -> None:
    for kind in KINDS:
        with paired(kind, tmp_path) as pair:
            chamber = pair.chamber
        began = time.monotonic()
        with pytest.raises(ChamberError) as caught:
            chamber.set(*WANTED)
        assert caught.value.code == "chamber-unreachable", kind
        with pytest.raises(ChamberError) as caught:
            chamber.safe()
        assert caught.value.code == "chamber-not-safe", kind
        assert time.monotonic() - began < 5.0


@pytest.mark.parametrize(
    "kind", [KINDS[0], *(kind for kind in KINDS if kind.driver == "modbus" or kind.serial)], ids=str
)
def test_without_its_client_a_chamber_says_what_to_install(
    kind: Kind, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with paired(kind, tmp_path) as pair:
        for name in ("serial", "pymodbus", "pymodbus.client"):
            monkeypatch.setitem(sys.modules, name, None)
        if kind == KINDS[0]:
            pair.chamber.set(*WANTED)  # a text line by TCP needs neither
            return
        with pytest.raises(ChamberError) as caught:
            pair.chamber.read()
        assert caught.value.code == "no-chamber-client"
        assert "chamber" in caught.value.repair
