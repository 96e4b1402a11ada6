"""One property is one entry of a table: how it is got, and how it is set if it can be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from virtual_cdaq.model.errors import ChassisError


@dataclass(frozen=True)
class Property:
    """A property of a task, a channel or a device.

    Parameters
    ----------
    get : callable
        From the thing to the value; the value must be of the type that the call carries.
    put : callable or None
        Takes the thing and a value; None when it is read only.
    reset : callable or None
        Brings the default back.
    """

    get: Callable[[Any], Any]
    put: Callable[[Any, Any], None] | None = None
    reset: Callable[[Any], None] | None = None


Table = dict[str, Property]


def get(table: Table, name: str, thing: Any) -> Any:
    """The value of a property."""
    return _property(table, name).get(thing)


def put(table: Table, name: str, thing: Any, value: Any) -> None:
    """Set a property."""
    found = _property(table, name)
    if found.put is None:
        raise ChassisError(-200452, f"Property: {name} (read only)")
    found.put(thing, value)


def reset(table: Table, name: str, thing: Any) -> None:
    """Bring the default of a property back."""
    found = _property(table, name)
    if found.reset is None:
        raise ChassisError(-200452, f"Property: {name}")
    found.reset(thing)


def _property(table: Table, name: str) -> Property:
    found = table.get(name)
    if found is None:
        raise ChassisError(-200452, f"Property: {name}")
    return found


def constant(value: Any) -> Property:
    """A property that is the same for everything that has it."""
    return Property(lambda _: value)


def kept(name: str, default: Any) -> Property:
    """A property that is kept and read back, and that nothing depends on.

    Parameters
    ----------
    name : str
        Its place in the ``properties`` of the thing.
    default : object
    """

    def keep(thing: Any, value: Any) -> None:
        thing.properties[name] = value

    def forget(thing: Any) -> None:
        thing.properties.pop(name, None)

    return Property(lambda thing: thing.properties.get(name, default), keep, forget)
