"""The same step as a command and as Python: nothing that the page does can be done by the page alone."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.page.replay import Replay
from ipmclab.signals import Samples


@dataclass(frozen=True)
class Step:
    """One step of the page, as it can be repeated without it.

    Parameters
    ----------
    command : str
        For a terminal in the folder of the lab.
    python : str
        The same with ``import ipmclab``.
    note : str
        What is to be known before it is done; mostly nothing.
    """

    command: str
    python: str
    note: str = ""


_IMPORT: Final = "import ipmclab\n\n"


def in_order(steps: Sequence[Step], *, note: str) -> Step:
    """Several steps as one: each is done where those before it succeeded. ``note`` comes before their own.

    Examples
    --------
    >>> fit = identify_step("friend-2", ["a.nc"], ["electrical"], out="mine.toml")
    >>> print(in_order([fit, validate_step(["mine.toml"], ["b.nc"])], note="").command)
    ipmclab identify friend-2 a.nc --free electrical --thorough --out mine.toml &&
    ipmclab validate mine.toml b.nc
    """
    commands = [step.command for step in steps]
    python = _IMPORT + "\n".join(step.python.replace(_IMPORT, "", 1) for step in steps)
    return Step(
        " &&\n".join(commands) if all(commands) else "",
        python,
        " ".join(filter(None, [note, *(step.note for step in steps)])),
    )


def identify_step(
    actuator: str,
    runs: Sequence[str],
    free: Sequence[str],
    per_run: Sequence[str] = (),
    per_mounting: Sequence[str] = (),
    prior: Sequence[str] = (),
    out: str = "fitted.toml",
) -> Step:
    """Identify, with all that the page shows of a fit, also where that takes long.

    What each run or mounting has for itself is free by that; the command wants something in ``free`` too.

    Examples
    --------
    >>> step = identify_step("friend-2", ["runs/a b.nc"], ["electrical"])
    >>> step.command
    "ipmclab identify friend-2 'runs/a b.nc' --free electrical --thorough --out fitted.toml"
    """
    free = free or [*per_run, *per_mounting]
    command = ["ipmclab", "identify", actuator, *runs, "--free", ",".join(free)]
    own = ""
    for name, names in {"per_run": per_run, "per_mounting": per_mounting, "prior": prior}.items():
        if names:
            command += [f"--{name.replace('_', '-')}", ",".join(names)]
            own += f", {name}={list(names)!r}"
    again = "fit = ipmclab.leave_one_run_out(fit)\n" if len(runs) > 1 else ""
    python = (
        "import ipmclab\n\n"
        f"runs = [ipmclab.read_run(path) for path in {list(runs)!r}]\n"
        f"fit = ipmclab.identify(ipmclab.load_actuator({actuator!r}), runs, free={list(free)!r}{own})\n"
        f"fit = ipmclab.profile(fit)\n{again}"
        f"ipmclab.write_fit(fit, {out!r})\n"
    )
    return Step(shlex.join([*command, "--thorough", "--out", out]), python)


def validate_step(models: Sequence[str], runs: Sequence[str]) -> Step:
    """Hold models against runs that they never saw.

    Examples
    --------
    >>> validate_step(["fitted.toml", "friend-2"], ["square.nc"]).command
    'ipmclab validate fitted.toml square.nc --also friend-2'
    """
    first, *others = models
    command = ["ipmclab", "validate", first, *runs]
    for other in others:
        command += ["--also", other]
    python = (
        "import ipmclab\n\n"
        f"runs = [ipmclab.read_run(path) for path in {list(runs)!r}]\n"
        f"for name in {list(models)!r}:\n"
        "    print(ipmclab.validate(ipmclab.load_actuator(name), runs))\n"
    )
    return Step(shlex.join(command), python)


def simulate_step(
    actuator: str,
    changes: Mapping[str, float],
    *,
    signal: str = "",
    duration: float = 40.0,
    rate: float = 50.0,
    run: Replay | None = None,
    is_fit: bool = False,
) -> Step:
    """Simulate a signal, or over a run; the command needs a file where parameters were changed, the Python does not.

    Of a fit that was left as it is the command reports how sure it is, and the Python has it as ``bands``. Over a run
    that no command can repeat there is none, and the note says why.

    Examples
    --------
    >>> simulate_step("friend-2", {}, signal="step 1 V").command
    "ipmclab simulate friend-2 --signal 'step 1 V' --duration '40 s' --rate '50 Hz' --out run.nc"
    >>> simulate_step("friend-2", {}, run=Replay("a.nc", 40.0, 50.0, "first")).command
    "ipmclab simulate friend-2 --signal 'file a.nc' --duration '40 s' --rate '50 Hz' --hold first --out simulated.nc"
    """
    name = "changed.toml" if changes else actuator
    note, hold, out = "", [], "run.nc"
    if run is not None:
        signal = str(Samples([0.0, 1.0], [0.0, 0.0], path=run.key))  # quoted as a signal's text has it
        duration, rate, out = run.duration, run.rate, "simulated.nc"
        hold = ["--hold", run.hold] if run.hold != "zero" else []
    times = ["--duration", f"{_exact(duration)} s", "--rate", f"{_exact(rate)} Hz", *hold]
    command = shlex.join(["ipmclab", "simulate", name, "--signal", signal, *times, "--out", out])
    assumes = run is not None and run.is_assumed
    lines = [*(["import dataclasses", ""] if assumes else []), "import ipmclab", ""]
    lines.append(f"actuator = ipmclab.load_actuator({actuator!r})")
    if changes:
        lines.append(f"actuator = actuator.replace(**{dict(changes)!r})")
        lines.append(f"ipmclab.write_actuator(actuator, {name!r})")
        note = f"The command takes {name}: save the changed actuator by this name, or let the Python write it."
    if run is not None:
        lines.append(f"measured = ipmclab.read_run({run.key!r})")
        if assumes:  # the page takes it so, and says it
            lines.append(f"measured = dataclasses.replace(measured, hold={run.hold!r})")
        lines.append("run = ipmclab.simulate(actuator, measured)")
        if run.why_no_command:
            command, note = "", f"No command does this: {run.why_no_command}."
    else:
        lines.append(f"run = ipmclab.simulate(actuator, {signal!r}, duration={duration!r}, rate={rate!r})")
    lines.append(f"ipmclab.write_run(run, {out!r})")
    if is_fit and not changes:
        lines.append(f"bands = ipmclab.prediction_bands(ipmclab.read_fit({actuator!r}), run)")
    return Step(command, "\n".join(lines) + "\n", note)


def _exact(number: float) -> str:
    """A number as short as it can be without being another."""
    short = f"{number:.15g}"
    return short if float(short) == number else repr(number)


def report_step(fit: str, runs: Sequence[str], validation: Sequence[str], out: str) -> Step:
    """Write a report.

    Examples
    --------
    >>> report_step("fitted.toml", ["step.nc"], ["square.nc"], "report.html").command
    'ipmclab report fitted.toml --runs step.nc --validation square.nc --out report.html'
    """
    command = ["ipmclab", "report", fit, "--runs", *runs]
    if validation:
        command += ["--validation", *validation]
    python = (
        "import ipmclab\n\n"
        f"runs = [ipmclab.read_run(path) for path in {list(runs)!r}]\n"
        f"unseen = [ipmclab.read_run(path) for path in {list(validation)!r}]\n"
        f"ipmclab.report(ipmclab.read_fit({fit!r}), runs=runs, validation_runs=unseen, path={out!r})\n"
    )
    return Step(shlex.join([*command, "--out", out]), python)


def import_step(file: str, map_file: str, out: str, *, sent: bool = False) -> Step:
    """Import a foreign record; one that a browser sent is in no folder of the lab.

    Examples
    --------
    >>> import_step("record.csv", "record.map.toml", "record.nc").command
    'ipmclab import record.csv --map record.map.toml --out record.nc'
    >>> import_step("record.csv", "record.map.toml", "record.nc", sent=True).note
    'record.csv is not in the folder of this page, as the browser sent it: copy it there first.'
    """
    command = ["ipmclab", "import", file, "--map", map_file, "--out", out]
    python = f"import ipmclab\n\nrun = ipmclab.import_run({file!r}, {map_file!r})\nipmclab.write_run(run, {out!r})\n"
    note = f"{file} is not in the folder of this page, as the browser sent it: copy it there first." if sent else ""
    return Step(shlex.join(command), python, note)


def baseline_step(run: str, displacement: str, test: str, share: str) -> Step:
    """Ask whether a strip that curls by itself can be tested.

    Examples
    --------
    >>> baseline_step("room.nc", "1.3 mm", "40 s", "0.05").command
    "ipmclab baseline room.nc --displacement '1.3 mm' --test '40 s' --share 0.05"
    """
    command = ["ipmclab", "baseline", run, "--displacement", displacement, "--test", test, "--share", share]
    python = (
        "from ipmclab import read_run\nfrom ipmclab.measurement.curl import curl\n"
        "from ipmclab.units import LENGTH, TIME, parse_quantity\n\n"
        f'displacement = parse_quantity({displacement!r}, LENGTH, where="displacement")\n'
        f'test = parse_quantity({test!r}, TIME, where="test")\n'
        f"found = curl(read_run({run!r}), displacement, test=test, share={float(share)!r})\n"
        "found.verdict, found.interval\n"
    )
    return Step(shlex.join(command), python)


def smooth_step(run: str, below: float, out: str) -> Step:
    """Take out of a run what is faster than a frequency [Hz].

    Examples
    --------
    >>> smooth_step("run.nc", 5.0, "quiet.nc").command
    "ipmclab smooth run.nc --below '5 Hz' --out quiet.nc"
    """
    command = ["ipmclab", "smooth", run, "--below", f"{_exact(below)} Hz", "--out", out]
    python = (
        f"import ipmclab\nfrom ipmclab.measurement.smooth import smooth\n\n"
        f"smoothed, taken_out = smooth(ipmclab.read_run({run!r}), {below!r})\n"
        f"ipmclab.write_run(smoothed, {out!r})\n"
    )
    return Step(shlex.join(command), python)


def next_step(
    fit: str,
    goal: str,
    minutes: float,
    *,
    limits: Mapping[str, str],
    longest: str,
    inputs: Sequence[str] = (),
    rival: str = "",
) -> Step:
    """Ask which runs to record next.

    Examples
    --------
    >>> limits = {"voltage": "3 V"}
    >>> next_step("fitted.toml", "model", 15.0, limits=limits, longest="40 s", rival="leak.exponential").command
    "ipmclab next fitted.toml --goal model --minutes 15 --limit 'voltage=3 V' --longest '40 s' --rival leak.exponential"
    """
    command = ["ipmclab", "next", fit, "--goal", goal, "--minutes", _exact(minutes)]
    for name, value in limits.items():
        command += ["--limit", f"{name}={value}"]
    command += ["--longest", longest]
    own = ""
    for text in inputs:
        command += ["--input", text]
    if inputs:
        own += f", inputs={list(inputs)!r}"
    if rival:
        command += ["--rival", rival]
        own += f", rival=ipmclab.load_actuator({rival!r})" if rival.endswith(".toml") else f", rival={rival!r}"
    python = (
        "import ipmclab\nfrom ipmclab.rig.safety.limits import Limits\n"
        "from ipmclab.units import TIME, parse_quantity\n\n"
        f'longest = parse_quantity({longest!r}, TIME, where="longest")\n'
        f"allowed = ipmclab.Allowance(limits=Limits.from_table({dict(limits)!r}), longest=longest)\n"
        f"fit = ipmclab.read_fit({fit!r})\n"
        f"print(ipmclab.propose_runs(fit, goal={goal!r}, minutes={minutes!r}, allowed=allowed{own}))\n"
    )
    return Step(shlex.join(command), python)
