"""The calls of NI's service: each a few lines on the model, kept in ``CALLS`` and ``STREAMS`` by its name."""

from virtual_cdaq.calls import configuration, devices, events, reading, scales, tasks, waveforms, writing
from virtual_cdaq.calls.events import STREAMS
from virtual_cdaq.service import CALLS

__all__ = [
    "CALLS",
    "STREAMS",
    "configuration",
    "devices",
    "events",
    "reading",
    "scales",
    "tasks",
    "waveforms",
    "writing",
]
