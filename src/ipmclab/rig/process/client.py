"""A client of a recorder that runs in a process of its own: the terminal, the page, a script."""

from __future__ import annotations

import json
import socket
import subprocess
import threading
from multiprocessing import AuthenticationError
from multiprocessing.connection import Connection, answer_challenge, deliver_challenge
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import as_typed, detached, python_child
from ipmclab.rig.process.aftermath import PATIENCE, fate
from ipmclab.rig.process.hub import SUFFIX, hang_up
from ipmclab.rig.process.messages import Message, decode, encode

LOGIN: Final = 10.0
"""How long [s] a recorder may take to let a client in: one that lives does it at once."""

KNOCK: Final = 4.0
"""How long [s] to wait for a closed port to refuse: Windows tries three times, which takes it 2 s."""

PROMPT: Final = 1.0
"""How long [s] it may take to take in a request; then we hang up, for half a one was sent."""


class Recorder:
    """A recorder in its own process, as one of its clients sees it.

    Parameters
    ----------
    file : Path
        What the recorder left in the laboratory folder: its address and its token.

    Raises
    ------
    IpmclabError
        Nothing listens there any more, the token is not the right one, or the recorder hangs.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        try:
            document = json.loads(file.read_text(encoding="utf-8"))
            host, port = str(document["address"]).rsplit(":", 1)
            token = bytes.fromhex(document["token"])
            self.process = int(document["process"])
            self.about: dict[str, Any] = document
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise IpmclabError(
                "the address of the recorder cannot be read",
                code="no-recorder",
                where=str(file),
                repair="it may have ended just now; ipmclab runs lists what it left",
            ) from error
        try:
            self._connection = _log_in((host, int(port)), token)
        except TimeoutError as error:
            folder = as_typed(file.parent.parent)
            raise IpmclabError(
                f"the recorder does not answer: its process {self.process} hangs; {fate(file)}",
                code="recorder-hangs",
                where=str(file),
                repair=f"end that process, then ipmclab recover {folder} keeps what it had recorded",
            ) from error
        except (OSError, EOFError, AuthenticationError, AssertionError) as error:
            raise IpmclabError(
                "no recorder answers: its process was ended",
                code="no-recorder",
                where=str(file),
                repair=f"ipmclab recover {as_typed(file.parent.parent)} keeps what it had recorded",
            ) from error

    def request(self, kind: str, **values: Any) -> bool:
        """Ask for something; False where it is not taken in: ``next`` shows whether the recorder is gone."""
        timer = threading.Timer(PROMPT, hang_up, [self._connection])
        timer.daemon = True
        timer.start()
        try:
            self._connection.send_bytes(encode(Message(kind, values)))
        except OSError:
            return False
        finally:
            _end(timer)
        return True

    def next(self, within: float | None = None, *, patience: float = PATIENCE) -> Message | None:
        """The next message, or None when none came within so many seconds.

        Parameters
        ----------
        within : float [s], optional
        patience : float [s]
            How long a guardian that still acts is waited for when the recorder is gone.

        Raises
        ------
        IpmclabError
            The recorder is gone without a last word.
        """
        try:
            if within is not None and not self._connection.poll(within):
                return None
            return decode(self._connection.recv_bytes())
        except (OSError, EOFError) as error:
            raise IpmclabError(
                f"the recorder's process is gone; {fate(self.file, patience)}",
                code="recorder-lost",
                where=str(self.file.parent.parent),
                repair=f"ipmclab recover {as_typed(self.file.parent.parent)} keeps what it had recorded",
            ) from error

    def close(self) -> None:
        """Leave; the recorder continues."""
        self._connection.close()


def _log_in(address: tuple[str, int], token: bytes) -> Connection:
    """A connection to a recorder that knows the token, and whose token we know.

    Raises
    ------
    TimeoutError
        It took longer than ``LOGIN``.
    """
    connection = Connection(_opened(address))
    late = threading.Event()

    def give_up() -> None:
        late.set()
        hang_up(connection)

    timer = threading.Timer(LOGIN, give_up)
    timer.daemon = True
    timer.start()
    try:
        answer_challenge(connection, token)
        deliver_challenge(connection, token)
    except (OSError, EOFError, AuthenticationError, AssertionError) as error:  # the last: what came was no challenge
        _end(timer)
        connection.close()
        if late.is_set():
            raise TimeoutError from error
        raise
    _end(timer)
    return connection


def _end(timer: threading.Timer) -> None:
    """End it for certain: it must not hang up what has the handle of its connection by then."""
    timer.cancel()
    timer.join()


def _opened(address: tuple[str, int]) -> int:
    """The handle of a socket that waits for ever from now on."""
    opened = socket.create_connection(address, timeout=LOGIN)
    opened.settimeout(None)
    return opened.detach()


def recorders(folder: Path) -> list[Path]:
    """The files of the recorders that may be running in a laboratory folder, the newest last."""
    found = (folder / "recording").glob(f"*{SUFFIX}")
    return sorted(found, key=_made)


def _made(file: Path) -> float:
    """When a file was made [s since 1970]; 0 where its recorder has just ended."""
    try:
        return file.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def forget_dead_recorders(folder: Path) -> None:
    """Remove what recorders that were killed left to be found by."""
    for file in recorders(folder):
        try:
            host, port = str(json.loads(file.read_text(encoding="utf-8"))["address"]).rsplit(":", 1)
            # No more than a knock: one that hangs would not answer, and must not hold up another rig's recorder.
            socket.create_connection((host, int(port)), timeout=KNOCK).close()
        except (OSError, ValueError, KeyError, TypeError) as error:
            if not isinstance(error, ConnectionRefusedError):
                continue  # it hangs, or is another user's: that is no death
            file.unlink(missing_ok=True)
            log = file.with_suffix(".log")
            if log.is_file() and not log.stat().st_size:
                log.unlink(missing_ok=True)


def others(recorder: Recorder) -> list[tuple[Path, str]]:
    """The files of the other recorders in its laboratory folder, and what each records, in words."""
    folder = recorder.file.parent.parent
    forget_dead_recorders(folder)
    found = []
    for file in recorders(folder):
        if file != recorder.file:
            try:
                about = json.loads(file.read_text(encoding="utf-8"))
                found.append((file, f"sample {about.get('sample', '?')} on {about.get('rig', '?')}"))
            except (OSError, ValueError, AttributeError):
                continue  # it has just ended
    return found


def attach(folder: Path) -> Recorder:
    """Join the recorder that runs in a laboratory folder, the newest where there are several.

    Parameters
    ----------
    folder : Path
        Or the file of one recorder in its ``recording``.

    Raises
    ------
    InputError
        None is running there.
    IpmclabError
        One is there, and hangs.
    """
    if folder.is_file():
        return Recorder(folder)
    hangs: IpmclabError | None = None
    for file in reversed(recorders(folder)):
        try:
            return Recorder(file)
        except IpmclabError as error:
            if isinstance(error.__cause__, ConnectionRefusedError):
                file.unlink(missing_ok=True)  # left by a process that was killed
            elif isinstance(error.__cause__, TimeoutError):
                hangs = error
    if hangs is not None:
        raise hangs
    raise InputError(
        "no recorder is running here",
        code="no-recorder",
        where=str(folder),
        repair=f"ipmclab recover {as_typed(folder)} keeps what an interrupted one had recorded",
    )


def launch(module: str, job: dict[str, Any]) -> Recorder:
    """Start a recorder in a process of its own and join it.

    Parameters
    ----------
    module : str
        What ``python -m`` runs: it reads the job as JSON from its standard input, and writes the name of the file
        with its address on its standard output, or ``{"error": ...}``.
    job : mapping

    Raises
    ------
    InputError, IpmclabError
        What the recorder refuses, or that it did not come up.
    """
    process = subprocess.Popen(python_child(module), stdin=subprocess.PIPE, stdout=subprocess.PIPE, **detached())
    assert process.stdin is not None
    assert process.stdout is not None
    with process.stdin:
        process.stdin.write(json.dumps(job).encode())
    with process.stdout:
        line = process.stdout.readline().decode(errors="replace")
    try:
        document = json.loads(line)
    except ValueError:
        process.wait()
        raise IpmclabError(
            f"the recorder ended at its start with status {process.returncode}",
            code="no-recorder",
            where="record",
            repair="report what it printed",
        ) from None
    if "error" in document:
        process.wait()
        raise error_from(document["error"])
    # It may outlive this process; where this one lives longer, somebody has to take note of its end.
    threading.Thread(target=process.wait, name="recorder process", daemon=True).start()
    return Recorder(Path(document["file"]))


def error_from(document: dict[str, Any]) -> IpmclabError:
    """The error that a document of ``IpmclabError.as_dict`` describes, with its exit status."""
    kind = InputError if document.get("exit_status") == InputError.exit_status else IpmclabError
    return kind(document["message"], code=document["code"], where=document["where"], repair=document["repair"])
