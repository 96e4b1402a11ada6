"""The campaign file: samples x signals x environments x repeats, in words and units of people."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from ipmclab.campaign.blocks import BASELINE, label_of
from ipmclab.campaign.campaign import ROOM, Campaign, Clamped, Fact, Order, Part, Strip, VirtualState, with_water
from ipmclab.campaign.lines import line_of
from ipmclab.errors import InputError, suggest
from ipmclab.model import Actuator, load_actuator
from ipmclab.rig.channels import Rig
from ipmclab.rig.experiments.experiment import VIRTUAL, Experiment
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.rig.files.rig_file import library_rigs, load_rig
from ipmclab.sample import Sample
from ipmclab.signals import Samples, Signal, parse
from ipmclab.signals import Sequence as SignalSequence
from ipmclab.store.strict import Strict, validated
from ipmclab.toml_file import parse_table, read_text
from ipmclab.units import parse_quantity

OF_THE_CAMPAIGN: Final = ("sample", "actuator", "rig", "folder", "title", "mounting_id")
"""Keys of an experiment file that a campaign states for all of its experiments, or makes."""

_LIBRARY: Final = resources.files("ipmclab.campaign") / "library"


class _Samples(Strict):
    """What belongs to a strip in a campaign, in addition to what describes the sample itself."""

    actuator: str | None = None
    virtual: Annotated[tuple[_State, ...], Field(strict=False)] = ()


class _State(Strict):
    measured: Literal["displacement", "force"] | None = None
    signal: str | None = None
    condition: str | None = None
    actuator: str | None = None
    set: dict[str, Any] = Field(default_factory=dict)


class _Table(Strict):
    title: str | None = None
    rig: str = VIRTUAL
    order: Order = "listed"
    seed: Annotated[int, Field(ge=0)] = 1
    clamped: Clamped = "for each block"
    attempts: Annotated[int, Field(ge=1)] = 2
    fails_at: Literal["error", "warning", "never"] = "error"
    measure: Annotated[tuple[Fact, ...], Field(strict=False)] = ()
    identify: bool = True
    method: dict[str, Any] = Field(default_factory=dict)
    samples: Annotated[tuple[dict[str, Any], ...], Field(strict=False)]
    experiments: Annotated[tuple[dict[str, Any], ...], Field(strict=False)]


def library_campaigns() -> list[str]:
    """Names of the campaigns that come with ipmclab.

    Examples
    --------
    >>> library_campaigns()
    ['friend-chapter-5']
    """
    names = [entry.name for entry in _LIBRARY.iterdir()]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml") and "-rig" not in name)


def load_campaign(name_or_path: str | Path) -> Campaign:
    """Read a campaign of the library or from a TOML file.

    Parameters
    ----------
    name_or_path : str or Path
        What the file names is looked for in the same folder.

    Raises
    ------
    InputError
        No such campaign, or what ``campaign_from_text`` refuses.

    Examples
    --------
    >>> campaign = load_campaign("friend-chapter-5")
    >>> len(campaign.strips), campaign.order
    (7, 'listed')
    """
    path = Path(name_or_path)
    name = str(name_or_path).removesuffix(".toml")
    if name in library_campaigns() and not path.is_file():
        path = Path(str(_LIBRARY / f"{name}.toml"))
    missing = InputError(
        "there is no campaign of this name, neither as a file nor in the library",
        code="no-such-file",
        where=str(name_or_path),
        repair=f"{suggest(name, library_campaigns())}; ipmclab characterise --template prints a file to start from",
    )
    text = read_text(path, kind="a campaign", missing=missing)
    return campaign_from_text(text, folder=path.parent, where=str(name_or_path), name=path.stem)


def campaign_from_text(
    text: str, *, folder: Path = Path(), where: str = "campaign", name: str = "campaign"
) -> Campaign:
    """Check a campaign as it is in a file.

    Parameters
    ----------
    text : str
        TOML.
    folder : Path
        Where what it names is looked for.
    where : str
        The file, for messages.
    name : str
        Its title where it states none.

    Raises
    ------
    InputError
        An unknown key, a wrong unit, a sample that is not listed or listed twice, and all that
        ``experiment_from_table`` refuses; with the line of the file.
    """
    table = parse_table(text, where=where)
    try:
        return _campaign(table, folder, name, text, where)
    except InputError as error:
        found, place = line_of(text, error.where), f"{where}: {error.where}".rstrip(": ")
        at = f"{where}, line {found}: {error.where}" if found is not None and error.where else place
        raise InputError(error.message, code=error.code, where=at, repair=error.repair) from error


def _campaign(table: Mapping[str, Any], folder: Path, name: str, text: str, where: str) -> Campaign:
    read = _bare(_Table, table)
    if not read.samples or not read.experiments:
        missing = "experiments" if read.samples else "samples"
        raise InputError(
            f"no {missing} are listed", code="missing-key", where=missing, repair=f"add a table [[{missing}]]"
        )
    rig_file: Path | str = read.rig if read.rig in library_rigs() else folder / read.rig
    strips = tuple(_strip(one, folder, f"samples.{at}") for at, one in enumerate(read.samples))
    ids = [strip.sample.id for strip in strips]
    for at, id_ in enumerate(ids):
        if id_ in ids[:at]:
            raise InputError(
                f"sample {id_!r} is listed twice",
                code="bad-value",
                where=f"samples.{at}.id",
                repair="give each its own id",
            )
    parts = tuple(_part(one, at, read, strips, folder) for at, one in enumerate(read.experiments))
    for at, part in enumerate(parts):
        if part.name in [other.name for other in parts[:at]]:
            raise InputError(
                f"two experiments are called {part.name!r}",
                code="bad-value",
                where=f"experiments.{at}.name",
                repair="give each its own name",
            )
    rig = _rig(rig_file)
    return Campaign(
        title=read.title or name,
        rig=rig,
        rig_file=rig_file,
        strips=strips,
        parts=parts,
        order=read.order,
        seed=read.seed,
        clamped=read.clamped,
        attempts=read.attempts,
        fails_at=read.fails_at,
        facts=read.measure,
        identify=read.identify,
        checksum=_checksum(table, _named_files(table, rig, rig_file, strips, folder), parts),
        where=where,
        text=text,
    )


def _bare(model: type[Any], table: Mapping[str, Any], place: str = "") -> Any:
    """A table, checked, with the keys alone as the place of what is wrong."""
    try:
        return validated(model, table, where="")
    except InputError as error:
        inside = error.where.removeprefix(":").strip()
        raise InputError(
            error.message, code=error.code, where=f"{place}.{inside}".strip("."), repair=error.repair
        ) from error


def _rig(rig_file: Path | str) -> Rig:
    try:
        return load_rig(rig_file)
    except InputError as error:
        raise InputError(
            f"{error.where}: {error.message}", code=error.code, where="rig", repair=error.repair
        ) from error


def _strip(table: Mapping[str, Any], folder: Path, place: str) -> Strip:
    own = {key: value for key, value in table.items() if key in _Samples.model_fields}
    read = _bare(_Samples, own, place)
    rest = {key: value for key, value in table.items() if key not in own}
    actuator = _beside(read.actuator, folder)
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
    named = _beside(read.actuator, folder)
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
            raise InputError(
                f"unknown parameter {name!r}", code="unknown-parameter", where=where, repair=suggest(name, known)
            )
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
        raise InputError(
            f"{error.where}: {error.message}".lstrip(": "), code=error.code, where=place, repair=error.repair
        ) from error


def _beside(named: str | None, folder: Path) -> str | None:
    """The name of a library actuator, or the path of a file in the folder of the campaign."""
    return str(folder / named) if named is not None and (folder / named).is_file() else named


def _part(table: Mapping[str, Any], at: int, read: _Table, strips: Sequence[Strip], folder: Path) -> Part:
    place = f"experiments.{at}"
    own = dict(table)
    name, wanted, file = (own.pop(key, None) for key in ("name", "samples", "file"))
    if not isinstance(name, str) or not name.strip() or "/" in name:
        raise InputError(
            "an experiment of a campaign needs a name without '/'",
            code="missing-key",
            where=f"{place}.name" if name is not None else place,
            repair='add name = "displacement"',
        )
    _refuse_campaign_keys(own, place)
    _refuse_campaign_keys(read.method, "method")
    from_file = {} if file is None else _of_file(folder / str(file), f"{place}.file")
    keys = _merged(read.method, from_file, own)
    experiments = {}
    for strip in strips if wanted is None else _named(wanted, strips, f"{place}.samples"):
        experiments[strip.sample.id] = _experiment(keys, strip, folder, place, set(read.method) - set(own))
    return Part(name, experiments)


def _merged(*tables: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of an experiment, each table over those before it: limits and environment key by key."""
    keys = {name: value for table in tables for name, value in table.items()}
    for name in ("limits", "environment"):
        found = [table[name] for table in tables if name in table]
        if found and all(isinstance(one, dict) for one in found):
            keys[name] = {key: value for one in found for key, value in one.items()}
    if keys.get("environment") == ROOM:
        del keys["environment"]
    for one, other in (("signal", "signals"), ("signals", "signal")):
        if one in tables[-1] and other not in tables[-1]:
            keys.pop(other, None)
    return keys


def _experiment(keys: Mapping[str, Any], strip: Strip, folder: Path, place: str, shared: set[str]) -> Experiment:
    """The experiment of one strip; a mistake in a key that all experiments share is reported for the shared table."""
    table = {**keys, "sample": strip.sample.id}
    if strip.actuator is not None:
        table["actuator"] = strip.actuator
    for key, why in (("rate", "50 Hz"), ("duration", "40 s")):
        if key not in table:
            raise InputError(
                "this key is missing",
                code="missing-key",
                where=place,
                repair=f'add {key} = "{why}", here or in [method]',
            )
    try:
        experiment = experiment_from_table(table, folder=folder, where="", name=place)
    except InputError as error:
        inside = error.where.removeprefix(":").strip()
        at = "method" if inside.partition(".")[0] in shared else place
        raise InputError(
            error.message, code=error.code, where=f"{at}.{inside}".strip("."), repair=error.repair
        ) from error
    return replace(experiment, sample=strip.sample, where=place)


def _refuse_campaign_keys(table: Mapping[str, Any], place: str) -> None:
    for key in OF_THE_CAMPAIGN:
        if key in table:
            raise InputError(
                f"{key!r} is the campaign's, not an experiment's",
                code="needless-key",
                where=f"{place}.{key}",
                repair="state it for the campaign, or in [[samples]]",
            )


def _of_file(path: Path, place: str) -> dict[str, Any]:
    """What an experiment file states, without what the campaign states for all."""
    missing = InputError(
        f"there is no experiment file {str(path)!r}",
        code="no-such-file",
        where=place,
        repair="name an experiment file in the folder of the campaign file",
    )
    table = parse_table(read_text(path, kind="an experiment", missing=missing), where=str(path))
    return {key: value for key, value in table.items() if key not in OF_THE_CAMPAIGN}


def _named(wanted: Any, strips: Sequence[Strip], place: str) -> list[Strip]:
    known = {strip.sample.id: strip for strip in strips}
    if not isinstance(wanted, list) or not wanted:
        raise InputError(
            "this is not a list of sample ids", code="bad-value", where=place, repair='write ["strip-1", "strip-2"]'
        )
    for at, id_ in enumerate(wanted):
        if not isinstance(id_, str) or id_ not in known:
            raise InputError(
                f"no sample {id_!r} is listed",
                code="unknown-sample",
                where=f"{place}.{at}",
                repair=suggest(str(id_), known),
            )
    return [known[id_] for id_ in dict.fromkeys(wanted)]


def _named_files(
    table: Mapping[str, Any], rig: Rig, rig_file: Path | str, strips: Sequence[Strip], folder: Path
) -> list[Path]:
    """The files of one's own that a campaign depends on: rig, what that names, strips, experiments."""
    names = [
        rig_file,
        rig.virtual.actuator,
        None if rig.chamber is None else rig.chamber.table,
        *(name for strip in strips for name in (strip.actuator, *(one.actuator for one in strip.states))),
    ]
    names += [folder / str(one["file"]) for one in table["experiments"] if "file" in one]
    return [path for name in names if name is not None and (path := Path(name)).is_file()]


def _checksum(table: Mapping[str, Any], files: Sequence[Path], parts: Sequence[Part]) -> str:
    """The same for two campaigns that say the same, whatever their comments; another for other files that they name."""
    found = hashlib.sha256(json.dumps(table, sort_keys=True, default=str).encode())
    for path in files:
        found.update(path.read_bytes())
    for experiment in (next(iter(part.experiments.values())) for part in parts):
        own = experiment.reference.signal if experiment.reference is not None else None
        for one in _of_files((*experiment.signals, *([own] if own is not None else []))):
            found.update(one.times.tobytes() + one.values.tobytes())
    return found.hexdigest()


def _of_files(signals: Iterable[Signal]) -> Iterator[Samples]:
    """The signals that stand in files."""
    for one in signals:
        if isinstance(one, SignalSequence):
            yield from _of_files(one.signals)
        elif isinstance(one, Samples) and one.path:
            yield one


_Samples.model_rebuild()
