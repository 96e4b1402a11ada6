"""A folder of runs, fits and tables as an RO-Crate: a zip file whose metadata say what each file is (RO-Crate 1.1).

RO-Crate (https://w3id.org/ro/crate) is what repositories of data read: schema.org in JSON-LD next to the files.
"""

from __future__ import annotations

import datetime
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

from ipmclab.checksum import file_checksum
from ipmclab.destination import keep_what_is_read, replacing, target_of
from ipmclab.errors import InputError
from ipmclab.extras import package
from ipmclab.kinds import tell_kinds
from ipmclab.publication.inventory import CHECKSUMS, Item, RunFacts, inventory
from ipmclab.publication.licences import licence_of
from ipmclab.publication.tables import ABOUT, tables
from ipmclab.sample import Sample
from ipmclab.version import __version__

if TYPE_CHECKING:
    from rocrate.rocrate import ROCrate

_ABOUT_CHECKSUMS: Final = {
    "name": "Checksums",
    "encodingFormat": "text/plain",
    "description": "SHA-256 of every file, for sha256sum -c",
}

_VERSION: Final = "1.1"
_TERMS: Final = {"sha256": "https://schema.org/sha256"}
_SOFTWARE: Final = "#ipmclab"
_NAMED: Final = re.compile(r"^(?P<name>[^<>]*[^<>\s])\s*(?:<(?P<address>https?://[^<>\s]+|\d{4}-[\dX-]+)>)?$")
_ORCID: Final = re.compile(r"(?:https?://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dX])")
_EPOCH: Final = (1980, 1, 1, 0, 0, 0)
"""The date of every file in the archive: the same folder gives the same bytes."""


@tell_kinds
def export_crate(
    folder: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    title: str,
    licence: str,
    people: Sequence[str] = (),
    organisation: str = "",
    description: str = "",
    overwrite: bool = False,
) -> None:
    """Write a folder of runs, fits, tables and reports as an RO-Crate in a zip file.

    Runs (netCDF), fits and the other files of the folder are taken along as they are, with tables of all runs, their
    metrics and the parameters of all fits as CSV. The metadata say of each file what it is, its size and its SHA-256;
    of each run its sample, its signal, who recorded it, when and with which rig, as far as the run says it.

    Parameters
    ----------
    folder : str or path
        With its folders; hidden files, links and what ``FORMATS`` does not name are left out.
    path : str or path
        A name that ends in ``.zip``.
    title : str
    licence : str
        Its SPDX name, such as ``CC-BY-4.0``, or its address; whoever owns the data chooses it.
    people : sequence of str
        Who made the data: ``"Ada Example <0000-0002-1825-0097>"``, the number being an ORCID, or a name alone. The
        operators of the runs where it is left out.
    organisation : str
        Where they work, which publishes the data: ``"Example University <https://ror.org/...>"``, or a name alone.
    description : str
        In a sentence or two; how many runs of which samples there are where it is left out.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        No such folder, nothing in it, another ending, an unknown licence, a person that cannot be read, a file that
        exists.
    IpmclabError
        The extra ``crate`` is not installed, or the system refuses to write there.

    Examples
    --------
    >>> import tempfile, pathlib, zipfile
    >>> from ipmclab import load_actuator, simulate, write_run
    >>> with tempfile.TemporaryDirectory() as place:
    ...     runs = pathlib.Path(place) / "runs"
    ...     runs.mkdir()
    ...     write_run(simulate(load_actuator("friend-2"), "step 1 V", duration=2, rate=50), runs / "step.nc")
    ...     export_crate(runs, runs.parent / "crate.zip", title="One step", licence="CC-BY-4.0")
    ...     sorted(zipfile.ZipFile(runs.parent / "crate.zip").namelist())
    ['manifest-sha256.txt', 'ro-crate-metadata.json', 'step.nc', 'tables/metrics.csv', 'tables/runs.csv']
    """
    target = Path(path)
    if target.suffix.lower() != ".zip" and not target.is_dir():
        raise InputError(
            f"the file ends in {target.suffix!r}, an RO-Crate is written as a zip file",
            code="bad-ending",
            where=str(path),
            repair=f"write {target.with_suffix('.zip').name}",
        )
    if not title.strip():
        raise InputError("the title is empty", code="no-title", where="title", repair="say what the data are")
    target_of(target, overwrite=overwrite)
    address, name = licence_of(licence)
    persons = [_identified(one, "Person") for one in people]
    house = _identified(organisation, "Organization") if organisation else None
    items = inventory(Path(folder))
    keep_what_is_read(target, [one.path for one in items])
    make = _library()
    # Next to its destination: a crate of many runs may be larger than what the system has for temporary files.
    hidden = f".{target.name}."
    with (
        replacing(target, overwrite=overwrite) as temporary,
        tempfile.TemporaryDirectory(prefix=hidden, suffix=".part", dir=target.parent) as made,
    ):
        place = Path(made)
        crate = make(version=_VERSION, gen_preview=False)
        crate.metadata.extra_terms.update(_TERMS)
        every = [*items, *_with_tables(items, place / "made")]
        _describe(crate, items, title, description)
        _add(crate, {"@id": address, "@type": "CreativeWork", "name": name, "description": f"The licence {name}."})
        crate.root_dataset["license"] = {"@id": address}
        _add(crate, _software())
        _fill(crate, every, _people(crate, every, persons, house))
        crate.add_file(_checksums(every, place / "made"), dest_path=CHECKSUMS, properties=_ABOUT_CHECKSUMS)
        crate.write(place / "crate")
        _zip(place / "crate", temporary)


def _library() -> Callable[..., ROCrate]:
    made: Callable[..., ROCrate] = package("rocrate.rocrate", extra="crate", where="export --to ro-crate").ROCrate
    return made


def _with_tables(items: Sequence[Item], place: Path) -> list[Item]:
    """The tables of a folder, written to another place."""
    taken = {one.name: one for one in items}
    found = []
    for name, text in tables(items).items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="")
        if name in taken and file_checksum(taken[name].path) != file_checksum(path):
            raise InputError(
                "this table is not that of the runs in its folder, and one of these runs is inside a crate in that "
                "folder",
                code="another-table",
                where=str(taken[name].path),
                repair="move it away, or give it another name",
            )
        if name not in taken:
            found.append(Item(path, name, path.stat().st_size, file_checksum(path)))
    return found


def _describe(crate: ROCrate, items: Sequence[Item], title: str, description: str) -> None:
    runs, fits = [one.run for one in items if one.run is not None], [one for one in items if one.fit is not None]
    samples = dict.fromkeys(run.metadata.sample.id for run in runs if run.metadata.sample is not None)
    of = f" of {', '.join(samples)}" if samples else ""
    crate.name = title
    crate.description = description or (
        f"{len(runs)} runs{of} and {len(fits)} fits of ionic polymer metal composite actuators, made with ipmclab. "
        "Runs are netCDF files; tables are CSV; all numbers are in SI units."
    )
    crate.datePublished = datetime.datetime.now(datetime.UTC).date().isoformat()
    crate.root_dataset["keywords"] = "IPMC, ionic polymer metal composite, electroactive polymer, actuator"


def _people(
    crate: ROCrate, items: Sequence[Item], persons: Sequence[dict[str, Any]], house: dict[str, Any] | None
) -> dict[str, str]:
    """Add authors, operators and their house; the identifier of each person by the name."""
    known = {person["name"]: person for person in persons}
    for item in items:
        if item.run is not None and item.run.metadata.operator:
            known.setdefault(item.run.metadata.operator, _named(item.run.metadata.operator, "Person"))
    affiliation = {} if house is None else {"affiliation": {"@id": house["@id"]}}
    for person in known.values():
        _add(crate, {**person, **affiliation})
    authors = [{"@id": person["@id"]} for person in (persons or known.values())]
    if authors:
        crate.root_dataset["author"] = authors if len(authors) > 1 else authors[0]
    if house is not None:
        crate.root_dataset["publisher"] = {"@id": _add(crate, house)}
    return {name: person["@id"] for name, person in known.items()}


def _fill(crate: ROCrate, items: Sequence[Item], people: Mapping[str, str]) -> None:
    """Add every file, and how each run came to be."""
    mentions = []
    for item in items:
        file = crate.add_file(item.path, dest_path=item.name, properties=dict(_of_file(item)))
        if item.run is not None:
            mentions.append(_recording(crate, item, item.run, file, people))
    if mentions:
        crate.root_dataset["mentions"] = mentions


def _checksums(items: Sequence[Item], place: Path) -> Path:
    """A file with the checksum of every other one."""
    path = place / CHECKSUMS
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"{one.sha256}  {one.name}\n" for one in sorted(items, key=lambda one: one.name)]
    path.write_text("".join(lines), encoding="utf-8", newline="")
    return path


def _of_file(item: Item) -> Iterator[tuple[str, Any]]:
    yield "name", item.name
    yield "encodingFormat", item.format
    yield "contentSize", str(item.size)
    yield "sha256", item.sha256
    if item.name in ABOUT:
        yield "description", ABOUT[item.name]
    elif item.fit is not None:
        yield (
            "description",
            f"Fit of {item.fit.actuator.name} to {len(item.fit.observations)} runs, with its uncertainty",
        )
    elif item.run is not None:
        about = item.run.metadata
        yield "description", f"{about.origin} run: {about.signal or 'voltage as recorded'}, {item.run.rows} rows"
        yield "variableMeasured", list(item.run.channels)
        if about.recorded_at:
            yield "dateCreated", about.recorded_at


def _recording(crate: ROCrate, item: Item, run: RunFacts, file: Any, people: Mapping[str, str]) -> dict[str, str]:
    """How a run came to be."""
    about = run.metadata
    entity: dict[str, Any] = {
        "@id": _local("recording", item.name),
        "@type": "CreateAction",
        "name": f"Recording of {item.name}" if about.origin == "measured" else f"Simulation of {item.name}",
        "result": {"@id": file.id},
    }
    if about.recorded_at:
        entity["startTime"] = about.recorded_at
    if about.operator:
        entity["agent"] = {"@id": people[about.operator]}
    if about.sample is not None:
        entity["object"] = {"@id": _add(crate, _of_sample(about.sample))}
    instrument = about.rig or about.bench
    if about.origin == "measured" and instrument:
        rig = {"@id": _local("rig", instrument), "@type": "IndividualProduct", "name": instrument}
        entity["instrument"] = {"@id": _add(crate, rig)}
    elif about.origin != "measured":
        entity["instrument"] = {"@id": _SOFTWARE}
    return {"@id": _add(crate, entity)}


def _of_sample(sample: Sample) -> dict[str, Any]:
    facts = [
        (name, value)
        for name, value in vars(sample).items()
        if name not in ("id", "source", "micrographs") and value is not None
    ]
    text = "; ".join(f"{name.replace('_', ' ')}: {value}" for name, value in facts)
    entity = {
        "@id": _local("sample", sample.id),
        "@type": "IndividualProduct",
        "name": sample.id,
        "description": f"A strip. {text} (SI units)" if text else "A strip.",
    }
    return {**entity, "material": sample.membrane} if sample.membrane else entity


def _software() -> dict[str, Any]:
    return {
        "@id": _SOFTWARE,
        "@type": "SoftwareApplication",
        "name": "ipmclab",
        "softwareVersion": __version__,
        "description": "An open laboratory for IPMC actuators: it recorded, simulated or identified these data.",
    }


def _identified(text: str, kind: str) -> dict[str, Any]:
    """A person or an organisation: a name, and its address in angle brackets where it has one."""
    is_person, match = kind == "Person", _NAMED.match(text.strip())
    address = match["address"] if match else None
    number = _ORCID.fullmatch(address or "")
    known = bool(number and _is_orcid(number[1])) if is_person else "://" in (address or "")
    if match is None or (address and not known):
        what, example = ("a person", "Ada Example <0000-0002-1825-0097>', the number being an ORCID")
        if not is_person:
            what, example = ("an organisation", "Example University <https://ror.org/...>'")
        why = f": {number[1]} is no ORCID, one of its digits is wrong" if number and is_person else ""
        raise InputError(
            f"{text!r} is not the name of {what}{why}",
            code="bad-name",
            where="people" if is_person else "organisation",
            repair=f"write '{example}, or the name alone",
        )
    name = match["name"].strip()
    if number:
        address = f"https://orcid.org/{number[1]}"
    return _named(name, kind) if address is None else {"@id": address, "@type": kind, "name": name, "url": address}


def _is_orcid(number: str) -> bool:
    """Whether the last digit is that of the others (ISO 7064, 11-2): a slip of the pen would name somebody else.

    Examples
    --------
    >>> _is_orcid("0000-0002-1825-0097"), _is_orcid("0000-0002-1825-0079")
    (True, False)
    """
    total = 0
    for digit in number.replace("-", ""):
        total = 2 * total + (10 if digit == "X" else int(digit))
    return total % 11 == 1


def _named(name: str, kind: str) -> dict[str, Any]:
    return {"@id": _local(kind.lower(), name), "@type": kind, "name": name}


def _local(kind: str, name: str) -> str:
    """An identifier within the crate, another one for each name in any script."""
    return f"#{kind}-{quote(name, safe='')}"


def _add(crate: ROCrate, entity: dict[str, Any]) -> str:
    """Add an entity unless it is there; its identifier."""
    if crate.get(entity["@id"]) is None:
        crate.add_jsonld(dict(entity))  # which it takes apart
    return str(entity["@id"])


def _zip(folder: Path, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        files = [one for one in folder.rglob("*") if one.is_file()]
        for one in sorted(files, key=lambda one: one.relative_to(folder).as_posix()):
            about = zipfile.ZipInfo(one.relative_to(folder).as_posix(), _EPOCH)
            about.file_size = one.stat().st_size  # above 2 GB its place in the archive has another form
            about.compress_type, about.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            with one.open("rb") as stream, archive.open(about, "w") as written:
                shutil.copyfileobj(stream, written)
