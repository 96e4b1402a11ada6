"""The sheet-resistance meter: an NI 9217 at the four contacts on the strip (Friend, section 3.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import FourProbe, Rig

FloatArray = npt.NDArray[np.float64]

RATE: Final = 2.0
"""Readings a second: an NI 9217 that resolves well takes 0.2 s for each."""

NOISE: Final = 1.2e-3
"""Standard deviation [ohm] of a reading of an NI 9217 that takes its time: 0.003 K of a Pt100."""

_ANSWER: Final = 5.0  # s, for a server to answer
_PATIENCE: Final = 5.0  # s, beyond the time that the readings take
_FEWEST, _MOST = 3, 1000


@dataclass(frozen=True, eq=False)
class FourProbeReadings:
    """What the meter read.

    Parameters
    ----------
    probe : FourProbe
    resistance : float array, shape (n,) [ohm]
        Between the inner contacts.
    bench : str
        Where it was read.
    """

    probe: FourProbe
    resistance: FloatArray
    bench: str

    @property
    def mean(self) -> float:
        """Mean of the readings [ohm]."""
        return float(self.resistance.mean())

    @property
    def scatter(self) -> float:
        """Standard deviation of one reading [ohm]."""
        return float(self.resistance.std(ddof=1))


def read_four_probe(rig: Rig, *, count: int = 20, shorted: bool = False) -> FourProbeReadings:
    """Read the four-probe contacts of a rig some times; its output is not touched.

    Parameters
    ----------
    rig : Rig
    count : int
        Readings, two a second.
    shorted : bool
        That a piece of metal joins all four contacts, so that the readings are the meter's own offset. A virtual strip
        is shorted by this; at a real one it says only that the end of the range is no reading.

    Returns
    -------
    readings : FourProbeReadings

    Raises
    ------
    InputError
        A rig without such contacts, a number of readings that makes no sense.
    BenchError
        The meter is not there, or its contacts do not touch.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> found = read_four_probe(THESIS_RIG, count=20)
    >>> round(found.mean, 2), round(found.probe.sheet_resistance(found.mean, width=5e-3), 2)
    (2.67, 1.33)
    """
    if rig.four_probe is None:
        raise InputError(
            "this rig has no four-probe contacts",
            code="no-four-probe",
            where="four_probe",
            repair='wire them to an NI 9217 and add [four_probe] with physical = "cDAQ1Mod3/ai0" and spacing = "10 mm"',
        )
    if not _FEWEST <= count <= _MOST:
        raise InputError(
            f"{count} readings",
            code="out-of-range",
            where="count",
            repair=f"take {_FEWEST} to {_MOST}: their scatter is a part of the result",
        )
    bench, values = _of_chassis(rig, count) if rig.bench == "ni" else _of_virtual(rig, count, shorted=shorted)
    from ipmclab.rig.daqmx.driver import LARGEST_RESISTANCE

    if float(values.max()) > 0.999 * LARGEST_RESISTANCE:
        raise BenchError(
            f"the meter reads the end of its range, {LARGEST_RESISTANCE:g} ohm: a contact does not touch",
            code="probe-open",
            where=f"four_probe ({rig.four_probe.physical or 'virtual'})",
            repair="press the contacts onto the strip and look at their four wires",
        )
    return FourProbeReadings(rig.four_probe, values, bench)


def _of_virtual(rig: Rig, count: int, *, shorted: bool) -> tuple[str, FloatArray]:
    from ipmclab.rig.plant import StripPlant

    assert rig.four_probe is not None
    plant = StripPlant(rig)
    plant.probes_shorted = shorted
    read = plant.advance(np.arange(1, count + 1) / RATE, {})[rig.four_probe.physical or "four_probe"]
    noise = np.random.default_rng([rig.virtual.seed, len(rig.channels), int(shorted)])
    return f"virtual bench, {rig.name}", np.asarray(read + NOISE * noise.standard_normal(count))


def _of_chassis(rig: Rig, count: int) -> tuple[str, FloatArray]:
    from ipmclab.rig.daqmx.client import client
    from ipmclab.rig.daqmx.driver import Driver, module_of
    from ipmclab.rig.daqmx.in_use import Hold

    assert rig.four_probe is not None
    driver = Driver(client(), rig, wait=_ANSWER)
    hold: Hold | None = None
    task = None
    try:
        # A run that is being recorded reads the thermometer at the same module.
        hold = Hold(rig.address, [module_of(rig.four_probe.physical)])
        with driver.translated():
            task = driver.task("four_probe")
            driver.add_four_probe(task)
            finite = driver.client.constants.AcquisitionType.FINITE
            task.timing.cfg_samp_clk_timing(RATE, sample_mode=finite, samps_per_chan=count)
            reader = driver.client.stream_readers.AnalogMultiChannelReader(task.in_stream)
            values = np.empty((1, count))
            task.start()
            reader.read_many_sample(values, count, timeout=count / RATE + _PATIENCE)
        return driver.describe(())[0], values[0]
    finally:
        driver.clear(task)
        driver.close()
        if hold is not None:
            hold.release()
