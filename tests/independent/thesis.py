"""The thesis's equations once more, written without the package: what its results are judged by.

Nothing here is optimised or collapsed. The circuit is written with its node (Fig. 4.3), the
displacement follows from the branch current through 1/s and the equivalent permittivity eta
(Friend, eqs 4.7 and 4.8), the force from V_in - 2 R_e I_in (eq. 4.9). Blocks are joined as dense
matrices and discretised with ``scipy.linalg.expm``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

Array = npt.NDArray[np.float64]

GAMMA = 1.875
OUTPUTS = ("current", "applied_voltage", "displacement", "force")


@dataclass(frozen=True)
class Strip:
    """Tables 4.1 and 4.2 with the appendix's geometry (sample 2), SI units."""

    free_length: float = 25e-3
    clamped_length: float = 5e-3
    width: float = 5e-3
    thickness: float = 0.245e-3
    sensing_length: float = 21e-3
    electrode_resistance: float = 8.0
    contact_resistance: float = 0.0
    dc_resistance: float = 70.92
    resistivities: tuple[float, ...] = (0.35734, 24.2415)
    permittivities: tuple[float, ...] = (0.11998, 0.48106)
    gain: float = 6.79e-9
    zero: float = 210.5
    p1: float = 15.897
    p2: float = 41.097
    density: float = 3965.0
    modulus: float = 1.45e9
    damping_ratio: float = 0.05

    def changed(self, **values: object) -> Strip:
        return replace(self, **values)  # type: ignore[arg-type]

    @property
    def total_length(self) -> float:
        return self.free_length + self.clamped_length

    @property
    def series_resistance(self) -> float:
        return 2.0 * self.electrode_resistance + self.contact_resistance

    @property
    def branch_resistances(self) -> Array:
        return np.array(self.resistivities) * self.thickness / (self.total_length * self.width)

    @property
    def branch_capacitances(self) -> Array:
        return np.array(self.permittivities) * self.total_length * self.width / self.thickness

    @property
    def dc_resistivity(self) -> float:
        return self.dc_resistance * self.total_length * self.width / self.thickness

    @property
    def sheet_resistance(self) -> float:
        return self.electrode_resistance * self.width / self.total_length

    @property
    def natural_frequency(self) -> float:
        """First mode [rad/s], from the beam factor of eq. 4.7."""
        return float(GAMMA**2 * self.thickness / self.free_length**2 * np.sqrt(self.modulus / (12.0 * self.density)))

    def dotted(self) -> dict[str, float]:
        """The same values under the package's parameter names."""
        values = {
            "geometry.free_length": self.free_length,
            "geometry.clamped_length": self.clamped_length,
            "geometry.width": self.width,
            "geometry.thickness": self.thickness,
            "geometry.sensing_length": self.sensing_length,
            "circuit.sheet_resistance": self.sheet_resistance,
            "circuit.contact_resistance": self.contact_resistance,
            "circuit.dc_resistivity": self.dc_resistivity,
            "coupling.gain": self.gain,
            "coupling.zero": self.zero,
            "coupling.p1": self.p1,
            "coupling.p2": self.p2,
            "beam.density": self.density,
            "beam.modulus": self.modulus,
            "beam.damping_ratio": self.damping_ratio,
        }
        for i, (rho, eps) in enumerate(zip(self.resistivities, self.permittivities, strict=True)):
            values[f"circuit.branches.{i}.resistivity"] = rho
            values[f"circuit.branches.{i}.permittivity"] = eps
        return values

    def toml(self, name: str = "strip") -> str:
        """The actuator file of the design, section 4."""
        lines = [
            f'name = "{name}"',
            "[geometry]",
            f'free_length = "{self.free_length!r} m"',
            f'clamped_length = "{self.clamped_length!r} m"',
            f'width = "{self.width!r} m"',
            f'thickness = "{self.thickness!r} m"',
            f'sensing_length = "{self.sensing_length!r} m"',
            "[circuit]",
            f'sheet_resistance = "{self.sheet_resistance!r} ohm"',
            f'contact_resistance = "{self.contact_resistance!r} ohm"',
            f'dc_resistivity = "{self.dc_resistivity!r} ohm m"',
        ]
        for rho, eps in zip(self.resistivities, self.permittivities, strict=True):
            lines += ["[[circuit.branches]]", f'resistivity = "{rho!r} ohm m"', f'permittivity = "{eps!r} F/m"']
        lines += [
            "[coupling]",
            f'gain = "{self.gain!r} m/V/s"',
            f'zero = "{self.zero!r} 1/s"',
            f'p1 = "{self.p1!r} 1/s"',
            f'p2 = "{self.p2!r} 1/s^2"',
            "[beam]",
            f'density = "{self.density!r} kg/m^3"',
            f'modulus = "{self.modulus!r} Pa"',
            f"damping_ratio = {self.damping_ratio!r}",
        ]
        return "\n".join(lines) + "\n"


FRIEND_2 = Strip()

Block = tuple[Array, Array, Array, Array]


def circuit(strip: Strip) -> Block:
    """Voltage to (I_in, V_appl, I_C), with the capacitor voltages as states."""
    resistances, capacitances = strip.branch_resistances, strip.branch_capacitances
    series = strip.series_resistance
    conductance = 1.0 / series + 1.0 / strip.dc_resistance + np.sum(1.0 / resistances)
    node_state = (1.0 / resistances) / conductance
    node_input = 1.0 / series / conductance
    n = len(resistances)
    tau = resistances * capacitances
    a = (np.tile(node_state, (n, 1)) - np.eye(n)) / tau[:, None]
    b = np.full((n, 1), node_input) / tau[:, None]
    branch_state = np.sum((np.tile(node_state, (n, 1)) - np.eye(n)) / resistances[:, None], axis=0)
    branch_input = np.sum(node_input / resistances)
    c = np.vstack([-node_state / series, node_state, branch_state])
    d = np.array([[(1.0 - node_input) / series], [node_input], [branch_input]])
    return a, b, c, d


def charge_over_permittivity(strip: Strip) -> Block:
    """I_C to I_C / (s eta), eq. 4.8: a real integrator, its cancellation is left to happen."""
    times = np.array(strip.resistivities) * np.array(strip.permittivities)
    numerator = np.array([1.0])
    for tau in times:
        numerator = np.polymul(numerator, [tau, 1.0])
    eta_numerator = np.zeros(len(times))
    for i, eps in enumerate(strip.permittivities):
        term = np.array([eps])
        for j, tau in enumerate(times):
            if j != i:
                term = np.polymul(term, [tau, 1.0])
        eta_numerator = np.polyadd(eta_numerator, term)
    return transfer_function(numerator, np.polymul(eta_numerator, [1.0, 0.0]))


def transfer_function(numerator: npt.ArrayLike, denominator: npt.ArrayLike) -> Block:
    """Companion form of a proper rational function (highest power first)."""
    den = np.asarray(denominator, dtype=float)
    num = np.concatenate([np.zeros(len(den) - len(np.atleast_1d(numerator))), np.atleast_1d(numerator)]) / den[0]
    den = den / den[0]
    order = len(den) - 1
    a = np.zeros((order, order))
    a[:-1, 1:] = np.eye(order - 1)
    a[-1] = -den[:0:-1]
    b = np.zeros((order, 1))
    b[-1, 0] = 1.0
    c = (num[1:] - den[1:] * num[0])[::-1].reshape(1, order)
    return a, b, c, np.array([[num[0]]])


def series(first: Block, then: Block) -> Block:
    a1, b1, c1, d1 = first
    a2, b2, c2, d2 = then
    a = np.block([[a1, np.zeros((len(a1), len(a2)))], [b2 @ c1, a2]])
    return a, np.vstack([b1, b2 @ d1]), np.hstack([d2 @ c1, c2]), d2 @ d1


def side_by_side(blocks: list[Block]) -> Block:
    """Several blocks fed by one input, outputs stacked."""
    n = [len(block[0]) for block in blocks]
    a = np.zeros((sum(n), sum(n)))
    c = np.zeros((sum(len(block[2]) for block in blocks), sum(n)))
    row = column = 0
    for block, size in zip(blocks, n, strict=True):
        a[column : column + size, column : column + size] = block[0]
        c[row : row + len(block[2]), column : column + size] = block[2]
        row += len(block[2])
        column += size
    return a, np.vstack([block[1] for block in blocks]), c, np.vstack([block[3] for block in blocks])


def state_space(strip: Strip) -> Block:
    """Voltage to OUTPUTS, as the thesis's Simulink model has it (Fig. 4.4)."""
    electrical = circuit(strip)

    def output_of_circuit(index: int, gain: float) -> Block:
        a, b, c, d = electrical
        return a, b, gain * c[index : index + 1], gain * d[index : index + 1]

    coupling = transfer_function([strip.gain, strip.gain * strip.zero], [1.0, strip.p1, strip.p2])
    wn = strip.natural_frequency
    beam = (
        np.array([[0.0, wn], [-wn, -2.0 * strip.damping_ratio * wn]]),
        np.array([[0.0], [wn]]),
        np.array([[1.0, 0.0]]),
        np.array([[0.0]]),
    )
    strain = 3.0 * strip.sensing_length**2 / (strip.total_length * strip.width * strip.thickness)
    force = 3.0 * strip.thickness * strip.width * strip.modulus / (4.0 * strip.sensing_length)
    displacement_path = series(
        series(series(output_of_circuit(2, strain), charge_over_permittivity(strip)), coupling), beam
    )
    # V_in - 2 R_e I_in of eq. 4.9: a contact resistance drops its part as well.
    force_path = series(output_of_circuit(1, force), coupling)
    return side_by_side([output_of_circuit(0, 1.0), output_of_circuit(1, 1.0), displacement_path, force_path])


def respond(strip: Strip, voltage: npt.ArrayLike, rate: float, hold: str) -> dict[str, Array]:
    """Every output at every row, from rest, by dense matrix exponentials."""
    a, b, c, d = state_space(strip)
    u = np.asarray(voltage, dtype=float)
    n = len(a)
    period = 1.0 / rate
    augmented = np.zeros((n + 2, n + 2))
    augmented[:n, :n] = a * period
    augmented[:n, n] = b[:, 0] * period
    augmented[n, n + 1] = 1.0
    exponential = expm(augmented)
    ad, held, ramp = exponential[:n, :n], exponential[:n, n], exponential[:n, n + 1]
    x = np.zeros(n)
    y = np.empty((len(c), len(u)))
    for k, value in enumerate(u):
        if k:
            if hold == "zero":
                x = ad @ x + held * u[k - 1]
            elif hold == "zero-before":
                x = ad @ x + held * value
            elif hold == "first":
                x = ad @ x + (held - ramp) * u[k - 1] + ramp * value
            else:
                raise ValueError(hold)
        y[:, k] = c @ x + d[:, 0] * value
    return dict(zip(OUTPUTS, y, strict=True))


def admittance_coefficients(log_parameters: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    """(a2, a1, a0, b1, b0) of I/V_in = (a2 s^2 + a1 s + a0)/(s^2 + b1 s + b0) of the two-branch circuit.

    The order of the argument: log of rho_1, rho_2, eps_1, eps_2, rho_dc, R_e. The strip is friend-2's size.
    Polynomials are multiplied out by hand, so that a complex step passes through.
    """
    rho1, rho2, eps1, eps2, rho_dc, electrode = np.exp(log_parameters)
    shape = FRIEND_2.thickness / (FRIEND_2.total_length * FRIEND_2.width)
    t1, t2 = rho1 * eps1, rho2 * eps2
    g0, c1, c2 = 1.0 / (rho_dc * shape), eps1 / shape, eps2 / shape
    # Admittance behind the electrodes: N/D with D = (1 + s t1)(1 + s t2).
    n2 = g0 * t1 * t2 + c1 * t2 + c2 * t1
    n1 = g0 * (t1 + t2) + c1 + c2
    n0 = g0
    d2, d1, d0 = t1 * t2, t1 + t2, 1.0
    r = 2.0 * electrode
    # I/V = N / (D + r N)
    lead = d2 + r * n2
    return np.array([n2 / lead, n1 / lead, n0 / lead, (d1 + r * n1) / lead, (d0 + r * n0) / lead])


def null_direction(strip: Strip = FRIEND_2) -> dict[str, float]:
    """The unit vector in the six log parameters of a two-branch strip along which current tells nothing.

    The derivative of log(coefficients) by a complex step, and the one vector it maps to zero.
    """
    point = np.log(
        np.array(
            [
                *strip.resistivities,
                *strip.permittivities,
                strip.dc_resistivity,
                strip.electrode_resistance,
            ],
            dtype=complex,
        )
    )
    step = 1e-30
    jacobian = np.empty((5, 6))
    for j in range(6):
        moved = point.copy()
        moved[j] += 1j * step
        jacobian[:, j] = np.log(admittance_coefficients(moved)).imag / step
    vector = np.linalg.svd(jacobian)[2][-1]
    names = (
        "circuit.branches.0.resistivity",
        "circuit.branches.1.resistivity",
        "circuit.branches.0.permittivity",
        "circuit.branches.1.permittivity",
        "circuit.dc_resistivity",
        "circuit.sheet_resistance",
    )
    return {name: float(value) for name, value in zip(names, vector * np.sign(vector[0]), strict=True)}


def respond_between_rows(
    strip: Strip, voltage: npt.ArrayLike, time: npt.ArrayLike, delay: float, output: str = "current"
) -> Array:
    """One output when each ``voltage[k]`` acts from ``time[k] + delay`` until ``time[k+1] + delay``.

    From rest with the first voltage 0; ``delay`` is less than one period, either way.
    A reading on an edge sees the new voltage.
    """
    a, b, c, d = state_space(strip)
    row = OUTPUTS.index(output)
    u, t = np.asarray(voltage, dtype=float), np.asarray(time, dtype=float)
    period = t[1] - t[0]
    n = len(a)

    def held(length: float) -> tuple[Array, Array]:
        augmented = np.zeros((n + 1, n + 1))
        augmented[:n, :n], augmented[:n, n] = a * length, b[:, 0] * length
        exponential = expm(augmented)
        return exponential[:n, :n], exponential[:n, n]

    # Between two readings the voltage changes once, `late` after the first of them.
    late = delay % period
    shift = int(np.floor(delay / period))  # 0 for a late strip, -1 for an early one
    before, after = held(late), held(period - late)
    x = np.zeros(n)
    y = np.empty(len(u))

    def commanded(index: int) -> float:
        return float(u[min(max(index, 0), len(u) - 1)])

    for k in range(len(u)):
        if k:
            old, new = commanded(k - 2 - shift), commanded(k - 1 - shift)
            x = before[0] @ x + before[1] * old
            x = after[0] @ x + after[1] * new
        # At reading k the latest edge at or before it belongs to row k - shift (late == 0) or k - 1 - shift.
        seen = commanded(k - shift if late == 0 else k - 1 - shift)
        y[k] = c[row] @ x + d[row, 0] * seen
    return y
