"""The limits of a strip: their table, the plans that they refuse, and the layer that hands voltages on."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, load_actuator, signals
from ipmclab.rig import request
from ipmclab.rig.chambers.settings import ChamberSettings
from ipmclab.rig.channels import THESIS_RIG, Channel, Converter
from ipmclab.rig.rows import ClampedRows, SignalRows
from ipmclab.rig.safety.guarded_bench import GuardedBench
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from ipmclab.rig.virtual import VirtualBench
from ipmclab.signals import Signal

RATE = 50.0


def refused(text: str, limits: Limits | None = None, duration: float = 10.0, rate: float = RATE) -> str:
    with pytest.raises(InputError) as caught:
        (limits or Limits()).refuse(signals.parse(text), duration, rate)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("step 35 V", "35 V at 0 s"),
        ("step -3.6 V delay=2 s", "-3.6 V at 2 s"),
        ("sine 3 V 1 Hz offset=1 V", "3.53298 V at 0.16 s"),
        ("step 1 V for 5 s then step 4 V", "4 V at 5 s"),
        ("square 3.5000001 V 1 Hz", "3.5 V at 0 s"),
    ],
)
def test_a_typo_or_an_offset_never_reaches_the_strip(text: str, where: str) -> None:
    message = refused(text)
    assert where in message
    assert "the limit is 3.5 V; give a smaller amplitude or offset" in message


def test_what_the_strip_stands_is_not_refused() -> None:
    for text in ("step 3.5 V", "square -3.5 V 1 Hz", "sine 3 V 1 Hz offset=0.5 V"):
        Limits().refuse(signals.parse(text), 10.0, RATE)
    Limits(voltage=Limit(10.0)).refuse(signals.parse("step 10 V"), 10.0, RATE)


def test_of_a_run_of_one_row_one_row_is_looked_at() -> None:
    assert "35 V at 0 s" in refused("step 35 V", duration=1.0 / RATE)
    Limits().refuse(signals.parse("step 35 V delay=20 ms"), 1.0 / RATE, RATE)


def test_a_ramp_has_a_slew_limit_and_a_step_has_none() -> None:
    slow = Limits(slew=1.0)
    # A triangle of 1 V climbs by 4 V in each period.
    slow.refuse(signals.parse("triangle 1 V 0.25 Hz"), 10.0, RATE)
    assert "it ramps by 4 V/s" in refused("triangle 1 V 1 Hz", slow)
    assert "it ramps by" in refused("sine 1 V 1 Hz offset=1 V", slow)
    for text in ("step 3 V", "square 3 V 10 Hz", "prbs 3 V 0.1 s", "step 3 V for 5 s then triangle 1 V 0.25 Hz"):
        slow.refuse(signals.parse(text), 10.0, RATE)
        replace(slow, slew=0.1).refuse(signals.parse(text.split(" then")[0]), 10.0, RATE)
    # 2 pi 1 V 0.2 Hz is 1.257 V/s.
    assert refused("sine 1 V 0.2 Hz", slow).startswith("signal: it ramps by 1.25")


def played(rows: list[float] | np.ndarray) -> tuple[Signal, float, float]:
    """A signal of these rows [V], its duration and its rate."""
    return signals.Samples(np.arange(len(rows)) / RATE, np.asarray(rows)), len(rows) / RATE, RATE


@pytest.mark.parametrize("piece", [1, 5, 8])
@pytest.mark.parametrize("begins", range(12))
def test_a_ramp_is_found_wherever_the_pieces_of_a_long_signal_meet(
    begins: int, piece: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hours of it are looked at piece by piece: here of a few rows, the shortest ramp that is one at each place."""
    monkeypatch.setattr(request, "_CHUNK", piece)
    ramp = np.array([0.125, 0.25, 0.375])
    rows = np.concatenate([np.zeros(begins + 1), ramp, np.full(20, 0.375), 0.375 + ramp, np.full(9, 0.75)])
    with pytest.raises(InputError, match=r"it ramps by 6\.25 V/s") as told:
        Limits(slew=1.0).refuse(*played(rows))
    assert f" at {begins / RATE:.6g} s" in str(told.value)  # from the last row at 0 V on; the second is as steep


@pytest.mark.parametrize("rows", [[3.0, 3.0], [0.0, 1.0, 2.0], [3.0, 2.0, 1.0, 1.0], [3.0, 3.25, 3.5, 3.5, 3.5]])
def test_two_changes_are_no_ramp_and_nothing_is_known_before_the_first_row(rows: list[float]) -> None:
    Limits(slew=1.0).refuse(*played(rows))


@pytest.mark.parametrize(("share", "beyond"), [(0.0, False), (5e-7, False), (1.5e-6, True)])
def test_a_ramp_at_its_limit_is_not_refused_for_what_is_rounded(share: float, beyond: bool) -> None:
    """After half an hour at 10 kHz a triangle of 12 V/s was: it ramps by 12 V/s, the limit is 12 V/s."""
    signal = played(np.arange(9) * 1.6 * (1.0 + share) / RATE)
    with pytest.raises(InputError, match=r"it ramps by 1\.6 V/s at") if beyond else nullcontext():
        Limits(slew=1.6).refuse(*signal)


@given(st.floats(-20.0, 20.0), st.floats(0.1, 10.0))
def test_a_clamped_signal_stays_within_its_limit_and_ends_at_0(wanted: float, most: float) -> None:
    clamped = ClampedRows(SignalRows(signals.Step(wanted), 50), -most, most, more=50)
    voltage = clamped.voltages(0, 100, 50.0)
    assert np.abs(voltage).max() <= most
    assert np.all(voltage[50:] == 0.0)
    if abs(wanted) <= most:
        assert np.all(voltage[:50] == wanted)


class _Treacherous(Signal):
    """A signal that is harmless when it is checked, and not when it is given out."""

    def __init__(self) -> None:
        object.__setattr__(self, "asked", 0)

    def voltage(self, time: object) -> np.ndarray:
        object.__setattr__(self, "asked", self.asked + 1)  # type: ignore[attr-defined]
        times = np.asarray(time)
        return np.where(times > 0.5, np.nan, 35.0) if self.asked > 1 else np.zeros(times.shape)  # type: ignore[attr-defined]

    def _shape(self, time: np.ndarray) -> np.ndarray:
        return time


def test_the_layer_that_hands_voltages_on_clamps_whatever_comes() -> None:
    bench = GuardedBench(VirtualBench(load_actuator("friend-2")), Limits(voltage=Limit(2.0)))
    bench.open(["voltage"], RATE)
    given_out = np.concatenate([block.output for block in bench.apply(_Treacherous(), 100)])
    assert given_out[1:26].tolist() == [2.0] * 25
    assert np.all(given_out[27:] == 0.0)
    with pytest.raises(InputError, match="it commands 3 V at 0 s, the limit is 2 V"):
        bench.apply(signals.Step(3.0), 10)
    for voltage in (2.1, -35.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="the limit of the strip is 2 V"):
            bench.exchange(voltage)
    assert "voltage" in bench.exchange(-2.0)
    bench.close()


def test_what_a_strip_stands_where_nothing_is_said() -> None:
    """A strip such as friend-2 hangs on these: none moves without being noticed."""
    assert Limits().as_text() == {
        "voltage": "3.5 V for 0.02 s, then zero",
        "current": "500 mA for 0.05 s, then zero",
        "mean_current": "190 mA for 1 s, then zero",
        "charge": "10 C, then zero",
        "power": "0.3 W for 5 s, then zero",
        "energy": "25 J, then warn",
        "displacement": "12 mm for 0.5 s, then warn",
        "force": "80 mN for 0.1 s, then warn",
        "temperature": "60 degC for 10 s, then zero",
    }


@pytest.mark.parametrize("duration", [-1e-9, np.inf, np.nan])
def test_a_limit_acts_after_a_time_that_ends(duration: float) -> None:
    with pytest.raises(InputError, match=r"the duration is .* s; give 0 s or more"):
        Limit(1.0, duration)


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ({"most": 0.0}, "most: the limit is 0, it must be above 0; give the largest magnitude"),
        ({"most": np.inf}, "most: the limit is inf, it must be above 0"),
        ({"most": 1.0, "least": 1.0}, "least: the lower limit is 1, the upper one is 1; give a lower limit below"),
        ({"most": 1.0, "least": 2.0}, "least: the lower limit is 2, the upper one is 1"),
        ({"most": 1.0, "least": -np.inf}, "least: the lower limit is -inf, the upper one is 1"),
    ],
)
def test_a_limit_has_ends_that_something_can_pass(ends: dict[str, float], message: str) -> None:
    with pytest.raises(InputError) as caught:
        Limit(**ends)  # type: ignore[arg-type]
    assert str(caught.value).startswith(message)


def test_a_limit_of_ramps_ends_somewhere() -> None:
    with pytest.raises(InputError, match=r"limits\.slew: the limit is inf V/s, it must be above 0"):
        Limits(slew=np.inf)


def test_the_air_has_a_lower_limit_too() -> None:
    """Of the humidity nothing is watched unless it is stated; what is not stated of it lasts 10 s, and ends the run."""
    limits = Limits.from_table({"temperature": {"least": "-5 degC"}, "relative_humidity": {"least": "20 percent"}})
    assert limits.temperature == Limit(60.0, 10.0, "zero", least=-5.0)
    assert limits.relative_humidity == Limit(100.0, 10.0, "zero", least=20.0)
    assert Limits.from_table(limits.to_table()) == limits
    told = replace(limits, slew=0.5).as_text()
    assert told["temperature"] == "-5 degC to 60 degC for 10 s, then zero"
    assert told["relative_humidity"] == "20 percent to 100 percent for 10 s, then zero"
    assert told["slew"] == "0.5 V/s"
    assert Limits.from_table({"relative_humidity": "95 percent"}).relative_humidity == Limit(95.0, 10.0)


def test_limits_from_a_table() -> None:
    limits = Limits.from_table(
        {
            "voltage": "2 V",
            "current": {"most": "150 mA", "duration": "100 ms"},
            "mean_current": {"action": "warn"},
            "charge": "500 mC",
            "power": "100 mW",
            "energy": {"most": "2 J", "action": "zero"},
            "displacement": "off",
            "force": "1 gf",
            "temperature": "35 degC",
            "slew": "1 V/s",
        }
    )
    assert limits == replace(
        Limits(),
        voltage=Limit(2.0, 0.02),
        current=Limit(0.15, 0.1),
        mean_current=Limit(0.19, 1.0, "warn"),
        charge=Limit(0.5),
        power=Limit(0.1, 5.0),
        energy=Limit(2.0, 0.0, "zero"),
        displacement=None,
        force=Limit(9.80665e-3, 0.1, "warn"),
        temperature=Limit(35.0, 10.0),
        slew=1.0,
    )
    assert Limits.from_table(limits.to_table()) == limits
    assert Limits.from_table({}) == Limits()


_LIMIT = st.builds(
    Limit,
    st.floats(1e-9, 10.0),
    st.floats(0.0, 1e6),
    st.sampled_from(["zero", "warn"]),
)


@given(_LIMIT, st.none() | _LIMIT, st.none() | st.floats(1e-3, 1e3))
def test_a_table_of_limits_comes_back_as_it_was(voltage: Limit, other: Limit | None, slew: float | None) -> None:
    limits = Limits(voltage=replace(voltage, action="zero"), force=other, charge=other, energy=other, slew=slew)
    assert Limits.from_table(limits.to_table()) == limits


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"current": {"least": "1 A"}}, "limits.current.least: unknown key 'least'"),
        ({"temperature": {"least": "70 degC"}}, "limits.temperature.least: the lower limit is 70, the upper one is 60"),
        ({"curent": "1 A"}, "limits.curent: unknown key 'curent'; did you mean 'current'?"),
        ({"current": {"mosst": "1 A"}}, "limits.current.mosst: unknown key 'mosst'; did you mean 'most'?"),
        ({"current": "1 V"}, "limits.current: '1 V' is not a current"),
        ({"current": 0.1}, "limits.current: 0.1 is not a text; write a number with its unit in quotes"),
        ({"current": "-1 A"}, "limits.current.most: the limit is -1 A, it must be above 0"),
        ({"temperature": {"most": "0 degC"}}, "limits.temperature.most: the limit is 0 degC, it must be above 0"),
        ({"current": {"duration": "-1 s"}}, "limits.current.duration: the duration is -1 s; give 0 s or more"),
        ({"current": {"action": "zro"}}, "limits.current.action: unknown action 'zro'; did you mean 'zero'?"),
        ({"voltage": "off"}, "limits.voltage: the voltage is never without a limit; give what this strip withstands"),
        ({"voltage": "35 V"}, "limits.voltage: the limit is 35 V, no strip is given more than 10 V"),
        ({"voltage": {"action": "warn"}}, "limits.voltage.action: a voltage beyond its limit always ends the run"),
        ({"slew": "0 V/s"}, "limits.slew: the limit is 0 V/s, it must be above 0"),
        ({"energy": "3 W"}, "limits.energy: '3 W' is not a energy"),
    ],
)
def test_a_bad_table_of_limits_is_refused(table: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        Limits.from_table(table)
    assert str(caught.value).startswith(message)
    with pytest.raises(InputError) as caught:
        Limits.from_table(table, where="dry.toml: limits")
    assert str(caught.value).startswith(f"dry.toml: {message}")


@pytest.mark.parametrize("piece", [2**18, 60])
def test_a_plan_says_how_long_water_is_split_and_at_which_voltage(piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request, "_CHUNK", piece)
    for text in ("sine 1.2 V 1 Hz", "square 1.23 V 1 Hz", "step 2 V delay=10 s"):
        assert Limits().remarks(signals.parse(text), 10.0, RATE) == ()
    for text in ("square 2 V 0.25 Hz", "step -1.3 V for 2 s then step -2 V for 2 s then step 1.5 V"):
        assert Limits().remarks(signals.parse(text), 8.0, RATE) == (
            "it is above 1.23 V for 8 s, up to 2 V: the water in the strip is split there",
        )


HUMID = Channel("relative_humidity", Converter(-10.0, 10.0, noise=0.0), gain=10.0, sensor_range=(20.0, 90.0))
COLD = Channel("temperature", Converter(-10.0, 10.0, noise=0.0), gain=10.0, sensor_range=(-90.0, 50.0))
# A load cell of 0 to 98.07 mN that is zeroed at a preload of 20 mN has 78.07 mN left, on one side.
PRESSED = replace(THESIS_RIG["force"], rest=20e-3)
# A laser of 25 mm whose strip hangs at 15 mm sees it move by that much, on one side.
NEAR = replace(THESIS_RIG["displacement"], rest=15e-3)


@pytest.mark.parametrize(
    ("channel", "most", "least", "reads"),
    [
        (THESIS_RIG["current"], 0.199, None, None),
        (THESIS_RIG["current"], 0.2, None, "the limit of the current is 200 mA, its channel reads up to 200 mA"),
        (THESIS_RIG["current"], 0.5, None, "the limit of the current is 500 mA, its channel reads up to 200 mA"),
        (PRESSED, 77e-3, None, None),
        (PRESSED, 80e-3, None, "the limit of the force is 80 mN, its channel reads up to 78.06 mN"),
        (replace(PRESSED, zeroed=False), 80e-3, None, None),
        (NEAR, 14e-3, None, None),
        (NEAR, 15e-3, None, "the limit of the displacement is 15 mm, its channel reads up to 15 mm"),
        # The air is warmer or drier than a limit, not larger.
        (COLD, 49.0, -89.0, None),
        (COLD, 60.0, None, "the limit of the temperature is 60 degC, its channel reads up to 50 degC"),
        (HUMID, 89.0, 21.0, None),
        (HUMID, 90.0, None, "the limit of the relative humidity is 90 percent, its channel reads up to 90 percent"),
        (
            HUMID,
            80.0,
            20.0,
            "the lower limit of the relative humidity is 20 percent, its channel reads down to 20 percent",
        ),
        # No air is above 100 percent: this is no upper limit.
        (HUMID, 100.0, 21.0, None),
        (HUMID, 100.0, 20.0, "the lower limit of the relative humidity is 20 percent, its channel reads"),
    ],
)
def test_a_limit_that_a_channel_ends_at_or_before_is_not_watched(
    channel: Channel, most: float, least: float | None, reads: str | None
) -> None:
    """A reading stays at the end of its range, and never gets beyond a limit there."""
    channels = (*(one for one in THESIS_RIG.channels if one.name != channel.name), channel)
    limits = replace(Limits(current=None), **{channel.name: Limit(most, least=least)})  # type: ignore[arg-type]
    found = limits.unwatched(replace(THESIS_RIG, channels=channels), [channel.name])
    assert list(found) == ([] if reads is None else [channel.name])
    if reads is not None:
        assert found[channel.name].startswith(reads)
        assert found[channel.name].endswith(": nothing shows when it is exceeded")


IN_CHAMBER = {"chamber": ChamberSettings("virtual")}


@pytest.mark.parametrize(
    ("rig", "measured", "blind"),
    [
        ({}, [], ["relative_humidity"]),
        ({}, ["relative_humidity"], []),
        (IN_CHAMBER, [], []),
        ({"thermometer": None}, ["relative_humidity"], ["temperature"]),
        ({"thermometer": None} | IN_CHAMBER, [], []),
    ],
)
def test_the_air_is_watched_by_sensors_at_the_strip_or_by_those_of_a_chamber(
    rig: dict[str, Any], measured: list[str], blind: list[str]
) -> None:
    limits = Limits(current=None, relative_humidity=Limit(95.0))
    found = limits.unwatched(replace(THESIS_RIG, **rig), measured)
    assert found == {
        name: f"the limit of the {told} is not watched: the {told} is not measured"
        for name, told in (("temperature", "temperature"), ("relative_humidity", "relative humidity"))
        if name in blind
    }


def test_a_plan_says_what_nothing_watches() -> None:
    blind = Limits().unwatched(THESIS_RIG, ["force"])
    assert list(blind) == ["current"]
    without = replace(THESIS_RIG, channels=(THESIS_RIG["voltage"],))
    blind = Limits().unwatched(without, [])
    assert set(blind) == {"current", "mean_current", "charge", "power", "energy"}
    assert blind["charge"] == "the limit of the charge above 1.23 V is not watched: the current is not measured"
    # Displacement is not to be measured, and is not: that is told where the plan is.
    assert "displacement" not in Limits(displacement=Limit(1.0)).unwatched(THESIS_RIG, ["force"])
