"""Sliders and what they change: the whole view runs in the browser, and asks ``/simulate`` at every change."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

from nicegui.element import Element

from ipmclab.errors import InputError

if TYPE_CHECKING:
    from nicegui.events import GenericEventArguments

    from ipmclab.errors import IpmclabError
    from ipmclab.model import Actuator
    from ipmclab.model.parameters import Parameter

_SPAN: Final = 5.0
"""A slider goes from a fifth of the value to five times it."""

_NEVER: Final = 1e300
"""What stands for infinity, which JSON lacks [SI]."""

_FROM_ZERO: Final = 20.0
"""Of a parameter that is 0, such as the contact resistance: how far its slider goes [its shown unit]."""


class Simulator(Element, component="simulator.js"):
    """Sliders for an actuator, its response, frequency response and shape.

    Parameters
    ----------
    key : str
        What ``/simulate`` calls the actuator.
    actuator : Actuator
    runs : sequence of (key, label)
        Runs that can be laid over.
    run : str, optional
        The one that is.
    stamp : str
        What changes when the actuator's file does, as it was before that was loaded.
    on_asked : callable, optional
        Called with what was asked: changes and signal; also a coroutine function.
    """

    def __init__(
        self,
        key: str,
        actuator: Actuator,
        *,
        runs: Sequence[tuple[str, str]] = (),
        run: str | None = None,
        stamp: str = "0",
        on_asked: Callable[[dict[str, Any]], Any] | None = None,
    ) -> None:
        super().__init__()
        known, notes = actuator.parameters().values(), left_open(actuator)
        self._props["options"] = {
            "actuator": key,
            "parameters": [slider(one, notes.get(one.name, "")) for one in known if one.transform != "count"],
            "fitted": actuator.fit_table is not None or "+" in key,
            "runs": list(runs),
            "run": run,
            "stamp": stamp,
        }
        if on_asked is not None:

            async def asked(event: GenericEventArguments) -> None:
                result = on_asked(event.args)
                if result is not None:
                    await result

            self.on("asked", asked, throttle=0.5)

    async def changes(self) -> dict[str, float]:
        """What the sliders say now, where it is not what was loaded [SI].

        Raises
        ------
        InputError
            The field of a parameter holds no number, or one that was refused: it says so itself.
        """
        state: dict[str, Any] = await self.run_method("told")
        if state["wrong"]:
            raise InputError(
                f"there is no number that can be used at: {', '.join(map(str, state['wrong']))}",
                code="wrong-fields",
                repair="correct what is marked",
            )
        return {str(name): float(value) for name, value in state["changes"].items()}

    def complain(self, error: IpmclabError) -> None:
        """Say at the field of a parameter what is wrong with it."""
        self.run_method("complain", error.as_dict())

    def set_runs(self, runs: Sequence[tuple[str, str]]) -> None:
        """Other runs that can be laid over."""
        self._props["options"]["runs"] = list(runs)
        self.run_method("set_runs", list(runs))


def left_open(actuator: Actuator) -> dict[str, str]:
    r"""Of each parameter that the fit of an actuator does not determine, within what it may be, in words.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ipmclab import load_actuator
    >>> entry = {"name": "beam.modulus", "determined": False, "interval": [0.0, 2.5e9]}
    >>> left_open(replace(load_actuator("friend-2"), fit_table={"parameters": [entry]}))
    {'beam.modulus': 'not determined by its fit: below 2500\xa0MPa (95 %)'}
    """
    known = actuator.parameters()
    found = {}
    entries = (actuator.fit_table or {}).get("parameters")
    for entry in entries if isinstance(entries, list) else []:
        try:
            name = entry["name"]
            if entry["determined"] or name not in known:
                continue
            quantity = known[name].quantity
            low, high = sorted(quantity.to_display(float(end)) for end in entry["interval"])
            words = _within(low, high, _spelled(quantity.display_unit))
        except (KeyError, TypeError, ValueError, AttributeError):
            continue  # no table that a fit wrote: those who read it as one say so
        found[name] = f"not determined by its fit: {words}"
    return found


def _within(low: float, high: float, unit: str) -> str:
    """An interval in words, with three digits, or as many as distinguish its ends."""
    is_above, is_below = low not in (0.0, -math.inf), math.isfinite(high)
    pairs = ([f"{float(f'{end:.{digits}g}'):g}" for end in (low, high)] for digits in (3, 4, 5, 6))
    first, last = next((pair for pair in pairs if pair[0] != pair[1]), (f"{low:.8g}", f"{high:.8g}"))
    spaced = f"\u00a0{unit}".replace(" ", "\u00a0") if unit else ""
    if is_above and is_below:
        return f"between {first} and {last}{spaced} (95 %)"
    if is_above or is_below:
        return f"above {first}{spaced} (95 %)" if is_above else f"below {last}{spaced} (95 %)"
    return "it may have any value"


def slider(parameter: Parameter, note: str = "") -> dict[str, Any]:
    """A parameter as the browser has it: how it is called and shown, and from where to where its slider goes [SI].

    ``note`` is what is next to it.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> modulus = slider(load_actuator("friend-2").parameters()["beam.modulus"])
    >>> modulus["label"], modulus["value"] * modulus["factor"], modulus["unit"], modulus["log"]
    ('modulus', 1450.0, 'MPa', True)
    """
    value, factor = parameter.value, parameter.quantity.to_display(1.0)
    is_log = parameter.transform == "log" and value > 0.0
    if value == 0.0:
        low, high = max(parameter.lower, 0.0), _FROM_ZERO / factor
    else:
        low, high = sorted((value / _SPAN, value * _SPAN))
    group, _, rest = parameter.name.partition(".")
    words = rest.replace("branches.", "branch ").replace(".", " ").replace("_", " ")
    return {
        "name": parameter.name,
        "label": _counted_from_one(words) if group == "circuit" else words,
        "group": group,
        "unit": _spelled(parameter.quantity.display_unit),
        "factor": factor,
        "value": value,
        "low": max(low, parameter.lower),
        "high": min(high, parameter.upper),
        "range": [max(parameter.lower, -_NEVER), min(parameter.upper, _NEVER)],
        "log": is_log,
        "note": note,
    }


def _counted_from_one(words: str) -> str:
    parts = words.split()
    return " ".join(str(int(part) + 1) if part.isdigit() else part for part in parts)


def _spelled(unit: str) -> str:
    return unit.replace("ohm", "Ω").replace("^2", "²").replace("^3", "³")
