"""Emulated instruments: what they say of the air in them, what they can be told, and how they fail.

Written from what is known of each language and of nothing else: no driver is imported here.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field


@dataclass
class Room:
    """The air in an emulated chamber; it is at once what it is told to be.

    Parameters
    ----------
    mode : str
        "STANDBY", "CONSTANT", "OFF" or "RUN".
    temperature_set_point : float [degC]
    humidity_set_point : float [percent], optional
    alarms : list of int
    fahrenheit : bool
        Whether it speaks in degrees Fahrenheit.
    deaf : bool
        Whether it acknowledges commands and does nothing.
    locked : bool
        Whether it refuses them.
    regulated : list
        Every pair of set points that it has ever regulated to.
    """

    mode: str = "STANDBY"
    temperature_set_point: float = 30.0
    humidity_set_point: float | None = 30.0
    alarms: list[int] = field(default_factory=list)
    fahrenheit: bool = False
    deaf: bool = False
    locked: bool = False
    regulated: list[tuple[float, float | None]] = field(default_factory=list)

    @property
    def temperature(self) -> float:
        return self.temperature_set_point if self.mode == "CONSTANT" else 22.0

    @property
    def relative_humidity(self) -> float:
        humidity = self.humidity_set_point
        return humidity if self.mode == "CONSTANT" and humidity is not None else 45.0

    def shown(self, temperature: float) -> float:
        return 1.8 * temperature + 32.0 if self.fahrenheit else temperature

    def meant(self, temperature: float) -> float:
        return (temperature - 32.0) / 1.8 if self.fahrenheit else temperature

    def note(self) -> None:
        """Keep what it regulates to."""
        now = (round(self.temperature_set_point, 2), self.humidity_set_point)
        if self.mode == "CONSTANT" and (not self.regulated or self.regulated[-1] != now):
            self.regulated.append(now)

    def trip(self) -> None:
        """An alarm that stops it: burn-out of the dry bulb."""
        self.alarms = [1]
        self.mode = "STANDBY"


class TextDevice:
    """An instrument that speaks lines of text."""

    end = b"\r\n"

    def __init__(self, room: Room | None = None) -> None:
        self.room = room or Room()

    def questions(self, came: bytes) -> tuple[list[bytes], bytes]:
        *whole, rest = came.replace(b"\r", b"\n").split(b"\n")
        return [one for one in whole if one.strip()], rest

    def answer(self, question: bytes) -> bytes:
        told = self.reply(question.decode("ascii", errors="replace").strip())
        self.room.note()
        return b"" if told is None else told.encode("ascii") + self.end

    def reply(self, question: str) -> str | None:
        raise NotImplementedError


class EspecDevice(TextDevice):
    """A P300, or with fewer words an SH."""

    def __init__(self, room: Room | None = None, *, sh: bool = False, knows_mode: bool = True) -> None:
        super().__init__(room)
        self._sh, self._knows_mode = sh, knows_mode

    def reply(self, question: str) -> str:
        room = self.room
        digits = 0 if self._sh else 1
        humidity = f"{room.relative_humidity:.{digits}f}"
        match question:
            case "TYPE?":
                return f"T,T,S2,{room.shown(160.0):.1f}"
            case "MON?" if not self._sh:
                return f"{room.shown(room.temperature):.1f},{humidity},{room.mode},{len(room.alarms)}"
            case "TEMP?":
                ends = f"{room.shown(105.0):.1f},{room.shown(-45.0):.1f}"
                return f"{room.shown(room.temperature):.1f},{room.shown(room.temperature_set_point):.1f},{ends}"
            case "HUMI?":
                wanted = "OFF" if room.humidity_set_point is None else f"{room.humidity_set_point:.{digits}f}"
                return f"{humidity},{wanted},100,0"
            case "MODE?" if self._knows_mode:
                return room.mode
            case "ALARM?" if self._knows_mode:
                return ",".join([str(len(room.alarms)), *map(str, room.alarms)])
        if question.endswith("?"):
            return "NA:CMD ERR"
        return self._command(question.replace(" ", ""))

    def _command(self, command: str) -> str:
        room = self.room
        if room.locked:
            return "NA:PROTECT ON"
        if room.deaf:
            return f"OK:{command}"
        try:
            if command.startswith("TEMP,S"):
                wanted = room.meant(float(command[6:]))
                if not -45.0 <= wanted <= 105.0:
                    return "NA:DATA OUT OF RANGE"
                room.temperature_set_point = wanted
            elif command == "HUMI,SOFF":
                room.humidity_set_point = None
            elif command.startswith("HUMI,S"):
                room.humidity_set_point = float(command[6:])
            elif command in ("MODE,STANDBY", "MODE,OFF"):
                room.mode = command[5:]
            elif command == "MODE,CONSTANT":
                if room.alarms:
                    return "NA:CHB NOT READY"
                room.mode = "CONSTANT"
            elif command != "POWER,ON":
                return "NA:CMD ERR"
        except ValueError:
            return "NA:PARA ERR"
        return f"OK:{command}"


class DewPointDevice(TextDevice):
    """A dew-point generator; the cell is at 25 degC while it runs."""

    def __init__(self, room: Room | None = None) -> None:
        super().__init__(room or Room(temperature_set_point=25.0))
        self.dew_point = 10.0
        self._wanted = 10.0

    def reply(self, question: str) -> str:
        room = self.room
        running = room.mode == "CONSTANT"
        match question:
            case "?TT":
                return f"{room.temperature:.2f}"
            case "?DP":
                return f"{self._wanted if running else self.dew_point:.2f}"
            case "?SP":
                return f"{self._wanted - 0.3:.2f} , {self._wanted:.2f} , 23100 , 14400 , 50.1 , 51.2 , 25.0 , 2.0 , 1"
            case "?RU":
                return "1" if running else "0"
            case "?ER":
                return str(sum(room.alarms))
        if not room.deaf and not room.locked:
            if question.startswith("DP="):
                self._wanted = float(question[3:])
                room.humidity_set_point = round(100.0 * _saturation(self._wanted) / _saturation(25.0), 1)
            elif question == "GEN" and not room.alarms:
                room.mode = "CONSTANT"
            elif question == "STO":
                room.mode = "STANDBY"
        return ""


class ScpiDevice(TextDevice):
    """A controller with SCPI words; commands are not answered."""

    end = b"\n"

    def reply(self, question: str) -> str | None:
        room = self.room
        stated = {
            "*IDN?": "Maker,Chamber 7,0815,1.0",
            ":UNIT:TEMPERATURE?": "F" if room.fahrenheit else "C",
            ":SOURCE:CLOOP1:PVALUE?": f"{room.shown(room.temperature):.2f}",
            ":SOURCE:CLOOP1:SPOINT?": f"{room.shown(room.temperature_set_point):.2f}",
            ":SOURCE:CLOOP2:PVALUE?": f"{room.relative_humidity:.2f}",
            ":SOURCE:CLOOP2:SPOINT?": "OFF" if room.humidity_set_point is None else f"{room.humidity_set_point:.2f}",
            ":SOURCE:CLOOP1:ERROR?": "ERROR" if room.alarms else "NONE",
            ":OUTPUT1:STATE?": "ON" if room.mode == "CONSTANT" else "OFF",
        }
        if question in stated:
            return stated[question]
        if room.deaf or room.locked:
            return None
        words, _, value = question.partition(" ")
        if words == ":SOURCE:CLOOP1:SPOINT":
            room.temperature_set_point = room.meant(float(value))
        elif words == ":SOURCE:CLOOP2:SPOINT":
            room.humidity_set_point = None if value == "OFF" else float(value)
        elif words == ":OUTPUT1:STATE" and value in ("ON", "OFF"):
            room.mode = "CONSTANT" if value == "ON" and not room.alarms else "STANDBY"
        return None


SCPI_TABLE = """
[unit]
ask = ":UNIT:TEMPERATURE?"
celsius = "C"
[temperature]
ask = ":SOURCE:CLOOP1:PVALUE?"
set_point = ":SOURCE:CLOOP1:SPOINT?"
tell = ":SOURCE:CLOOP1:SPOINT {value:.2f}"
[relative_humidity]
ask = ":SOURCE:CLOOP2:PVALUE?"
set_point = ":SOURCE:CLOOP2:SPOINT?"
tell = ":SOURCE:CLOOP2:SPOINT {value:.2f}"
off = [":SOURCE:CLOOP2:SPOINT OFF"]
[run]
ask = ":OUTPUT1:STATE?"
constant = ["ON"]
standby = ["OFF"]
start = [":OUTPUT1:STATE ON"]
stop = [":OUTPUT1:STATE OFF"]
[alarm]
ask = ":SOURCE:CLOOP1:ERROR?"
none = ["NONE"]
"""


class ModbusDevice:
    """An instrument with registers, by Modbus TCP or, with ``rtu``, on a serial line."""

    def __init__(self, room: Room | None = None, *, rtu: bool = False, unit: int = 1) -> None:
        self.room = room or Room()
        self._rtu, self._unit = rtu, unit

    def read(self, address: int) -> int | None:
        """The value of a register; None where there is none."""
        raise NotImplementedError

    def write(self, address: int, words: list[int]) -> None:
        raise NotImplementedError

    def questions(self, came: bytes) -> tuple[list[bytes], bytes]:
        whole = []
        while True:
            length = self._length(came)
            if length is None or len(came) < length:
                return whole, came
            whole.append(came[:length])
            came = came[length:]

    def _length(self, came: bytes) -> int | None:
        if not self._rtu:
            return None if len(came) < 6 else 6 + int.from_bytes(came[4:6])
        if len(came) < 7:
            return None
        return 9 + came[6] if came[1] == 16 else 8

    def answer(self, question: bytes) -> bytes:
        if self._rtu:
            unit, body = question[0], question[1:-2]
            if question[-2:] != _crc(question[:-2]):
                return b""
        else:
            unit, body = question[6], question[7:]
        if unit != self._unit:
            return b""
        told = bytes([unit]) + self._reply(body)
        self.room.note()
        return told + _crc(told) if self._rtu else question[:4] + len(told).to_bytes(2) + told

    def _reply(self, body: bytes) -> bytes:
        function, address = body[0], int.from_bytes(body[1:3])
        if function in (3, 4):
            words = [self.read(address + place) for place in range(int.from_bytes(body[3:5]))]
            if None in words:
                return bytes([function | 0x80, 2])
            return bytes([function, 2 * len(words)]) + b"".join((word or 0).to_bytes(2) for word in words)
        if self.room.locked:
            return bytes([function | 0x80, 4])
        if function == 6:
            words = [int.from_bytes(body[3:5])]
        else:
            count = int.from_bytes(body[3:5])
            words = [int.from_bytes(body[6 + 2 * place : 8 + 2 * place]) for place in range(count)]
        if not self.room.deaf:
            self.write(address, words)
        return body[:5]


class F4TDevice(ModbusDevice):
    """A Watlow F4T, as its user's guide lists its registers; floats with their low word first."""

    def __init__(self, room: Room | None = None, *, rtu: bool = False) -> None:
        super().__init__(room, rtu=rtu)
        self.loops = [62, 62]  # off
        self.program = 251  # not started

    def read(self, address: int) -> int | None:
        room = self.room
        self._follow()
        floats = {
            2820: room.shown(room.temperature),
            2980: room.relative_humidity,
            2782: room.shown(room.temperature_set_point),
            2942: room.humidity_set_point or 0.0,
        }
        for first, value in floats.items():
            if address in (first, first + 1):
                return _words(value)[address - first]
        plain = {6730: 30 if room.fahrenheit else 15, 14080: 30 if room.fahrenheit else 15, 16568: self.program}
        plain |= {2814: self.loops[0], 2974: self.loops[1], 2730: self.loops[0], 2890: self.loops[1]}
        plain |= {1356 + 100 * place: 61 for place in range(4)}
        if room.alarms:
            plain[1356] = 37
        return plain.get(address)

    def write(self, address: int, words: list[int]) -> None:
        room = self.room
        if address in (2782, 2942):
            value = struct.unpack("<f", struct.pack("<HH", *words))[0]
            if address == 2782:
                room.temperature_set_point = round(room.meant(value), 3)
            else:
                room.humidity_set_point = round(value, 3)
        elif address in (2730, 2890):
            self.loops[address == 2890] = words[0]
        elif address == 16566:
            self.program = 253
        if room.alarms:
            self.loops = [62, 62]
        self._follow()

    def _follow(self) -> None:
        if self.room.mode == "STANDBY" and self.room.alarms:
            self.loops = [62, 62]
        self.room.mode = "CONSTANT" if 10 in self.loops else "STANDBY"

    def answer(self, question: bytes) -> bytes:
        # With one loop on and the other still off, no pair of set points is regulated yet.
        before, self.room.note = self.room.note, lambda: None  # type: ignore[method-assign]
        try:
            return super().answer(question)
        finally:
            self.room.note = before  # type: ignore[method-assign]
            if self.loops[0] == 10:
                humidity = self.room.humidity_set_point if self.loops[1] == 10 else None
                now = (round(self.room.temperature_set_point, 2), humidity)
                if not self.room.regulated or self.room.regulated[-1] != now:
                    self.room.regulated.append(now)


class PlainModbusDevice(ModbusDevice):
    """A controller of whole numbers: tenths of a degree, tenths of a percent."""

    def read(self, address: int) -> int | None:
        room = self.room
        return {
            0: round(10.0 * room.shown(room.temperature)) & 0xFFFF,
            1: round(10.0 * room.relative_humidity),
            10: round(10.0 * room.shown(room.temperature_set_point)) & 0xFFFF,
            11: round(10.0 * (room.humidity_set_point or 0.0)),
            20: 1 if room.mode == "CONSTANT" else 0,
            30: room.alarms[0] if room.alarms else 0,
        }.get(address)

    def write(self, address: int, words: list[int]) -> None:
        room = self.room
        if address == 10:
            room.temperature_set_point = room.meant(struct.unpack("<h", struct.pack("<H", words[0]))[0] / 10.0)
        elif address == 11:
            room.humidity_set_point = words[0] / 10.0
        elif address == 20:
            room.mode = "CONSTANT" if words[0] and not room.alarms else "STANDBY"


MODBUS_TABLE = """
[temperature]
reading = { number = 0, scale = 0.1 }
set_point = { number = 10, scale = 0.1 }
[relative_humidity]
reading = { number = 1, scale = 0.1 }
set_point = { number = 11, scale = 0.1 }
[run]
state = 20
command = 20
constant = [1]
standby = [0]
start = 1
stop = 0
[alarm]
number = 30
"""


def _words(value: float) -> tuple[int, int]:
    low, high = struct.unpack("<HH", struct.pack("<f", value))
    return low, high


def _crc(frame: bytes) -> bytes:
    crc = 0xFFFF
    for byte in frame:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc.to_bytes(2, "little")


def _saturation(t: float) -> float:
    """Buck 1981."""
    return 611.21 * math.exp((18.678 - t / 234.5) * t / (257.14 + t))
