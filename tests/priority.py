"""How nice the system lets a process be that asks to go before others."""

from __future__ import annotations

import subprocess
import sys


def granted() -> int:
    """The niceness of a process that asked: another one on a machine of an administrator than on a user's."""
    ask = "import os; from ipmclab.platform import go_first; go_first(); print(os.nice(0))"
    return int(subprocess.run([sys.executable, "-c", ask], capture_output=True, check=True).stdout)
