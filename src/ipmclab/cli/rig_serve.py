"""``ipmclab rig serve``: a stand-in chassis with the virtual strip of a rig behind its terminals."""

from __future__ import annotations

import re
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.errors import InputError, IpmclabError
from ipmclab.extras import how_to_install

if TYPE_CHECKING:
    from ipmclab.rig.channels import Rig
    from ipmclab.rig.plant import StripPlant
    from virtual_cdaq.model.chassis import Chassis
    from virtual_cdaq.model.clock import LockStepClock, RealClock
    from virtual_cdaq.model.faults import Fault

_NAME: Final = re.compile(r"/?(?P<chassis>\w+?)Mod(?P<slot>[1-4])/a[io]\d+", re.IGNORECASE)
_LAST_PORT: Final = 65535


def serve(
    rig: Annotated[
        str, typer.Argument(metavar="RIG", help="A rig file (.toml), or thesis: the rig in the library.")
    ] = "thesis",
    port: Annotated[int, typer.Option(metavar="PORT", help="The port on 127.0.0.1; 0: any that is free.")] = 0,
    clock: Annotated[
        str,
        typer.Option(
            metavar="real|x10|lock-step",
            help="real: in real time. x10: ten times as fast, or another number. lock-step: as fast as it is asked.",
        ),
    ] = "real",
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="FAULT", help='Such as "freeze at 2 s"; may be repeated.', show_default=False),
    ] = None,
    levels: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep the level of every output in this file.")
    ] = None,
    hands: Annotated[
        bool, typer.Option("--hands", help='Read lines such as "tip clear" on stdin: the actions of an operator.')
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the line as a JSON document.")] = False,
) -> None:
    """Serve a stand-in chassis that speaks NI's protocol, until Ctrl-C.

    Prints one line, the address 127.0.0.1:PORT, as soon as it can be used.

    \b
    ipmclab rig serve rig.toml --port 31763
    """
    if not 0 <= port <= _LAST_PORT:
        raise InputError(
            f"there is no port {port}, they go from 0 to {_LAST_PORT}",
            code="out-of-range",
            where="--port",
            repair="give another port, or 0 for a free one",
        )
    from ipmclab.platform import go_first
    from ipmclab.rig.files.rig_file import load_rig
    from ipmclab.rig.plant import StripPlant

    loaded = load_rig(rig)
    need_client()
    name, modules = chassis_of(loaded)
    plant = StripPlant(loaded)
    chassis, server = make_server(plant, name, modules, port=port, clock=clock, faults=fault or [], levels=levels)
    if clock == "real":
        go_first()  # before its threads begin: a chassis waits for no processor
    try:
        address = server.start()
    except OSError as error:
        raise InputError(
            str(error), code="port-taken", where="--port", repair="give another port, or 0 for a free one"
        ) from error
    stop = threading.Event()
    for wanted in (signal.SIGINT, signal.SIGTERM):
        signal.signal(wanted, lambda *_: stop.set())
    what = "a dummy load" if plant.actuator is None else plant.actuator.name
    print(f"{loaded.name}, with {what}; clock {clock}; Ctrl-C stops it", file=sys.stderr, flush=True)
    import json

    print(json.dumps({"address": address, "rig": rig, "clock": clock}) if as_json else address, flush=True)
    if hands:
        threading.Thread(target=_take_actions, args=(chassis, plant), name="operator", daemon=True).start()
    while not stop.wait(0.5):  # without a time, Windows would not let Ctrl-C through
        pass
    server.stop()


def need_client() -> None:
    """Look that NI's client is there, before anything is made.

    Raises
    ------
    IpmclabError
        It is not installed.
    """
    try:
        import virtual_cdaq.server  # noqa: F401
    except ImportError as error:
        raise IpmclabError(
            f"{error.name} is not installed: the stand-in uses NI's protocol through NI's client",
            code="no-nidaqmx",
            where="the stand-in chassis",
            repair=how_to_install("ni"),
        ) from error


def chassis_of(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """The name of the chassis that a rig is wired to, and the modules in its slots, from slot 1 on.

    Raises
    ------
    InputError
        Names that no such chassis has, two modules in one slot.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> chassis_of(THESIS_RIG)
    ('cDAQ1', ('NI 9205', 'NI 9263', 'NI 9217'))
    """
    wires = [("output", rig.output.physical, "NI 9263")]
    wires += [(f"channels.{one.name}", one.physical, "NI 9205") for one in rig.channels]
    wires += [
        (key, one.physical, "NI 9217")
        for key, one in (("thermometer", rig.thermometer), ("four_probe", rig.four_probe))
        if one is not None
    ]
    slots: dict[int, str] = {}
    names: dict[str, str] = {}
    for key, physical, product in wires:
        match = _NAME.fullmatch(physical)
        if match is None:
            raise InputError(
                f"{physical!r} is at no module of a cDAQ-9174",
                code="bad-channel-name",
                where=f"{key}.physical",
                repair="the stand-in has the modules cDAQ1Mod1 to cDAQ1Mod4: write for example cDAQ1Mod1/ai0",
            )
        slot = int(match["slot"])
        names.setdefault(match["chassis"].lower(), match["chassis"])
        if slots.setdefault(slot, product) != product:
            raise InputError(
                f"slot {slot} would need an {slots[slot]} and an {product}",
                code="shared-module",
                where=f"{key}.physical",
                repair="wire voltages to an NI 9205, the output to an NI 9263, resistances to an NI 9217",
            )
    if len(names) > 1:
        raise InputError(
            f"the rig is wired to {len(names)} chassis: {', '.join(names.values())}",
            code="several-chassis",
            where="rig",
            repair="the stand-in is one chassis: wire everything to it",
        )
    # A slot that nothing is wired to holds another voltage module.
    return next(iter(names.values())), tuple(slots.get(slot, "NI 9205") for slot in range(1, max(slots) + 1))


def make_server(
    plant: StripPlant,
    name: str,
    modules: Sequence[str],
    *,
    port: int,
    clock: str,
    faults: Sequence[str],
    levels: Path | None,
) -> tuple[Chassis, Any]:
    """The chassis with a plant behind it, and the server that has not started yet.

    The plant compiles what it needs, so that the first client does not wait for it.

    Raises
    ------
    InputError
        An unknown clock or fault.
    IpmclabError
        NI's client is not installed.
    """
    need_client()
    from virtual_cdaq.levels import LevelFile
    from virtual_cdaq.model.chassis import Chassis
    from virtual_cdaq.server import Server

    plant.advance([0.0], {})
    chassis = Chassis(
        plant,
        _clock(clock),
        name=name,
        modules=modules,
        seed=plant.rig.virtual.seed,
        faults=[_fault(text) for text in faults],
    )
    if levels is not None:
        chassis.on_level = LevelFile(levels, chassis.levels).write
    return chassis, Server(chassis, port)


def _clock(text: str) -> RealClock | LockStepClock:
    from virtual_cdaq.model.clock import make_clock

    try:
        return make_clock(text)
    except ValueError as error:
        raise InputError(
            f"unknown clock {text!r}", code="unknown-clock", where="--clock", repair="give real, x10 or lock-step"
        ) from error


def _fault(text: str) -> Fault:
    from virtual_cdaq.model.faults import parse_fault

    try:
        return parse_fault(text)
    except ValueError as error:
        raise InputError(
            str(error), code="unknown-fault", where="--fault", repair='write for example "freeze at 2 s for 5 s"'
        ) from error


def _take_actions(chassis: Chassis, plant: StripPlant) -> None:
    """Do what is in the lines of stdin, until it ends; what cannot be done is reported on stderr."""
    from ipmclab.rig.operator_actions import carry_out

    for line in sys.stdin:
        if not line.strip():
            continue
        try:
            with chassis.lock:
                chassis.advance()  # up to here the plant was as before
                carry_out(plant, line)
            print(f"done: {line.strip()}", file=sys.stderr, flush=True)
        except InputError as error:
            print(f"error: {error}", file=sys.stderr, flush=True)
