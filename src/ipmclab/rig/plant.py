"""A strip behind its sensors: what is at the terminals of a rig while its output drives an actuator.

The in-process virtual bench and the stand-in chassis read the same plant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.four_probe import sheet_factor
from ipmclab.model.stages.circuit import CONTACT, SHEET
from ipmclab.rig.channels import Channel, FourProbe, Rig
from ipmclab.rig.exact import TICK, ExactSystem, to_ticks
from ipmclab.rig.lag import Lag
from ipmclab.rig.thermometer import platinum_resistance

if TYPE_CHECKING:
    from ipmclab.model import Actuator
    from ipmclab.model.assemble import System
    from ipmclab.rig.chambers.virtual import VirtualChamber
    from ipmclab.rig.plant_water import StripWater

FloatArray = npt.NDArray[np.float64]

Tip = Literal["either", "free", "on cell"]
"""Where the tip is: clear of the load cell, against it, or each sensor reads as if the strip were mounted for it."""

Contact = Literal["good", "bad", "open"]
"""How the clamp touches the electrodes."""

CONTACT_RESISTANCE: Final[dict[Contact, float]] = {"good": 0.0, "bad": 50.0, "open": 1e6}
"""What a contact adds in series with the strip [ohm]."""

CHAMBER_TIME: Final = 300.0
"""Time constant [s] with which the air follows the chamber's setting."""

PRELOAD_TIME: Final = 600.0
"""Time constant [s] with which the preload of the load cell falls."""

DUMMY_RESISTANCE: Final = 10.0
DUMMY_CAPACITANCE: Final = 0.1
"""The dummy load of ``rig prove`` [ohm, F], in series."""

_BEYOND_ANY_SENSOR: Final = 1.0  # [m]

_TEMPERATURE_LIMITS: Final = (-40.0, 150.0)  # of the thesis's chamber (Espec SH-262) [degC]


class StripPlant:
    """An actuator in the clamp, in series with shunt and source, its sensors, and the air around it.

    Its clock starts at 0 with a strip that is discharged and at rest. The strip is computed exactly over any
    interval, so that blocks of any rate and calls at any time may follow each other.

    Parameters
    ----------
    rig : Rig
        With the wiring, the sensors, and in ``rig.virtual`` what the plant is like.
    actuator : Actuator, optional
        That of ``rig.virtual`` where it is left out.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> plant = StripPlant(THESIS_RIG)
    >>> volts = plant.advance([0.0, 0.02, 0.04], {"cDAQ1Mod2/ao0": [0.0, 1.0, 1.0]})
    >>> volts["cDAQ1Mod1/ai0"].round(4).tolist()  # the shunt, before the edge and after it
    [0.0, 0.0561, 0.0553]
    """

    def __init__(self, rig: Rig, actuator: Actuator | None = None) -> None:
        about = rig.virtual
        self.rig = rig
        self._actuator = None if about.load == "dummy" else actuator or _load(about.actuator)
        self._contact: Contact = "good"
        self._tip: Tip = "either"
        self.laser_blocked = False
        self.probes_shorted = False
        self._now = 0
        self._mounted = 0.0
        self.temperature = Lag(about.temperature, CHAMBER_TIME)
        self.relative_humidity = Lag(about.relative_humidity, CHAMBER_TIME)
        self.chamber = self._virtual_chamber()
        self._water = self._strip_water()
        self._strip = ExactSystem(self._system())
        self._named = {channel.physical or channel.name: channel for channel in rig.channels}

    @property
    def noise(self) -> dict[str, float]:
        """Standard deviation [V] of the noise that each sensor adds at its terminal.

        Whoever converts adds it to that of the converter, sample by sample: the plant is asked at other times too.
        """
        return {
            terminal: channel.sensor_noise / abs(channel.gain)
            for terminal, channel in self._named.items()
            if channel.sensor_noise
        }

    @property
    def time(self) -> float:
        """How far the plant has come [s]."""
        return self._now * TICK

    @property
    def actuator(self) -> Actuator | None:
        """The strip in the clamp; None where there is a dummy load."""
        return self._actuator

    @property
    def terminals(self) -> tuple[str, ...]:
        """What can be read; the name of a channel where it has no physical one."""
        meter, probe = self.rig.thermometer, self.rig.four_probe
        others = [] if meter is None else [meter.physical or "thermometer"]
        others += [] if probe is None else [probe.physical or "four_probe"]
        return (*self._named, *others)

    def advance(self, times: npt.ArrayLike, outputs: Mapping[str, npt.ArrayLike]) -> Mapping[str, FloatArray]:
        """Let time pass, and read every terminal at some times.

        Parameters
        ----------
        times : float array, shape (n_time,) [s]
            Ascending, not before ``time``.
        outputs : mapping of terminal to float array, shape (n_time,) [V]
            What each output gave since the time before; an output that is left out gives 0 V.

        Returns
        -------
        terminals : mapping of terminal to float array, shape (n_time,) [V]
            Just before the output changes, without noise. For the thermometer and the four-probe contacts it is the
            resistance [ohm]. What nobody looks at is not computed.
        """
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        source = outputs.get(self.rig.output.physical)
        volts = np.zeros(len(instants)) if source is None else np.atleast_1d(np.asarray(source, dtype=np.float64))
        return self._read(instants, volts)

    def _read(self, times: FloatArray, source: FloatArray) -> Mapping[str, FloatArray]:
        ticks = to_ticks(times)
        intervals = ticks.copy()
        intervals[1:] -= ticks[:-1]
        intervals[:1] -= self._now
        if len(intervals) and intervals.min() < 0:
            raise ValueError(f"the time goes back to {times[int(np.argmin(intervals))]:g} s, from {self.time:g} s")
        self._follow_air()
        answer = self._strip.advance(intervals, np.ascontiguousarray(source))
        current: FloatArray = answer[0]
        displacement: FloatArray = answer[2] if self._water is None else answer[2] + self._water.curl(times)
        force: FloatArray = answer[3]
        if len(ticks):
            self._now = int(ticks[-1])

        def value(name: str) -> FloatArray:
            if name == "voltage":
                return source - self._drop() * current
            if name == "current":
                return current
            if name == "displacement":
                return np.zeros_like(current) if self._tip == "on cell" else self._before_laser(displacement)
            if name == "force":
                return force
            return self._air(times)[0 if name == "temperature" else 1]

        def terminal(name: str) -> FloatArray:
            channel, meter, probe = self._named.get(name), self.rig.thermometer, self.rig.four_probe
            if channel is not None:
                return self._sensor(channel, value(channel.name) + self._rest(channel, times))
            if meter is not None and name == (meter.physical or "thermometer"):
                return platinum_resistance(value("temperature"), meter.resistance)
            assert probe is not None
            return np.full(len(times), self._surface_resistance(probe))

        return _Terminals(self.terminals, terminal)

    def _before_laser(self, displacement: FloatArray) -> FloatArray:
        """What a laser reads of large bending [m]; beyond the range of any sensor where it has lost the strip."""
        if self._actuator is None or not self._actuator.structure.laser:
            return displacement
        from ipmclab.model.stages.laser import Laser

        laser, values = Laser(), self._actuator.parameter_values
        read = laser.reading(displacement, values).values
        return np.where(laser.lost(read, values), read + np.copysign(_BEYOND_ANY_SENSOR, read), read)

    def _virtual_chamber(self) -> VirtualChamber | None:
        """The chamber around the strip, where the rig has a simulated one; its clock is that of the plant."""
        if self.rig.chamber is None or not self.rig.chamber.is_virtual:
            return None
        from ipmclab.rig.chambers.chamber import Ranges
        from ipmclab.rig.chambers.virtual import RANGES, VirtualChamber, VirtualClimate

        about = self.rig.virtual
        stated = self.rig.chamber
        climate = VirtualClimate(
            Ranges(stated.temperature or RANGES.temperature, stated.relative_humidity or RANGES.relative_humidity),
            room_temperature=about.temperature,
            room_humidity=about.relative_humidity,
        )
        return VirtualChamber(lambda: self.time, climate, seed=about.seed)

    def _air(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The air around the strip [degC] and [percent]."""
        if self.chamber is not None:
            return self.chamber.air(times)
        return self.temperature.at(times), self.relative_humidity.at(times)

    def _strip_water(self) -> StripWater | None:
        """The water of a strip whose parameters follow it."""
        strip = self._actuator
        if strip is None or not (strip.environment_laws or strip.structure.hydration):
            return None
        from ipmclab.rig.plant_water import StripWater

        return StripWater(strip, self._air, self.time, wet=self.rig.virtual.hydrated)

    def _follow_air(self) -> None:
        """Let the strip follow its air; charge continues."""
        if self._water is None:
            return
        before = self._water.strip.parameter_values
        if self._water.follow(self.time):
            from ipmclab.model.environment.charge import charges

            system, after = self._system(), self._water.strip.parameter_values
            kept = charges(system.states, before) / charges(system.states, after)
            self._strip = ExactSystem(system, self._strip.state * kept)

    def _drop(self) -> float:
        """The resistance [ohm] between the output and where the voltage is sensed."""
        upstream = self.rig.voltage_sensed == "upstream of shunt"
        return self.rig.source_resistance + (0.0 if upstream else self.rig.shunt_resistance)

    def _rest(self, channel: Channel, times: FloatArray) -> FloatArray | float:
        """What the sensor reads while the strip rests."""
        drift = self.rig.virtual.preload_drift
        if channel.name != "force" or self._actuator is None or not drift:
            return channel.rest
        return channel.rest + drift * np.expm1(-(times - self._mounted) / PRELOAD_TIME)

    def _sensor(self, channel: Channel, output: FloatArray) -> FloatArray:
        """What a sensor makes of what is there to be measured [V]."""
        if channel.name == "force" and (self._tip == "free" or self._actuator is None):
            output = np.zeros_like(output)
        if channel.sensor_range is None:
            return channel.to_volts(output)
        low, high = channel.sensor_range
        volts = channel.to_volts(np.clip(output, low, high))
        if channel.lost is None:
            return volts
        if channel.name == "displacement" and (self.laser_blocked or self._actuator is None):
            return np.full(len(output), channel.lost)
        return np.where((output < low) | (output > high), channel.lost, volts)

    def _surface_resistance(self, probe: FourProbe) -> float:
        """What the meter of the four-probe contacts reads [ohm]; a dummy load has no surface."""
        if self.probes_shorted:
            return self.rig.virtual.meter_offset
        if self._actuator is None:
            return CONTACT_RESISTANCE["open"]
        width, length = self._actuator["geometry.width"], _length(self._actuator)
        squares = 1.0 / sheet_factor(probe.contacts, probe.spacing, width, length)
        return self._actuator[SHEET] * squares + self.rig.virtual.meter_offset

    def _system(self) -> System:
        """The strip, or the dummy load, as the output sees it."""
        in_series = self.rig.shunt_resistance + self.rig.source_resistance + CONTACT_RESISTANCE[self._contact]
        if self._actuator is None:
            return _dummy(in_series)
        strip = self._actuator if self._water is None else self._water.strip
        resistance = min(strip[CONTACT] + in_series, strip.parameters()[CONTACT].upper)
        return strip.replace(**{CONTACT: resistance}).system

    @property
    def tip(self) -> Tip:
        """Where the tip is."""
        return self._tip

    @tip.setter
    def tip(self, place: Tip) -> None:
        if place == "on cell" != self._tip:
            self._mounted = self.time
        self._tip = place

    @property
    def contact(self) -> Contact:
        """How the clamp touches the electrodes."""
        return self._contact

    @contact.setter
    def contact(self, contact: Contact) -> None:
        self._contact = contact
        self._strip = ExactSystem(self._system(), self._strip.state)

    def rest(self) -> None:
        """Let the strip discharge and come to rest, as if hours had passed."""
        self._strip.state[:] = 0.0

    def set_chamber(self, *, temperature: float | None = None, relative_humidity: float | None = None) -> None:
        """Set the chamber; the air follows with ``CHAMBER_TIME``.

        Parameters
        ----------
        temperature : float [degC], optional
        relative_humidity : float [percent], optional

        Raises
        ------
        InputError
            What no chamber gives.
        """
        if self.chamber is not None:
            raise InputError(
                "the chamber of this rig is set by the program",
                code="bad-value",
                where="chamber",
                repair="state the conditions in the experiment",
            )
        limits = {"temperature": _TEMPERATURE_LIMITS, "relative_humidity": (0.0, 100.0)}
        for name, value in (("temperature", temperature), ("relative_humidity", relative_humidity)):
            if value is None:
                continue
            low, high = limits[name]
            if not low <= value <= high:
                raise InputError(
                    f"the chamber cannot be set to {value:g}, it goes from {low:g} to {high:g}",
                    code="out-of-range",
                    where=name,
                    repair="give a value within",
                )
            lag: Lag = getattr(self, name)
            lag.set(value, self.time)


class _Terminals(Mapping[str, FloatArray]):
    """What is at the terminals, computed where it is looked at."""

    def __init__(self, names: tuple[str, ...], read: Callable[[str], FloatArray]) -> None:
        self._names = names
        self._read = read

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self._names:
            raise KeyError(name)
        return self._read(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _load(name: str) -> Actuator:
    from ipmclab.model import load_actuator

    return load_actuator(name)


def _length(actuator: Actuator) -> float:
    """Of the whole strip [m]."""
    return actuator["geometry.free_length"] + actuator["geometry.clamped_length"]


def _dummy(in_series: float) -> System:
    """A resistor and a capacitor in series; nothing moves."""
    from ipmclab.model.assemble import System

    resistance = DUMMY_RESISTANCE + in_series
    rate = 1.0 / (resistance * DUMMY_CAPACITANCE)
    return System(
        states=("dummy.capacitor",),
        inputs=("voltage",),
        outputs=("current", "applied_voltage", "displacement", "force"),
        a=np.array([[-rate]]),
        b=np.array([[rate]]),
        c=np.array([[-1.0 / resistance], [1.0], [0.0], [0.0]]),
        d=np.array([[1.0 / resistance], [0.0], [0.0], [0.0]]),
    )
