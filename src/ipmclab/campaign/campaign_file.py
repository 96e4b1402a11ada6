"""The campaign file: samples x signals x environments x repeats, in words and units of people."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from ipmclab.campaign.campaign import Campaign, Clamped, Fact, Order, Part, Strip
from ipmclab.campaign.lines import keyed, line_of
from ipmclab.campaign.listed_experiments import part_of
from ipmclab.campaign.listed_strips import strip_of
from ipmclab.errors import InputError, suggest
from ipmclab.rig.channels import Rig
from ipmclab.rig.experiments.experiment import VIRTUAL
from ipmclab.rig.files.rig_file import library_rigs, load_rig
from ipmclab.signals import Samples, Signal
from ipmclab.signals import Sequence as SignalSequence
from ipmclab.store.strict import Strict
from ipmclab.toml_file import parse_table, read_text

_LIBRARY: Final = resources.files("ipmclab.campaign") / "library"


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
        raise error.at(at) from error


def _campaign(table: Mapping[str, Any], folder: Path, name: str, text: str, where: str) -> Campaign:
    read = keyed(_Table, table)
    if not read.samples or not read.experiments:
        missing = "experiments" if read.samples else "samples"
        raise InputError(
            f"no {missing} are listed", code="missing-key", where=missing, repair=f"add a table [[{missing}]]"
        )
    rig_file: Path | str = read.rig if read.rig in library_rigs() else folder / read.rig
    strips = tuple(strip_of(one, folder, f"samples.{at}") for at, one in enumerate(read.samples))
    ids = [strip.sample.id for strip in strips]
    for at, id_ in enumerate(ids):
        if id_ in ids[:at]:
            raise InputError(
                f"sample {id_!r} is listed twice",
                code="bad-value",
                where=f"samples.{at}.id",
                repair="give each its own id",
            )
        alike = [other for other in ids[:at] if other.casefold() == id_.casefold()]
        if alike:
            raise InputError(
                f"the files of sample {id_!r} would be those of {alike[0]!r} where capitals do not count",
                code="bad-value",
                where=f"samples.{at}.id",
                repair="give each an id that differs from the others not in capitals alone",
            )
    parts = tuple(part_of(one, at, read.method, strips, folder) for at, one in enumerate(read.experiments))
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


def _rig(rig_file: Path | str) -> Rig:
    try:
        return load_rig(rig_file)
    except InputError as error:
        raise error.at("rig", f"{error.where}: {error.message}") from error


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
