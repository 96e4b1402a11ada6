"""That one program at a time drives a module: opening a bench resets it, and would end another's run unseen."""

from __future__ import annotations

import hashlib
import ipaddress
import os
import socket
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from ipmclab.errors import InputError
from ipmclab.platform import folder_of_the_machine, lock_file, open_for_all_users
from ipmclab.rig.bench import BenchError


class InUse(BenchError):
    """Somebody else records on it: refused, before anything is given out (exit status 2)."""

    exit_status = InputError.exit_status


class Hold:
    """The modules of a chassis, taken for one bench of one program of one user on this computer.

    The system lets go of them when the program ends, however it ends. Programs on other computers, and those that are
    not ipmclab, are not kept out: NI-DAQmx itself refuses what they have reserved.

    Parameters
    ----------
    address : str or None
        Of the gRPC server.
    modules : collection of str

    Raises
    ------
    InUse
        ``"bench-in-use"`` when another bench holds one of them.
    """

    def __init__(self, address: str | None, modules: Collection[str]) -> None:
        self._files: list[int] = []
        for module in modules:
            path = lock_of(address, module)
            try:
                descriptor = open_for_all_users(path)
            except OSError as error:
                self.release()
                raise InUse(
                    f"it is not known whether another run is being recorded on it: its lock {path} cannot be opened "
                    f"({error.strerror or error})",
                    code="bench-in-use",
                    where=module,
                    repair="ask the user whose file it is to end that run and to remove the file",
                ) from error
            self._files.append(descriptor)
            if not lock_file(descriptor):
                holder = os.read(descriptor, 20).decode("ascii", errors="replace").strip()
                self.release()
                raise InUse(
                    "another run is being recorded on it" + (f", by process {holder}" if holder else ""),
                    code="bench-in-use",
                    where=module,
                    repair="wait until it has ended, or stop it",
                )
            with suppress(OSError):
                os.ftruncate(descriptor, 0)
                os.write(descriptor, str(os.getpid()).encode("ascii"))

    def release(self) -> None:
        """Let go of the modules. May be called twice."""
        files, self._files = self._files, []
        for descriptor in files:
            os.close(descriptor)


def lock_of(address: str | None, module: str) -> Path:
    """The file that is locked for a module of a chassis: one on this computer, for every user and program."""
    name = hashlib.sha256(f"{_place(address)}|{module}".encode()).hexdigest()[:16]
    return folder_of_the_machine() / f"ipmclab-module-{name}.lock"


def _place(address: str | None) -> str:
    """An address in one spelling: the host as a number, so that a name of it is the same chassis."""
    host, _, port = (address or "").rpartition(":")
    if not host:
        return address or ""
    try:
        found = sorted({str(entry[4][0]) for entry in socket.getaddrinfo(host.strip("[]"), None)})
    except OSError:
        return f"{host}:{port}"  # a name that only a server knows is taken as it is
    if any(ipaddress.ip_address(one.partition("%")[0]).is_loopback for one in found):
        return f"127.0.0.1:{port}"
    return f"{found[0]}:{port}"
