"""Properties of tasks: timing, buffers, reading, writing, triggers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from virtual_cdaq.attributes.table import Property, Table, constant, kept
from virtual_cdaq.model.chassis import HostedTask
from virtual_cdaq.model.clock import TICKS_PER_SECOND, sample_period, ticks
from virtual_cdaq.model.errors import ChassisError, unsupported_value
from virtual_cdaq.model.names import expand
from virtual_cdaq.model.task import CONTINUOUS, FEWEST_SAMPLES, FINITE, ON_DEMAND, SAMPLE_CLOCK, State, Timing

ALLOW_REGENERATION, NO_REGENERATION = 10097, 10158
OVERWRITE, DO_NOT_OVERWRITE = 10252, 10159
RISING, PULSE = 10280, 10265
CURRENT_READ_POSITION, CURRENT_WRITE_POSITION = 10425, 10430
NO_TRIGGER, DIGITAL_EDGE = 10230, 10150
CONVERSION_PADDING = 10e-6  # s
NEW_DEFAULTS = Timing()


def _names(task: HostedTask) -> str:
    return ", ".join(channel.name for channel in task.channels)


def _looked_at(task: HostedTask) -> HostedTask:
    """The task after the chassis has caught up: a look takes time on a clock that does not move."""
    if task.running and task.hardware_timed:
        task.chassis.pass_time()
    return task


# Timing


def _set_timing(name: str) -> Any:
    def put(task: HostedTask, value: Any) -> None:
        task.refuse_while_running()
        timing = replace(task.timing, **{name: value})
        if name == "kind" and value not in (ON_DEMAND, SAMPLE_CLOCK):
            raise unsupported_value("SampTimingType", value, "on demand or sample clock")
        if name == "rate":
            if not value > 0.0:
                raise unsupported_value("SampClk.Rate", value, "above 0 S/s")
            timing = replace(timing, kind=SAMPLE_CLOCK)
            task.check_rate(timing)
        if name == "samples" and timing.mode == FINITE and value < FEWEST_SAMPLES:
            raise unsupported_value("SampQuant.SampPerChan", value, f"at least {FEWEST_SAMPLES}")
        if name == "mode" and value not in (FINITE, CONTINUOUS):
            raise unsupported_value("SampQuant.SampMode", value, "finite or continuous samples")
        task.timing = timing
        task.changed()

    return put


def _timing(name: str) -> Property:
    put = _set_timing(name)

    def reset(task: HostedTask) -> None:
        task.timing = replace(task.timing, **{name: getattr(NEW_DEFAULTS, name)})
        task.changed()

    def get(task: HostedTask) -> Any:
        task.check_samples()
        return getattr(task.timing, name)

    return Property(get, put, reset)


def _source(task: HostedTask) -> str:
    if not task.timing.source:
        return _terminal(task, "SampleClockTimebase")
    return task.chassis.full_terminal(task.timing.source)


def _terminal(task: HostedTask, signal: str) -> str:
    # Which engine a task gets is decided when it is reserved. Before that this is the one that it would get now, and
    # not the one that it will get if another task comes first.
    engine = task.engine or task.chassis.free_engine(task)
    if engine is None:
        raise ChassisError(-50103, f"No timing engine is free.\nTask: {task.name}")
    return f"/{task.chassis.name}/{engine.name}/{signal}"


def _fastest_conversion(task: HostedTask) -> float:
    return task.highest_rate * max(1, len(task.channels))


def _conversion_ticks(task: HostedTask) -> int:
    """From one channel of a scan to the next [ticks]: 10 us more than it takes, where the sample clock leaves room."""
    chosen = task.properties.get("AI_CONV_TIMEBASE_DIV")
    if chosen is not None:
        return int(chosen)
    padded = ticks(1.0 / _fastest_conversion(task) + CONVERSION_PADDING) + 1
    if not task.hardware_timed:
        return padded
    return min(padded, sample_period(task.timing.rate) // max(1, len(task.channels)))


def _set_conversion_ticks(task: HostedTask, value: int) -> None:
    task.refuse_while_running()
    fastest = _fastest_conversion(task)
    if not 0 < TICKS_PER_SECOND / max(value, 1) <= fastest * (1 + 1e-9):
        raise unsupported_value("AIConv.Rate", TICKS_PER_SECOND / max(value, 1), f"at most {fastest:g} conversions/s")
    task.properties["AI_CONV_TIMEBASE_DIV"] = value


def _forget_conversion(task: HostedTask) -> None:
    task.properties.pop("AI_CONV_TIMEBASE_DIV", None)


OF_A_MODULE = {
    "AI_CONV_ACTIVE_EDGE",
    "AI_CONV_MAX_RATE",
    "AI_CONV_RATE",
    "AI_CONV_TIMEBASE_DIV",
}
"""Timing that each module of a task has for itself: a client may name the module."""


TIMING: Table = {
    "SAMP_TIMING_TYPE": _timing("kind"),
    "SAMP_CLK_RATE": Property(lambda t: t.rate, _set_timing("rate"), _timing("rate").reset),
    "SAMP_CLK_MAX_RATE": Property(lambda t: t.highest_rate),
    "SAMP_CLK_SRC": Property(_source, _set_timing("source"), _timing("source").reset),
    "SAMP_CLK_TERM": Property(lambda t: _terminal(t, "SampleClock")),
    "SAMP_CLK_ACTIVE_EDGE": kept("SAMP_CLK_ACTIVE_EDGE", RISING),
    "SAMP_CLK_TIMEBASE_RATE": constant(float(TICKS_PER_SECOND)),
    "SAMP_CLK_TIMEBASE_DIV": Property(
        lambda t: sample_period(t.timing.rate),
        lambda t, value: _set_timing("rate")(t, TICKS_PER_SECOND / value),
        _timing("rate").reset,
    ),
    "SAMP_CLK_TIMEBASE_SRC": Property(lambda t: f"/{t.chassis.name}/80MHzTimebase"),
    "SAMP_CLK_TIMEBASE_TERM": Property(lambda t: f"/{t.chassis.name}/80MHzTimebase"),
    "SAMP_QUANT_SAMP_MODE": _timing("mode"),
    "SAMP_QUANT_SAMP_PER_CHAN": _timing("samples"),
    "AI_CONV_ACTIVE_EDGE": kept("AI_CONV_ACTIVE_EDGE", RISING),
    "AI_CONV_RATE": Property(
        lambda t: TICKS_PER_SECOND / _conversion_ticks(t),
        lambda t, value: _set_conversion_ticks(t, round(TICKS_PER_SECOND / value) if value > 0.0 else 0),
        _forget_conversion,
    ),
    "AI_CONV_MAX_RATE": Property(_fastest_conversion),
    "AI_CONV_TIMEBASE_DIV": Property(_conversion_ticks, _set_conversion_ticks, _forget_conversion),
    "ON_DEMAND_SIMULTANEOUS_AO_ENABLE": kept("ON_DEMAND_SIMULTANEOUS_AO_ENABLE", False),
    "REF_CLK_SRC": kept("REF_CLK_SRC", "None"),
}

# Triggers


def _set_trigger(task: HostedTask, source: str) -> None:
    task.refuse_while_running()
    task.chassis.engine_of_terminal(source, "StartTrigger")
    task.trigger = source


def set_trigger_type(task: HostedTask, kind: int) -> None:
    """A start trigger on a digital edge, or none."""
    task.refuse_while_running()
    if kind == NO_TRIGGER:
        task.trigger = ""
    elif kind != DIGITAL_EDGE:
        raise unsupported_value("StartTrig.Type", kind, "none or digital edge")


def _set_retriggerable(task: HostedTask, value: bool) -> None:
    task.refuse_while_running()
    task.retriggerable = value
    task.changed()


TRIGGER: Table = {
    "START_TRIG_TYPE": Property(
        lambda t: DIGITAL_EDGE if t.trigger else NO_TRIGGER, set_trigger_type, lambda t: set_trigger_type(t, NO_TRIGGER)
    ),
    "DIG_EDGE_START_TRIG_SRC": Property(
        lambda t: t.trigger and t.chassis.full_terminal(t.trigger), _set_trigger, lambda t: _set_trigger(t, "")
    ),
    "DIG_EDGE_START_TRIG_EDGE": kept("DIG_EDGE_START_TRIG_EDGE", RISING),
    "START_TRIG_TERM": Property(lambda t: _terminal(t, "StartTrigger")),
    "START_TRIG_DELAY": kept("START_TRIG_DELAY", 0.0),
    "START_TRIG_DELAY_UNITS": kept("START_TRIG_DELAY_UNITS", 10364),
    "START_TRIG_RETRIGGERABLE": Property(
        lambda t: t.retriggerable, _set_retriggerable, lambda t: _set_retriggerable(t, False)
    ),
    "REF_TRIG_TYPE": constant(NO_TRIGGER),
    "PAUSE_TRIG_TYPE": constant(NO_TRIGGER),
    "ARM_START_TRIG_TYPE": constant(NO_TRIGGER),
}

# Buffers


def set_input_size(task: HostedTask, size: int) -> None:
    """Samples per channel of the input buffer."""
    task.refuse_while_running()
    task.input_size = size
    if task.state >= State.COMMITTED:
        task.state = State.RESERVED


def set_output_size(task: HostedTask, size: int) -> None:
    """Samples per channel of the output buffer."""
    if task.kind == "ai":
        raise ChassisError(-200452, f"Property: OUTPUT_BUF_SIZE\nTask: {task.name}")
    task.refuse_while_running()
    task.output_size = size
    task.output_buffer = None


def _output_size(task: HostedTask) -> int:
    if task.output_buffer is not None:
        return task.output_buffer.size
    return task.output_size or 0


BUFFER: Table = {
    "INPUT_BUF_SIZE": Property(
        lambda t: t.input_buffer_size() if t.hardware_timed else (t.input_size or 0),
        set_input_size,
        lambda t: set_input_size(t, None),  # type: ignore[arg-type]
    ),
    "OUTPUT_BUF_SIZE": Property(_output_size, set_output_size, lambda t: set_output_size(t, None)),  # type: ignore[arg-type]
    "INPUT_ONBRD_BUF_SIZE": constant(127),
    "OUTPUT_ONBRD_BUF_SIZE": kept("OUTPUT_ONBRD_BUF_SIZE", 127),
}

# Reading


def _available(task: HostedTask) -> int:
    _looked_at(task)
    task.raise_failure()
    return task.input_buffer.available if task.input_buffer is not None and task.running else 0


def _acquired(task: HostedTask) -> int:
    _looked_at(task)
    return task.input_buffer.acquired if task.input_buffer is not None else 0


def _default_count(task: HostedTask) -> int:
    if not task.hardware_timed:
        return 1
    if task.timing.mode == FINITE and not task.properties.get("READ_ALL_AVAIL_SAMP", False):
        return task.timing.samples
    return _available(task)


def _set_channels_to_read(task: HostedTask, text: str) -> None:
    wanted = expand(text)
    known = {channel.name for channel in task.channels}
    for name in wanted:
        if name not in known:
            raise ChassisError(-200486, f"Channel: {name}\nTask: {task.name}")
    task.properties["CHANNELS_TO_READ"] = text


def _set_overwrite(task: HostedTask, value: int) -> None:
    task.refuse_while_running()
    task.overwrite = value == OVERWRITE


def _width(task: HostedTask) -> int:
    return 4 if any(channel.module.bits > 16 for channel in task.channels) else 2


READ: Table = {
    "AUTO_START": kept("READ_AUTO_START", True),
    "AVAIL_SAMP_PER_CHAN": Property(_available),
    "CHANNELS_TO_READ": Property(
        lambda t: t.properties.get("CHANNELS_TO_READ", _names(t)),
        _set_channels_to_read,
        lambda t: t.properties.pop("CHANNELS_TO_READ", None),
    ),
    "CURR_READ_POS": Property(lambda t: t.input_buffer.position if t.input_buffer is not None else 0),
    "DEFAULT_NUMBER_OF_SAMPLES_TO_READ": Property(_default_count),
    "NUM_CHANS": Property(lambda t: len(expand(READ["CHANNELS_TO_READ"].get(t)))),
    "OFFSET": kept("READ_OFFSET", 0),
    "OVERWRITE": Property(
        lambda t: OVERWRITE if t.overwrite else DO_NOT_OVERWRITE,
        _set_overwrite,
        lambda t: _set_overwrite(t, DO_NOT_OVERWRITE),
    ),
    "OVERLOADED_CHANS_EXIST": constant(False),
    "OPEN_CURRENT_LOOP_CHANS_EXIST": constant(False),
    "RAW_DATA_WIDTH": Property(lambda t: _width(t) * len(t.channels)),
    "READ_ALL_AVAIL_SAMP": kept("READ_ALL_AVAIL_SAMP", False),
    "RELATIVE_TO": kept("READ_RELATIVE_TO", CURRENT_READ_POSITION),
    "SLEEP_TIME": kept("READ_SLEEP_TIME", 0.001),
    "TOTAL_SAMP_PER_CHAN_ACQUIRED": Property(_acquired),
    "WAIT_MODE": kept("READ_WAIT_MODE", 12524),
}

# Writing


def _set_regeneration(task: HostedTask, value: int) -> None:
    task.refuse_while_running()
    if value not in (ALLOW_REGENERATION, NO_REGENERATION):
        raise unsupported_value("Write.RegenMode", value, "allow or do not allow regeneration")
    task.regenerate = value == ALLOW_REGENERATION


def _generated(task: HostedTask) -> int:
    _looked_at(task)
    return task.output_buffer.generated if task.output_buffer is not None else 0


def _space(task: HostedTask) -> int:
    _looked_at(task)
    task.raise_failure()
    return task.output_buffer.space if task.output_buffer is not None else (task.output_size or 0)


WRITE: Table = {
    "CURR_WRITE_POS": Property(lambda t: t.output_buffer.written if t.output_buffer is not None else 0),
    "NUM_CHANS": Property(lambda t: len(t.channels)),
    "OFFSET": kept("WRITE_OFFSET", 0),
    "RAW_DATA_WIDTH": Property(lambda t: _width(t) * len(t.channels)),
    "REGEN_MODE": Property(
        lambda t: ALLOW_REGENERATION if t.regenerate else NO_REGENERATION,
        _set_regeneration,
        lambda t: _set_regeneration(t, ALLOW_REGENERATION),
    ),
    "RELATIVE_TO": kept("WRITE_RELATIVE_TO", CURRENT_WRITE_POSITION),
    "SLEEP_TIME": kept("WRITE_SLEEP_TIME", 0.001),
    "SPACE_AVAIL": Property(_space),
    "TOTAL_SAMP_PER_CHAN_GENERATED": Property(_generated),
    "WAIT_MODE": kept("WRITE_WAIT_MODE", 12524),
}

# The task itself, and signals that it gives away

TASK: Table = {
    "CHANNELS": Property(_names),
    "COMPLETE": Property(lambda t: _looked_at(t).done),
    "DEVICES": Property(lambda t: ", ".join(t.all_devices)),
    "NAME": Property(lambda t: t.name),
    "NUM_CHANS": Property(lambda t: len(t.channels)),
    "NUM_DEVICES": Property(lambda t: len(t.all_devices)),
}

EXPORTED: Table = {
    "SAMP_CLK_OUTPUT_BEHAVIOR": kept("SAMP_CLK_OUTPUT_BEHAVIOR", PULSE),
    "SAMP_CLK_OUTPUT_TERM": kept("SAMP_CLK_OUTPUT_TERM", ""),
    "START_TRIG_OUTPUT_TERM": kept("START_TRIG_OUTPUT_TERM", ""),
}
