"""What a heading says of its column: which channels its words can mean, and the unit that it ends in."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from ipmclab.store.import_map import MAPPED
from ipmclab.units import spell_unit

_WORDS: Final[dict[str, str]] = {
    "time": "t time times zeit temps tiempo tempo tid tijd timestamp elapsed seconds date datum datetime uhrzeit heure "
    "fecha hora clock czas čas день время дата 时间 時間 时刻 日期 時刻 日時",
    "voltage": "u v e ewe voltage volt volts spannung tension voltaje voltagem tensione spanning potential potentiel "
    "napięcie napětí напряжение 电压 電圧",
    "current": "i current currents amp amps strom stromstärke courant corriente corrente stroom shunt prąd proud "
    "ток 电流 電流",
    "displacement": "x d delta δ displacement deflection deflexion laser weg auslenkung verschiebung position tip "
    "déplacement deplacement fleche flèche desplazamiento deslocamento spostamento verplaatsing przemieszczenie "
    "ugięcie posunutí výchylka перемещение 位移 変位",
    "force": "f force kraft load loadcell kraftmessdose wägezelle fuerza força forza kracht effort siła "
    "síla сила 力 荷重",
    "temperature": "temp temperature temperatur température temperatura teplota температура 温度 溫度",
    "relative_humidity": "rh humidity feuchte luftfeuchte humidité humidite humedad umidade umidità wilgotność "
    "vlhkost влажность 湿度 濕度",
}
"""Words of headings, in lower case, in the languages of the laboratories that we know of."""

_MEANINGS: Final = {word: channel for channel, words in _WORDS.items() for word in words.split()}

_JOINED: Final = re.compile(r"[^a-zäöüéèêçа-я]+|spannung|auslenkung|verschiebung|feuchte|temperatur|kraft")
"""Words that are joined to others: Chinese and Japanese write no blanks, German makes one word of several."""

_COMMANDED: Final = frozenset(
    [
        "set",
        "setpoint",
        "setpt",
        "soll",
        "sollwert",
        "command",
        "commanded",
        "cmd",
        "target",
        "ref",
        "reference",
        "nominal",
        "desired",
        "consigne",
    ]
)
_NOT_READ: Final = frozenset(
    [
        "max",
        "min",
        "limit",
        "std",
        "error",
        "err",
        "avg",
        "mean",
        "rms",
        "range",
        "resistance",
        "power",
        "charge",
        "energy",
    ]
)
"""Words next to that of a channel which say that the column is something else."""

_ROW: Final = re.compile(
    r"(?:(?:sample|row|scan|point|data|zeile)[ _]*)?(?:index|idx|nr|no|number|nummer|count|counter|sample|row|scan|"
    r"point|zeile|record|id|n|k|#|序号|点)\.?|.*\bpoint\b.*"
)

_SPELLED: Final[dict[str, str]] = {
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes segundo segundos secondi 秒",
    "ms": "ms msec millisecond milliseconds millisekunden 毫秒",
    "us": "us usec microseconds mikrosekunden",
    "min": "min mins minute minutes minuten",
    "h": "h hr hrs hour hours stunden",
    "d": "d day days tage",
    "V": "v volt volts 伏",
    "mV": "mv millivolt millivolts 毫伏",
    "uV": "uv microvolt microvolts",
    "A": "a amp amps ampere amperes ampère 安",
    "mA": "ma milliamp milliamps milliampere milliamperes 毫安",
    "uA": "ua microamp microamps microampere",
    "m": "m meter meters metre metres",
    "cm": "cm centimeter",
    "mm": "mm millimeter millimeters millimetre millimetres 毫米",
    "um": "um micron microns micrometer micrometre mikrometer 微米",
    "nm": "nm nanometer",
    "N": "n newton newtons 牛",
    "mN": "mn millinewton millinewtons 毫牛",
    "uN": "un micronewton",
    "gf": "gf",
    "degC": "degc c celsius deg_c grad_c",
    "percent": "percent % %rh rh% prozent %r.h. %rf",
}
_UNITS: Final = {spelling: unit for unit, spellings in _SPELLED.items() for spelling in spellings.split()}

_BRACKETS: Final = re.compile(
    r"^(?P<words>.*?)\s*[\[(（]\s*(?P<unit>[^\[\]()（）]*?[^\[\]()（）\d\s][^\[\]()（）]*?)\s*[\])）]\s*$"
)
_BEHIND: Final = re.compile(r"^(?P<words>.*?)(?:\s*[_/,:;]\s*|\s+in\s+|\s+)(?P<unit>[^\s_/,:;]+)$", re.IGNORECASE)


@dataclass(frozen=True)
class Heading:
    """What a heading says.

    Parameters
    ----------
    channels : tuple of str
        That its words can mean.
    unit : str
        In which the numbers are; empty where it says none.
    foreign_unit : str
        What is in brackets and is no unit that we know.
    is_commanded : bool
        It names what was asked for, not what was read.
    is_row : bool
        It counts rows.
    """

    channels: tuple[str, ...] = ()
    unit: str = ""
    foreign_unit: str = ""
    is_commanded: bool = False
    is_row: bool = False

    @property
    def of_unit(self) -> tuple[str, ...]:
        """The channels that are given in this unit."""
        return channels_of(self.unit)


def channels_of(unit: str) -> tuple[str, ...]:
    """The channels that are given in a unit."""
    return tuple(name for name, quantity in MAPPED.items() if unit in quantity.units and name != "applied_voltage")


def known_unit(text: str) -> str:
    """A unit in our spelling; empty where the text is none.

    Examples
    --------
    >>> known_unit("µA"), known_unit("[Sek.]"), known_unit("kg")
    ('uA', 's', '')
    """
    spelled = spell_unit(text.strip(" []()（）"))
    if any(spelled in quantity.units for quantity in MAPPED.values()):
        return spelled
    return _UNITS.get(spelled.lower().rstrip("."), "")


def read_heading(text: str, units_row: str | None = None) -> Heading:
    """What a heading says, with the unit that is below it where the file has a row of units.

    Examples
    --------
    >>> heading = read_heading("Strom (mA)")
    >>> heading.channels, heading.unit
    (('current',), 'mA')
    >>> read_heading("Laser voltage [V]").channels
    ('voltage', 'displacement')
    """
    written = " ".join(text.strip().lstrip("#%/ ").split())
    words, unit, foreign = written, "", ""
    bracketed = _BRACKETS.match(written)
    behind = _BEHIND.match(written)
    if bracketed:
        words, inside = bracketed["words"], bracketed["unit"]
        unit = known_unit(inside)
        foreign = "" if unit else inside
    elif behind and behind["words"] and (unit := known_unit(behind["unit"])):
        words = behind["words"]
    elif _MEANINGS.get(written.lower()) is None:
        unit = known_unit(written)
        words = "" if unit else written
    if units_row and units_row.strip(" []()-"):
        unit = known_unit(units_row)
        foreign = "" if unit else units_row.strip()
    if foreign == "g" and "force" in _channels(words):
        unit, foreign = "gf", ""  # a load cell that reads grams
    tokens = _tokens(words)
    return Heading(
        channels=() if tokens & _NOT_READ else _channels(words, unit),
        unit=unit,
        foreign_unit=foreign,
        is_commanded=bool(tokens & _COMMANDED),
        is_row=bool(_ROW.fullmatch(words.lower().replace("_", " ").strip())),
    )


def _tokens(words: str) -> frozenset[str]:
    return frozenset(re.findall(r"[^\W\d_]+", words.lower()))


def _channels(words: str, unit: str = "") -> tuple[str, ...]:
    """The channels whose words stand in a heading; a letter counts only where no word does."""
    lowered = words.lower()
    tokens = _tokens(lowered)
    if words.strip() == "T" and unit == "degC":
        return ("temperature",)
    if lowered.endswith("x_value"):
        return ("time",)  # of LabVIEW
    found = {_MEANINGS[token] for token in tokens if len(token) > 1 and token in _MEANINGS}
    found |= {channel for word, channel in _MEANINGS.items() if _JOINED.fullmatch(word) and word in lowered}
    if "load" in tokens and "current" in tokens:
        found.discard("force")
    if not found:
        found = {_MEANINGS[token] for token in tokens if len(token) == 1 and token in _MEANINGS}
    return tuple(name for name in MAPPED if name in found)
