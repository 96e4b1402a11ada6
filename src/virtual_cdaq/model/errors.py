"""What the chassis refuses, with the codes of NI-DAQmx.

The codes are NI's (the client's ``nidaqmx.error_codes`` lists them); the sentences are our own, but for -200077,
-200284 and -200524: programs look for how NI's begin, and the client has the second one in itself.
"""

from __future__ import annotations

OWN_TEXT = {
    -50103: "The resource is reserved: another task holds a module, an engine or a channel that this task needs.",
    -50352: "The requested buffer does not fit into the memory.",
    -88709: "The task was aborted, or its device was reset or removed.",
    -88710: "The operation was cut short: the task was aborted, or its device was reset or removed.",
    -89120: "The source terminal does not exist on this chassis.",
    -89121: "The destination terminal does not exist on this chassis.",
    -200077: (
        "Requested value is not a supported value for this property."
        " The property value may be invalid because it conflicts with another property."
    ),
    -200082: "The minimum is not below the maximum.",
    -200088: "The task does not exist: it was never made, was cleared, or the server was started anew.",
    -200170: "The physical channel does not exist on this device.",
    -200197: "The device does not support this property.",
    -200220: "The device identifier is invalid: no device of this name.",
    -200229: "The buffer is too small for the samples to be read.",
    -200262: "A task without a sample clock cannot wait for a trigger.",
    -200278: "The samples will never be available: the finite acquisition has ended and everything was read.",
    -200279: (
        "The application cannot keep up with the hardware acquisition: unread samples were overwritten."
        " Read more at a time, more often, or give the task a larger buffer."
    ),
    -200284: (
        "Some or all of the samples requested have not yet been acquired.\n\nTo wait for the samples to become"
        " available use a longer read timeout or read later in your program. To make the samples available sooner,"
        " increase the sample rate. If your task uses a start trigger, make sure that your start trigger is configured"
        " correctly. It is also possible that you configured the task for external timing, and no clock was supplied."
        " If this is the case, supply an external clock."
    ),
    -200288: "Samples cannot be written beyond the end of a finite generation.",
    -200290: (
        "The generation has stopped so that old samples are not generated again: the application did not write"
        " in time. The output holds the last sample."
    ),
    -200292: "There was no room for the samples in the output buffer before the time-out.",
    -200378: "The custom scale does not exist.",
    -200431: "The physical channel does not support this measurement or generation.",
    -200452: "The property is not supported by the device or not in this kind of task.",
    -200459: "The task has no output channels to write to.",
    -200460: "The task has no input channels to read from.",
    -200462: "The generation cannot start: the output buffer is empty. Write before starting.",
    -200478: "There are no channels in the task.",
    -200479: "The operation cannot be done while the task runs.",
    -200485: "There is no saved task of this name.",
    -200486: "The channel is not in the task.",
    -200489: "The channel is in the task already.",
    -200524: (
        "Write cannot be performed, because the number of channels in the data does not match the number of channels"
        " in the task."
    ),
    -200547: "The write does not fit a buffer of automatic size.",
    -200557: "The property cannot be set while the task runs.",
    -200559: "All channels of a task must be of one kind.",
    -200560: "The task was not done when the wait ended.",
    -200561: "A sample lies outside the range of the output channel.",
    -200609: "The generation cannot start: an output buffer needs at least two samples.",
    -200846: "An on-demand write needs the task to run, or auto start.",
    -200882: "There is no saved channel of this name.",
    -200949: "A callback for this signal is registered already.",
    -200950: "A callback for the end of the task is registered already.",
    -200960: "The event cannot be registered while the task runs.",
    -200966: "A callback for every N samples acquired is registered already.",
    -200967: "A callback for every N samples transferred is registered already.",
    -200980: "The event 'N samples transferred from the buffer' is for buffered output tasks.",
    -200981: "The event 'N samples acquired into the buffer' is for buffered input tasks.",
    -200984: "A read must not start the task: an event is registered. Start it first.",
    -200985: "A write must not start the task: an event is registered. Start it first.",
    -201003: "The device cannot be accessed: unplugged, without power, or not responding.",
    -201118: "The operation does not support the device context.",
}


class ChassisError(Exception):
    """The chassis refuses or fails, as NI-DAQmx would.

    Parameters
    ----------
    code : int
        NI-DAQmx status code, negative.
    detail : str
        What it is about: property, value and the allowed one, channel, task.
    done : int or None
        Samples per channel that the failed read or write did move.

    Examples
    --------
    >>> print(ChassisError(-200170, "cDAQ1Mod1/ai99").text)
    The physical channel does not exist on this device.
    <BLANKLINE>
    cDAQ1Mod1/ai99
    """

    def __init__(self, code: int, detail: str = "", *, done: int | None = None) -> None:
        self.code = code
        self.done = done
        text = OWN_TEXT.get(code, f"Error {code}.")
        self.text = f"{text}\n\n{detail}" if detail else text
        super().__init__(f"{code}: {self.text}")


def unsupported_value(name: str, value: object, allowed: str) -> ChassisError:
    """-200077 with what was asked for and what is allowed.

    Examples
    --------
    >>> unsupported_value("SampClk.Rate", 300000.0, "at most 250000 S/s").code
    -200077
    """
    return ChassisError(-200077, f"Property: {name}\nRequested value: {value}\nAllowed: {allowed}")
