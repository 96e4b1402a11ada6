"""A procedure to fill in."""

from __future__ import annotations

from typing import Final

TEMPLATE: Final = """\
# The procedure of Friend's thesis (figure 4.9) for one strip. Fill in what was measured, take the # away from a step
# when it is done, and run
#     ipmclab procedure THIS.toml
# after each: it says what came of it and what to do next. At the end
#     ipmclab procedure THIS.toml --out fitted.toml
#
# A measured number is a text with its unit, or
#     { value = "25 mm", standard_uncertainty = "0.2 mm" }
# or readings, ["5.01 mm", "4.98 mm", "5.02 mm"], or { readings = [...], standard_uncertainty = "0.02 mm" }, where the
# uncertainty is what all readings share. Where none is stated, one that is usual is taken, and said.

name = "strip-1"

[geometry]                                       # of the wet strip
free_length = { value = "25 mm", standard_uncertainty = "0.2 mm" }
clamped_length = { value = "5 mm", standard_uncertainty = "0.2 mm" }
width = { value = "5 mm", standard_uncertainty = "0.05 mm" }
thickness = { value = "0.245 mm", standard_uncertainty = "0.003 mm" }
sensing_length = { value = "21 mm", standard_uncertainty = "0.2 mm" }   # where laser and load cell meet it

# [circuit]
# contact_resistance = { value = "0.05 ohm", standard_uncertainty = "0.02 ohm" }   # of the clamp; 0 unless given

# Step 1. Four probes on one face, in air, the other face free. `ipmclab rig sheet RIG --width "5 mm"` reads them with
# an NI 9217. "line" contacts lie across the whole width; "points" are four in a row, equally far apart.
# [sheet_resistance]
# contacts = "line"
# spacing = { value = "10 mm", standard_uncertainty = "0.05 mm" }       # between the inner contacts
# resistance = ["2.66 ohm", "2.67 ohm", "2.67 ohm"]
# outer_spacing = "16 mm"                        # of lines: what the other face carries is then taken off, by half
# offset = "0.05 ohm"                            # of the meter, to either side; 0.05 ohm is that of an NI 9217
# zero = "0.01 ohm"                              # what it reads with the contacts shorted: then no offset is counted

# Step 2. A constant voltage of 1 V or less, held until the current no longer falls: some 80 s.
# [dc_resistance]
# runs = ["step.nc"]

# Step 3. A step and a slow sine.
# [branches]
# runs = ["step.nc", "sine.nc"]
# count = 2

# Step 4. The whole wet strip on a balance, its surface dabbed dry.
# [density]
# mass = { value = "113 mg", standard_uncertainty = "0.5 mg" }

# Step 5. At 0 V move the load cell against the strip and back, some 0.5 mm, and let the force settle at each position.
# [modulus]
# position = { value = "21 mm", standard_uncertainty = "0.2 mm" }       # the sensing length unless given
# displacement = ["0 mm", "0.1 mm", "0.2 mm", "0.3 mm", "0.2 mm", "0.1 mm", "0 mm"]
# force = ["0 mN", "0.29 mN", "0.57 mN", "0.86 mN", "0.58 mN", "0.29 mN", "0 mN"]
# calibration = 0.01     # relative, of both scales together (10 gf are 98.07 mN, not 100); 3 % of each unless given

# Step 6. The blocked force under a step and a slow sine.
# [coupling]
# runs = ["force-step.nc", "force-sine.nc"]

# A number from elsewhere can replace steps 1, 2, 4 and 5:
#     value = { value = "1.33 ohm/sq", standard_uncertainty = "0.02 ohm/sq" }
"""
