"""The names under which clients hold tasks."""

from __future__ import annotations

import secrets

from virtual_cdaq.model.chassis import Chassis, HostedTask
from virtual_cdaq.model.errors import ChassisError

INITIALIZE_NEW, ATTACH_TO_EXISTING = 1, 2  # of NI's SessionInitializationBehavior


class Refused(Exception):
    """The server refuses what the driver is never asked about.

    Parameters
    ----------
    status : {"ALREADY_EXISTS", "FAILED_PRECONDITION"}
        Of gRPC.
    text : str
    """

    def __init__(self, status: str, text: str) -> None:
        self.status = status
        self.text = text
        super().__init__(text)


class Sessions:
    """Tasks by the name of their session.

    A name that the server makes up is never used twice, not even after a restart: a client that outlives the server
    must not find somebody else's task under its old handle.

    Parameters
    ----------
    chassis : Chassis
    """

    def __init__(self, chassis: Chassis) -> None:
        self._chassis = chassis
        self._tasks: dict[str, HostedTask] = {}
        self._boot = secrets.token_hex(4)
        self._made = 0

    def create(self, name: str, behaviour: int) -> tuple[str, bool]:
        """A session of a name, or of a new one; and whether it was made now."""
        exists = name in self._tasks
        if behaviour == INITIALIZE_NEW and exists:
            raise Refused("ALREADY_EXISTS", f"Cannot initialize '{name}' when a session already exists.")
        if behaviour == ATTACH_TO_EXISTING and not exists:
            raise Refused(
                "FAILED_PRECONDITION", f"Cannot attach to '{name}' because a session has not been initialized."
            )
        if exists:
            return name, False
        session = name
        if not name:
            session = f"{self._boot}-{self._made}"
            name = f"_unnamedTask<{self._made}>"
            self._made += 1
        self._tasks[session] = self._chassis.new_task(name)
        return session, True

    def task(self, session: str) -> HostedTask:
        """The task of a session.

        Raises
        ------
        ChassisError
            -200088, there is none.
        """
        found = self._tasks.get(session)
        if found is None:
            raise ChassisError(-200088, f"Session: {session}")
        return found

    def remove(self, session: str) -> None:
        """Forget a session."""
        self._tasks.pop(session, None)
