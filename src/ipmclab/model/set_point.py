"""Set point: whether a constant displacement or force can be held, given slow modes that oppose the coupling."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.kinds import tell_kinds
from ipmclab.model.assemble import System, assemble

if TYPE_CHECKING:
    from ipmclab.model.actuator import Actuator

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
Drive = Literal["displacement", "force"]
Kind = Literal["none", "partial", "washout", "reversal"]

DRIVES: Final[tuple[Drive, ...]] = ("displacement", "force")

_ROUNDING: Final = 1e-12
"""A ratio within this of 1 is 1; a zero this much smaller than the slowest rate is at the origin."""

_SETTLED: Final = 40.0
"""Time constants of the slowest pole after which nothing of it is left."""

_REFINED: Final = 3
"""Grids, each between two points of the one before, down to the moment."""


@dataclass(frozen=True, eq=False)
class SetPoint:
    """What the slow modes of one drive mean for holding it.

    Parameters
    ----------
    drive : "displacement" or "force"
    ratio : float
        r: what the slow modes take back under a constant voltage, as a part of what the coupling gives.
    kind : "none", "partial", "washout" or "reversal"
        No slow mode; r < 1; r = 1, a zero at the origin; r > 1.
    inverse_start : bool
        Whether a step first moves it against the coupling's direction (of one slow mode: r tau1 > tau2).
    zeros : complex array, shape (n_zeros,) [1/s]
        Of the whole drive, the coupling and its slow modes together.
    inverse_for : float [s]
        How long a step of the voltage behind the electrodes keeps the drive on the wrong side; 0 without an inverse
        start, infinite where it stays there.
    """

    drive: Drive
    ratio: float
    kind: Kind
    inverse_start: bool
    zeros: ComplexArray
    inverse_for: float = 0.0

    @property
    def right_half_plane(self) -> ComplexArray:
        """The zeros with a positive real part [1/s]: whoever inverts the drive grows with them."""
        return self.zeros[self.zeros.real > 0.0]

    @property
    def can_be_held(self) -> bool:
        """Whether a bounded voltage in the original direction holds a constant set point."""
        return self.ratio < 1.0 - _ROUNDING

    @property
    def sentence(self) -> str:
        """What it means for whoever wants to hold a set point."""
        text = f"r = {self.ratio:.4g} of the {self.drive}: {self._held()}"
        unstable = self.right_half_plane
        if len(unstable):
            text += f"; {_told(unstable)} (non-minimum phase): its inverse grows"
            slow = f"slower than about {0.5 * float(np.min(np.abs(unstable))):.3g} rad/s"
            if self.can_be_held:
                text += f", and a loop that holds is {slow}"
            elif self.kind == "reversal":
                text += f", and a loop of the opposite sign, which alone could hold, is {slow}"
        if self.inverse_start and self.kind != "none":
            text += "; a step starts in the inverse direction"
            text += f", for about {self.inverse_for:.2g} s" if math.isfinite(self.inverse_for) else " and stays there"
        return text

    def _held(self) -> str:
        if self.kind == "none":
            return "no slow mode takes anything back: a constant voltage holds a set point"
        if self.kind == "partial" and self.ratio <= 0.0:
            return "the slow modes add to the coupling: it creeps on, and a set point can be held"
        if self.kind == "partial":
            return (
                f"partial relaxation: a constant voltage keeps {1.0 - self.ratio:.3g} of what the coupling gives, so "
                f"that a set point can be held, with {1.0 / (1.0 - self.ratio):.3g} times the voltage that reaches it "
                "without relaxation"
            )
        if self.kind == "washout":
            return (
                "a zero at the origin: under a constant voltage everything is taken back, and a set point is held only "
                "by a voltage that grows without end, as a ramp; integral action cannot"
            )
        return (
            "the strip ends on the other side: integral action in the original direction cannot hold a set point, and "
            "drives the voltage to its limit"
        )


@tell_kinds
def set_point(actuator: Actuator, drive: str = "displacement") -> SetPoint:
    """Judge whether a set point can be held, from the static gain and the zeros of the whole drive.

    With one fast mode x1 and one slow mode x2 the drive is ``G [(1 - r) + (tau2 - r tau1) s] / ((1 + tau1 s)(1 +
    tau2 s))``: r < 1 is partial relaxation, r = 1 a zero at the origin; r > 1 with tau2 > r tau1 a zero in the right
    half plane; and r tau1 > tau2 an inverse start.

    Parameters
    ----------
    actuator : Actuator
    drive : "displacement" or "force"

    Returns
    -------
    set_point : SetPoint

    Raises
    ------
    InputError
        Another drive.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> point = set_point(load_actuator("friend-2+relaxation.displacement").replace(
    ...     **{"relaxation.displacement.0.ratio": 1.4}))
    >>> point.kind, point.can_be_held, len(point.right_half_plane)
    ('reversal', False, 1)
    """
    if drive not in DRIVES:
        raise InputError(
            f"no drive is called {drive!r}", code="unknown-drive", where="drive", repair=suggest(drive, DRIVES)
        )
    which: Drive = "force" if drive == "force" else "displacement"
    values = actuator.parameter_values
    system = drive_system(actuator, which)
    ratio = sum(value for name, value in values.items() if _is_ratio(name, which))
    has_modes = any(_is_ratio(name, which) for name in values)
    kind: Kind = "partial" if has_modes else "none"
    if has_modes and ratio > 1.0 - _ROUNDING:
        kind = "washout" if ratio < 1.0 + _ROUNDING else "reversal"
    inverse = bool((system.c @ system.b)[0, 0] < 0.0)
    return SetPoint(
        drive=which,
        ratio=float(ratio),
        kind=kind,
        inverse_start=inverse,
        zeros=_zeros(system),
        inverse_for=_wrong_side(system) if inverse else 0.0,
    )


def drive_system(actuator: Actuator, drive: Drive) -> System:
    """The coupling with all that is in one drive: from the node voltage to that drive [m].

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> drive_system(load_actuator("friend-2"), "force").outputs
    ('force_drive',)
    """
    wanted = actuator.structure.drive_blocks(actuator.parameter_values, drive)
    return assemble(wanted, inputs=("node_voltage",), outputs=[f"{drive}_drive"])


def ratio_names(actuator: Actuator, drive: str) -> tuple[str, ...]:
    """The parameters whose sum is the ratio r of a drive.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> ratio_names(load_actuator("friend-2+relaxation.force=2"), "force")
    ('relaxation.force.0.ratio', 'relaxation.force.1.ratio')
    """
    return tuple(name for name in actuator.parameter_values if _is_ratio(name, drive))


def _is_ratio(name: str, drive: str) -> bool:
    return name.startswith((f"relaxation.{drive}.", f"relaxation.{drive}_pair.")) and name.endswith(".ratio")


def _told(unstable: ComplexArray) -> str:
    nearest = complex(unstable[np.argmin(np.abs(unstable))])
    turning = f" ± {abs(nearest.imag):.4g}j" if nearest.imag else ""
    where = f"at {nearest.real:.4g}{turning} 1/s"
    if len(unstable) == 1:
        return f"a zero lies in the right half plane, {where}"
    return f"{len(unstable)} zeros lie in the right half plane, the nearest {where}"


def _wrong_side(system: System) -> float:
    """When the step response of a drive that starts below 0 first comes above it [s]; infinite where it never does."""
    poles = np.linalg.eigvals(system.a)
    rates = np.abs(poles)
    times = np.geomspace(1e-4 / rates.max(), _SETTLED / np.abs(poles.real).min(), 500)
    turning = np.abs(poles.imag[poles.imag > 1e-9 * rates])
    for rate in turning:  # several in each turn, for as many turns as can matter
        times = np.append(times, np.arange(1, 1000) * (0.2 / rate))
    times = np.unique(times)
    for _ in range(_REFINED):
        above = np.flatnonzero(_step(system, times) > 0.0)
        if not len(above):
            return math.inf
        last = int(above[0])
        times = np.linspace(times[last - 1] if last else 0.0, times[last], 100)[1:]
    return float(times[-1])


def _step(system: System, times: FloatArray) -> FloatArray:
    from ipmclab.model.numerics.discretise import transitions

    drive: FloatArray = transitions([system], times).constant[0, :, :, 0] @ system.c[0]
    return drive


def _zeros(system: System) -> ComplexArray:
    """Where the drive gives nothing: the finite generalised eigenvalues of its system matrix, the smallest first."""
    from scipy.linalg import eigvals

    n = len(system.states)
    slowest = float(np.min(np.abs(np.linalg.eigvals(system.a))))
    pencil = np.zeros((n + 1, n + 1))
    pencil[:n, :n], pencil[:n, n] = system.a, system.b[:, 0]
    pencil[n, :n] = system.c[0] / np.max(np.abs(system.c))
    mass = np.diag([1.0] * n + [0.0])
    above, below = eigvals(pencil, mass, homogeneous_eigvals=True)
    finite = np.abs(below) > 1e-13 * np.abs(above)
    zeros: ComplexArray = above[finite] / below[finite]
    zeros[np.abs(zeros) < _ROUNDING * slowest * n * 100.0] = 0.0
    return _in_order(zeros)


def _in_order(zeros: ComplexArray) -> ComplexArray:
    """The smallest first, in pairs of exact conjugates, of which the one above the real axis comes first."""
    above = sorted(map(complex, zeros[zeros.imag >= 0.0]), key=lambda zero: (float(f"{abs(zero):.9g}"), zero.real))
    found = [each for zero in above for each in ([zero, zero.conjugate()] if zero.imag else [zero])]
    return np.array(found, dtype=np.complex128)
