"""The guardian as the recorder holds it: its process is started and armed, gets beats, and is heard."""

from __future__ import annotations

import subprocess
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Final, Literal

from ipmclab.errors import IpmclabError
from ipmclab.platform import detached, python_child
from ipmclab.rig.channels import Rig
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.own_clock import Lateness

SILENCE: Final = 0.5
"""The guardian acts when the recorder has been silent for so long [s]."""

_LOST: Final = 3.0  # s without a sign of life: the guardian hangs itself
_START: Final = 30.0  # s to start Python and to connect
_ANSWER: Final = 2.0  # s for an answer to a word
_WORD: Final = 0.3  # s for one while rows are due (the next beat asks again), or the output is to be brought to 0 V
_OFTEN: Final = 0.2  # s; blocks that are further apart need beats between them

Outcome = Literal["", "zero", "unread", "failed"]

_DEEDS: Final[dict[Outcome, str]] = {
    "": "is bringing the output to 0 V, and has not read that back yet",
    "zero": "brought the output to 0 V",
    "unread": "reset the output, but could not read back that it is at 0 V",
    "failed": "could NOT bring the output to 0 V so far",
}


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
        command = python_child("ipmclab.rig.safety.guardian_process", *arguments)
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, **detached()
        )
        self._told = threading.Condition()
        self._state: Literal["starting", "ready", "armed", "acted", "gone"] = "starting"
        self._text = ""
        self._outcome: Outcome = ""
        self._asked = self._answered = 0
        self._sign = self._progress = self._held_until = time.monotonic()
        self._used = time.thread_time()
        self._lateness = Lateness(_OFTEN / 2.0)
        self._disarmed = threading.Event()
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
        self._progress, self._used = time.monotonic(), time.thread_time()
        self._lateness.forget(self._progress)
        longest = 3.0 * block_time if block_time > _OFTEN else 0.0
        self._send(f"arm {self._silence}")
        self._disarmed.set()  # by a run that left it armed: the thread that beat for it ends
        self._disarmed = threading.Event()
        threading.Thread(target=self._beat_on, args=(self._disarmed, longest), name="heartbeat", daemon=True).start()
        with self._told:
            self._told.wait_for(lambda: self._state in ("armed", "gone"), _ANSWER)
            if self._state != "armed":
                raise self._lost(self._text or "it does not answer")

    def beat(self) -> None:
        """All is well. It waits only for a guardian that may have acted: after half of the silence that it acts on.

        Raises
        ------
        IpmclabError
            The guardian is gone, or hangs, or has brought the output to 0 V.
        """
        now, used = time.monotonic(), time.thread_time()
        silent, worked = now - self._progress, used - self._used
        late = self._lateness.at(now)
        if silent <= self._silence / 2.0 or self._hear(_WORD):
            self._progress, self._used = now, used
            self._lateness.forget(now)
        self._held_until = now
        if self._state == "acted":
            raise self._after_silence(silent, waited=max(worked, late) < self._silence / 2.0)
        if self._state != "armed":
            raise self._lost(self._text or "it is not armed")
        if now - self._sign > _LOST:
            raise self._lost(f"it has given no sign of life for {now - self._sign:.1f} s")
        self._send("beat")

    def explain(self, failure: IpmclabError) -> None:
        """Put the cause in the place of a failure that only follows from it.

        A program that was stopped, or had no processor, finds all its deadlines passed when it continues: the server
        that seems not to answer has answered long ago. The clock tells that, and the guardian what it did meanwhile.

        Parameters
        ----------
        failure : IpmclabError
            It is changed where it is but a consequence.
        """
        now = time.monotonic()
        silent = now - self._progress
        held_up = self._lateness.at(now) > max(self._silence, silent) / 2.0
        if not held_up and failure.code != "bench-lost":
            return  # at once: the output is to be brought to 0 V
        with suppress(IpmclabError):  # one that is gone has said why
            self._hear(_WORD)
        if self._state == "acted":
            cause = self._after_silence(silent, waited=not held_up)
            failure.message, failure.code, failure.where = cause.message, cause.code, cause.where
            failure.repair = cause.repair

    def _hear(self, patience: float) -> bool:
        """Whether an armed guardian answers, so that what it said before has been read: that it acted, above all."""
        with self._told:
            if self._state != "armed":
                return True
            self._asked += 1
            self._send(f"ask {self._asked}")
            return self._told.wait_for(lambda: self._answered == self._asked or self._state != "armed", patience)

    def hold(self, seconds: float) -> None:
        """The next beat may take so long [s]: tasks are started or stopped. A thread beats until then.

        A process that is stopped or killed is noticed all the same.
        """
        self._held_until = time.monotonic() + seconds

    def disarm(self) -> None:
        """The output is at 0 V: silence is allowed again."""
        self._lateness.end()
        self._disarmed.set()
        if self._state in ("starting", "ready", "gone"):
            return
        with suppress(IpmclabError):
            self._send("disarm")
            with self._told:
                self._told.wait_for(lambda: self._state in ("ready", "gone"), _ANSWER)

    def close(self) -> None:
        """Let it go. One that is armed brings the output to 0 V first. May be called twice."""
        self._disarmed.set()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(2.0 * _LOST)
        except subprocess.TimeoutExpired:
            # It still tries to bring the output to 0 V. Somebody has to take note of its end, where it ends first.
            threading.Thread(target=self._await_its_end, name="guardian's end", daemon=True).start()
            return
        self._listener.join(_ANSWER)
        self._process.stdout.close()

    def _await_its_end(self) -> None:
        assert self._process.stdout is not None
        self._process.wait()
        self._listener.join()
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

    def _beat_on(self, ended: threading.Event, longest: float) -> None:
        """Beat where the recorder is known to have other things to do, but not for ever."""
        self._lateness.begin()
        while not ended.wait(_OFTEN / 2.0):
            self._lateness.woke()
            now = time.monotonic()
            if self._state == "armed" and (now < self._held_until or now - self._progress < longest):
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
                elif word == "heard":
                    self._answered = int(text)
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
        busy = "give this computer less to do during the recording, and record again"
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
