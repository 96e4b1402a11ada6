"""The limits of a strip: their table, the plans that they refuse, and the layer that hands voltages on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, load_actuator, signals
from ipmclab.rig import request
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.rows import ClampedRows, SignalRows
from ipmclab.rig.safety.guarded_bench import GuardedBench
from ipmclab.rig.safety.limits import Limit, Limits
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
    Limits(voltage=Limit(5.0)).refuse(signals.parse("step 5 V"), 10.0, RATE)


def test_a_ramp_has_a_slew_limit_and_a_step_has_none() -> None:
    slow = Limits(slew=1.0)
    # A triangle of 1 V climbs by 4 V in each period.
    slow.refuse(signals.parse("triangle 1 V 0.25 Hz"), 10.0, RATE)
    assert "it ramps by 4 V/s" in refused("triangle 1 V 1 Hz", slow)
    assert "it ramps by" in refused("sine 1 V 1 Hz offset=1 V", slow)
    for text in ("step 3 V", "square 3 V 10 Hz", "prbs 3 V 0.1 s", "step 3 V for 5 s then triangle 1 V 0.25 Hz"):
        slow.refuse(signals.parse(text), 10.0, RATE)
    # 2 pi 1 V 0.2 Hz is 1.257 V/s.
    assert refused("sine 1 V 0.2 Hz", slow).startswith("signal: it ramps by 1.25")


@pytest.mark.parametrize("begins", range(12))
def test_a_ramp_is_found_wherever_the_pieces_of_a_long_signal_meet(
    begins: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hours of it are looked at piece by piece: here of eight rows, the shortest ramp that is one at each place."""
    monkeypatch.setattr(request, "_CHUNK", 8)
    rows = np.concatenate([np.zeros(begins + 1), [0.1, 0.2, 0.3], np.full(20, 0.3)])
    signal = signals.Samples(np.arange(len(rows)) / RATE, rows)
    with pytest.raises(InputError, match="it ramps by 5 V/s") as told:
        Limits(slew=1.0).refuse(signal, len(rows) / RATE, RATE)
    assert f" at {begins / RATE:.6g} s" in str(told.value)  # from the last row at 0 V on


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


def test_a_plan_says_what_is_electrolysed_and_what_nothing_watches() -> None:
    limits = Limits()
    assert limits.remarks(signals.parse("sine 1.2 V 1 Hz"), 10.0, RATE) == ()
    assert limits.remarks(signals.parse("square 2 V 0.25 Hz"), 8.0, RATE) == (
        "it is above 1.23 V for 8 s, up to 2 V: the water in the strip is split there",
    )
    blind = limits.unwatched(THESIS_RIG, ["force"])
    assert list(blind) == ["current"]
    assert blind["current"] == (
        "the limit of the current, 500 mA, is beyond what its channel reads, 200 mA: nothing shows when it is exceeded"
    )
    # A load cell of 0 to 98.07 mN that is zeroed at a preload of 20 mN has 78.07 mN left, on one side.
    pressed = replace(THESIS_RIG["force"], rest=20e-3, zeroed=True)
    rig = replace(THESIS_RIG, channels=(THESIS_RIG["voltage"], pressed))
    for most, seen in ((77e-3, True), (80e-3, False)):
        assert ("force" in replace(limits, force=Limit(most)).unwatched(rig, ["force"])) is not seen
    without = replace(THESIS_RIG, channels=(THESIS_RIG["voltage"],))
    assert set(limits.unwatched(without, [])) == {"current", "mean_current", "charge", "power", "energy"}
