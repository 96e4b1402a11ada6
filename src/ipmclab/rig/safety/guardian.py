"""The guardian: a process of its own that brings the output to 0 V when the recorder no longer can.

``python -m ipmclab.rig.safety.guardian TARGET`` is started by the recorder and connected to it by a pipe. It
connects to the hardware first; then, while it is armed, it waits for beats. When the pipe breaks (the recorder was
killed, or crashed) or is silent for half a second (it hangs), it resets the output through its own connection, reads
it back, and tries until 0 V is read. A reset that met no error is not 0 V: what could not be read is told as that.
Nothing that ends the recorder ends the guardian: it is in no group and at no console of
the recorder's.
"""

from __future__ import annotations

import json
import math
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any, Final, Literal, Protocol, Self

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import detached, own_stdin, python_child, replace_file
from ipmclab.rig.channels import Channel, Converter, Output, Rig
from ipmclab.rig.safety.readback import TOLERANCE, channels_at_output, resistance_between
from ipmclab.rig.safety.session_end import SLEEP, told_of_the_end

SILENCE: Final = 0.5
"""The guardian acts when the recorder has been silent for so long [s]."""

ATTEMPT_TIME: Final = 1.5
"""A reset that takes longer [s] has failed: the next one goes through a new connection."""

GIVE_UP: Final = 600.0
"""How long [s] it goes on trying."""

LOUD: Final = 3.0
"""After so long [s] without success it says so, loudly; what was reset and cannot be read is given up then."""

_PAUSE: Final = 0.1  # s between two attempts
_ALIVE: Final = 0.5  # s between two signs of life while armed
_GRACE: Final = 0.03  # s for the thread that reads, before silence is believed
_LOST: Final = 3.0  # s without one: the guardian hangs itself
_LEAVE: Final = 1.5  # s that the system is kept waiting before it sleeps or ends the session
_START: Final = 30.0  # s to start Python and to connect
_ANSWER: Final = 2.0  # s for an answer to a word
_WORD: Final = 0.3  # s for the guardian's word to be read after this program was stopped
_OFTEN: Final = 0.2  # s; blocks that are further apart need beats between them


Outcome = Literal["", "zero", "unread", "failed"]

_DEEDS: Final[dict[Outcome, str]] = {
    "": "is bringing the output to 0 V, and has not read that back yet",
    "zero": "brought the output to 0 V",
    "unread": "reset the output, but could not read back that it is at 0 V",
    "failed": "could NOT bring the output to 0 V so far",
}


@dataclass(frozen=True)
class Target:
    """What the guardian brings to 0 V.

    Parameters
    ----------
    kind : "ni" or "file"
        A module of a chassis; or, to try the guardian without hardware, a file that gets a line for each reset.
    place : str
        The physical output, such as ``"cDAQ1Mod2/ao0"``; the path of the file.
    address : str, optional
        ``host:port`` of a gRPC server.
    channels : tuple of Channel
        Which together tell what the output gives; none where nothing does.
    between : float [ohm]
        The resistance between the output and the place where the voltage is read.
    """

    kind: Literal["ni", "file"]
    place: str
    address: str | None = None
    channels: tuple[Channel, ...] = ()
    between: float = 0.0

    @classmethod
    def of(cls, rig: Rig) -> Target:
        """The output of a rig."""
        channels = tuple(rig[name] for name in channels_at_output(rig))
        return cls("ni", rig.output.physical, rig.address, channels, resistance_between(rig))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """What ``to_json`` gave."""
        table = json.loads(text)
        channels = (Channel(**{**one, "converter": Converter(**one["converter"])}) for one in table["channels"])
        return cls(**{**table, "channels": tuple(channels)})

    def to_json(self) -> str:
        """For the command line of the guardian."""
        return json.dumps(asdict(self))


class Connection(Protocol):
    """How the output is reached."""

    def reset(self) -> None:
        """Bring it to 0 V."""

    def read(self) -> float:
        """What it gives [V]. Raises IpmclabError, of code ``"output-unread"`` where that can never be told."""

    def close(self) -> None:
        """Let go."""


class Guardian:
    """The guardian process, as the recorder holds it.

    Parameters
    ----------
    target : Rig or Target
    log : path, optional
        A file that gets a line, with the time, for everything that happens.
    status : path, optional
        A file that says what it has come to, for who is there when the recorder is not: ``armed``, ``disarmed``,
        ``zero`` (the output was read back at 0 V), ``unread`` (it was reset, and could not be read back) or
        ``failed``. It goes when the guardian ends unarmed.
    silence : float [s]

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     guardian = Guardian(Target("file", f"{folder}/output.txt"))
    ...     guardian.arm()
    ...     guardian.beat()
    ...     guardian.disarm()
    ...     guardian.close()
    ...     Path(folder, "output.txt").exists()
    False
    """

    def __init__(
        self,
        target: Rig | Target,
        *,
        log: str | Path | None = None,
        status: str | Path | None = None,
        silence: float = SILENCE,
    ) -> None:
        self._target = Target.of(target) if isinstance(target, Rig) else target
        self.status = None if status is None else Path(status)
        self._silence = silence
        arguments = (self._target.to_json(), str(log or ""), str(status or ""))
        command = python_child("ipmclab.rig.safety.guardian", *arguments)
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, **detached()
        )
        self._told = threading.Condition()
        self._state: Literal["starting", "ready", "armed", "acted", "gone"] = "starting"
        self._text = ""
        self._outcome: Outcome = ""
        self._sign = time.monotonic()
        self._progress = 0.0
        self._used = 0.0
        self._late = 0.0
        self._due = math.inf
        self._longest = 0.0
        self._held_until = 0.0
        self._beating: threading.Event | None = None
        self._listener = threading.Thread(target=self._listen, name="guardian", daemon=True)
        self._listener.start()

    @property
    def acted(self) -> str:
        """Why it stepped in since it was armed; empty when it did not."""
        return self._text if self._state == "acted" else ""

    @property
    def outcome(self) -> Outcome:
        """What became of the output when it stepped in; empty while it is still trying."""
        return self._outcome

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def wait(self, timeout: float = _START) -> None:
        """Wait until it is connected.

        Raises
        ------
        IpmclabError
            It could not connect to what it has to guard.
        """
        with self._told:
            self._told.wait_for(lambda: self._state != "starting", timeout)
            if self._state in ("starting", "gone"):
                raise self._lost(self._text or f"it was not ready within {timeout:g} s")

    def arm(self, block_time: float = 0.0) -> None:
        """From now on it acts when there are no beats.

        Parameters
        ----------
        block_time : float [s]
            Between two beats. Where that is more than 0.2 s, a thread beats in between for three of these times.

        Raises
        ------
        IpmclabError
            It is not there: nothing may be given out.
        """
        self.wait()
        self._progress, self._used, self._late = time.monotonic(), time.thread_time(), 0.0
        self._longest = 3.0 * block_time if block_time > _OFTEN else 0.0
        self._send(f"arm {self._silence}")
        self._beating = threading.Event()
        threading.Thread(target=self._beat_on, args=(self._beating,), name="heartbeat", daemon=True).start()
        with self._told:
            self._told.wait_for(lambda: self._state in ("armed", "gone"), _ANSWER)
            if self._state != "armed":
                raise self._lost(self._text or "it does not answer")

    def beat(self) -> None:
        """All is well. It never waits.

        Raises
        ------
        IpmclabError
            The guardian is gone, or hangs, or has brought the output to 0 V.
        """
        now, used = time.monotonic(), time.thread_time()
        silent, worked = now - self._progress, used - self._used
        self._hear_after(now)
        self._progress, self._used, late, self._late = now, used, self._late, 0.0
        self._held_until = 0.0
        if self._state == "acted":
            raise self._after_silence(silent, waited=max(worked, late) < self._silence / 2.0)
        if self._state != "armed":
            raise self._lost(self._text or "it is not armed")
        if now - self._sign > _LOST:
            raise self._lost(f"it has given no sign of life for {now - self._sign:.1f} s")
        self._send("beat")

    def explain(self, failure: IpmclabError) -> None:
        """Put the cause in the place of a failure that only follows from it.

        A program that was stopped, or had no processor, finds all its deadlines passed when it goes on: the server that
        seems not to answer has answered long ago. The clock tells that, and the guardian what it did meanwhile.

        Parameters
        ----------
        failure : IpmclabError
            It is changed where it is but a consequence.
        """
        now = time.monotonic()
        silent, held_up = now - self._progress, self._hear_after(now)
        if self._state == "acted" and (held_up or failure.code == "bench-lost"):
            cause = self._after_silence(silent, waited=not held_up)
            failure.message, failure.code, failure.where = cause.message, cause.code, cause.where
            failure.repair = cause.repair

    def _hear_after(self, now: float) -> bool:
        """Whether this program itself was held up until now; then what the guardian said meanwhile is heard first."""
        late = max(self._late, now - self._due)
        if late <= max(self._silence, now - self._progress) / 2.0:
            return False
        with self._told:
            self._told.wait_for(lambda: self._state in ("acted", "gone"), _WORD)
        return True

    def hold(self, seconds: float) -> None:
        """The next beat may take so long [s]: tasks are started or stopped. A thread beats until then.

        A process that is stopped or killed is noticed all the same.
        """
        self._held_until = time.monotonic() + seconds

    def disarm(self) -> None:
        """The output is at 0 V: silence is allowed again."""
        self._due = math.inf
        if self._beating is not None:
            self._beating.set()
            self._beating = None
        if self._state in ("starting", "ready", "gone"):
            return
        with suppress(IpmclabError):
            self._send("disarm")
            with self._told:
                self._told.wait_for(lambda: self._state in ("ready", "gone"), _ANSWER)

    def close(self) -> None:
        """Let it go. One that is armed brings the output to 0 V first. May be called twice."""
        if self._beating is not None:
            self._beating.set()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(2.0 * _LOST)
        except subprocess.TimeoutExpired:
            # It still tries to bring the output to 0 V. Somebody has to take note of its end, where it ends first.
            threading.Thread(target=self._process.wait, name="guardian's end", daemon=True).start()
            return
        self._listener.join(_ANSWER)
        self._process.stdout.close()

    def __enter__(self) -> Guardian:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, word: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{word}\n".encode())
        except (OSError, ValueError) as error:
            raise self._lost(str(error)) from error

    def _beat_on(self, ended: threading.Event) -> None:
        """Beat where the recorder is known to have other things to do, but not for ever."""
        self._due = time.monotonic() + _OFTEN / 2.0
        while not ended.wait(_OFTEN / 2.0):
            now = time.monotonic()
            self._late = max(self._late, now - self._due)
            self._due = now + _OFTEN / 2.0
            if self._state == "armed" and (now < self._held_until or now - self._progress < self._longest):
                with suppress(IpmclabError):
                    self._send("beat")

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in iter(self._process.stdout.readline, b""):
            word, _, text = line.decode(errors="replace").strip().partition(" ")
            with self._told:
                self._sign = time.monotonic()
                if word in ("ready", "armed", "disarmed", "acted"):
                    self._state = "ready" if word == "disarmed" else word
                    self._text, self._outcome = text, ""
                elif self._state == "acted" and word in ("zero", "unread", "failed"):
                    self._outcome = word
                elif word == "failed":
                    self._text = text
                self._told.notify_all()
        with self._told:
            self._state = "gone"
            self._text = self._text or "it has ended"
            self._told.notify_all()

    def _after_silence(self, silent: float, *, waited: bool) -> IpmclabError:
        """Why there was no beat: this program waited for its next rows, or was itself held up."""
        why = "the chassis gave no readings" if waited else "this computer held the recording up"
        wait = "see that the chassis, its cable and its server answer without a pause, then record again"
        busy = "give this computer less to do beside the recording, and record again"
        return IpmclabError(
            f"the guardian {_DEEDS[self._outcome]}: {self._text}; {why} for {silent:.1f} s",
            code="guardian-acted",
            where="guardian",
            repair=wait if waited else busy,
        )

    def _lost(self, text: str) -> IpmclabError:
        return IpmclabError(
            f"there is no guardian: {text}",
            code="guardian-lost",
            where="guardian",
            repair="without it nothing is given out: see its log and the connection to the chassis, then record again",
        )


class _FileConnection:
    """Writes a line for each reset: a guardian to try."""

    def __init__(self, path: str) -> None:
        self._path = path

    def reset(self) -> None:
        """Write the line."""
        try:
            with open(self._path, "a", encoding="utf-8") as stream:  # a path that may be a pipe
                stream.write(f"0 V at {time.time():.6f}\n")
        except OSError as error:
            raise IpmclabError(str(error), code="unwritable", where=self._path, repair="make its folder") from error

    def read(self) -> float:
        """What the last line says."""
        try:
            said = Path(self._path).read_text(encoding="utf-8").splitlines()[-1]
            return float(said.split(" V at ")[0])
        except (OSError, ValueError, IndexError) as error:
            raise IpmclabError(str(error), code="unreadable", where=self._path, repair="see what it is") from error

    def close(self) -> None:
        """Nothing is held."""


def connect(target: Target) -> Connection:
    """Reach what is to be guarded.

    Raises
    ------
    InputError
        An unknown kind of target.
    IpmclabError
        It cannot be reached.
    """
    if target.kind == "file":
        return _FileConnection(target.place)
    if target.kind == "ni":
        from ipmclab.rig.ni import Resetter

        output = Output(-10.0, 10.0, target.place)
        rig = Rig("guarded", target.channels, target.between, "electrodes", output, bench="ni", address=target.address)
        return Resetter(rig)
    raise InputError(
        f"unknown target {target.kind!r}", code="unknown-target", where="guardian", repair="use ni or file"
    )


@dataclass(frozen=True)
class _Attempt:
    """What came of a reset or of a reading: why it failed, whether it always will, and what was read [V]."""

    failure: str | None = None
    is_final: bool = False
    volts: float = math.nan


class _Watch:
    """What the guardian process does."""

    def __init__(
        self, target: Target, log: Path | None, tell: IO[str], connection: Connection, status: Path | None = None
    ) -> None:
        self._target = target
        self._log = log
        self._status = status
        self._tell = tell
        self._connection: Connection | None = connection
        self._words: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._silence = SILENCE
        self._armed = False
        self._has_acted = False
        self._deadline = 0.0
        self._next_sign = 0.0

    def hear(self, word: str | None) -> None:
        """A word of the recorder; None when it is gone. From any thread, and from signal handlers."""
        self._words.put(word)

    def run(self) -> int:
        """Watch until the recorder lets go, or is gone."""
        self.say("ready")
        while True:
            try:
                word = self._words.get(timeout=self._patience() if self._armed else None)
            except queue.Empty:
                self._sign()
                if time.monotonic() >= self._deadline:
                    self._look_again()
                continue
            if word is None:
                if self._armed and not self._act("the recorder is gone"):
                    return 1
                self.log("the recorder has ended")
                if self._status is not None and not self._has_acted:
                    with suppress(OSError):
                        self._status.unlink(missing_ok=True)
                return 0
            self._obey(word)

    def _patience(self) -> float:
        """How long to wait for the next word [s]."""
        return max(0.0, min(self._deadline, self._next_sign) - time.monotonic())

    def _look_again(self) -> None:
        """Act on silence, unless a word waits that this process, held up itself, had no time to read."""
        try:
            word = self._words.get(timeout=_GRACE)
        except queue.Empty:
            self._act(f"the recorder was silent for {self._silence:g} s")
        else:
            if word is None:
                self.hear(None)  # for the loop, which ends by it
            else:
                self._obey(word)

    def _obey(self, word: str) -> None:
        what, _, value = word.partition(" ")
        if what == "arm":
            self._silence, self._armed, self._has_acted = float(value), True, False
            self.log("armed")
            self.note("armed")
            self.say("armed")
        elif what == "disarm":
            self._armed = False
            self.log("disarmed")
            self.note("disarmed")
            self.say("disarmed")
        elif what == "sleep" and self._armed:
            self._act(SLEEP)
        self._deadline = time.monotonic() + self._silence
        if self._armed:
            self._sign()

    def _sign(self) -> None:
        """Show the recorder that this process lives, now and then."""
        now = time.monotonic()
        if now >= self._next_sign:
            self._next_sign = now + _ALIVE
            self.say("alive")

    def _act(self, why: str) -> bool:
        """Bring the output to 0 V, and say whether 0 V was read back."""
        self._armed, self._has_acted = False, True
        self.say(f"acted {why}")
        self.log(f"{why}: bringing the output {self._target.place} to 0 V")
        begun, told = time.monotonic(), False
        while True:
            reset = self._attempt("reset")
            seen = self._attempt("read") if reset.failure is None else reset
            lasted = time.monotonic() - begun
            if reset.failure is None and seen.failure is None and abs(seen.volts) <= TOLERANCE:
                self.log(f"the output {self._target.place} is at 0 V, {lasted:.3f} s after that")
                self.note("zero", why)
                self.say("zero")
                return True
            failure = seen.failure or f"it was reset, but {seen.volts:.3g} V are still read"
            if reset.failure is None and seen.failure is not None and (seen.is_final or lasted > LOUD):
                self._leave_unread(failure)
                return False
            self.log(f"it failed: {failure}")
            if lasted > LOUD and not told:
                told = True
                self.note("failed", f"{self._target.place}: {failure}")
                self.shout(f"the output {self._target.place} could NOT be brought to 0 V so far: {failure}")
                self.say(f"failed the output could not be brought to 0 V: {failure}")
            if lasted > GIVE_UP:
                self.shout(f"the output {self._target.place} could NOT be brought to 0 V: {failure}")
                return False
            time.sleep(_PAUSE if lasted < LOUD else 10.0 * _PAUSE)

    def _leave_unread(self, reason: str) -> None:
        """The output was reset, and what it gives cannot be read: that is all there is to say."""
        self.note("unread", f"{self._target.place}: {reason}")
        self.shout(f"the output {self._target.place} was reset, but could NOT be read back: {reason}")
        self.say(f"unread {reason}")

    def _attempt(self, what: Literal["reset", "read"]) -> _Attempt:
        """Reset or read once. One that hangs is left behind, with its connection."""
        done: queue.SimpleQueue[_Attempt] = queue.SimpleQueue()

        def attempt() -> None:
            try:
                if self._connection is None:
                    self._connection = connect(self._target)
                if what == "reset":
                    self._connection.reset()
                    done.put(_Attempt())
                else:
                    done.put(_Attempt(volts=self._connection.read()))
            except Exception as error:  # whatever it is, the next attempt is due
                is_final = getattr(error, "code", "") == "output-unread"
                done.put(_Attempt(f"{type(error).__name__}: {error}", is_final=is_final))

        threading.Thread(target=attempt, daemon=True).start()
        try:
            return done.get(timeout=ATTEMPT_TIME)
        except queue.Empty:
            self._connection = None
            return _Attempt(f"no answer within {ATTEMPT_TIME:g} s")

    def say(self, text: str) -> None:
        """To the recorder, which may be gone."""
        with suppress(OSError, ValueError):
            self._tell.write(f"{text}\n")
            self._tell.flush()

    def log(self, text: str) -> None:
        """Into the log, with the time."""
        if self._log is not None:
            with suppress(OSError), self._log.open("a", encoding="utf-8") as stream:
                stream.write(f"{datetime.now().astimezone().isoformat('T', 'milliseconds')} {text}\n")

    def note(self, state: str, text: str = "") -> None:
        """What this has come to, into its own file: whole at any moment."""
        if self._status is None:
            return
        with suppress(OSError):
            new = self._status.with_suffix(".new")
            new.write_text(json.dumps({"state": state, "text": text, "time": time.time()}) + "\n", encoding="utf-8")
            replace_file(new, self._status)

    def shout(self, text: str) -> None:
        """What somebody must do something about at once."""
        text = f"SWITCH THE AMPLIFIER OFF, or take the strip off its leads: {text}"
        self.log(text)
        with suppress(OSError, ValueError):
            sys.stderr.write(f"\aipmclab guardian: {text}\n")
            sys.stderr.flush()


def main(arguments: list[str]) -> int:
    """The guardian process.

    Parameters
    ----------
    arguments : list of str
        The target as JSON, and the log.
    """
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    target = Target.from_json(arguments[0])
    log, status = (Path(text) if text else None for text in (*arguments[1:3], "", "")[:2])
    try:
        connection = connect(target)
    except IpmclabError as error:
        with suppress(OSError):
            sys.stdout.write(f"failed {error}\n")
            sys.stdout.flush()
        return 1
    watch = _Watch(target, log, sys.stdout, connection, status)
    signal.signal(signal.SIGTERM, _then(watch.hear))
    threading.Thread(target=_read, args=(own_stdin(), watch.hear), daemon=True).start()
    over = threading.Event()

    def leave(why: str) -> None:
        watch.hear("sleep" if why == SLEEP else None)
        over.wait(_LEAVE)

    with told_of_the_end(leave, last=True):
        try:
            return watch.run()
        finally:
            over.set()


def _then(hear: Callable[[str | None], None]) -> Callable[[int, Any], None]:
    """Asked to end, an armed guardian does what it would do if the recorder were gone."""
    return lambda _number, _frame: hear(None)


def _read(stream: IO[bytes], hear: Callable[[str | None], None]) -> None:
    with suppress(OSError):
        for line in iter(stream.readline, b""):
            hear(line.decode(errors="replace").strip())
    hear(None)


if __name__ == "__main__":
    import os

    status = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(status)  # a reset that hangs in its thread must not hold the process
