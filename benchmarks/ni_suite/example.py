"""One of NI's example programs on the stand-in: ``python -m benchmarks.ni_suite.example PROGRAM``.

The program is run as it is. Every ``Task`` gets the options of the stand-in, ``System.local()`` is its system, the
trigger input gets an edge twice a second, and who is asked for Enter gives it after some seconds, or interrupts. The
last line of the output is a line of JSON: how it ended, what was refused, and which outputs moved.
"""

from __future__ import annotations

import builtins
import functools
import json
import os
import runpy
import signal
import sys
import threading
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import grpc
import nidaqmx
import nidaqmx.system

from benchmarks.ni_suite import evidence
from benchmarks.ni_suite.disguise import chassis_for
from virtual_cdaq.server import Server

ENTER, INTERRUPT = 2.5, 5.0  # s until somebody who watches the program ends it


def _interrupt() -> None:
    time.sleep(INTERRUPT)
    os.kill(os.getpid(), signal.SIGINT)  # a signal, for the program may be waiting for an answer


def _enter(*_: object) -> str:
    time.sleep(ENTER)
    return ""


def main(program: str) -> None:
    """Run it, and tell how it ended."""
    chassis = chassis_for(Path(program).read_text(encoding="utf-8-sig"))
    moved: set[str] = set()
    chassis.on_level = lambda levels: moved.update(name for name, level in levels.items() if level != 0.0)
    server = Server(chassis)
    channel = grpc.insecure_channel(server.start())
    options = nidaqmx.GrpcSessionOptions(channel, "")
    nidaqmx.Task.__init__ = functools.partialmethod(nidaqmx.Task.__init__, grpc_options=options)  # type: ignore[assignment]
    nidaqmx.system.System.local = staticmethod(lambda: nidaqmx.system.System.remote(options))
    builtins.input = _enter
    evidence.listen()
    over = threading.Event()

    def pulse() -> None:
        while not over.wait(0.5):
            with chassis.lock:
                chassis.pulse("PFI0")

    threading.Thread(target=pulse, daemon=True).start()
    threading.Thread(target=_interrupt, daemon=True).start()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a program in the background would take no notice
    warnings.simplefilter("ignore")
    end: dict[str, Any] = {"end": "passed", "text": ""}
    try:
        runpy.run_path(program, run_name="__main__")
    except KeyboardInterrupt:
        end["text"] = "interrupted"
    except SystemExit as error:
        end = {"end": "passed" if not error.code else "failed", "text": str(error.code)}
    except BaseException:
        end = {"end": "failed", "text": traceback.format_exc()}
    over.set()
    print("\n" + json.dumps({**end, "refused": evidence.refused, "moved": sorted(moved)}), flush=True)
    os._exit(0)  # what the program left behind, such as a stream of events, would be waited for


if __name__ == "__main__":
    main(sys.argv[1])
