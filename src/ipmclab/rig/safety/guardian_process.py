"""The guardian's process: it brings the output to 0 V when the recorder no longer can.

``python -m ipmclab.rig.safety.guardian_process TARGET LOG STATUS`` is started by the recorder and connected to it by a
pipe. It connects to the hardware first; then, while it is armed, it waits for beats. When the pipe breaks (the recorder
was killed, or crashed) or is silent for half a second (it hangs), it resets the output through its own connection,
reads it back, and tries until 0 V is read. A reset that met no error is not 0 V: what could not be read is reported as
that.
Nothing that ends the recorder ends the guardian: it is in no group and at no console of the recorder's.
"""

from __future__ import annotations

import json
import math
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any, Final, Literal

from ipmclab.errors import IpmclabError
from ipmclab.platform import go_first, own_stdin, replace_file
from ipmclab.rig.safety.guarded_output import Connection, Target, connect
from ipmclab.rig.safety.readback import TOLERANCE
from ipmclab.rig.safety.session_end import SLEEP, on_session_end

ATTEMPT_TIME: Final = 1.5
"""A reset that takes longer [s] has failed: the next one goes through a new connection."""

GIVE_UP: Final = 600.0
"""How long [s] it continues trying."""

LOUD: Final = 3.0
"""After so long [s] without success it says so, loudly; what was reset and cannot be read is given up then."""

_PAUSE: Final = 0.1  # s between two attempts
_ALIVE: Final = 0.5  # s between two signs of life while armed
_GRACE: Final = 0.03  # s for the thread that reads, before silence is believed
_TICK: Final = 0.125  # s; by how late it wakes from so short a sleep it knows that it was held up itself
_LATE: Final = 0.1  # s
_GRACE_LATE: Final = 0.25  # s; what held this process up held the recorder up as well, which then has rows to read
_LEAVE: Final = 1.5  # s that the system is kept waiting before it sleeps or ends the session


@dataclass(frozen=True)
class _Attempt:
    """What came of a reset or of a reading: why it failed, whether it always will, and what was read [V]."""

    failure: str | None = None
    is_final: bool = False
    volts: float = math.nan


class Watch:
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
        self._silence = math.inf
        self._armed = self._has_acted = False
        self._deadline = math.inf
        self._next_sign = -math.inf
        self._late = 0.0

    def hear(self, word: str | None) -> None:
        """A word of the recorder; None when it is gone. From any thread, and from signal handlers."""
        self._words.put(word)

    def run(self) -> int:
        """Watch until the recorder lets go, or is gone."""
        self.say("ready")
        while True:
            patience = self._patience() if self._armed else None
            began = time.monotonic()
            try:
                word = self._words.get(timeout=patience)
            except queue.Empty:
                self._late = max(self._late, time.monotonic() - began - (patience or 0.0))
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
                        self._status.unlink()
                return 0
            self._obey(word)

    def _patience(self) -> float:
        """How long to wait for the next word [s]."""
        return min(_TICK, max(0.0, min(self._deadline, self._next_sign) - time.monotonic()))

    def _look_again(self) -> None:
        """Act on silence, unless a word comes that this process or the recorder, held up, had no time for."""
        try:
            word = self._words.get(timeout=_GRACE if self._late < _LATE else _GRACE_LATE)
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
        elif what == "ask":
            self.say(f"heard {value}")
            return  # no beat: who asks why a run failed is not to be waited for any longer
        elif what == "sleep" and self._armed:
            self._act(SLEEP)
        self._deadline = time.monotonic() + self._silence
        self._late = 0.0
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
        begun, is_reported = time.monotonic(), False
        while True:
            reset = self._attempt("reset")
            reading = self._attempt("read") if reset.failure is None else reset
            lasted = time.monotonic() - begun
            is_long = lasted > LOUD
            if reset.failure is None and reading.failure is None and abs(reading.volts) <= TOLERANCE:
                self.log(f"the output {self._target.place} is at 0 V, {lasted:.3f} s after that")
                self.note("zero", why)
                self.say("zero")
                return True
            failure = reading.failure or f"it was reset, but {reading.volts:.3g} V are still read"
            if reset.failure is None and reading.failure is not None and (reading.is_final or is_long):
                self._leave_unread(failure)
                return False
            self.log(f"it failed: {failure}")
            if is_long and not is_reported:
                is_reported = True
                self.note("failed", f"{self._target.place}: {failure}")
                self.shout(f"the output {self._target.place} could NOT be brought to 0 V so far: {failure}")
                self.say(f"failed the output could not be brought to 0 V: {failure}")
            if lasted > GIVE_UP:
                self.shout(f"the output {self._target.place} could NOT be brought to 0 V: {failure}")
                return False
            time.sleep(10.0 * _PAUSE if is_long else _PAUSE)

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


def main(arguments: list[str]) -> int:
    """The guardian process.

    Parameters
    ----------
    arguments : list of str
        The target as JSON; the path of the log, and that of the status file, each empty where there is to be none.
    """
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    go_first()  # before its threads begin
    target_text, *files = arguments
    target = Target.from_json(target_text)
    log, status = (Path(file) if file else None for file in files)
    try:
        connection = connect(target)
    except IpmclabError as error:
        with suppress(OSError):
            sys.stdout.write(f"failed {error}\n")
            sys.stdout.flush()
        return 1
    watch = Watch(target, log, sys.stdout, connection, status)
    signal.signal(signal.SIGTERM, _then(watch.hear))
    threading.Thread(target=_read, args=(own_stdin(), watch.hear), daemon=True).start()
    over = threading.Event()

    def leave(why: str) -> None:
        watch.hear("sleep" if why == SLEEP else None)
        over.wait(_LEAVE)

    with on_session_end(leave, last=True):
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

    os._exit(main(sys.argv[1:]))  # a reset that hangs in its thread must not hold the process
