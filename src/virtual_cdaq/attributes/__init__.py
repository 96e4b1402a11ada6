"""The properties of tasks, channels and devices, as tables by NI's symbolic names."""

from virtual_cdaq.attributes.channel import CHANNEL
from virtual_cdaq.attributes.device import DEVICE, PHYSICAL, SYSTEM
from virtual_cdaq.attributes.scale import SCALE
from virtual_cdaq.attributes.table import Property, Table, get, put, reset
from virtual_cdaq.attributes.task import BUFFER, EXPORTED, OF_A_MODULE, READ, TASK, TIMING, TRIGGER, WRITE

TABLES: dict[str, Table] = {
    "Buffer": BUFFER,
    "Chan": CHANNEL,
    "Device": DEVICE,
    "ExportedSignal": EXPORTED,
    "PhysicalChan": PHYSICAL,
    "Read": READ,
    "Scale": SCALE,
    "SystemInfo": SYSTEM,
    "Task": TASK,
    "Timing": TIMING,
    "Trig": TRIGGER,
    "Write": WRITE,
}
"""Tables by the scope in the name of a call, ``GetChanAttributeDouble``: ``Chan``."""

__all__ = ["OF_A_MODULE", "TABLES", "Property", "Table", "get", "put", "reset"]
