"""The stand-in under the names that NI's programs ask for.

They are written for a multifunction device (``Dev1``, a PCIe-6363) and for a cDAQ-9189. Names, numbers of channels and
the one input engine are those of such a device; what its inputs and outputs do is the stand-in's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from virtual_cdaq.model.channels import Channel, Converter
from virtual_cdaq.model.chassis import Chassis
from virtual_cdaq.model.clock import RealClock
from virtual_cdaq.model.modules import MODULES, NI9205, NI9263, Range
from virtual_cdaq.model.plant import RcPlant
from virtual_cdaq.model.scales import Scale

LOOPED = 30
"""The first input to which an output is wired within the device."""

VOLTS = 10348  # DAQmx_Val_Volts

# A simulated device of NI's is without noise, and its codes end at its range.
_ENDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_RANGES = tuple(Range(-end, end, end, 0.0) for end in _ENDS)
INPUTS = replace(NI9205, product="PCIe-6363 inputs", ranges=_RANGES, offset=0.0)
OUTPUTS = replace(NI9263, product="PCIe-6363 outputs", ranges=(Range(-10.0, 10.0, 10.0, 0.0),))
MODULES.update({module.product: module for module in (INPUTS, OUTPUTS)})


class Wires:
    """Nothing at the inputs but the outputs of the device itself."""

    def __init__(self, name: str) -> None:
        self._name = name

    def advance(
        self,
        times: npt.NDArray[np.float64],  # noqa: ARG002 - wires know no time
        outputs: Mapping[str, npt.NDArray[np.float64]],
    ) -> Mapping[str, npt.NDArray[np.float64]]:
        """The voltages at the terminals."""
        return {f"{self._name}/ai{LOOPED + k}": outputs[f"{self._name}/ao{k}"] for k in range(2)}


class Simulated(Converter):
    """An input of a simulated device: it reads within the limits of its channel, whatever is wired to it."""

    def convert(self, values: npt.NDArray[np.float64], first: int) -> npt.NDArray[np.int32]:
        """Samples of a clocked task."""
        return super().convert(np.clip(values, self.channel.low, self.channel.high), first)

    def convert_one(self, value: float, sample: int) -> int:
        """One sample on demand."""
        return super().convert_one(float(np.clip(value, self.channel.low, self.channel.high)), sample)


class Multifunction(Chassis):
    """A device in one piece: its modules bear its name, and it has one input engine and a trigger input."""

    product = "PCIe-6363"
    category = 14643  # DAQmx_Val_XSeriesDAQ
    input_engines = ("ai",)
    trigger_inputs = ("PFI0",)
    inner_channels: ClassVar[Mapping[str, str]] = {f"_ao{k}_vs_aognd": f"ai{LOOPED + k}" for k in range(2)}

    def device_name(self, number: int) -> str:  # noqa: ARG002 - all of it is one device
        """The name of the module in a slot."""
        return self.name

    def converter(self, channel: Channel, **more: Any) -> Converter:
        """The converter of a new acquisition on a channel."""
        super().converter(channel, **more)
        return Simulated(channel, self.seed, 0)


class Network(Chassis):
    """A cDAQ-9189 with two of the modules that the stand-in has."""

    product = "cDAQ-9189"


def multifunction() -> Chassis:
    """``Dev1``, with the custom scales of NI's settings for its tests."""
    made = Multifunction(Wires("Dev1"), RealClock(), name="Dev1", modules=(INPUTS.product, OUTPUTS.product))
    for name, slope in (("double_gain_scale", 2.0), ("no_scaling_scale", 1.0)):
        made.scales[name] = Scale(name, "linear", (0.0, slope), (), VOLTS)
    made.scales["polynomial_scale"] = Scale("polynomial_scale", "polynomial", (0.0, 1.0), (0.0, 1.0), VOLTS)
    return made


def chassis_for(source: str) -> Chassis:
    """What an example asks for: the chassis under its own name, or the multifunction device."""
    return Chassis(RcPlant(), RealClock()) if "cDAQ1Mod" in source else multifunction()


def network() -> Chassis:
    """A chassis on the network."""

    class Nothing:
        def advance(self, times: Any, outputs: Any) -> Mapping[str, npt.NDArray[np.float64]]:  # noqa: ARG002
            return {}

    return Network(Nothing(), RealClock(), name="cdaqChassisTester", modules=("NI 9205", "NI 9263"))
