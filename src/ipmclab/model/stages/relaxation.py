"""Relaxation: slow modes that oppose the coupling, so that a strip relaxes back under a constant voltage."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from ipmclab.model.blocks import Block, block
from ipmclab.model.parameters import Declaration, Values
from ipmclab.model.stages.kind import LITTLE, Excitation, Numbers, StageKind, Trial, no_trials, number_of
from ipmclab.units import NUMBER, TIME

LARGEST: Final = 1e3
"""Ratios of a strip are of order one; those of two modes that meet grow against each other (convention)."""


def mode_name(drive: str, number: int | str = "") -> str:
    """What the parameters of one slow mode, or of all, begin with.

    Examples
    --------
    >>> mode_name("force", 1)
    'relaxation.force.1.'
    """
    return f"relaxation.{drive}.{number}." if number != "" else f"relaxation.{drive}."


def pair_name(drive: str, number: int) -> str:
    """What the parameters of one pair of slow modes begin with."""
    return f"relaxation.{drive}_pair.{number}."


def mode_ratios(names: Iterable[str], drive: str) -> tuple[str, ...]:
    """Those of some parameters that are ratios of slow modes of a drive.

    Examples
    --------
    >>> mode_ratios(["relaxation.force.0.ratio", "relaxation.force_pair.0.ratio"], "force")
    ('relaxation.force.0.ratio',)
    """
    return tuple(name for name in names if name.startswith(mode_name(drive)) and name.endswith(".ratio"))


def slow_times(names: Iterable[str], drive: str) -> tuple[str, ...]:
    """Those of some parameters that are time constants of slow modes of a drive, and of pairs of them.

    Examples
    --------
    >>> slow_times(["relaxation.force.0.ratio", "relaxation.force_pair.0.time_constant"], "force")
    ('relaxation.force_pair.0.time_constant',)
    """
    begins = mode_name(drive), mode_name(f"{drive}_pair")
    return tuple(name for name in names if name.startswith(begins) and name.endswith(".time_constant"))


@dataclass(frozen=True)
class Relaxation:
    """A drive d(s) V less d(0) times slow modes of the node voltage, each with its ratio r at s = 0.

    A **mode** is r/(1 + tau s). A **pair** is (r + lead s)/(1 + 2 zeta tau s + tau^2 s^2): two real modes where
    zeta > 1, complex ones where zeta < 1, and regular where the two meet. Modes r1, tau1 and r2, tau2 are the pair with
    r = r1 + r2, lead = r1 tau2 + r2 tau1, tau^2 = tau1 tau2 and 2 zeta tau = tau1 + tau2: as the time constants meet,
    r1 and r2 may grow without bound against each other while all four of these stay finite.

    With a single fast mode and one slow mode this is G (x1 - r x2): partial relaxation for r < 1, a zero at the origin
    for r = 1, and for r > 1 a zero in the right half plane where tau2 > r tau1 (see ``set_point``).

    Parameters
    ----------
    drive : "displacement" or "force"
        Each may have its own slow modes; which of them is slower differs between samples.
    modes, pairs : int
    """

    drive: str
    modes: int = 0
    pairs: int = 0

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""
        return (*self._of_modes(), *self._of_pairs())

    def _of_modes(self) -> Iterator[Declaration]:
        for i in range(self.modes):
            name = f"relaxation.{self.drive}.{i}"
            yield Declaration(f"{name}.ratio", NUMBER, f"r_{i + 1}", -math.inf, math.inf, "linear", typical=0.5)
            yield Declaration(f"{name}.time_constant", TIME, f"τ_{i + 1}", 1e-3, 1e6, typical=min(10.0 * 10.0**i, 1e6))

    def _of_pairs(self) -> Iterator[Declaration]:
        for i in range(self.pairs):
            name, slow = f"relaxation.{self.drive}_pair.{i}", min(10.0 * 10.0**i, 1e6)
            yield Declaration(f"{name}.ratio", NUMBER, f"r_p{i + 1}", -math.inf, math.inf, "linear", typical=0.5)
            yield Declaration(f"{name}.lead", TIME, f"l_p{i + 1}", -math.inf, math.inf, "linear", typical=0.5 * slow)
            yield Declaration(f"{name}.time_constant", TIME, f"τ_p{i + 1}", 1e-3, 1e6, typical=slow)
            yield Declaration(f"{name}.damping_ratio", NUMBER, f"ζ_p{i + 1}", 1e-3, 1e4, typical=1.2)

    def block(self, values: Values) -> Block:
        """``fast_..._drive`` and ``node_voltage`` to ``..._drive``.

        Its states are lagged node voltages [V]: one of each mode; of each pair the filtered voltage and tau times its
        rate.
        """
        level = values["coupling.gain"] * values["coupling.zero"] / values["coupling.p2"]
        n = self.modes + 2 * self.pairs
        states: list[str] = []
        a: list[list[complex]] = [[0.0] * n for _ in range(n)]
        b: list[list[complex]] = [[0.0, 0.0] for _ in range(n)]
        weights: list[complex] = []
        for i in range(self.modes):
            name = f"relaxation.{self.drive}.{i}"
            rate = 1.0 / values[f"{name}.time_constant"]
            a[i][i], b[i][1] = -rate, rate
            states.append(f"{name}.lagged_voltage")
            weights.append(values[f"{name}.ratio"])
        for i in range(self.pairs):
            name, first = f"relaxation.{self.drive}_pair.{i}", self.modes + 2 * i
            rate = 1.0 / values[f"{name}.time_constant"]
            second = first + 1
            a[first][second], a[second][first] = rate, -rate
            a[second][second], b[second][1] = -2.0 * values[f"{name}.damping_ratio"] * rate, rate
            states += [f"{name}.lagged_voltage", f"{name}.lagged_voltage_rate"]
            weights += [values[f"{name}.ratio"], values[f"{name}.lead"] * rate]
        return block(
            states=states,
            inputs=[f"fast_{self.drive}_drive", "node_voltage"],
            outputs=[f"{self.drive}_drive"],
            a=a,
            b=b,
            c=[[-level * weight for weight in weights]],
            d=[[1.0, 0.0]],
        )


def _trials(drive: str) -> Callable[[Numbers, Excitation], Iterator[Trial]]:
    def found(values: Numbers, excitation: Excitation) -> Iterator[Trial]:
        name = f"relaxation.{drive}"
        modes = number_of(values, f"{name}.") + number_of(values, f"{name}_pair.")
        for lag in excitation.lags:
            mode = {f"{name}.{modes}.ratio": LITTLE, f"{name}.{modes}.time_constant": lag}
            yield Trial(name if not modes else f"{name}={modes + 1}", mode, both_ways=True, lag=lag)

    return found


def _kinds(drive: str) -> Iterator[StageKind]:
    name = f"relaxation.{drive}"
    modes = StageKind(
        name,
        f"{name}.",
        group="relaxation",
        example=drive == "displacement",
        counted=True,
        compared_as=name,
        outputs=(drive,),
        several_minima=True,
        curved=True,
        off=("ratio",),
        proportional={"ratio": LARGEST},
        shows=f"a {drive} that relaxes back or creeps on",
        to_determine="record at a constant voltage for longer than the slow modes take, and a fast signal too",
        to_show="record for longer at a constant voltage, or with less noise",
        trials=_trials(drive),
        speed=lambda values, name: values[f"{name}.time_constant"],
    )
    yield modes
    yield replace(
        modes,
        name=f"{name}_pair",
        prefix=f"{name}_pair.",
        example=False,
        off=("ratio", "lead"),
        proportional={"ratio": LARGEST, "lead": math.inf},
        held=("damping_ratio",),
        trials=no_trials,
    )


KINDS = (*_kinds("displacement"), *_kinds("force"))
