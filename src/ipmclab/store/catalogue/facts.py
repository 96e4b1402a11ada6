"""What the catalogue keeps of a run: the facts by which people look for it."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ipmclab.checksum import file_checksum
from ipmclab.errors import InputError, IpmclabError
from ipmclab.store.catalogue.range import seconds_of
from ipmclab.store.document import FORMAT, FORMAT_VERSION, to_document
from ipmclab.store.heap import refuse_endless_heap
from ipmclab.store.run_file import read_run
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.run import Finding

_LONGEST: Final = 500
"""Characters of a fact that is searched: an index holds no page of prose. The document has it whole."""

_FILE_SIGNAL: Final = re.compile(r"(?:^|\bthen\s)\s*file\s")


@dataclass(frozen=True)
class FileFacts:
    """One run file as the catalogue keeps it.

    Parameters
    ----------
    size : int [bytes]
    mtime_ns : int [ns]
    sha256 : str
        Of the bytes of the file.
    run : mapping
        The columns of its run.
    """

    size: int
    mtime_ns: int
    sha256: str
    run: Mapping[str, Any]


def read_facts(path: Path) -> FileFacts:
    """Read of a run file what the catalogue keeps of it, without its arrays where that can be avoided.

    Raises
    ------
    InputError
        What ``read_run`` refuses, or a file that changes while it is read.
    """
    try:
        before = path.stat()
        digest = file_checksum(path)
        facts = _quick_facts(path)
        if facts is None:
            facts = _facts_of_run(path)  # also says what is wrong with the file
        after = path.stat()
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(
            f"it cannot be read: {getattr(error, 'strerror', None) or error}",
            code="unreadable-file",
            where=str(path),
            repair="see that the disk is sound and that you may read it",
        ) from error
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        raise InputError(
            "it changed while it was read", code="file-changes", where=str(path), repair="try again when it is written"
        )
    return FileFacts(after.st_size, after.st_mtime_ns, digest, facts)


def _quick_facts(path: Path) -> dict[str, Any] | None:
    """The facts by way of the one document in the file; None when anything is not as it should be."""
    import h5py
    import numpy as np

    try:
        refuse_endless_heap(path)
        with h5py.File(path, "r") as file:
            text, checksum = file.attrs["metadata_json"], file.attrs["metadata_sha256"]
            if hashlib.sha256(text.encode()).hexdigest() != checksum:
                return None
            document = json.loads(text)
            if document["format"] != FORMAT or not 1 <= document["format_version"] <= FORMAT_VERSION:
                return None
            time = file["time"]
            means = {
                name: float(np.nanmean(file[name][()]))
                for name in ("temperature", "relative_humidity")
                if name in file and np.isfinite(file[name][()]).any()
            }
            return facts_of(
                document,
                identity=str(checksum),
                channels=[name for name in CHANNELS if name in file],
                rows=len(time),
                first=float(time[0]),
                last=float(time[-1]),
                means=means,
            )
    except Exception:  # a damaged file makes HDF5 raise nearly anything; read_run knows what to say of it
        return None


def _facts_of_run(path: Path) -> dict[str, Any]:
    import numpy as np

    run = read_run(path)
    text = to_document(run)
    slow = {"temperature": run.temperature, "relative_humidity": run.relative_humidity}
    return facts_of(
        json.loads(text),
        identity=hashlib.sha256(text.encode()).hexdigest(),
        channels=run.channels,
        rows=len(run),
        first=float(run.time[0]),
        last=float(run.time[-1]),
        means={
            name: float(np.nanmean(values))
            for name, values in slow.items()
            if values is not None and np.isfinite(values).any()
        },
    )


def facts_of(
    document: Mapping[str, Any],
    *,
    identity: str,
    channels: Iterable[str] = (),
    rows: int | None = None,
    first: float = 0.0,
    last: float = 0.0,
    means: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The columns of a run.

    Parameters
    ----------
    document : mapping
        What ``store.document.to_document`` wrote.
    identity : str
        What distinguishes the run from others, and from its other versions: the SHA-256 of its document, which names
        the content; empty for one that is being recorded.
    channels : names of its channels
    rows : int, optional
    first, last : float [s]
        Times of its first and last row.
    means : mapping of name to float [degC], [percent]
        Of what the environment did meanwhile.
    """
    metadata: Mapping[str, Any] = document.get("metadata") or {}
    sample = metadata.get("sample") or {}
    uuid = _text(metadata.get("uuid"))
    signal = signal_facts(metadata.get("signal"))
    means = means or {}
    duration = last - first if rows and rows > 1 else None
    return {
        "identity": f"{uuid or 'document'} {identity}".strip(),
        "uuid": uuid,
        "content_sha256": _text(document.get("content_sha256")),
        "state": _text(metadata.get("state")),
        "state_reason": _text(metadata.get("state_reason")),
        "recorded_at": _text(metadata.get("recorded_at")),
        "recorded": seconds_of(_text(metadata.get("recorded_at"))),
        "rows": rows,
        "duration": _number(duration * rows / (rows - 1)) if duration and rows else None,
        "rate": _number(float(f"{(rows - 1) / duration:.12g}")) if duration and rows else None,
        "origin": _text(metadata.get("origin")) or "measured",
        "sample": _text(sample.get("id")),
        "mounting": _text(metadata.get("mounting_id")),
        "run_number": _count(metadata.get("run_number")),
        "purpose": _text(metadata.get("purpose")),
        "signal": _text(metadata.get("signal")),
        "drive": _text(signal.drive),
        "signal_words": _joined(signal.words),
        "amplitude": _number(signal.amplitude),
        "frequency": _number(signal.frequency),
        "channels": _joined(channels),
        "temperature": _number(means.get("temperature", metadata.get("temperature"))),
        "relative_humidity": _number(means.get("relative_humidity", metadata.get("relative_humidity"))),
        "minutes_out_of_water": _number(metadata.get("minutes_out_of_water")),
        "minutes_in_environment": _number(metadata.get("minutes_in_environment")),
        "operator": _text(metadata.get("operator")),
        "rig": _text(metadata.get("rig")),
        "document": storable(dict(metadata)),
    }


@dataclass(frozen=True)
class SignalFacts:
    """What a signal is in short: its rests before and after, at 0 V, left out.

    Parameters
    ----------
    drive : str
        The signal without its rests, as text; the whole text of one that cannot be read.
    words : tuple of str
        Its waveforms.
    amplitude : float [V], optional
        Of several signals in sequence the largest, with its sign.
    frequency : float [Hz], optional
        Where it has one.
    """

    drive: str | None = None
    words: tuple[str, ...] = ()
    amplitude: float | None = None
    frequency: float | None = None


@lru_cache(maxsize=1000)
def signal_facts(text: str | None) -> SignalFacts:
    """What a signal is in short.

    A signal from a file is not looked up: the file may be gone, the run is not.

    Examples
    --------
    >>> signal_facts("step 0 V for 5 s then sine 1 V 0.1 Hz for 40 s")
    SignalFacts(drive='sine 1 V 0.1 Hz', words=('sine',), amplitude=1.0, frequency=0.1)
    >>> signal_facts("step 0.5 V for 10 s then step -1 V").amplitude
    -1.0
    >>> signal_facts("whatever the generator did").drive
    'whatever the generator did'
    """
    from ipmclab.signals import parse

    if not text:
        return SignalFacts()
    if _FILE_SIGNAL.search(text):
        return SignalFacts(text, ("file",))
    try:
        signal: Any = parse(text)
    except InputError:  # a foreign record may say anything
        return SignalFacts(text)
    every = getattr(signal, "signals", (signal,))
    parts = [part for part in every if _size(part) != 0.0] or list(every[-1:])
    sizes = [float(size) for part in parts if (size := _size(part)) is not None]
    frequencies = {float(part.frequency) for part in parts if hasattr(part, "frequency")}
    return SignalFacts(
        drive=str(parts[0]) if len(parts) == 1 else text,
        words=tuple(dict.fromkeys(part.word for part in parts)),
        amplitude=max(sizes, key=abs, default=None),
        frequency=frequencies.pop() if len(frequencies) == 1 else None,
    )


def _size(signal: Any) -> float | None:
    values = getattr(signal, "values", None)
    return max(values.tolist(), key=abs) if values is not None else getattr(signal, "amplitude", None)


def finding_columns(findings: Iterable[Finding]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What findings add to the row of a run, and their own rows."""
    found = list(findings)
    columns: dict[str, Any] = {"finding_codes": _joined(dict.fromkeys(finding.code for finding in found)) or " "}
    rows = []
    for finding in found:
        numbers = storable(dict(finding.values))
        if finding.code == "fingerprint":
            columns |= {name: _number(numbers.get(name)) for name in ("series_resistance", "capacitance")}
        rows.append(
            {
                "code": _text(finding.code),
                "severity": finding.severity,
                "channel": finding.channel,
                "message": storable(finding.message),
                "numbers": numbers,
            }
        )
    return columns, rows


def storable(value: Any) -> Any:
    """A JSON value as every database takes it: no NUL or lone surrogate in a text, no number that is not finite."""
    if isinstance(value, str):
        return value.replace("\0", "\N{REPLACEMENT CHARACTER}").encode("utf-8", "replace").decode()
    if isinstance(value, Mapping):
        return {storable(str(key)): storable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [storable(item) for item in value]
    if hasattr(value, "tolist"):  # a NumPy scalar
        return storable(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def problem_text(error: Exception) -> tuple[str, str]:
    """The code of an error and its sentence, without the place, which the catalogue has beside it."""
    if isinstance(error, IpmclabError):
        return error.code, storable(f"{error.message}; {error.repair}" if error.repair else error.message)
    return "fault", storable(f"{type(error).__name__}: {error}")


def _text(value: object) -> str | None:
    return storable(value)[:_LONGEST] if isinstance(value, str) and value else None


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and abs(value) < 1e300 else None


def _count(value: object) -> int | None:
    return value if isinstance(value, int) and abs(value) < 2**63 else None


def _joined(words: Iterable[str]) -> str:
    text = " ".join(words)
    return f" {text} " if text else ""
