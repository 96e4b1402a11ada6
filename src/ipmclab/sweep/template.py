"""A sweep to fill in."""

from __future__ import annotations

from typing import Final

TEMPLATE: Final = """\
# A sweep of ipmclab: simulate a strip with many parameter sets, and keep a few numbers of each.
actuator = "friend-2"                    # of the library, or a TOML file in this folder
signal = "sine 1 V 0.5 Hz"
duration = "10 s"
rate = "50 Hz"
hold = "zero"                            # what the voltage does between rows: zero, zero-before or first

# An output, a dot, and one of final, mean, rms, maximum, minimum, peak, peak_time.
metrics = ["displacement.peak", "force.rms", "current.rms"]

[design]
kind = "saltelli"                        # sobol, latin-hypercube; saltelli for Sobol indices, morris to screen many
base = 512                               # points; saltelli makes base x (parameters + 2) sets of them, morris + 1
seed = 1

[ranges]
"beam.modulus" = { low = "0.8 GPa", high = "2 GPa", scale = "log" }
"coupling.gain" = { low = "5e-9 m/V/s", high = "9e-9 m/V/s" }
"circuit.dc_resistivity" = { low = "30 ohm m", high = "60 ohm m" }

# In place of [design] and [ranges], a table: its first line names parameters, with a unit in brackets or in SI units.
# table = "strips.csv"                   # beam.modulus [GPa],coupling.gain
"""
