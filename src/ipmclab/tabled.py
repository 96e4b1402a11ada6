"""What is kept in a file, in the types that TOML has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

_PLAIN: Final = frozenset({float, int, str, bool})


def in_toml(value: Any) -> Any:
    """A value in the types that TOML has; of what is None, which it has not, nothing is said."""
    if type(value) in _PLAIN:
        return value
    if is_dataclass(value):
        value = {one.name: getattr(value, one.name) for one in fields(value)}
    if isinstance(value, Mapping):
        return {name: in_toml(one) for name, one in value.items() if one is not None}
    return [in_toml(one) for one in value] if isinstance(value, tuple | list) else value


class Tabled:
    """What has a table of its own in a file."""

    def to_table(self) -> dict[str, Any]:
        """In the types that TOML has, without what is not known."""
        return dict(in_toml(self))
