"""Shape: where a strip is whose curvature is known along it, however far it bends.

Positions count along the strip from the clamp; x along the strip as it lies straight, y across it, positive as the
displacement.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError
from ipmclab.kinds import tell_kinds

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Shape:
    """A bent strip, at places along it.

    Parameters
    ----------
    along : float array, shape (n_places,) [m]
        Along the strip, from the clamp.
    x, y : float array, shape (n_places,) [m]
    angle : float array, shape (n_places,) [rad]
    """

    along: FloatArray
    x: FloatArray
    y: FloatArray
    angle: FloatArray

    def height_at(self, x: float) -> float:
        """The height [m] at which the strip first crosses a line across it at x [m]; NaN where it does not.

        This is what a laser fixed there reads.

        Examples
        --------
        >>> import numpy as np
        >>> arc = shape(np.full(50, 20.0), 0.025)
        >>> round(1e3 * arc.height_at(0.021), 4), arc.height_at(0.0249)
        (4.6238, nan)
        """
        beyond = np.flatnonzero(self.x >= x * (1.0 - 1e-12))
        if not len(beyond):
            return float("nan")
        after = int(beyond[0])
        if after == 0:
            return float(self.y[0])
        before = after - 1
        length, turn = self.along[after] - self.along[before], self.angle[after] - self.angle[before]
        return float(self.y[before] + _up(self.angle[before], turn / length, x - self.x[before]))


@tell_kinds
def shape(curvature: npt.ArrayLike, length: float) -> Shape:
    """The shape of a strip of these curvatures: each is that of an arc, one after the other, without a kink.

    Parameters
    ----------
    curvature : float array, shape (n_segments,) [1/m]
        Of segments of equal length, from the clamp on; one number for a uniform curvature.
    length : float [m]

    Returns
    -------
    shape : Shape
        At the n_segments + 1 ends of the segments.

    Raises
    ------
    InputError
        No curvature, one that is not finite, or a length that is not above 0.

    Examples
    --------
    A uniform curvature k ends at sin(k L)/k, (1 - cos k L)/k:

    >>> arc = shape([40.0] * 10, 0.025)
    >>> (1e3 * arc.x[-1]).round(4), (1e3 * arc.y[-1]).round(4), arc.angle[-1].round(4)
    (np.float64(21.0368), np.float64(11.4924), np.float64(1.0))
    """
    bent = np.atleast_1d(np.asarray(curvature, dtype=np.float64))
    if bent.ndim != 1 or not len(bent) or not np.all(np.isfinite(bent)):
        raise InputError(
            "not a row of finite curvatures",
            code="bad-curvature",
            where="curvature",
            repair="give one curvature [1/m] for each segment, from the clamp on",
        )
    step = _above_zero(length, "length") / len(bent)
    turn = bent * step
    angle = np.concatenate([[0.0], np.cumsum(turn)])
    middle, chord = angle[:-1] + 0.5 * turn, step * np.sinc(turn / (2.0 * np.pi))
    return Shape(
        along=np.linspace(0.0, length, len(bent) + 1, dtype=np.float64),
        x=np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))]),
        y=np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))]),
        angle=angle,
    )


@tell_kinds
def curvature_from_height(height: npt.ArrayLike, x: float) -> FloatArray:
    """The uniform curvature [1/m] of a strip that a laser at x [m] reads at some heights [m].

    Examples
    --------
    >>> curvature_from_height([4.6238e-3], 0.021).round(2).tolist()
    [20.0]
    """
    y = np.asarray(height, dtype=np.float64)
    bent: FloatArray = 2.0 * y / (y * y + _above_zero(x, "x") ** 2)
    return bent


@tell_kinds
def bending_rigidity(values: Mapping[str, float]) -> float:
    """Y I [N m^2], I = w h^3/12, of an actuator's parameters; with the static modulus.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> f"{bending_rigidity(load_actuator('friend-2').parameter_values):.4e}"
    '8.8850e-06'
    """
    return values["beam.modulus"] * values["geometry.width"] * values["geometry.thickness"] ** 3 / 12.0


@tell_kinds
def blocked_torque(curvature: npt.ArrayLike, values: Mapping[str, float]) -> FloatArray:
    """The torque [N m] that holds a strip straight which would bend freely with a curvature [1/m]: Y I kappa.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> float(blocked_torque(2.836, load_actuator("friend-2").parameter_values).round(8))
    2.52e-05
    """
    return bending_rigidity(values) * np.asarray(curvature, dtype=np.float64)


@tell_kinds
def loaded_shape(curvature: npt.ArrayLike, length: float, *, rigidity: float, force: float) -> Shape:
    """The shape from the clamp to a force that stays normal to the straight strip, added to its free curvature.

    In each place the curvature is kappa_free - F (x_load - x)/(Y I), however far the strip bends.

    Parameters
    ----------
    curvature : float array, shape (n_segments,) [1/m]
        The free curvature, of segments of equal length; straight between their middles.
    length : float [m]
        From the clamp to the force; beyond it a strip bends freely.
    rigidity : float [N m^2]
        Y I, see ``bending_rigidity``.
    force : float [N]
        Positive against the displacement.

    Returns
    -------
    shape : Shape

    Raises
    ------
    InputError
        A curvature, length, rigidity or force that cannot be used.
    IpmclabError
        No equilibrium was found: the load is too large for this strip.

    Examples
    --------
    A small load bends a straight strip by F L^3/(3 Y I):

    >>> from ipmclab import load_actuator
    >>> rigidity = bending_rigidity(load_actuator("friend-2").parameter_values)
    >>> pressed = loaded_shape([0.0], 0.021, rigidity=rigidity, force=-1e-5)
    >>> round(1e6 * float(pressed.y[-1]), 3), round(1e6 * 1e-5 * 0.021**3 / (3 * rigidity), 3)
    (3.474, 3.474)
    """
    from scipy.integrate import solve_bvp

    free = shape(curvature, length)
    if not np.isfinite(force):
        raise InputError(f"the force is {force}", code="bad-value", where="force", repair="give a finite force in N")
    load = force * length**2 / _above_zero(rigidity, "rigidity")
    bent = np.atleast_1d(np.asarray(curvature, dtype=np.float64))
    middles = 0.5 * (free.along[1:] + free.along[:-1]) / length

    # Lengths count in parts of the whole; the unknown number is where along x the load ends up.
    def rates(along: FloatArray, state: FloatArray, load_x: FloatArray) -> FloatArray:
        angle, x, _ = state
        own = length * np.interp(along, middles, bent)
        return np.vstack([own - load * (load_x[0] - x), np.cos(angle), np.sin(angle)])

    def ends(first: FloatArray, last: FloatArray, load_x: FloatArray) -> FloatArray:
        return np.array([first[0], first[1], first[2], last[1] - load_x[0]])

    guess = np.vstack([free.angle, free.x / length, free.y / length])
    grid = np.linspace(0.0, 1.0, max(41, 2 * len(bent) + 1))
    guess = np.vstack([np.interp(grid, free.along / length, row) for row in guess])
    solved = solve_bvp(rates, ends, grid, guess, p=[guess[1, -1]], tol=1e-8, max_nodes=20_000)
    if not solved.success:
        raise IpmclabError(
            f"no equilibrium found under {force:g} N at {length:g} m: {solved.message}",
            code="no-equilibrium",
            where="loaded_shape",
            repair="give a smaller force",
        )
    angle, x, y = solved.sol(free.along / length)
    return Shape(free.along, length * x, length * y, angle)


def _up(angle: float, curvature: float, across: float) -> float:
    """How far an arc climbs that starts at an angle, over a distance along x."""
    if abs(curvature * across) < 1e-9:
        return float(across * np.tan(angle))
    end = np.arcsin(np.clip(np.sin(angle) + curvature * across, -1.0, 1.0))
    return float((np.cos(angle) - np.cos(end)) / curvature)


def _above_zero(value: float, where: str) -> float:
    if not 0.0 < value < np.inf:
        raise InputError(
            f"{value!r} is not a number above 0", code="bad-value", where=where, repair="give it in SI units, above 0"
        )
    return float(value)
