"""Rig files: what stands in them is read to the digit, and what cannot be is refused by name."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, load_actuator, write_actuator
from ipmclab.rig.channels import THESIS_RIG, Channel, Converter, FourProbe, Output, Rig, Thermometer, VirtualStrip
from ipmclab.rig.files.rig_file import NI_9205_NOISE, load_rig, rig_from_text
from ipmclab.rig.files.text import rig_to_text, write_rig

RIG = """
name = "bench 1"
bench = "ni"
address = "127.0.0.1:31763"
shunt_resistance = "1 ohm"
voltage_sensed = "upstream of shunt"
[output]
physical = "cDAQ1Mod2/ao0"
range = ["-10 V", "10 V"]
[channels.voltage]
physical = "cDAQ1Mod1/ai3"
range = ["-5 V", "5 V"]
[channels.current]
physical = "cDAQ1Mod1/ai0"
range = ["-1 V", "1 V"]
scale = [["0 V", "0 A"], ["1 V", "1 A"]]
calibrated = "2026-10-01"
uncertainty = "0.1 mA"
[channels.displacement]
physical = "cDAQ1Mod1/ai1"
terminal = "single-ended"
range = ["-10 V", "10 V"]
scale = [["2 V", "0 mm"], ["10 V", "25 mm"]]
sensor_range = ["0 mm", "25 mm"]
lost = "1.5 V"
zeroed = true
[thermometer]
physical = "cDAQ1Mod3/ai1"
wires = 3
[virtual]
temperature = "30 degC"
"""


def test_the_example_is_read() -> None:
    rig = rig_from_text(RIG)
    current, displacement = rig["current"], rig["displacement"]
    assert (rig.name, rig.bench, rig.address, rig.shunt_resistance) == ("bench 1", "ni", "127.0.0.1:31763", 1.0)
    assert (rig.output, rig.source_resistance) == (Output(-10.0, 10.0, "cDAQ1Mod2/ao0"), 0.0)
    assert (current.gain, current.offset, current.calibrated, current.uncertainty) == (1.0, 0.0, "2026-10-01", 1e-4)
    assert (current.converter.low, current.converter.high, current.converter.noise) == (-1.0, 1.0, 26e-6)
    assert displacement.to_quantity(0.012 * 500) == pytest.approx(12.5e-3)  # 12 mA is the middle
    assert (displacement.terminal, displacement.lost, displacement.zeroed) == ("single-ended", 1.5, True)
    assert rig.thermometer == Thermometer("cDAQ1Mod3/ai1", 100.0, 3, 1e-3)
    assert rig.virtual == VirtualStrip(temperature=30.0)


def test_the_library_holds_the_rig_of_the_thesis() -> None:
    rig = load_rig("thesis")
    assert replace(rig, virtual=THESIS_RIG.virtual) == THESIS_RIG
    assert load_rig("virtual") == rig


def test_a_file_is_written_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    rig = rig_from_text(RIG)
    write_rig(rig, path)
    assert load_rig(path) == rig
    with pytest.raises(InputError, match="the file exists already"):
        write_rig(rig, path)


def test_the_strip_of_a_virtual_rig_lies_beside_its_file(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG + 'actuator = "mine.toml"\n', "utf-8")
    assert Path(load_rig(tmp_path / "rig.toml").virtual.actuator) == tmp_path / "mine.toml"


def test_the_strip_of_a_virtual_rig_may_have_further_stages(tmp_path: Path) -> None:
    write_actuator(load_actuator("friend-2"), tmp_path / "mine.toml")
    for named, stage in (("friend-2+leak.cubic", "cubic"), ("mine.toml+leak.exponential", "exponential")):
        (tmp_path / "rig.toml").write_text(f'{RIG}actuator = "{named}"\n', "utf-8")
        assert load_actuator(load_rig(tmp_path / "rig.toml").virtual.actuator).structure.leak == stage


def ranges(low: float, high: float) -> st.SearchStrategy[tuple[float, float]]:
    ends = st.floats(low, high).map(lambda value: float(f"{value:.6g}"))
    return st.tuples(ends, ends).map(sorted).filter(lambda pair: pair[1] - pair[0] > 1e-3 * (high - low)).map(tuple)


names = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), min_size=1, max_size=20).filter(
    str.strip
)
magnitudes = st.floats(1e-9, 10.0)
SPAN = {"voltage": 10.0, "current": 2.0, "displacement": 0.1, "force": 1.0, "relative_humidity": 100.0}


@st.composite
def channels(draw: st.DrawFn, name: str, number: int) -> Channel:
    high = draw(st.sampled_from(list(NI_9205_NOISE)))
    v0, v1 = draw(ranges(-high, high))
    q0, q1 = draw(ranges(-SPAN[name], SPAN[name]))
    gain = (q1 - q0) / (v1 - v0)
    return Channel(
        name,
        Converter(-high, high, noise=draw(st.sampled_from([NI_9205_NOISE[high], 0.0, 3.3e-5]))),
        gain=gain,
        offset=q0 - gain * v0,
        sensor_range=draw(st.sampled_from([None, (q0, q1)])),
        sensor_noise=draw(st.just(0.0) | magnitudes),
        rest=draw(st.just(0.0) | magnitudes),
        zeroed=draw(st.booleans()),
        physical=f"cDAQ1Mod1/ai{number}",
        terminal=draw(st.sampled_from(["differential", "single-ended", "non-referenced"])),
        calibrated=draw(st.none() | st.dates(datetime.date(1990, 1, 1), datetime.date(2026, 1, 1)).map(str)),
        uncertainty=draw(st.just(0.0) | magnitudes),
        instrument=draw(st.sampled_from(["", "optoNCDT 1420-25"])),
        interface=draw(st.sampled_from(["", "RS-485"])),
        sensor_resolution=draw(st.just(0.0) | magnitudes),
    )


@st.composite
def rigs(draw: st.DrawFn) -> Rig:
    wanted = ["voltage", *draw(st.lists(st.sampled_from(list(SPAN)[1:]), unique=True))]
    low, high = draw(st.floats(-10.0, 0.0)), draw(st.floats(1.0, 10.0))
    ni = draw(st.booleans())
    return Rig(
        name=draw(names),
        channels=tuple(draw(channels(name, number)) for number, name in enumerate(wanted)),
        shunt_resistance=draw(st.floats(0.0, 1000.0)),
        source_resistance=draw(st.floats(0.0, 1000.0)),
        voltage_sensed=draw(st.sampled_from(["electrodes", "upstream of shunt"])),
        output=Output(
            low,
            high,
            "cDAQ1Mod2/ao0",
            draw(st.sampled_from(["", "current amplifier"])),
            draw(st.none() | st.floats(1e-3, 10.0)),
        ),
        thermometer=draw(st.none() | st.just(Thermometer("cDAQ1Mod3/ai1", 1000.0, 3))),
        four_probe=draw(
            st.none()
            | st.builds(
                FourProbe,
                st.just("cDAQ1Mod3/ai0"),
                st.floats(1e-4, 0.1),
                contacts=st.sampled_from(["line", "points"]),
                offset=st.floats(0.0, 1.0),
            )
        ),
        bench="ni" if ni else "virtual",
        address=draw(st.sampled_from([None, "127.0.0.1:1", "lab-pc.example:65535"])) if ni else None,
        virtual=VirtualStrip(
            seed=draw(st.integers(0, 2**63 - 1)),
            temperature=draw(st.floats(-40.0, 150.0)),
            relative_humidity=draw(st.floats(0.0, 100.0)),
            hydrated=draw(st.booleans()),
            load=draw(st.sampled_from(["strip", "dummy"])),
            preload_drift=draw(st.floats(-0.1, 0.1)),
            meter_offset=draw(st.floats(-1.0, 1.0)),
        ),
    )


def without_scales(rig: Rig) -> Rig:
    return replace(rig, channels=tuple(replace(one, gain=1.0, offset=0.0) for one in rig.channels))


@given(rigs())
def test_what_is_written_is_read_again(rig: Rig) -> None:
    again = rig_from_text(rig_to_text(rig))
    assert without_scales(again) == without_scales(rig)
    for one, other in zip(rig.channels, again.channels, strict=True):
        for volts in (one.converter.low, 0.0, one.converter.high):
            scale = abs(one.gain * one.converter.high) + abs(one.offset)
            assert other.to_quantity(volts) == pytest.approx(one.to_quantity(volts), rel=1e-11, abs=1e-11 * scale)


LATER = (datetime.date.today() + datetime.timedelta(days=400)).isoformat()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "bench 1"', 'nam = "bench 1"', "rig: nam: unknown key 'nam'; did you mean 'name'?"),
        ('name = "bench 1"', 'name = " "', "rig: name: the rig has no name"),
        ('bench = "ni"', 'bench = "nj"', "rig: bench: 'nj' is not 'virtual' or 'ni'; write one of these"),
        ('bench = "ni"', 'bench = "virtual"', "rig: address: a virtual bench has no address"),
        ("127.0.0.1:31763", "127.0.0.1", "rig: address: '127.0.0.1' is not HOST:PORT"),
        ("127.0.0.1:31763", "127.0.0.1:99999", "is not HOST:PORT; write for example"),
        ('"1 ohm"', '"1"', "rig: shunt_resistance: '1' has no unit; write for example '1 ohm'"),
        ('"1 ohm"', '"1 V"', "rig: shunt_resistance: '1 V' is not a resistance: the unit 'V' is not one of ohm"),
        ('"1 ohm"', "1.0", "rig: shunt_resistance: 1.0 is not a text"),
        ('"1 ohm"', '"-1 ohm"', "rig: shunt_resistance: '-1 ohm' is below 0"),
        ('"1 ohm"', '"1 Mohm"', "'1 Mohm' in series leaves no voltage for a strip, at most 1000 ohm"),
        ("upstream of shunt", "upstream", "rig: voltage_sensed: 'upstream' is not"),
        ('["-10 V", "10 V"]\n[channels.v', '["-20 V", "20 V"]\n[channels.v', "rig: output.range: -20 V to 20 V"),
        ('["-10 V", "10 V"]\n[channels.v', '["10 V", "-10 V"]\n[channels.v', "it goes from '10 V' to '-10 V'"),
        (
            '["-1 V", "1 V"]',
            '["-2 V", "2 V"]',
            'the NI 9205, which has ±0.2 V, ±1 V, ±5 V, ±10 V; write ["-5 V", "5 V"]',
        ),
        ('["-1 V", "1 V"]', '["-30 V", "30 V"]', "-30 V to 30 V is not a range of the NI 9205"),
        ('["-1 V", "1 V"]', '["0 V", "1 V"]', "rig: channels.current.range: 0 V to 1 V is not a range"),
        ('["-1 V", "1 V"]', '["-1 V"]', "rig: channels.current.range"),
        ("channels.current", "channels.curent", "unknown channel 'curent'; did you mean 'current'?"),
        ("channels.current", "channels.temperature", "describe its resistance thermometer in [thermometer]"),
        ("channels.voltage", "channels.force", "rig: channels.voltage: this table is missing: every run needs"),
        ('["1 V", "1 A"]', '["0 V", "1 A"]', "rig: channels.current.scale: both points are at 0 V"),
        ('["1 V", "1 A"]', '["1 V", "0 A"]', "both points are at 0 A"),
        ('["1 V", "1 A"]', '["1 V", "1 mm"]', "rig: channels.current.scale.1.1: '1 mm' is not a current"),
        (
            'scale = [["0 V", "0 A"], ["1 V", "1 A"]]\n',
            "",
            'channels.current.scale: this key is missing; add scale = [["0 V',
        ),
        ('"2026-10-01"', '"1 October"', "rig: channels.current.calibrated: '1 October' is not a date"),
        ('"2026-10-01"', f'"{LATER}"', f"{LATER} is in the future"),
        ('"0.1 mA"', '"-0.1 mA"', "rig: channels.current.uncertainty: '-0.1 mA' is below 0"),
        ('"single-ended"', '"RSE"', "rig: channels.displacement.terminal: 'RSE' is not"),
        ('["0 mm", "25 mm"]', '["40 mm", "50 mm"]', "the sensor gives 14.8 V to 18 V, the range is -10 V to 10 V"),
        ('"1.5 V"', '"5 V"', "rig: channels.displacement.lost: 5 V is a reading: the sensor gives 2 V to 10 V"),
        ('"1.5 V"', '"15 V"', "15 V is beyond the range -10 V to 10 V"),
        ('sensor_range = ["0 mm", "25 mm"]\n', "", "the reading of a lost target needs the range of the sensor"),
        (
            "Mod1/ai1",
            "Mod1/ai0",
            "channels.displacement.physical: 'cDAQ1Mod1/ai0' is taken by channels.current already",
        ),
        ("Mod1/ai1", "mod1/AI0", "'cDAQ1mod1/AI0' is not the name of an analogue input"),
        ("cDAQ1Mod1/ai1", "/CDAQ1MOD1/ai0", "'CDAQ1MOD1/ai0' is taken by channels.current already"),
        ("Mod1/ai1", "Mod1/ai8", "ai8' is taken by channels.current already"),
        ("Mod1/ai0", "Mod1/ai9", "'cDAQ1Mod1/ai9' cannot be differential: it is the other terminal of ai1"),
        ("Mod3/ai1", "Mod1/ai0", "thermometer.physical: 'cDAQ1Mod1/ai0' is taken by channels.current already"),
        ("Mod2/ao0", "Mod2/ai0", "rig: output.physical: 'cDAQ1Mod2/ai0' is not the name of an analogue output"),
        ('physical = "cDAQ1Mod2/ao0"\n', "", "rig: output.physical: this key is missing; add"),
        ("wires = 3", "wires = 2", "rig: thermometer.wires: 2 is not 3 or 4"),
        ('"30 degC"', '"300 degC"', "rig: virtual.temperature: '300 degC' is not within -40 degC to 150 degC"),
        ("[virtual]", "[virtual]\nsede = 1", "rig: virtual.sede: unknown key 'sede'; did you mean 'seed'?"),
        ("[output]", "[output", "rig: not a TOML file"),
    ],
)
def test_a_rig_that_cannot_be_is_refused(old: str, new: str, message: str) -> None:
    assert old in RIG
    with pytest.raises(InputError) as caught:
        rig_from_text(RIG.replace(old, new, 1))
    assert message in str(caught.value)
    assert caught.value.repair or "TOML" in message


def test_a_file_that_is_no_rig_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"rig: there is no rig 'thesi', .*; did you mean 'thesis'\?"):
        load_rig("thesi")
    with pytest.raises(InputError, match="this is a folder, not a rig file"):
        load_rig(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="the file cannot be read as text"):
        load_rig(tmp_path / "binary.toml")


def test_the_slash_before_a_name_is_no_part_of_it() -> None:
    """A terminal is written so; the module of such a name was looked for under an empty one."""
    rig = rig_from_text(rig_to_text(THESIS_RIG).replace('"cDAQ1', '"/cDAQ1'))
    assert rig == rig_from_text(rig_to_text(THESIS_RIG))
