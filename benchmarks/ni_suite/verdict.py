"""What the end of a program of NI's says of the stand-in: passed, not applicable and why, or failed.

Not applicable is what asks for hardware that is not there, or for something that the table of what is missing names
(docs/virtual_bench.md). It is told by what the client was refused, not by the name of the program. Whatever no rule
explains has failed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

PASSED, FAILED = "passed", "failed"
AS_EXPECTED = "fails on NI's own devices too (NI's mark xfail)"

RULES = (
    (r"Could not detect a persisted|Could not detect a global", "missing: saved tasks, channels and scales"),
    (r"Could not detect|requires two or more devices", "another device"),
    (r"call Create(DI|DO)Chan|(?s:(\bd[io]_|digital|_d[io]\.py).*IndexError)", "digital lines"),
    (r"call Create(CI|CO)\w+|(?s:(\bc[io]_|counter|_c[io]\.py).*IndexError)", "counters"),
    (r"TEDS", "sensors with TEDS"),
    (r"call CreateWatchdog", "watchdog timers"),
    (r"call \w*Anlg(Edge|Window)|Requested value: 10099", "missing: analog triggers"),
    (r"call CfgDigEdgeRefTrig|REF_TRIG", "missing: reference triggers"),
    (r"LOGGING_|call (ConfigureLogging|StartNewFile)", "missing: TDMS logging"),
    (
        r"-20(0485|0882)|persisted|global_channels?\b|global channel|NonexistentScale|PersistedScale",
        "missing: saved tasks, channels and scales",
    ),
    (r"call \w*(Cal|ExtCal\w*|SelfCal\w*)\b|_cal_|\bcal_", "missing: calibration of a module"),
    (r"DIG_FLTR", "filters of trigger terminals: the chassis has no such terminal"),
    (r"call \w+PowerUpStates", "power-up states of another device"),
    (r"call CreateAI\w+|-200431 ", "a measurement of another module"),
    (r"FIRST_SAMP_TIMESTAMP", "time stamps of a chassis on the network"),
    (r"assert 80000 == 100000|assert 400\.0 == 500", "the 100 MHz timebase of a PCIe-6363: the chassis has 80 MHz"),
    (r"Device Specified: ", "another device"),
    (r"Physical channel: (?!Dev1/a[io]\d)", "another device"),
    (r"Windows", "Windows"),
    (r"requires compatible encoding", "code pages of Windows"),
)


@dataclass(frozen=True)
class Verdict:
    """Of one program, or of one test with one set of parameters.

    Parameters
    ----------
    name : str
    end : str
        `PASSED`, `FAILED`, or why it is not applicable.
    cause : str
        What a failure said last.
    """

    name: str
    end: str
    cause: str = ""


def judge(line: dict[str, Any]) -> Verdict:
    """What the line that a program or a test left behind says.

    Examples
    --------
    >>> judge({"name": "a", "end": "failed", "text": "", "refused": ["call CreateDIChan"]}).end
    'digital lines'
    >>> judge({"name": "a", "end": "failed", "text": "E   assert 1 == 2", "refused": []}).end
    'failed'
    """
    if line["end"] == PASSED:
        return Verdict(line["name"], PASSED)
    if line["end"] == "xfailed":
        return Verdict(line["name"], AS_EXPECTED)
    asked = "\n".join([line["name"], *line.get("marks", []), *line["refused"][:1], line["text"]])
    for pattern, why in RULES:
        if re.search(pattern, asked):
            return Verdict(line["name"], why)
    said = [one.strip() for one in line["text"].splitlines() if one.strip()]
    return Verdict(line["name"], FAILED, said[-1] if said else "")


def listed(names: Iterable[str]) -> list[str]:
    """Names of tests as lines: a file each, its tests with how many sets of parameters each of them had.

    Examples
    --------
    >>> listed(["a/b.py::one[x]", "a/b.py::one[y]", "a/b.py::two"])
    ['* `a/b.py`: one (2), two']
    """
    files: dict[str, dict[str, int]] = {}
    for name in names:
        file, _, test = name.partition("::")
        tests = files.setdefault(file, {})
        if test:
            short = test.split("[")[0].removeprefix("test___").removeprefix("test_")
            tests[short] = tests.get(short, 0) + 1
    lines = []
    for file, tests in sorted(files.items()):
        told = ", ".join(f"{test} ({count})" if count > 1 else test for test, count in sorted(tests.items()))
        lines.append(f"* `{file}`" + (f": {told}" if told else ""))
    return lines
