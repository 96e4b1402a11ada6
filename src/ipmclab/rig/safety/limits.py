"""The limits of a strip: what it may be given, and how far its readings may go. A plan checks them, the guard watches
them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ipmclab.errors import InputError, unknown_name
from ipmclab.rig.request import chunks
from ipmclab.rig.safety.limit import (
    _HUMIDITY,
    AIR,
    ELECTROLYSIS,
    NEEDS,
    QUANTITIES,
    Limit,
    _read,
    _text,
    _unseen,
    _write,
    shown,
    words,
)
from ipmclab.units import (
    SLEW_RATE,
    format_quantity,
    parse_quantity,
)

if TYPE_CHECKING:
    from ipmclab.rig.channels import Rig
    from ipmclab.signals import Signal


MOST_VOLTAGE: Final = 10.0
"""No strip is given more [V], whatever a table states: it is what the NI 9263 can give."""


_OFF: Final = "off"

_ROUNDING: Final = 1e-6
"""By this share a ramp may exceed its limit: in hours at 10 kHz the times of rows are rounded to 1e-8 of a row."""


@dataclass(frozen=True)
class Limits:
    """Everything that the guard watches; None is not watched.

    The defaults are for a strip such as ``friend-2``: 30 mm x 5 mm x 0.245 mm, 103 mg dry with 10 mg of water
    (0.15 J/K), 250 mm^2 of surface in still air (about 5 mW/K, so that it warms with a time constant of 30 s).
    3 V x 110 mA would warm it by some 60 K in the end, and by 2 K in each second at first.

    Parameters
    ----------
    voltage : Limit [V]
        3.5 V. A plan that needs more is refused, and so is such a value where voltages are handed to the bench. The
        guard holds the reading against it too, with a tolerance of 2 % and 20 mV for noise and calibration.
    current : Limit [A]
        0.5 A for 50 ms: a short circuit. The inrush of friend-2 is 57 mA for a step of 1 V and 324 mA for a square
        of 3.5 V.
    mean_current : Limit [A]
        Mean magnitude over 1 s; 190 mA for 1 s. A square of 3 V, 0.1 Hz draws that much for no longer.
    charge : Limit [C]
        Magnitude that passes while the electrodes are above 1.23 V; 10 C split 0.9 mg of water, a tenth of what the
        strip holds, into 1.3 ml of hydrogen, and oxygen.
    power : Limit [W]
        Into the strip, mean over 1 s; 0.3 W for 5 s warm it by up to 10 K.
    energy : Limit [J]
        Into the strip since the run began; 25 J, a warning: as heat it would evaporate all 10 mg of water.
    displacement : Limit [m]
        12 mm for 0.5 s, a warning: the strip leaves the range of the laser.
    force : Limit [N]
        80 mN for 0.1 s, a warning: the load cell ends at 98 mN.
    temperature : Limit [degC]
        Of the air; 60 degC for 10 s.
    relative_humidity : Limit [percent]
        Of the air; not watched unless it is stated. A sensor that is wet reads 100 percent.
    slew : float [V/s], optional
        Steepest ramp of a signal. A change that stands alone is a step and has no such limit.

    Examples
    --------
    >>> limits = Limits.from_table({"voltage": "2 V", "force": {"most": "20 mN", "action": "zero"}})
    >>> limits.voltage.most, limits.force
    (2.0, Limit(most=0.02, duration=0.1, action='zero', least=None))
    """

    voltage: Limit = Limit(3.5, 0.02)
    current: Limit | None = Limit(0.5, 0.05)
    mean_current: Limit | None = Limit(0.19, 1.0)
    charge: Limit | None = Limit(10.0)
    power: Limit | None = Limit(0.3, 5.0)
    energy: Limit | None = Limit(25.0, 0.0, "warn")
    displacement: Limit | None = Limit(12e-3, 0.5, "warn")
    force: Limit | None = Limit(80e-3, 0.1, "warn")
    temperature: Limit | None = Limit(60.0, 10.0)
    relative_humidity: Limit | None = None
    slew: float | None = None

    def __post_init__(self) -> None:
        if self.voltage.most > MOST_VOLTAGE:
            raise InputError(
                f"the limit is {self.voltage.most:g} V, no strip is given more than {MOST_VOLTAGE:g} V",
                code="bad-limit",
                where="limits.voltage",
                repair="give what this strip withstands, such as 3.5 V",
            )
        if self.voltage.action != "zero":
            raise InputError(
                "a voltage beyond its limit always ends the run",
                code="bad-limit",
                where="limits.voltage.action",
                repair="leave the action out",
            )
        if self.slew is not None and not 0.0 < self.slew < math.inf:
            raise InputError(
                f"the limit is {self.slew:g} V/s, it must be above 0",
                code="bad-limit",
                where="limits.slew",
                repair="give for example 1 V/s, or leave it out",
            )

    @property
    def watched(self) -> dict[str, Limit]:
        """The limits that are set, by name."""
        found = {name: getattr(self, name) for name in QUANTITIES}
        return {name: limit for name, limit in found.items() if limit is not None}

    @classmethod
    def from_table(cls, table: Mapping[str, Any], *, where: str = "limits") -> Limits:
        """Read limits from a table of texts with units; what it does not name keeps its default.

        Parameters
        ----------
        table : mapping
            For each limit a text such as ``"150 mA"``, ``"off"``, or a table with ``most``, ``duration`` and
            ``action``, of which each may be left out.
        where : str
            What the messages name.

        Raises
        ------
        InputError
            An unknown key, a unit of something else, a voltage limit that is off or above 10 V.
        """
        values: dict[str, Limit | float | None] = {}
        defaults = cls()
        for key, given in table.items():
            place = f"{where}.{key}"
            if key == "slew":
                values[key] = None if given == _OFF else parse_quantity(_text(given, place), SLEW_RATE, where=place)
            elif key not in QUANTITIES:
                raise unknown_name("key", key, [field.name for field in fields(cls)], where=place)
            elif given == _OFF:
                if key == "voltage":
                    raise InputError(
                        "the voltage is never without a limit",
                        code="bad-limit",
                        where=place,
                        repair="give what this strip withstands, such as '3.5 V'",
                    )
                values[key] = None
            else:
                values[key] = _read(given, getattr(defaults, key) or _HUMIDITY, key, place)
        try:
            return replace(defaults, **values)  # type: ignore[arg-type]
        except InputError as error:
            error.where = error.where.replace("limits", where)
            raise

    def to_table(self) -> dict[str, Any]:
        """The limits as ``from_table`` reads them back to equal ones.

        Examples
        --------
        >>> Limits.from_table(Limits().to_table()) == Limits()
        True
        """
        table: dict[str, Any] = {}
        for name, quantity in QUANTITIES.items():
            limit: Limit | None = getattr(self, name)
            table[name] = _OFF if limit is None else _write(limit, quantity)
        table["slew"] = _OFF if self.slew is None else format_quantity(self.slew, SLEW_RATE)
        return table

    def as_text(self) -> dict[str, str]:
        """The limits as they are in the record of a run.

        Examples
        --------
        >>> Limits().as_text()["current"]
        '500 mA for 0.05 s, then zero'
        """
        texts = {}
        for name, limit in self.watched.items():
            lasts = f" for {limit.duration:g} s" if limit.duration else ""
            most = shown(name, limit.most)
            ends = most if limit.least is None else f"{shown(name, limit.least)} to {most}"
            texts[name] = f"{ends}{lasts}, then {limit.action}"
        if self.slew is not None:
            texts["slew"] = f"{self.slew:g} V/s"
        return texts

    def refuse(self, signal: Signal, duration: float, rate: float) -> None:
        """Refuse a signal that would put more on the strip than it withstands.

        Parameters
        ----------
        signal : Signal
        duration : float [s]
        rate : float [Hz]

        Raises
        ------
        InputError
            ``"voltage-limit"`` with the first row that is beyond the limit, ``"slew-limit"`` with the steepest ramp.

        Examples
        --------
        >>> from ipmclab.signals import parse
        >>> try:
        ...     Limits().refuse(parse("step 35 V"), 40.0, 50.0)
        ... except InputError as error:
        ...     print(error)
        signal: it commands 35 V at 0 s, the limit is 3.5 V; give a smaller amplitude or offset
        """
        most, before = self.voltage.most, np.array([])
        steepest = at = 0.0
        for first, voltage in chunks(signal, round(duration * rate), rate):
            beyond = np.flatnonzero(~(np.abs(voltage) <= most))  # what is no number is beyond too
            if len(beyond):
                row = int(beyond[0])
                raise InputError(
                    f"it commands {voltage[row]:.6g} V at {(first + row) / rate:.6g} s, the limit is {most:g} V",
                    code="voltage-limit",
                    where="signal",
                    repair="give a smaller amplitude or offset",
                )
            if self.slew is not None:
                joined = np.concatenate([before, voltage])
                slopes = _ramps(joined) * rate
                if len(slopes) and slopes.max() > steepest:
                    steepest, row = float(slopes.max()), int(slopes.argmax()) - len(before)
                    at = (first + row) / rate
                before = joined[len(slopes) :]  # a ramp may continue in the next piece
        if self.slew is not None and steepest > self.slew * (1.0 + _ROUNDING):
            raise InputError(
                f"it ramps by {steepest:.4g} V/s at {at:.6g} s, the limit is {self.slew:g} V/s",
                code="slew-limit",
                where="signal",
                repair="give a lower frequency or amplitude; a step has no such limit",
            )

    def remarks(self, signal: Signal, duration: float, rate: float) -> tuple[str, ...]:
        """What a plan should say about a signal that is not refused.

        Parameters
        ----------
        signal : Signal
        duration : float [s]
        rate : float [Hz]

        Examples
        --------
        >>> from ipmclab.signals import parse
        >>> print(*Limits().remarks(parse("step 2 V"), 40.0, 50.0))
        it is above 1.23 V for 40 s, up to 2 V: the water in the strip is split there
        """
        above = largest = 0.0
        for _, voltage in chunks(signal, round(duration * rate), rate):
            above += np.count_nonzero(np.abs(voltage) > ELECTROLYSIS)
            largest = max(largest, float(np.abs(voltage).max()))
        if not above:
            return ()
        return (
            f"it is above {ELECTROLYSIS} V for {above / rate:.3g} s, up to {largest:.3g} V: "
            "the water in the strip is split there",
        )

    def unwatched(self, rig: Rig, measured: Collection[str]) -> dict[str, str]:
        """The limits that the readings of a rig cannot show to be passed, and why, in words.

        Displacement and force that are not to be measured are left out.

        Parameters
        ----------
        rig : Rig
        measured : collection of str
            What will be read in addition to the voltage and the current.
        """
        read = {"voltage", "current", *measured} & {channel.name for channel in rig.channels}
        elsewhere = {"displacement", "force"}
        if rig.thermometer is not None:
            elsewhere.add("temperature")
        if rig.chamber is not None:
            elsewhere.update(AIR)
        found = {}
        for name, limit in self.watched.items():
            missing = [channel for channel in NEEDS[name] if channel not in read]
            if missing and name not in elsewhere:
                found[name] = f"the limit of the {words(name)} is not watched: the {words(missing[0])} is not measured"
            elif name in read:
                unseen = _unseen(name, limit, rig[name])
                found |= {} if unseen is None else {name: unseen}
        return found


def _ramps(voltage: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The change per row of every ramp: the middle one of three changes in one direction.

    A jump at the start or the end of a ramp is not the middle one.
    """
    changes = np.diff(voltage)
    three = np.stack([changes[:-2], changes[1:-1], changes[2:]])
    ramp = np.abs(np.sign(three).sum(axis=0)) == 3
    return np.where(ramp, np.median(np.abs(three), axis=0), 0.0)
