"""NI-DAQmx as a rig needs it: tasks by their role, the modules that are there, the reset. Errors come out as ours.

The client (the package ``nidaqmx``) is an argument: ``client.py`` is the only place that imports it.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Final

import numpy as np

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import Channel, Rig
from ipmclab.rig.daqmx.errors import STATUSES_OF_LOSS, translate
from ipmclab.rig.daqmx.link import OPENING_PATIENCE, PATIENCE, Link

_TERMINALS: Final = {"differential": "DIFF", "single-ended": "RSE", "non-referenced": "NRSE"}
_NOT_APPLICABLE: Final = -200197
"""What the driver says when a module is asked for a property that it does not have."""

COLDEST, HOTTEST = -200.0, 850.0
"""What an NI 9217 reads of a platinum thermometer [degC]."""

LARGEST_RESISTANCE: Final = 400.0
"""The range of an NI 9217 [ohm]; contacts that do not touch read as its end."""


def module_of(physical: str) -> str:
    """The module of a physical channel.

    Examples
    --------
    >>> module_of("cDAQ1Mod1/ai0")
    'cDAQ1Mod1'
    """
    return physical.split("/")[0]


class Driver:
    """The driver of this computer, or one behind a gRPC server.

    Parameters
    ----------
    client : module
        The package ``nidaqmx``.
    rig : Rig
    wait : float [s]
        For a server to answer at all.
    patience : float [s]
        How long a call may take at first.

    Raises
    ------
    BenchError
        No driver, no server.
    """

    def __init__(self, client: Any, rig: Rig, *, wait: float, patience: float = OPENING_PATIENCE) -> None:
        self.client = client
        self.rig = rig
        self.lost: IpmclabError | None = None
        """Why the connection is of no use any more."""
        self._names = _names(rig)
        self._link = Link(rig.address, wait=wait, patience=patience) if rig.address else None
        try:
            with self.translated():
                self._system = client.system.System(self._options(""))
                # The client swallows what goes wrong at its own first call: ask again.
                self._there = list(self._system.devices.device_names)
        except IpmclabError:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the connection; tasks must have been closed before. May be called twice."""
        if self._link is not None:
            self._link.close()

    def be_patient(self, seconds: float = PATIENCE) -> None:
        """How long [s] a call may take from now on."""
        if self._link is not None:
            self._link.patience = seconds

    @contextmanager
    def translated(self) -> Iterator[None]:
        """Turn what the client raises within into our errors, and notice when the connection is lost."""
        if self.lost is not None:
            raise self.lost
        try:
            yield
        except IpmclabError:
            raise
        except (self.client.errors.Error, *_grpc_errors()) as error:
            ours = translate(error, names=self._names, address=self.rig.address)
            status = getattr(getattr(error, "rpc_code", None), "name", None)
            if status in STATUSES_OF_LOSS or isinstance(error, ValueError):
                self.lost = ours
            raise ours from error

    def task(self, role: str) -> Any:
        """A new task, whose name no other task ever had.

        Over gRPC the name is also the name of the session. An unnamed one would get a number from the server, which
        counts from the beginning after a restart: an old handle would then mean somebody's new task.
        """
        name = f"ipmclab_{role}_{uuid.uuid4().hex}"
        return self.client.Task(name, grpc_options=self._options(name))

    def _options(self, name: str) -> Any:
        if self._link is None:
            return None
        from_scratch = self.client.grpc_session_options.SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
        return self.client.GrpcSessionOptions(self._link.channel, name, initialization_behavior=from_scratch)

    def add_input(self, task: Any, channel: Channel) -> None:
        """Add a channel of the rig to a task, under its own name."""
        task.ai_channels.add_ai_voltage_chan(
            channel.physical,
            name_to_assign_to_channel=channel.name,
            terminal_config=self.client.constants.TerminalConfiguration[_TERMINALS[channel.terminal]],
            min_val=channel.converter.low,
            max_val=channel.converter.high,
        )

    def add_output(self, task: Any) -> None:
        """Add the output of the rig to a task."""
        output = self.rig.output
        task.ao_channels.add_ao_voltage_chan(
            output.physical, name_to_assign_to_channel="output", min_val=output.low, max_val=output.high
        )

    def add_thermometer(self, task: Any) -> None:
        """Add the thermometer of the rig to a task."""
        constants, thermometer = self.client.constants, self.rig.thermometer
        assert thermometer is not None
        wires = {3: "THREE_WIRE", 4: "FOUR_WIRE"}[thermometer.wires]
        task.ai_channels.add_ai_rtd_chan(
            thermometer.physical,
            name_to_assign_to_channel="thermometer",
            min_val=COLDEST,
            max_val=HOTTEST,
            units=constants.TemperatureUnits.DEG_C,
            rtd_type=constants.RTDType.PT_3851,
            resistance_config=constants.ResistanceConfiguration[wires],
            current_excit_source=constants.ExcitationSource.INTERNAL,
            current_excit_val=thermometer.current,
            r_0=thermometer.resistance,
        )

    def add_four_probe(self, task: Any) -> None:
        """Add the four-probe contacts of the rig to a task: the outer two carry the current of the module."""
        constants, probe = self.client.constants, self.rig.four_probe
        assert probe is not None
        self._check_present("four_probe", probe.physical)
        task.ai_channels.add_ai_resistance_chan(
            probe.physical,
            name_to_assign_to_channel="four_probe",
            min_val=0.0,
            max_val=LARGEST_RESISTANCE,
            resistance_config=constants.ResistanceConfiguration.FOUR_WIRE,
            current_excit_source=constants.ExcitationSource.INTERNAL,
            current_excit_val=probe.current,
        )

    def clear(self, task: Any) -> None:
        """Clear a task, whatever state it is in, if the connection still allows it; None is no task."""
        if task is not None and self.lost is None:
            # What the task was doing has been dealt with before.
            with suppress(IpmclabError), self.translated():
                task.close()

    def modules(self, measured: Collection[str] | None = None) -> tuple[str, ...]:
        """The modules that are needed to read some channels, or all; that of the output first."""
        rig = self.rig
        physical = [rig.output.physical]
        physical += [one.physical for one in rig.channels if measured is None or one.name in measured]
        if rig.thermometer is not None:
            physical.append(rig.thermometer.physical)
        return tuple(dict.fromkeys(module_of(one) for one in physical if one))

    def reset(self, modules: Collection[str]) -> None:
        """Bring modules to the state after power-up: outputs at 0 V, nothing reserved, every task on them aborted.

        Raises
        ------
        BenchError
            After all of them were tried.
        """
        failure: IpmclabError | None = None
        for name in modules:
            try:
                with self.translated():
                    self._system.devices[name].reset_device()
            except IpmclabError as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def _check_present(self, key: str, physical: str) -> None:
        if not physical:
            raise InputError(
                "no physical channel is given",
                code="missing-physical",
                where=f"{key}.physical",
                repair='give the name that NI MAX shows, such as "cDAQ1Mod1/ai0"',
            )
        module = module_of(physical)
        if module not in self._there:
            # With what they are: the nearest name may be a module that cannot do it.
            known = [f"{name} ({self._system.devices[name].product_type})" for name in self._there]
            raise BenchError(
                f"there is no module {module!r}",
                code="no-device",
                where=f"{key}.physical ({physical})",
                repair=f"there are {', '.join(known)}" if known else "no chassis is connected: check power and cable",
            )

    def check(self, measured: Collection[str]) -> None:
        """Refuse a rig that does not fit what is there.

        Raises
        ------
        BenchError
            A module that is not there.
        InputError
            A physical channel that is not given, a range that its module does not have.
        """
        output = self.rig.output
        channels = [self.rig[name] for name in measured]
        with self.translated():
            wired = [("output", output.physical), *((f"channels.{one.name}", one.physical) for one in channels)]
            if self.rig.thermometer is not None:
                wired.append(("thermometer", self.rig.thermometer.physical))
            for key, physical in wired:
                self._check_present(key, physical)
            for channel in channels:
                _check_input(channel, *self._ranges(channel.physical, "ai_voltage_rngs"))
            _check_output(self.rig, *self._ranges(output.physical, "ao_voltage_rngs"))
        self._check_thermometer(channels)

    def _ranges(self, physical: str, attribute: str) -> tuple[str, list[tuple[float, float]]]:
        """What a module is, and its ranges; none where it has no inputs or outputs of that kind."""
        device = self._system.devices[module_of(physical)]
        try:
            flat = list(getattr(device, attribute))
        except self.client.errors.DaqError as error:
            if error.error_code != _NOT_APPLICABLE:
                raise
            flat = []
        return device.product_type, list(zip(flat[::2], flat[1::2], strict=True))

    def _check_thermometer(self, channels: Collection[Channel]) -> None:
        if self.rig.thermometer is None:
            return
        module = module_of(self.rig.thermometer.physical)
        for channel in channels:
            if module_of(channel.physical) == module:
                raise InputError(
                    f"it is on the module of {channel.name}, {module}: a module has one sample clock",
                    code="shared-module",
                    where="thermometer.physical",
                    repair="wire it to a module of its own, such as an NI 9217",
                )

    def describe(self, measured: Collection[str] | None = None) -> tuple[str, bool]:
        """The chassis and its modules as text, and whether it is a simulated one."""
        names = self.modules(measured)
        with self.translated():
            devices = [self._system.devices[name] for name in names]
            simulated = any(bool(device.is_simulated) for device in devices)
            modules = ", ".join(f"{device.product_type} {name}" for device, name in zip(devices, names, strict=True))
            version = self._system.driver_version
        number = ".".join(str(part) for part in (version.major_version, version.minor_version, version.update_version))
        behind = f" at {self.rig.address}" if self.rig.address else ""
        return f"{'simulated chassis' if simulated else 'chassis'}{behind}, {modules}, NI-DAQmx {number}", simulated


def _grpc_errors() -> tuple[type[Exception], ...]:
    """What gRPC itself raises: its errors, and a ValueError for a channel that was closed."""
    try:
        import grpc
    except ImportError:
        return ()
    return (grpc.RpcError, ValueError)


def _names(rig: Rig) -> Mapping[str, str]:
    names = {channel.physical: channel.name for channel in rig.channels if channel.physical}
    names[rig.output.physical] = "output"
    if rig.thermometer is not None:
        names[rig.thermometer.physical] = "thermometer"
    if rig.four_probe is not None:
        names[rig.four_probe.physical] = "four_probe"
    return names


def _check_input(channel: Channel, product: str, ranges: list[tuple[float, float]]) -> None:
    where = f"channels.{channel.name}.physical ({channel.physical})"
    if not ranges:
        raise InputError(
            f"{product} reads no voltages", code="wrong-module", where=where, repair="use an input of an NI 9205"
        )
    wanted = (channel.converter.low, channel.converter.high)
    if not any(np.allclose(wanted, pair, rtol=1e-6, atol=0.0) for pair in ranges):
        shown = ", ".join(_range(pair) for pair in sorted(ranges, key=lambda pair: pair[1]))
        raise InputError(
            f"{product} has no range {_range(wanted)}",
            code="bad-range",
            where=f"channels.{channel.name}.range",
            repair=f"give one of: {shown}",
        )


def _check_output(rig: Rig, product: str, ranges: list[tuple[float, float]]) -> None:
    wanted = (rig.output.low, rig.output.high)
    if not ranges:
        raise InputError(
            f"{product} has no outputs",
            code="wrong-module",
            where=f"output.physical ({rig.output.physical})",
            repair="use an output of an NI 9263",
        )
    if not any(low <= wanted[0] and wanted[1] <= high for low, high in ranges):
        raise InputError(
            f"{product} does not reach {_range(wanted)}",
            code="bad-range",
            where="output.range",
            repair=f"give a range within {_range(max(ranges, key=lambda pair: pair[1] - pair[0]))}",
        )


def _range(pair: tuple[float, float]) -> str:
    return f"{pair[0]:g} V to {pair[1]:g} V"
