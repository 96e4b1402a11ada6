"""What is given in the place of a run, a fit, a path, a number, ...: told by name, in every public function."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest

import ipmclab
from ipmclab.errors import InputError

REFERENCE = Path(__file__).parents[1] / "docs" / "reference.md"
FRIEND = ipmclab.load_actuator("friend-2")
RUN = ipmclab.simulate(FRIEND, "step 1 V", duration=1.0, rate=50.0)
ANY = {("simulate_many", "signals")}
"""Arguments that take nearly anything: the function itself looks at them."""


class Other:
    """Nothing takes one."""


def public_functions() -> dict[str, Callable[..., Any]]:
    """All functions of the root of the package, and of the reference in the docs, by their names there."""
    found = {name: getattr(ipmclab, name) for name in ipmclab.__all__}
    for kind, name in re.findall(r"auto(function|module):: ([\w.]+)", REFERENCE.read_text(encoding="utf-8")):
        if kind == "module":
            module = importlib.import_module(name)
            found |= {key: one for key, one in vars(module).items() if getattr(one, "__module__", "").startswith(name)}
        else:
            home, _, key = name.rpartition(".")
            found[key] = getattr(importlib.import_module(home), key)
    return {name: one for name, one in found.items() if inspect.isfunction(one) and not name.startswith("_")}


FUNCTIONS = public_functions()
ARGUMENTS = [
    pytest.param(function, name, id=f"{key}-{name}")
    for key, function in FUNCTIONS.items()
    for name in inspect.signature(function).parameters
    if (key, name) not in ANY
]


def test_functions_are_found() -> None:
    assert {"simulate", "write_run", "compare", "forecast", "opened", "parse", "resonance", "shape"} <= FUNCTIONS.keys()


@pytest.mark.parametrize(("function", "name"), ARGUMENTS)
def test_each_argument_is_told(function: Callable[..., Any], name: str) -> None:
    """Most were "'Other' object has no attribute ...", some were taken for something."""
    with pytest.raises(InputError, match=rf"^{name}: this is an Other, not an? [\w ,]+; give .") as caught:
        function(**{name: Other()})
    assert caught.value.code.startswith("not-")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: ipmclab.write_run("step.nc", "copy.nc"),
            "run: 'step.nc' is a str, not a run; give read_run('step.nc')",
        ),
        (lambda: ipmclab.write_run(None, "copy.nc"), "run: this is None, not a run; give one that read_run read, or"),
        (lambda: ipmclab.plot([RUN, np.ones(3)]), "runs[1]: this is a NumPy array, not a run; give one that read_run"),
        (lambda: ipmclab.plot(iter([RUN, 3])), "runs[1]: this is an int, not a run; give one that read_run"),
        (lambda: ipmclab.plot(pandas.DataFrame({"a": [1.0]})), "runs: this is a DataFrame, not a run; give one that"),
        (lambda: ipmclab.plot(RUN, overwrite="no"), "overwrite: 'no' is a str, not a truth value; give True or False"),
        (lambda: ipmclab.plot(RUN, labels="a"), "labels: 'a' is a str, not a list of texts; give a list: ['a']"),
        (lambda: ipmclab.compare("a.nc"), "runs: 'a.nc' is a str, not a list of runs or paths; give a list: ['a.nc']"),
        (lambda: ipmclab.compare(RUN), "runs: this is a Run, not a list of runs or paths; give a list: [...]"),
        (
            lambda: ipmclab.choose(RUN, FRIEND),
            "models: this is an Actuator, not a text or a list of texts or actuators; give a list: [...]",
        ),
        (
            lambda: ipmclab.simulate_many(FRIEND, [RUN, RUN], duration=1.0, rate=50.0),
            "signals[0].signal: this is a Run, not a signal; give its voltage, run.voltage",
        ),
        (lambda: FRIEND.simulator(50.0, None), "hold: this is None, not a text; give a text in quotes"),
        (
            lambda: FRIEND.frequency_response("1 Hz"),
            "frequency: '1 Hz' is a str, not an array of numbers; give a list or an array of numbers in Hz",
        ),
        (
            lambda: ipmclab.Run.from_arrays(time=[0.0, 1.0], voltage=None),
            "voltage: the array has shape (), it must have one",
        ),
        (lambda: ipmclab.check(RUN, RUN), "actuator: this is a Run, not an actuator; give one that load_actuator read"),
        (
            lambda: ipmclab.profile(FRIEND),
            "fit: this is an Actuator, not a fit; give what identify returned, or read_fit",
        ),
        (
            lambda: ipmclab.refit("fitted.toml", []),
            "fit: 'fitted.toml' is a str, not a fit; give read_fit('fitted.toml')",
        ),
        (lambda: ipmclab.read_run(3), "path: this is an int, not a path; give the name of a file or folder, in quotes"),
        (
            lambda: ipmclab.run_sweep("e.toml", "new"),
            "sweep: 'e.toml' is a str, not a sweep; give read_sweep('e.toml')",
        ),
        (
            lambda: ipmclab.identifiability(FRIEND, voltage="3 V"),
            "voltage: '3 V' is a str, not a number; give a number in V",
        ),
        (
            lambda: ipmclab.simulate(FRIEND, RUN, external_force="1 mN"),
            "external_force: '1 mN' is a str, not an array of numbers; give a list or an array of numbers",
        ),
    ],
)
def test_sentences(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(message)


def test_what_counts_as_a_number_or_a_list() -> None:
    """Numbers of NumPy and of 0-d arrays, an iterator, an array of texts."""
    runs = iter([RUN])
    fit = ipmclab.identify(FRIEND, runs, free=np.array(["circuit.dc_resistivity"]), labels="step")
    assert fit.observations[0].label == "step"
    for voltage in (np.float64(3.0), np.float32(3.0), 3, np.int64(3), np.array(3.0)):
        assert ipmclab.identifiability(FRIEND, voltage=voltage)
