"""The names of what drives a strip and of what it gives out, and the ports behind them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ipmclab.errors import InputError, unknown_name

INPUTS: Final = ("voltage", "external_force")
"""What drives a strip from outside: the voltage [V], and a force on it at the sensing point [N], positive as the
displacement."""

OUTPUTS: Final = ("current", "applied_voltage", "displacement", "force")
"""What a strip gives out, always in this order."""

OUTPUT_PORTS: Final = tuple("node_voltage" if name == "applied_voltage" else name for name in OUTPUTS)
"""The port behind each output, in the same order."""


def choose_outputs(outputs: Sequence[str] | None) -> list[int]:
    """The places in ``OUTPUTS`` of some output names.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if outputs is None:
        return list(range(len(OUTPUTS)))
    for name in outputs:
        if name not in OUTPUTS:
            raise unknown_name("output", name, OUTPUTS, where="outputs")
    return [OUTPUTS.index(name) for name in outputs]


def left_at_rest(inputs: Sequence[str]) -> tuple[str, ...]:
    """The inputs of a strip at which nothing happens, where these are driven.

    Raises
    ------
    InputError
        No names, a name twice, an unknown one.

    Examples
    --------
    >>> left_at_rest(["voltage"])
    ('external_force',)
    """
    if not inputs or len(set(inputs)) < len(inputs):
        raise InputError(
            f"the inputs are {', '.join(inputs) or 'none'}",
            code="bad-inputs",
            where="inputs",
            repair=f"name each once, of {', '.join(INPUTS)}",
        )
    for name in inputs:
        if name not in INPUTS:
            raise unknown_name("input", name, INPUTS, where="inputs")
    return tuple(name for name in INPUTS if name not in inputs)
