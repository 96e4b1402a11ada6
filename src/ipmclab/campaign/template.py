"""What ``ipmclab characterise --template`` prints."""

from __future__ import annotations

from typing import Final

TEMPLATE: Final = """\
title = "two strips, two voltages"
rig = "virtual"                   # or a rig file in this folder
order = "randomised"              # of samples and signals, new in each repeat; "listed": in the order of this file
seed = 1                          # of the random order
clamped = "for each block"        # or "for each run": hydrated and clamped again each time
attempts = 2                      # of a run that fails its checks; then it is flagged
fails_at = "error"                # the least severity of a finding with which a run fails; or "warning", "never"
measure = ["mass", "sheet resistance", "stiffness"]

[method]                          # keys of an experiment file, for every experiment below
rate = "50 Hz"
duration = "40 s"
pause = "2 min"
limits = { voltage = "4 V", current = "300 mA" }

[[samples]]
id = "strip-1"
actuator = "friend-1-measured"    # a model: foretells currents, and is the strip at a virtual bench

[[samples]]
id = "strip-3"
actuator = "friend-3-measured"

[[experiments]]                   # keys of an experiment file; file = "step.toml" takes one that you have
name = "displacement"
measured = ["current", "displacement"]
signals = ["step 1 V", "step 2 V", "sine 1 V 0.1 Hz"]
environments = ["20 degC, 80 percent", "20 degC, 60 percent"]   # up the list, and down again
repeats = 2
baseline = true

[[experiments]]
name = "force"
samples = ["strip-1"]             # all of them where it is left out
measured = ["current", "force"]
signals = ["step 2 V"]
"""
"""A campaign file to start from."""
