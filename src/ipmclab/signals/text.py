"""Signals from text, with errors that point at the words that are wrong."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Final, NoReturn

from ipmclab.errors import InputError, suggest
from ipmclab.kinds import tell_kinds
from ipmclab.signals.broadband import Multisine, Prbs, Random
from ipmclab.signals.files import read_samples
from ipmclab.signals.samples import Samples
from ipmclab.signals.sequence import Sequence, refuse_idle
from ipmclab.signals.signal import CHOICES, QUANTITIES, Signal, check_value, is_required, is_unnamed
from ipmclab.signals.tones import Chirp, Cosine, Sine, Square, Step, Triangle
from ipmclab.units import ANGLE, FREQUENCY, NUMBER, TIME, VOLTAGE, parse_quantity

_WAVEFORMS: Final[dict[str, type[Signal]]] = {
    "step": Step,
    "dc": Step,
    "sine": Sine,
    "cosine": Cosine,
    "square": Square,
    "triangle": Triangle,
    "chirp": Chirp,
    "multisine": Multisine,
    "prbs": Prbs,
    "random": Random,
}
WORDS: Final = (*_WAVEFORMS, "file", "samples")
"""The words with which a signal begins."""

_LONG: Final = 500  # characters

_JOINTS: Final = ("for", "then")
_EXAMPLES: Final = {VOLTAGE: "1 V", FREQUENCY: "0.1 Hz", TIME: "0.5 s", ANGLE: "90 deg", NUMBER: "1"}
_UNITS: Final = {unit for quantity in QUANTITIES.values() for unit in quantity.units if unit}

# A quoted path, a name with its "=", or a word.
_WORD: Final = re.compile(r"""\s*("[^"]*"|'[^']*'|[A-Za-z_]\w*\s*=|[^\s=]+|=)""")
_PATH: Final = re.compile(r"""\s*("[^"]*"|'[^']*'|\S+)""")
_BARE_NUMBER: Final = re.compile(r"[+-]?[\d.,]+(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf(?:inity)?)", re.IGNORECASE)


@tell_kinds
def parse(text: str, *, folder: str | Path = "") -> Signal:
    """Read a signal from text.

    Parameters
    ----------
    text : str
        For example ``"sine 1 V 0.1 Hz phase=90 deg for 20 s then step 0.5 V"``; the package's own
        documentation lists every form.
    folder : str or Path
        Where a file is looked for that is named without its own; the current one where it is left out.

    Returns
    -------
    signal : Signal

    Raises
    ------
    InputError
        Names the words that are wrong, where they stand, and what would be right there.

    Examples
    --------
    >>> parse("sine 1 V 0.1 Hz phase=90 deg").voltage([0.0, 5.0]).tolist()
    [1.0, -1.0]
    >>> try:
    ...     parse("sien 1 V 0.1 Hz")
    ... except InputError as error:
    ...     print(error)
    signal 'sien 1 V 0.1 Hz', at 'sien' (character 1): unknown waveform 'sien'; did you mean 'sine'?
    """
    # What a file holds may have changed since; a long text would fill the memory.
    return _kept(text) if len(text) < _LONG and "file" not in text.lower() else _read(text, str(folder))


@lru_cache(maxsize=256)
def _kept(text: str) -> Signal:
    """Kept, because reading a text takes longer than simulating 2,000 rows."""
    return _read(text, "")


def _read(text: str, folder: str) -> Signal:
    reader = _Reader(text, folder=Path(folder))
    signals: list[Signal] = []
    durations: list[float] = []
    while True:
        signals.append(_read_waveform(reader))
        joint = reader.next()
        if joint == "for":
            start = reader.begin
            durations.append(_read_number(reader, "duration", reader.at))
            _refuse_idle(reader, signals[-1], durations[-1], start)
            joint = reader.next()
        if joint is None:
            break
        if joint != "then":
            reader.fail(f"unexpected {joint!r}", "unexpected-word", _about_unexpected(joint, signals[-1]))
        if len(durations) < len(signals):
            reader.fail(
                "how long does the signal before 'then' last?",
                "missing-duration",
                f"write for example '{signals[-1]} for 20 s then ...'",
            )
    return signals[0] if not durations else Sequence(tuple(signals), tuple(durations))


def _refuse_idle(reader: _Reader, signal: Signal, duration: float, start: int) -> None:
    reader.begin = start  # at "for"
    try:
        refuse_idle(signal, duration, where="")
    except InputError as error:
        raise _pointed(error, reader) from error


@dataclass
class _Reader:
    """Walks along the words of a text and knows where it is."""

    text: str
    at: int = 0
    """Where the next word starts to be looked for."""
    begin: int = 0
    """Where the words that an error is about begin."""
    folder: Path = Path()
    """Where files are looked for."""

    def next(self, pattern: re.Pattern[str] = _WORD) -> str | None:
        """The next word, or None at the end."""
        match = pattern.match(self.text, self.at)
        if match is None:
            self.begin = self.at = len(self.text.rstrip())
            return None
        self.begin, self.at = match.start(1), match.end()
        return match.group(1)

    def peek(self) -> str | None:
        match = _WORD.match(self.text, self.at)
        return match.group(1) if match else None

    def place(self) -> str:
        words = self.text[self.begin : self.at]
        point = f"at {words!r} (character {self.begin + 1})" if words.strip() else "at its end"
        return f"signal {self.text!r}, {point}"

    def fail(self, message: str, code: str, repair: str) -> NoReturn:
        raise InputError(message, code=code, where=self.place(), repair=repair)


def _read_waveform(reader: _Reader) -> Signal:
    word = reader.next()
    if word is None:
        reader.fail("a waveform is missing", "missing-word", "write for example 'step 1 V'")
    if word not in WORDS:
        reader.fail(f"unknown waveform {word!r}", "unknown-waveform", suggest(word, WORDS))
    if word == "file":
        return _read_file(reader)
    if word == "samples":
        return _read_samples(reader)
    return _read_parameters(reader, word)


def _read_parameters(reader: _Reader, word: str) -> Signal:
    kind = _WAVEFORMS[word]
    names = {parameter.name: is_required(parameter) for parameter in fields(kind)}
    unnamed = [parameter.name for parameter in fields(kind) if is_unnamed(parameter)]
    usage = " ".join([word, *(_EXAMPLES[QUANTITIES[name]] for name in unnamed)])
    values: dict[str, float | int | str] = {}
    for name in unnamed:
        following = reader.peek()
        if following is None or following in _JOINTS or following.endswith("="):
            if not names[name]:
                break
            if following is not None:
                reader.begin = reader.at
                reader.next()
            label = name.replace("_", " ")
            reader.fail(f"the {label} of {word!r} is missing", "missing-word", f"write for example {usage!r}")
        values[name] = _read_number(reader, name, reader.at)
    start = reader.begin
    _read_options(reader, word, names, values)
    try:
        return kind(**values)
    except InputError as error:
        reader.begin = start
        raise _pointed(error, reader) from error


def _read_options(reader: _Reader, word: str, names: Collection[str], values: dict[str, float | int | str]) -> None:
    while (following := reader.peek()) is not None and following.endswith("=") and following != "=":
        reader.next()
        begin, name = reader.begin, following.removesuffix("=").rstrip()
        if name not in names:
            reader.fail(f"{word!r} has no option {name!r}", "unknown-option", suggest(name, names))
        if name in values:
            reader.fail(f"{name!r} is given twice", "duplicate-option", "leave one of them out")
        if name in CHOICES:
            choice = reader.next() or ""
            reader.begin = begin
            try:
                values[name] = check_value(name, choice, where=name)
            except InputError as error:
                raise _pointed(error, reader) from error
        else:
            values[name] = _read_number(reader, name, begin)


def _read_number(reader: _Reader, name: str, begin: int) -> float | int:
    """A number and its unit, which may be one word or two."""
    number = reader.next()
    if number is None or number in _JOINTS:
        reader.fail(
            f"the {name.replace('_', ' ')} is missing",
            "missing-word",
            f"write for example {_EXAMPLES[QUANTITIES[name]]!r}",
        )
    if begin < reader.begin and not reader.text[begin : reader.begin].strip():
        begin = reader.begin
    written = number
    following = reader.peek()
    if _BARE_NUMBER.fullmatch(number) and following is not None and _is_unit(following, QUANTITIES[name].unit):
        written = f"{number} {reader.next()}"
    reader.begin = begin
    example = _EXAMPLES[QUANTITIES[name]]
    if re.match(r"[+-]?(nan|inf)", number, re.IGNORECASE):
        reader.fail(f"{written!r} is not a finite number", "bad-number", f"write for example {example!r}")
    try:
        value = check_value(name, parse_quantity(written, QUANTITIES[name], where=name), where=name)
    except InputError as error:
        if error.code == "bad-number":
            error.repair = f"write for example {example!r}"
        raise _pointed(error, reader) from error
    assert not isinstance(value, str)
    return value


def _is_unit(word: str, unit: str) -> bool:
    """Whether a word after a number is meant as its unit: for a bare number only if it could be nothing else."""
    if word in _UNITS:
        return True  # also one that begins like a number: 1/s
    return bool(unit) and word not in _JOINTS and not word.endswith("=") and not _BARE_NUMBER.match(word)


def _read_file(reader: _Reader) -> Samples:
    quoted = reader.next(_PATH)
    if quoted is None:
        reader.fail("the path of the file is missing", "missing-word", "write for example 'file voltage.csv'")
    path = quoted[1:-1] if quoted[0] in "\"'" and quoted[-1] == quoted[0] and len(quoted) > 1 else quoted
    path = path if reader.folder == Path() else str(reader.folder / path)
    begin = reader.begin
    try:
        time, voltage = read_samples(path)
        values: dict[str, float | int | str] = {}
        _read_options(reader, "file", ("delay", "gain"), values)
        delay, gain = float(values.get("delay", 0.0)), float(values.get("gain", 1.0))
        return Samples(time, voltage, delay=delay, path=path, gain=gain)
    except InputError as error:
        if error.where.startswith("signal "):
            raise
        reader.begin = begin
        raise _pointed(error, reader, keep=True) from error


def _read_samples(reader: _Reader) -> Samples:
    times: list[float] = []
    voltages: list[float] = []
    begin = reader.begin
    while (following := reader.peek()) is not None and following not in _JOINTS and not following.endswith("="):
        times.append(_read_number(reader, "time", reader.at))
        voltages.append(_read_number(reader, "voltage", reader.at))
    end = reader.at
    values: dict[str, float | int | str] = {}
    _read_options(reader, "samples", ("delay",), values)
    try:
        return Samples(times, voltages, delay=float(values.get("delay", 0.0)))
    except InputError as error:
        reader.begin, reader.at = begin, end
        raise _pointed(error, reader) from error


def _pointed(error: InputError, reader: _Reader, *, keep: bool = False) -> InputError:
    where = f"{reader.place()}, {error.where}" if keep and error.where else reader.place()
    return error.at(where)


def _about_unexpected(word: str, signal: Signal) -> str:
    names = [parameter.name for parameter in fields(signal) if not is_unnamed(parameter)]
    if word in names:
        return f"write '{word}=...'"
    return suggest(word, [*_JOINTS, *(f"{name}=" for name in names)])
