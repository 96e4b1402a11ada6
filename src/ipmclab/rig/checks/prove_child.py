"""The program that ``rig prove`` starts, and then kills or lets hang: it drives the dummy load as the recorder would.

``python -m ipmclab.rig.checks.prove_child RIG MODE VOLTS`` prints ``on`` once the output gives the
voltage. MODE is ``alone`` (no guardian), ``guarded``, or ``hang`` (guarded, and silent from then on). It ends when its
stdin does.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from typing import BinaryIO, Final

from ipmclab.errors import IpmclabError
from ipmclab.platform import own_stdin

RATE: Final = 50.0
LONGEST: Final = 60.0  # s: long enough to be killed, short enough to end by itself


def _end_with_parent(stdin: BinaryIO) -> None:
    """End at once when whoever started this program is gone."""
    stdin.read()
    os._exit(3)


def _report(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main(rig_name: str, mode: str, volts: float) -> int:
    """Drive the dummy load until killed.

    Returns
    -------
    int
        0 when nobody killed it, 1 when the bench failed.
    """
    from ipmclab.rig.files.rig_file import load_rig
    from ipmclab.rig.ni import NiBench
    from ipmclab.rig.safety.guardian import Guardian
    from ipmclab.signals import Step

    threading.Thread(target=_end_with_parent, args=(own_stdin(),), daemon=True).start()
    rig = load_rig(rig_name)
    bench = NiBench(rig)
    guardian = None
    try:
        bench.open(["voltage", "current"], RATE)
        if mode != "alone":
            guardian = Guardian(rig)
            guardian.arm()
        on = False
        for block in bench.apply(Step(volts), round(LONGEST * RATE)):
            if guardian is not None:
                guardian.beat()
            if not on and abs(block.output[-1] - volts) < 1e-9:
                on = True
                _report("on")
                if mode == "hang":
                    time.sleep(LONGEST)
    except IpmclabError as error:
        _report(f"failed {error.code}")
        return 1
    finally:
        bench.close()
        if guardian is not None:
            guardian.disarm()
            guardian.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], float(sys.argv[3])))
