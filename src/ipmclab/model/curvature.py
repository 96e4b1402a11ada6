"""Curvature along the strip: how each place of it bends under the voltage between the electrodes there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.kinds import tell_kinds
from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import assemble
from ipmclab.model.blocks import Block
from ipmclab.model.numerics.timeline import timeline
from ipmclab.model.outputs import run_dense
from ipmclab.model.request import check_hold
from ipmclab.model.simulate import with_shunt
from ipmclab.model.stages.leak import Leak
from ipmclab.run import Run

FloatArray = npt.NDArray[np.float64]


@tell_kinds
def curvature(actuator: Actuator, run: Run, positions: npt.ArrayLike) -> FloatArray:
    """The free curvature kappa(x, t) of an actuator under the voltage of a run, from rest.

    kappa = 6 d(s) u(x)/h^2 with u(x) the voltage between the electrodes at x (Friend, eq. 4.7 for a short piece), less
    the slow modes of the displacement. Electrodes that are lumped give one curvature for the whole strip. The beam's
    inertia is left out: this is the shape far below the first resonance, where the linear displacement is
    int_0^Ls (L_s - x) kappa(x) dx. A modulus that relaxes changes nothing of a strip that bends freely.

    Parameters
    ----------
    actuator : Actuator
    run : Run
        Its voltage, times and hold are used; a shunt that its voltage was sensed upstream of is put in series.
    positions : float array, shape (n_positions,) [m]
        From the clamp's edge, within the free length.

    Returns
    -------
    curvature : float array, shape (n_positions, n_time) [1/m]

    Raises
    ------
    InputError
        A place that is not on the free length, or a hold that says nothing.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> strip = load_actuator("friend-2+line.modes=6")
    >>> run = simulate(strip, "step 1 V", duration=2.0, rate=50.0)
    >>> at_clamp, at_end = curvature(strip, run, [0.0, 0.025])[:, -1]
    >>> bool(at_clamp > 1.1 * at_end > 0.0)
    True
    """
    if actuator.structure.load:
        raise InputError(
            "a load bends the strip in addition to its own curvature",
            code="loaded",
            where="load.stiffness",
            repair="take the curvature of the strip without its load",
        )
    places = _places(actuator, positions)
    check_hold(run.hold)
    strip = with_shunt(actuator, run)
    values, structure = strip.parameter_values, strip.structure
    ports, weights = structure.electrical.profile(values, places)
    blocks = [structure.electrical.block(values, along=True)]
    for stage in structure.stages:
        if isinstance(stage, Leak):
            blocks += stage.blocks(values, structure.law_ports(values))
    bending = structure.drive_blocks(values, "displacement")
    # Drives are linear in the voltage: one chain for each port of which the voltage along the strip is made.
    blocks += [_at(port, block) for port in ports for block in bending]
    drives = [f"displacement_drive of {port}" for port in ports]
    system = assemble(blocks, inputs=("voltage",), outputs=drives, laws=structure.laws(values))
    outputs = np.empty((len(drives), len(run.time)))
    line = timeline(run.time, run.voltage, run.hold, delay=0.0, from_rest=True)
    run_dense(system, [line], np.zeros(len(system.states)), outputs)
    found: FloatArray = 6.0 / strip["geometry.thickness"] ** 2 * (weights @ outputs)
    return found


def _at(port: str, block: Block) -> Block:
    """The same block, bending by the voltage of one port."""
    return replace(
        block,
        states=tuple(f"{name} of {port}" for name in block.states),
        inputs=tuple(port if name == "node_voltage" else f"{name} of {port}" for name in block.inputs),
        outputs=tuple(f"{name} of {port}" for name in block.outputs),
    )


def _places(actuator: Actuator, positions: npt.ArrayLike) -> FloatArray:
    free = actuator["geometry.free_length"]
    try:
        places = np.atleast_1d(np.asarray(positions, dtype=np.float64))
    except (TypeError, ValueError):
        places = np.empty((0, 0))
    if places.ndim != 1 or not len(places):
        raise InputError(
            f"{positions!r} is not a row of places", code="bad-positions", where="positions", repair="give them in m"
        )
    outside = np.flatnonzero(~((places >= 0.0) & (places <= free)))
    if len(outside):
        raise InputError(
            f"place {outside[0]} is {places[outside[0]]:g} m, the free length goes from 0 to {free:g} m",
            code="out-of-range",
            where="positions",
            repair="measure from the clamp's edge, in m",
        )
    return places
