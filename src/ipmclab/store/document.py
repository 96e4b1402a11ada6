"""What a run carries in addition to its arrays, as one JSON document: the same in every file that we write."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError, unknown_name
from ipmclab.run import QUALITY_FLAGS, Finding, Hold, Mark, Run, RunMetadata, ZeroReading
from ipmclab.sample import Sample
from ipmclab.units import (
    CHANNELS,
    MASS,
    PRESSURE,
    RELATIVE_HUMIDITY,
    RESISTANCE,
    TEMPERATURE,
    Quantity,
    format_quantity,
)

if TYPE_CHECKING:
    from pydantic import TypeAdapter

FORMAT: Final = "ipmclab run"
FORMAT_VERSION: Final = 1

Result = TypeVar("Result")

METADATA_QUANTITIES: Final[dict[str, Quantity]] = {
    "shunt_resistance": RESISTANCE,
    "source_resistance": RESISTANCE,
    "mass": MASS,
    "clamp_pressure": PRESSURE,
    "temperature": TEMPERATURE,
    "relative_humidity": RELATIVE_HUMIDITY,
}
"""The metadata that are physical quantities."""


def to_document(run: Run) -> str:
    """The document of a run: format version, checksum, hold and metadata.

    Raises
    ------
    InputError
        When the metadata hold something that no file can keep (a NaN, an object).
    """
    return document_of(run.hold, run.metadata, run.content_sha256)


def document_of(hold: Hold, metadata: RunMetadata, content_sha256: str) -> str:
    """The document of a run whose arrays have this checksum."""
    return json.dumps(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "content_sha256": content_sha256,
            "hold": hold,
            "metadata": metadata_table(metadata),
        }
    )


def metadata_table(metadata: RunMetadata) -> dict[str, Any]:
    """Metadata as the table of plain values that ``parse_metadata`` reads.

    Raises
    ------
    InputError
        When they hold something that no file can keep (a NaN, an object).
    """
    from pydantic_core import PydanticSerializationError

    try:
        table = _adapter().dump_python(metadata, exclude_none=True, warnings="error")
        # What an older ipmclab does not know is there only where it says something.
        if not table["findings"]:
            del table["findings"]
        if "sample" in table:
            sample = table["sample"].items()
            table["sample"] = {name: one for name, one in sample if not isinstance(one, list | tuple) or one}
        table = json.loads(json.dumps(table, allow_nan=False))
    except (PydanticSerializationError, TypeError, ValueError) as error:
        raise InputError(
            f"the metadata of the run cannot be written: {str(error).splitlines()[0]}",
            code="bad-metadata",
            where="metadata",
            repair="give finite numbers and texts, and leave out what is not known",
        ) from error
    parse_metadata(table, where="metadata")
    return dict(table)


def from_document(text: str, arrays: Mapping[str, npt.NDArray[Any]], *, where: str) -> Run:
    """Make the run of a document and its arrays, after checking both.

    Parameters
    ----------
    text : str
        What ``to_document`` gave.
    arrays : mapping of name to array
        ``time``, the channels, ``<channel>_quality`` and ``time_environment``.
    where : str
        The file, for messages.

    Raises
    ------
    InputError
        A damaged document, a newer format, arrays that are no run, or a checksum that does not match.
    """
    place = f"{where}: metadata_json"
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"damaged, it is not JSON: {error}",
            code="damaged-metadata",
            where=place,
            repair="take a copy of the file that was not edited",
        ) from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(
            f'it does not say "format": {FORMAT!r}',
            code="not-a-run",
            where=place,
            repair="import a foreign file with an import map",
        )
    version = document.get("format_version")
    if type(version) is not int or version < 1:
        raise InputError(
            f"damaged, the format version is {version!r}",
            code="damaged-metadata",
            where=place,
            repair="take a copy of the file that was not edited",
        )
    if version > FORMAT_VERSION:
        raise InputError(
            f"format version {version!r}, this ipmclab reads versions up to {FORMAT_VERSION}",
            code="newer-format",
            where=place,
            repair="update ipmclab",
        )
    metadata = parse_metadata(document.get("metadata"), where=f"{place}.metadata")
    missing = [name for name in ("time", "voltage") if name not in arrays]
    if missing:
        raise InputError(
            f"no {' and no '.join(missing)} in it",
            code="not-a-run",
            where=where,
            repair="a run has at least time and voltage",
        )
    given = _as_given(arrays)
    run = locate(where, Run.from_arrays, hold=document.get("hold"), metadata=metadata, **given)
    if document.get("content_sha256") != run.content_sha256:
        raise InputError(
            f"the checksum does not match: content_sha256 is {document.get('content_sha256')!r} in the file "
            f"and {run.content_sha256!r} of what was read",
            code="checksum",
            where=where,
            repair="its numbers were changed after it was written: take another copy of the file",
        )
    return run


def flat_attributes(run: Run) -> dict[str, str]:
    """The same facts as texts with units, one by one, for people."""
    return attributes_of(run.hold, run.metadata, run.content_sha256)


def attributes_of(hold: Hold, metadata: RunMetadata, content_sha256: str) -> dict[str, str]:
    """The attributes of a run whose arrays have this checksum."""
    known: dict[str, Any] = {"hold": hold, "content_sha256": content_sha256}
    for key in RunMetadata.__dataclass_fields__:
        value = getattr(metadata, key)
        if value is None or (isinstance(value, (tuple, Mapping)) and not value):
            continue
        if key == "sample":
            known |= {f"sample_{name}": text for name, text in value.to_table().items()}
        elif key in _LISTED:
            known[key] = "; ".join(_LISTED[key](one) for one in value)
        elif key in _NAMED:
            known[key] = "; ".join(_NAMED[key](name, one).rstrip() for name, one in value.items())
        elif key in METADATA_QUANTITIES:
            known[key] = format_quantity(value, METADATA_QUANTITIES[key])
        elif key.startswith("minutes_"):
            known[key] = f"{float(value)!r} min"
        else:
            known[key] = str(value)
    return known


def _unit(name: str) -> str:
    return CHANNELS[name].unit if name in CHANNELS else ""


def _zero_text(zero: ZeroReading) -> str:
    unit = _unit(zero.channel)
    text = f"{zero.channel}: {zero.kind} {zero.when} {float(zero.value)!r} {unit}".rstrip()
    text += f", standard uncertainty {float(zero.standard_uncertainty)!r} {unit}".rstrip()
    return text if zero.drift is None else f"{text}, drift {float(zero.drift)!r} {unit}/s"


_LISTED: Final[Mapping[str, Callable[[Any], str]]] = {
    "marks": lambda mark: f"{float(mark.time)!r} s: {mark.text}",
    "zeros": _zero_text,
    "findings": lambda finding: f"{finding.severity} {finding.code}: {finding.message}",
}
"""How one entry of a list in the metadata reads."""

_NAMED: Final[Mapping[str, Callable[[str, Any], str]]] = {
    "calibrations": lambda name, text: f"{name}: {text}",
    "limits": lambda name, text: f"{name}: {text}",
    "uncertainties": lambda name, uncertainty: f"{name}: {float(uncertainty)!r} {_unit(name)}",
    "parameters": lambda name, number: f"{name} = {float(number)!r}",
    "ranges": lambda name, ends: f"{name}: {float(ends[0])!r} to {float(ends[1])!r} {_unit(name)}",
}
"""How one entry of a table in the metadata reads, from its name and what it holds."""


def checked(run: Run) -> Run:
    """The run, after the checks of ``Run.from_arrays``: nothing is written that could not be read."""
    return Run.from_arrays(hold=run.hold, metadata=run.metadata, **_as_given(run.arrays))


def _as_given(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, Any]:
    """Arrays by their names in files, as ``Run.from_arrays`` takes them."""
    given: dict[str, Any] = {name: arrays[name] for name in (*CHANNELS, "time", "time_environment") if name in arrays}
    for kind, names in (("quality", CHANNELS), ("raw", (*CHANNELS, "output"))):
        given[kind] = {name: arrays[f"{name}_{kind}"] for name in names if f"{name}_{kind}" in arrays}
    return given


def locate(where: str, call: Callable[..., Result], /, *arguments: Any, **keywords: Any) -> Result:
    """Call something, and name the file in the message of its error."""
    try:
        return call(*arguments, **keywords)
    except IpmclabError as error:
        raise type(error)(
            error.message,
            code=error.code,
            where=f"{where}: {error.where}" if error.where else where,
            repair=error.repair,
        ) from error


def flag_text() -> str:
    """The meaning of the quality bits, for people."""
    return ", ".join(f"{bit} {name}" for name, bit in QUALITY_FLAGS.items())


def parse_metadata(table: Any, *, where: str) -> RunMetadata:
    """Metadata from a table of plain values: an unknown key or a value of another kind is an error."""
    from pydantic import ValidationError

    from ipmclab.store.strict import as_input_error

    _refuse_unknown_keys(table, RunMetadata, where)
    if isinstance(table, dict):
        _refuse_unknown_keys(table.get("sample"), Sample, f"{where}.sample")
        for key, kind in (("marks", Mark), ("zeros", ZeroReading), ("findings", Finding)):
            for item in table[key] if isinstance(table.get(key), list) else ():
                _refuse_unknown_keys(item, kind, f"{where}.{key}")
    try:
        return _adapter().validate_json(json.dumps(table), strict=True)
    except ValidationError as error:
        raise as_input_error(error, table, where=f"{where}.") from error


@cache
def _adapter() -> TypeAdapter[RunMetadata]:
    """What checks metadata; making it costs more than reading a file."""
    from pydantic import TypeAdapter

    return TypeAdapter(RunMetadata)


def _refuse_unknown_keys(table: Any, kind: type[Any], where: str) -> None:
    known = list(kind.__dataclass_fields__)
    for key in table if isinstance(table, dict) else ():
        if key not in known:
            raise unknown_name("key", key, known, where=where)
