"""The samples that a campaign file lists: strips, and the virtual bench in their place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ipmclab.campaign.blocks import BASELINE, label_of
from ipmclab.campaign.campaign import Strip, VirtualState, with_water
from ipmclab.campaign.lines import keyed
from ipmclab.errors import InputError, unknown_name
from ipmclab.model import Actuator, load_actuator
from ipmclab.rig.experiments.experiment_file import beside
from ipmclab.sample import Sample
from ipmclab.signals import parse
from ipmclab.store.strict import Strict
from ipmclab.units import parse_quantity


class _State(Strict):
    measured: Literal["displacement", "force"] | None = None
    signal: str | None = None
    condition: str | None = None
    actuator: str | None = None
    set: dict[str, Any] = Field(default_factory=dict)


class _Samples(Strict):
    """What belongs to a strip in a campaign, in addition to what describes the sample itself."""

    actuator: str | None = None
    virtual: Annotated[tuple[_State, ...], Field(strict=False)] = ()


def strip_of(table: Mapping[str, Any], folder: Path, place: str) -> Strip:
    """A strip, with its actuator and what else a virtual bench may have in its place.

    Raises
    ------
    InputError
        Its ``where`` is a key of the campaign file.
    """
    own = {key: value for key, value in table.items() if key in _Samples.model_fields}
    read = keyed(_Samples, own, place)
    rest = {key: value for key, value in table.items() if key not in own}
    actuator = beside(read.actuator, folder)
    if "id" not in rest or "/" in str(rest["id"]):
        raise InputError(
            "a sample of a campaign needs an id without '/'",
            code="missing-key",
            where=f"{place}.id" if "id" in rest else place,
            repair='add id = "strip-1"',
        )
    sample = Sample.from_table(rest, where=place)
    model = None if actuator is None else _loaded(actuator, f"{place}.actuator")
    if model is not None and set(rest) == {"id"} and model.sample is not None and model.sample.id == sample.id:
        sample = model.sample
    states = tuple(_state(one, model, folder, f"{place}.virtual.{at}") for at, one in enumerate(read.virtual))
    return Strip(sample, actuator, states)


def _state(read: _State, model: Actuator | None, folder: Path, place: str) -> VirtualState:
    signal = read.signal
    if signal not in (None, BASELINE):
        signal = _placed(lambda: label_of(parse(read.signal or "", folder=folder), folder), f"{place}.signal")
    named = beside(read.actuator, folder)
    base = model if named is None else _loaded(named, f"{place}.actuator")
    if base is None and read.set:
        raise InputError(
            "there is no model in which this could be set",
            code="missing-key",
            where=f"{place}.set",
            repair='add actuator = "friend-1-measured" to the sample',
        )
    known = {} if base is None else with_water(base, read.set).parameters()
    values = {}
    for name, value in read.set.items():
        where = f"{place}.set.{name}"
        if name not in known:
            raise unknown_name("parameter", name, known, where=where)
        values[name] = parse_quantity(str(value), known[name].quantity, where=where)
    return VirtualState(read.measured, signal, read.condition, named, values)


def _loaded(actuator: str, place: str) -> Actuator:
    found: Actuator = _placed(lambda: load_actuator(actuator), place)
    return found


def _placed(make: Callable[[], Any], place: str) -> Any:
    """What is made, with the key of the campaign where it cannot be."""
    try:
        return make()
    except InputError as error:
        raise error.at(place, f"{error.where}: {error.message}".lstrip(": ")) from error
