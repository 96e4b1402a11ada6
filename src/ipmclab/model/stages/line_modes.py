"""Line by modes: an electrode of evenly distributed resistance as lumped circuits side by side, exact but for its tail.

Along a line of length L the voltage obeys u'' = R Y(s) u with the place counted in L, R the resistance of both
electrodes and Y the admittance of its membrane. The source feeds it behind the contact resistance R_f, together with
a membrane m Y that lies at the contacts themselves. Because one Y(s) is everywhere, the modes in space do not
depend on s: cos(k_n (1 - place)) with ``R/R_f = k tan k + m k^2``, and each mode is the lumped circuit of the whole
membrane behind the series resistance R_n = R/k_n^2:

    I(s) = sum W_n Y/(1 + R_n Y) V,    u(place) = sum w_n cos(k_n (1 - place)) V/(1 + R_n Y).

The modes beyond the last that is kept stand together as one more circuit, with the weight that is left and the
mean resistance that is left: sum W_n = 1 + m and sum W_n R_n = R_f (1 + m)^2 + R/3 are known in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from ipmclab.model import geometry
from ipmclab.model.blocks import Block, Matrix
from ipmclab.model.parameters import Values
from ipmclab.model.stages.membrane import membrane

_SERIES: Final = 10
"""Terms of the series below kappa = 1, the last below 1e-17."""

_LEAST: Final = 1e-11
"""Share of the whole below which what is left is rounding and has no mean of its own."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The modes of a line, the last entry of ``resistances`` and ``weights`` the tail.

    Parameters
    ----------
    squares : matrix, shape (count,)
        k_n^2.
    shares : matrix, shape (count,)
        w_n: what a mode adds to the voltage at the open end, with sign.
    norms : matrix, shape (count,)
        Mean square of a mode, what lies at the contacts included.
    resistances : matrix, shape (count + 1,) [ohm]
    weights : matrix, shape (count + 1,)
        W_n: how many times a circuit's current flows.
    line, front, mass : number
        R [ohm], R_f [ohm] and m.
    """

    squares: Matrix
    shares: Matrix
    norms: Matrix
    resistances: Matrix
    weights: Matrix
    line: complex
    front: complex
    mass: complex


def spectrum(values: Values, count: int) -> Spectrum:
    """The first modes of a line and what is left of the others."""
    length = geometry.line_length(values)
    line = geometry.electrodes(values, length)
    front = values["circuit.contact_resistance"]
    mass = geometry.direct_length(values) / length
    squares = _squares(line, front, mass, count)
    cosine, sine, _ = _entire(squares)
    overlap = sine + mass * cosine
    norms = 0.5 * (1.0 + sine * cosine) + mass * cosine**2
    resistances = line / squares
    weights = overlap**2 / norms
    weight = 1.0 + mass - np.sum(weights)
    drop = front * (1.0 + mass) ** 2 + line / 3.0
    left = drop - np.sum(weights * resistances)
    mean = 0.5 * line / (count * np.pi) ** 2
    if weight.real > _LEAST * (1.0 + mass).real and left.real > _LEAST * drop.real:
        mean = left / weight
    return Spectrum(
        squares=squares,
        shares=overlap / norms,
        norms=norms,
        resistances=np.append(resistances, mean),
        weights=np.append(weights, weight),
        line=line,
        front=front,
        mass=mass,
    )


@dataclass(frozen=True, eq=False)
class Reading:
    """A linear reading of the voltage along the line: ``sum modes_n u_n + direct V - drop I``.

    u_n are the voltages behind the resistances of the kept modes and I is the current of the tail's circuit: the tail
    of a reading differs from that of the current, and so takes its own two sums along.

    Parameters
    ----------
    modes : matrix, shape (..., count)
    direct, drop : matrix, shape (...) [1 and ohm]
    """

    modes: Matrix
    direct: Matrix
    drop: Matrix


def mean(values: Values, of: Spectrum) -> tuple[Reading, Matrix]:
    """The mean that moves the sensing point, (2/L_s^2) int_0^Ls (L_s - x) u(x) dx, and that of each mode."""
    length, sensing = geometry.line_length(values), values["geometry.sensing_length"]
    lead, reach = (length - values["geometry.free_length"]) / length, sensing / length
    kappa, back = of.squares, 1.0 - lead
    cosine, sine, _ = _entire(kappa * back**2)
    _, _, rest = _entire(kappa * reach**2)
    _, half, _ = _entire(0.25 * kappa * reach**2)
    modes = 2.0 * kappa * back * reach * sine * rest + cosine * half**2
    place = lead + reach / 3.0
    square = lead**2 + 2.0 * lead * reach / 3.0 + reach**2 / 6.0
    return _reading(of, modes, place - 0.5 * square), modes


def at(values: Values, of: Spectrum, positions: Matrix) -> Reading:
    """The voltage at some places [m from the clamp's edge], shape (n_positions,)."""
    length = geometry.line_length(values)
    place = (length - values["geometry.free_length"] + np.asarray(positions)) / length
    cosine, _, _ = _entire(of.squares * (1.0 - place[:, None]) ** 2)
    return _reading(of, cosine, place - 0.5 * place**2)


def _reading(of: Spectrum, modes: Matrix, slope: Matrix | complex) -> Reading:
    """``slope`` is the same reading of place - place^2/2, the shape of the drop along the line at low frequency."""
    own = of.shares * modes
    drop = of.front * (1.0 + of.mass) + of.line * slope
    return Reading(own, 1.0 - own.sum(axis=-1), drop - (own * of.resistances[:-1]).sum(axis=-1))


def block(values: Values, branches: int, count: int, *, along: bool) -> Block:
    """``voltage`` to ``current`` and ``node_voltage``; ``along`` gives the modes' voltages and the tail's current."""
    found = spectrum(values, count)
    own = membrane(values, branches, geometry.line_length(values))
    pulls, rates = np.array(own.branches), np.array(own.rates)
    series = found.resistances
    loaded = 1.0 / (1.0 + series * own.at_once)
    n = (count + 1) * branches
    kind = np.result_type(float, series, pulls, rates, loaded)
    # Each circuit: its node u = (V + R sum g v)/(1 + R g_all), its current (g_all V - sum g v)/(1 + R g_all).
    from_state = np.zeros((count + 1, n), kind)
    drawn = np.zeros((count + 1, n), kind)
    for place in range(count + 1):
        columns = slice(place * branches, (place + 1) * branches)
        from_state[place, columns] = series[place] * loaded[place] * pulls
        drawn[place, columns] = -loaded[place] * pulls
    to_states = np.repeat(np.eye(count + 1), branches, axis=0) * np.tile(rates, count + 1)[:, None]
    reading, _ = mean(values, found)
    every = np.append(reading.modes, 0.0)
    rows = [found.weights @ drawn, every @ from_state - reading.drop * drawn[-1]]
    direct = [
        own.at_once * (found.weights @ loaded),
        every @ loaded + reading.direct - reading.drop * own.at_once * loaded[-1],
    ]
    ports = ["current", "node_voltage"]
    if along:
        ports += [*(f"node_voltage.{i}" for i in range(count)), "tail_current"]
        rows += [*from_state[:-1], drawn[-1]]
        direct += [*loaded[:-1], own.at_once * loaded[-1]]
    return Block(
        states=tuple(f"line.modes.{j}.branches.{i}.voltage" for j in range(count + 1) for i in range(branches)),
        inputs=("voltage",),
        outputs=tuple(ports),
        a=to_states @ from_state - np.diag(np.tile(rates, count + 1)),
        b=to_states @ loaded[:, None],
        c=np.array(rows),
        d=np.array(direct)[:, None],
    )


def error_bound(values: Values, branches: int, count: int) -> tuple[float, float]:
    """How far the tail can put the current [A] and the mean node voltage [V] off, for each volt of the largest voltage.

    With A_n = Y/(1 + R_n Y) and T for the tail's one circuit, partial fractions give the difference between the true
    tail and that circuit exactly: ``sum W_n (R_n - R_T)^2 A_n A_T^2 - (sum W_n (R_n - R_T)) A_T^2`` for the current,
    whose second part is 0 where R_T is the mean, and ``sum q_n R_n (R_n - R_T) A_n A_T`` for the mean voltage.

    The impulse response of A_n is its conductance at once, g/(1 + R_n g), less decaying exponentials that together
    take at most as much away again: a voltage within 1 V, whatever its course, draws at no time more than
    2 g/(1 + R_n g). Each factor A of the difference so costs twice its conductance. The sums are closed,
    sum W_n R_n^2 = R_f^2 (1 + m)^3 + 2 R_f (1 + m) R/3 + 2 R^2/15; that of the mean voltage follows by Cauchy and
    Schwarz from sum mu_n^2/N_n = 4 L/(3 L_s), with mu_n the mean and N_n the mean square of a mode.
    """
    found = spectrum(values, count)
    line, front, whole = (complex(part).real for part in (found.line, found.front, 1.0 + found.mass))
    weights, resistances = found.weights.real, found.resistances.real
    kept, tail = resistances[:-1], resistances[-1]
    squares = front**2 * whole**3 + 2.0 * front * whole * line / 3.0 + 2.0 * line**2 / 15.0
    drop = front * whole**2 + line / 3.0
    rounding = 1e-15 * count
    left = [
        max(total - float(np.sum(weights[:-1] * kept**power)), 0.0) + rounding * total
        for power, total in enumerate((whole, drop, squares))
    ]
    off = abs(left[1] - tail * left[0]) + rounding * drop
    spread = max(left[2] - 2.0 * tail * left[1] + tail**2 * left[0], rounding * squares)
    own = membrane(values, branches, geometry.line_length(values))
    at_once = complex(own.at_once).real
    at_tail = at_once / (1.0 + tail * at_once)
    _, means = mean(values, found)
    reach = complex(values["geometry.sensing_length"] / geometry.line_length(values)).real
    beyond = max(4.0 / (3.0 * reach) - float(np.sum(means.real**2 / found.norms.real)), 0.0)
    largest = line / ((count - 0.5) * np.pi) ** 2  # no mode of the tail has more
    return (
        float(8.0 * spread * at_once * at_tail**2 + 4.0 * off * at_tail**2),
        float(4.0 * at_once * at_tail * largest * np.sqrt(beyond * spread)),
    )


def _squares(line: complex, front: complex, mass: complex, count: int) -> Matrix:
    """k^2 of the first modes: one for each n, with k between (n - 1/2) pi and (n + 1/2) pi."""
    kappa = _roots(complex(line).real, complex(front).real, complex(mass).real, count)
    # One step more with the numbers as they come: it carries the derivative where they are complex.
    value, slope = _boundary(kappa, line, front, mass)
    squares: Matrix = kappa - value / slope
    return squares


@lru_cache(maxsize=16)
def _roots(line: float, front: float, mass: float, count: int) -> Matrix:
    """The same of real numbers, kept: a complex step of any parameter asks for them again."""
    n = np.arange(count)
    low, high = np.maximum((n - 0.5) * np.pi, 0.0) ** 2, ((n + 0.5) * np.pi) ** 2
    sign = 1.0 - 2.0 * (n % 2)
    kappa = 0.5 * (low + high)
    for _ in range(100):
        value, slope = _boundary(kappa, line, front, mass)
        low, high = np.where(sign * value < 0.0, kappa, low), np.where(sign * value < 0.0, high, kappa)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = kappa - value / slope
        following = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        done = np.all(np.abs(following - kappa) <= 1e-12 * following)
        kappa = following
        if done:
            break
    kappa.setflags(write=False)
    roots: Matrix = kappa
    return roots


def _boundary(kappa: Matrix, line: complex, front: complex, mass: complex) -> tuple[Matrix, Matrix]:
    """R_f (k sin k + m k^2 cos k) - R cos k as a function of k^2, and its derivative."""
    cosine, sine, _ = _entire(kappa)
    value = front * kappa * (sine + mass * cosine) - line * cosine
    slope = front * (0.5 * (sine + cosine) + mass * cosine - 0.5 * mass * kappa * sine) + 0.5 * line * sine
    return value, slope


def _entire(kappa: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """cos k, sin k/k and (k - sin k)/k^3 as functions of kappa = k^2, which have no root in them."""
    small = kappa.real < 1.0
    far = np.where(small, 1.0, kappa)
    root = np.sqrt(far)
    cosine, sine = np.cos(root), np.sin(root) / root
    rest = (1.0 - sine) / far
    if np.any(small):
        z = -kappa[small]
        for power, found in zip((0, 1, 3), (cosine, sine, rest), strict=True):
            total = np.ones_like(z)
            for j in range(_SERIES, 0, -1):
                total = 1.0 + total * z / ((2 * j + power - 1) * (2 * j + power))
            found[small] = total / 6.0 if power == 3 else total
    return cosine, sine, rest
