"""NI's own examples and tests on the stand-in chassis, through NI's client.

Run ``python -m benchmarks.ni_client FOLDER [--gate] [--record]``, where FOLDER holds github.com/ni/nidaqmx-python.
Nothing of it is kept here. Of the tests, that half of ``tests/component`` and ``tests/acceptance`` is asked that goes
through gRPC: once with the stand-in dressed up as the multifunction device that they are written for, and what looks
for a cDAQ-9189 once more with it as such a chassis. What passes, what does not apply and why, and what failed is
written down by name; the gate is that nothing has failed.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.harness import finish
from benchmarks.ni_suite.verdict import FAILED, PASSED, Verdict, judge, listed
from benchmarks.sources import ROOT

SOURCES = (
    "src/virtual_cdaq/attributes",
    "src/virtual_cdaq/calls",
    "src/virtual_cdaq/model",
    "src/virtual_cdaq/protocol.py",
    "src/virtual_cdaq/server.py",
    "src/virtual_cdaq/service.py",
    "src/virtual_cdaq/sessions.py",
    "benchmarks/ni_suite",
)

LONGEST_EXAMPLE, LONGEST_SUITE = 120.0, 1800.0  # s
CHASSIS = "cDAQ-9189"


def environment(folder: Path, **more: str) -> dict[str, str]:
    """What the programs run with: NI's folder first, for its tests are a package of the name ``tests``."""
    paths = os.pathsep.join([str(folder), str(ROOT)])
    return {**os.environ, "PYTHONPATH": paths, "LC_ALL": "C.UTF-8", "MPLBACKEND": "Agg", **more}


def _end(program: Path, folder: Path) -> dict[str, Any]:
    """How one of NI's examples ended."""
    command = [sys.executable, "-m", "benchmarks.ni_suite.example", str(program)]
    line = {"end": FAILED, "text": "", "refused": [], "name": program.relative_to(folder).as_posix()}
    with tempfile.TemporaryDirectory() as room:
        try:
            told = subprocess.run(
                command,
                env=environment(folder),
                cwd=room,
                capture_output=True,
                text=True,
                timeout=LONGEST_EXAMPLE,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return line | {"text": f"it has not ended within {LONGEST_EXAMPLE:g} s"}
    said = (told.stdout.splitlines() or [""])[-1]
    return line | (json.loads(said) if said.startswith("{") else {"text": told.stderr})


def examples(folder: Path) -> list[dict[str, Any]]:
    """How each of NI's examples ended."""
    programs = [path for path in sorted((folder / "examples").rglob("*.py")) if path.name != "__init__.py"]
    return [_end(program, folder) for program in programs]


def suite(folder: Path, disguise: str, *what: str) -> list[dict[str, Any]]:
    """How each of NI's tests ended, with the stand-in in one disguise."""
    with tempfile.TemporaryDirectory() as room:
        results = Path(room, "results.jsonl")
        command = [sys.executable, "-m", "pytest", "-p", "benchmarks.ni_suite.plugin", "-p", "no:cacheprovider"]
        command += ["-p", "no:xdist", "-p", "no:rerunfailures", "-o", "addopts=--strict-markers", "-q", "--tb=short"]
        subprocess.run(
            [*command, *(what or ("tests/component", "tests/acceptance", "-k", "grpc_init_kwargs"))],
            env=environment(folder, NI_SUITE_DISGUISE=disguise, NI_SUITE_RESULTS=str(results)),
            cwd=folder,
            stdout=subprocess.DEVNULL,
            timeout=LONGEST_SUITE,
            check=False,
        )
        return [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]


def tests(folder: Path) -> list[dict[str, Any]]:
    """How each of NI's tests ended, in whichever disguise it found its device."""
    lines = {line["name"]: line for line in suite(folder, "multifunction")}
    others = [name for name, line in lines.items() if CHASSIS in line["text"]]
    for line in suite(folder, "network", *others):
        lines[line["name"]] = line
    return list(lines.values())


def report(title: str, verdicts: list[Verdict]) -> tuple[list[str], list[str]]:
    """Counts and lists of names, as lines; and the names of what failed."""
    ends: dict[str, list[str]] = {PASSED: [], FAILED: []}
    for verdict in verdicts:
        ends.setdefault(verdict.end, []).append(verdict.name)
    others = sorted(set(ends) - {PASSED, FAILED}, key=lambda end: -len(ends[end]))
    counts = ["| end | how many |", "|---|---|"]
    counts += [f"| {PASSED} | {len(ends[PASSED])} |", f"| {FAILED} | {len(ends[FAILED])} |"]
    counts += [f"| not applicable: {end} | {len(ends[end])} |" for end in others]
    lines = [f"## {title}", "", *counts]
    if ends[FAILED]:
        lines += ["", "### Failed", ""]
        lines += [f"* `{verdict.name}`: {verdict.cause}" for verdict in verdicts if verdict.end == FAILED]
    for end in (PASSED, *others):
        if ends[end]:
            head = "Passed" if end == PASSED else f"Not applicable: {end}"
            lines += ["", f"### {head}", "", *listed(ends[end])]
    return lines, ends[FAILED]


def commit(folder: Path) -> str:
    """What the folder holds, where git knows it."""
    told = subprocess.run(
        ["git", "-C", str(folder), "log", "-1", "--format=%h of %cs"], capture_output=True, text=True, check=False
    )
    return told.stdout.strip() or "a copy without its history"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="holds github.com/ni/nidaqmx-python")
    parser.add_argument("--gate", action="store_true", help="exit 1 when something failed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/ni_client.md")
    options = parser.parse_args()
    folder = options.folder.resolve()
    programs, failed_programs = report("Examples", [judge(line) for line in examples(folder)])
    asked, failed_tests = report("Tests", [judge(line) for line in tests(folder)])
    head = [
        f"nidaqmx {importlib.metadata.version('nidaqmx')}, github.com/ni/nidaqmx-python at {commit(folder)}. A number",
        'behind the name of a test says with how many sets of parameters it was asked. What begins with "missing"',
        "stands in the table of docs/virtual_bench.md; the rest is no thing of this chassis and its modules.",
    ]
    body = "\n".join(["\n".join(head), "", *programs, "", *asked])
    finish("ni_client", "NI's examples and tests on the stand-in", body, [], record=options.record, gate=False)
    failed = [*failed_programs, *failed_tests]
    if options.gate and failed:
        sys.exit(f"failed: {'; '.join(failed)}")


if __name__ == "__main__":
    main()
