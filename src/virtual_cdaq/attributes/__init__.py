"""The properties of tasks, channels and devices, as tables by NI's symbolic names."""

from virtual_cdaq.attributes.channel import CHANNEL
from virtual_cdaq.attributes.device import DEVICE, PHYSICAL, SYSTEM
from virtual_cdaq.attributes.table import Property, Table, get, put, reset
from virtual_cdaq.attributes.task import BUFFER, EXPORTED, READ, TASK, TIMING, TRIGGER, WRITE

TABLES: dict[str, Table] = {
    "Buffer": BUFFER,
    "Chan": CHANNEL,
    "Device": DEVICE,
    "ExportedSignal": EXPORTED,
    "PhysicalChan": PHYSICAL,
    "Read": READ,
    "SystemInfo": SYSTEM,
    "Task": TASK,
    "Timing": TIMING,
    "Trig": TRIGGER,
    "Write": WRITE,
}
"""Tables by the scope in the name of a call, ``GetChanAttributeDouble``: ``Chan``."""

__all__ = ["TABLES", "Property", "Table", "get", "put", "reset"]
