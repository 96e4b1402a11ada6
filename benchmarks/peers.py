"""The same strip by other tools: python-control, SciPy, CasADi, diffrax; the same fit by SciPy and lmfit.

Run ``uv run --with casadi --with diffrax --with lmfit python -m benchmarks.peers [--rounds 31] [--record]``; a tool
that is not installed is left out, and named. One process, candidates take short turns (``harness.interleave``),
processor time. Every candidate is first held against the thesis's equations (1e-4 of the peak of each output); what
integrates does so with a tolerance that just meets this. Each tool is used as its manual does: set up once, then
called; what it compiles is compiled before. A fit must reach the noise floor and give standard errors. ``--record``
draws ``docs/images/speed.svg`` too.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.metadata
import tempfile
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.integrate
import scipy.signal

import ipmclab
from benchmarks.core import RATE, ROWS, compile_modal, minimal_state_space, modal_job
from benchmarks.fit import BOUNDS, SEED, TRUTH, Given
from benchmarks.harness import clock, finish, interleave
from tests.independent.bounds import ELECTRICAL
from tests.independent.thesis import FRIEND_2, OUTPUTS, respond

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "benchmarks/core.py", "benchmarks/fit.py")

Array = npt.NDArray[np.float64]
Candidates = dict[str, Callable[[], Array | ipmclab.Run]]

WITHIN: Final = 1e-4
"""Of the peak of an output, by which a candidate may be off."""

RELATIVE, ABSOLUTE = 1e-7, 1e-14
"""Tolerances of what integrates: with ten times as much some are off by more than that."""

LONG: Final = 10_000_000
LEAK: Final = 3.0
"""Cubic coefficient of the leak [A/V^3/m^2]: that of an actuator's file with ``leak.cubic``."""

PICTURE: Final = Path(__file__).parents[1] / "docs" / "images" / "speed.svg"
TIME: Final = np.arange(ROWS) / RATE


class Strip:
    """The strip as an ordinary differential equation: capacitors, coupling and beam; the node solves an equation."""

    def __init__(self, leak: float) -> None:
        self.leak = leak * FRIEND_2.total_length * FRIEND_2.width
        self.a, self.b, self.c, self.d = minimal_state_space()
        self.series, self.dc = FRIEND_2.series_resistance, FRIEND_2.dc_resistance
        self.resistance = FRIEND_2.branch_resistances
        self.rate = 1.0 / (FRIEND_2.branch_resistances * FRIEND_2.branch_capacitances)
        # Behind the circuit's two states stands what the node drives.
        direct = self.d[1, 0]
        self.motion, self.drive = self.a[2:, 2:], self.b[2:, 0] / direct
        self.seen, self.seen_directly = self.c[2:, 2:], self.d[2:, 0] / direct

    def node(self, voltage: Any, capacitors: Any, sqrt: Any = np.sqrt, cube_root: Any = np.cbrt) -> Any:
        """Of the voltage behind the electrodes: a cubic equation with one solution, by Cardano."""
        conductance = 1.0 / self.series + 1.0 / self.dc + float(np.sum(1.0 / self.resistance))
        given = voltage / self.series + capacitors[0] / self.resistance[0] + capacitors[1] / self.resistance[1]
        if self.leak == 0.0:
            return given / conductance
        third, half = conductance / self.leak / 3.0, 0.5 * given / self.leak
        root = sqrt(half * half + third**3)
        # The second term of Cardano's formula by the first, whose product is known: no difference of near numbers.
        first = cube_root(half + root)
        return first - third / first

    def derivatives(self, voltage: Any, state: Any, stack: Any = np.concatenate, **functions: Any) -> Any:
        """Of the state [1/s]."""
        p = self.node(voltage, state, **functions)
        return stack([self.rate * (p - state[:2]), self.motion @ state[2:] + self.drive * p])

    def outputs(self, voltage: float, states: Array) -> Array:
        """Current, node voltage, displacement and force, from states of shape (n_states, n_time)."""
        p = self.node(voltage, states)
        return np.vstack([(voltage - p) / self.series, p, self.seen @ states[2:] + np.outer(self.seen_directly, p)])


def by_scipy(strip: Strip, voltage: float) -> Array:
    """``solve_ivp`` with LSODA, as one writes it first."""
    found = scipy.integrate.solve_ivp(
        lambda _, state: strip.derivatives(voltage, state),
        (0.0, TIME[-1]),
        np.zeros(len(strip.a)),
        method="LSODA",
        t_eval=TIME,
        rtol=RELATIVE,
        atol=ABSOLUTE,
    )
    return strip.outputs(voltage, found.y)


def by_casadi(strip: Strip, voltage: float) -> Callable[[], Array] | None:
    """CasADi's CVODES over all rows."""
    try:
        import casadi
    except ImportError:
        return None
    state = casadi.SX.sym("x", len(strip.a))
    right = strip.derivatives(
        voltage, state, stack=lambda parts: casadi.vertcat(*parts), sqrt=casadi.sqrt, cube_root=lambda x: x ** (1 / 3)
    )
    options = {"reltol": RELATIVE, "abstol": ABSOLUTE}
    integrator = casadi.integrator("strip", "cvodes", {"x": state, "ode": right}, 0.0, TIME[1:].tolist(), options)

    def call() -> Array:
        states = np.array(integrator(x0=np.zeros(len(strip.a)))["xf"])
        return strip.outputs(voltage, np.column_stack([np.zeros(len(strip.a)), states]))

    return call


def by_diffrax(strip: Strip, voltage: float) -> Callable[[], Array] | None:
    """Diffrax on a processor, in double precision, compiled before."""
    try:
        import diffrax
        import jax
    except ImportError:
        return None
    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    functions = {"stack": jnp.concatenate, "sqrt": jnp.sqrt, "cube_root": jnp.cbrt}
    term = diffrax.ODETerm(lambda _t, state, _args: strip.derivatives(voltage, state, **functions))

    @jax.jit  # type: ignore[misc, unused-ignore]
    def solved(start: Any) -> Any:
        return diffrax.diffeqsolve(
            *(term, diffrax.Kvaerno5(), 0.0, float(TIME[-1]), 1e-4, start),
            saveat=diffrax.SaveAt(ts=jnp.asarray(TIME)),
            stepsize_controller=diffrax.PIDController(rtol=RELATIVE, atol=ABSOLUTE),
            max_steps=100_000,
        ).ys

    return lambda: strip.outputs(voltage, np.asarray(solved(jnp.zeros(len(strip.a)))).T)


def by_control(strip: Strip) -> Callable[[], Array] | None:
    """python-control's ``forced_response`` of the linear strip."""
    try:
        import control
    except ImportError:
        return None
    system, volts = control.ss(strip.a, strip.b, strip.c, strip.d), np.ones(ROWS)
    return lambda: np.asarray(control.forced_response(system, TIME, volts).outputs)


def simulated(actuator: ipmclab.Actuator, voltage: float) -> ipmclab.Run:
    """By the public call, from the signal's text to a run."""
    return ipmclab.simulate(actuator, f"step {voltage:g} V", duration=ROWS / RATE, rate=RATE)


def held_to(expected: Array, candidates: dict[str, Callable[[], Array | ipmclab.Run] | None]) -> Candidates:
    """Those that are there, each right in all outputs."""
    found: Candidates = {}
    for name, candidate in candidates.items():
        if candidate is None:
            print(f"{name} is not installed")
            continue
        given = candidate()
        values = np.stack([getattr(given, output) for output in OUTPUTS]) if isinstance(given, ipmclab.Run) else given
        error = float(np.max(np.max(np.abs(values - expected), axis=1) / np.max(np.abs(expected), axis=1)))
        print(f"{name}: off by {error:.1e} of the peak at most")
        if not error < WITHIN:
            raise SystemExit(f"{name} is off by {error:.1e} of the peak")
        found[name] = candidate
    return found


def records(rounds: int) -> tuple[dict[str, Array], dict[str, Array]]:
    """Times of one record, without and with a leak."""
    linear, leaking = Strip(0.0), Strip(LEAK)
    ours = ipmclab.load_actuator("friend-2")
    system = scipy.signal.StateSpace(linear.a, linear.b, linear.c, linear.d)
    expected = respond(FRIEND_2, np.ones(ROWS), RATE, "zero")
    with tempfile.TemporaryDirectory() as folder:
        modal, outputs, volts = compile_modal(Path(folder)), np.empty((4, ROWS)), np.ones(ROWS)
        job = modal_job(volts, outputs)

        def in_c() -> Array:
            assert modal is not None
            modal(ctypes.byref(job))
            return outputs

        alike = held_to(
            np.stack([expected[name] for name in OUTPUTS]),
            {
                "C, compiled on the spot": in_c if modal else None,
                "ipmclab.simulate": lambda: simulated(ours, 1.0),
                "scipy.signal.lsim": lambda: scipy.signal.lsim(system, np.ones(ROWS), TIME, interp=False)[1].T,
                "control.forced_response": by_control(linear),
                "CasADi (CVODES)": by_casadi(linear, 1.0),
                "diffrax (Kvaerno5)": by_diffrax(linear, 1.0),
                "scipy solve_ivp (LSODA)": lambda: by_scipy(linear, 1.0),
            },
        )
        times = interleave(alike, rounds=rounds)
    with_leak = ipmclab.load_actuator("friend-2+leak.cubic").replace(**{"leak.cubic.cubic": LEAK})
    reference = scipy.integrate.solve_ivp(
        lambda _, state: leaking.derivatives(2.0, state),
        *((0.0, TIME[-1]), np.zeros(6)),
        method="DOP853",
        t_eval=TIME,
        rtol=1e-12,
        atol=1e-18,
        max_step=0.1 / RATE,  # between its steps it is less exact than at them
    )
    nonlinear = held_to(
        leaking.outputs(2.0, reference.y),
        {
            "ipmclab.simulate": lambda: simulated(with_leak, 2.0),
            "CasADi (CVODES)": by_casadi(leaking, 2.0),
            "diffrax (Kvaerno5)": by_diffrax(leaking, 2.0),
            "scipy solve_ivp (LSODA)": lambda: by_scipy(leaking, 2.0),
        },
    )
    return times, interleave(nonlinear, rounds=rounds)


def timed(call: Callable[[], object]) -> float:
    """Of one call [s]."""
    begin = clock()
    call()
    return clock() - begin


def long_records() -> str:
    """Ten million samples: nanoseconds a sample, and the most memory that was taken, over that of four outputs."""
    ours = ipmclab.load_actuator("friend-2")
    lines = ["| samples | candidate | ns a sample | memory / outputs |", "|---|---|---|---|"]
    system = scipy.signal.StateSpace(*minimal_state_space())

    def by_lsim(rows: int) -> object:
        return scipy.signal.lsim(system, np.ones(rows), np.arange(rows) / RATE, interp=False)

    def by_us(rows: int) -> object:
        return ipmclab.simulate(ours, "step 1 V", duration=rows / RATE, rate=RATE)

    tries: tuple[tuple[int, str, Callable[[int], object]], ...] = (
        (LONG, "ipmclab.simulate", by_us),
        (LONG // 10, "scipy.signal.lsim", by_lsim),
    )
    for rows, name, call in tries:
        took = min(timed(partial(call, rows)) for _ in range(3))
        tracemalloc.start()
        call(rows)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        lines.append(f"| {rows:,} | {name} | {1e9 * took / rows:.1f} | {most / (4 * 8 * rows):.2f} |")
    return "\n".join(lines)


def fits(rounds: int) -> dict[str, Array]:
    """Times of the electrical fit of two records, from the same starts, with standard errors."""
    generator = np.random.default_rng(SEED)
    given = Given.drawn(generator)

    def by_least_squares(start: Array) -> tuple[Array, Array]:
        found = given.by_hand(start)
        return found.x, np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))

    def by_lmfit(start: Array) -> tuple[Array, Array]:
        import lmfit

        parameters = lmfit.Parameters()
        for j, value in enumerate(start):
            parameters.add(f"p{j}", value=value, min=BOUNDS[0][j], max=BOUNDS[1][j])
        found = lmfit.minimize(lambda p: given.residual(np.array(list(p.valuesdict().values()))), parameters)
        values = [found.params[f"p{j}"] for j in range(len(start))]
        return np.array([one.value for one in values]), np.array([one.stderr or np.nan for one in values])

    runs = given.runs
    friend = ipmclab.load_actuator("friend-2")

    def by_us(start: Array) -> tuple[Array, Array]:
        actuator = friend.replace(**dict(zip(ELECTRICAL, np.exp(start).tolist(), strict=True)))
        found = ipmclab.identify(actuator, runs, free=["electrical"])
        values = np.array([found.parameters[name].value for name in ELECTRICAL])
        return np.log(values), np.array([found.parameters[name].standard_error for name in ELECTRICAL]) / values

    candidates = {"ipmclab.identify": by_us, "scipy least_squares over lsim": by_least_squares}
    try:
        importlib.metadata.version("lmfit")
    except importlib.metadata.PackageNotFoundError:
        print("lmfit is not installed")
    else:
        candidates["lmfit over lsim"] = by_lmfit
    floor = float(np.sum(given.residual(given.by_hand(TRUTH).x) ** 2))
    times: dict[str, list[float]] = {name: [] for name in candidates}
    missed = dict.fromkeys(candidates, 0)
    by_us(TRUTH)
    for _ in range(rounds):
        start = TRUTH + np.log(10.0) * generator.uniform(-1.0, 1.0, len(TRUTH))
        for name, candidate in candidates.items():
            begin = clock()
            values, errors = candidate(start)
            times[name].append(clock() - begin)
            missed[name] += not (np.sum(given.residual(values) ** 2) < floor + 1.0 and np.all(np.isfinite(errors)))
    for name, count in missed.items():
        print(f"{name}: {count} of {rounds} not at the noise floor, or without standard errors")
    return {name: np.array(one) for name, one in times.items()}


def table(times: dict[str, Array], unit: float, word: str, ours: str) -> str:
    """The median of each, and how many times ours."""
    lines = [f"| candidate | {word} | times `{ours}` (10 to 90 % of rounds) |", "|---|---|---|"]
    for name, values in times.items():
        median, low, high = np.quantile(values / times[ours], [0.5, 0.1, 0.9])
        others = "" if name == ours else f" ({low:.3g} to {high:.3g})"
        took = float(np.median(values)) / unit
        lines.append(f"| {name} | {took:,.{1 if took < 100.0 else 0}f} | {median:.3g}{others} |")
    return "\n".join(lines)


def draw(panels: dict[str, dict[str, Array]]) -> None:
    """A panel for each kind of work: the time of each candidate, on one logarithmic scale."""
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullLocator

    with mpl.rc_context({"svg.hashsalt": "speed", "svg.fonttype": "none", "font.size": 9.0}):
        figure = Figure(figsize=(7.2, 5.2), layout="constrained")
        heights = [len(times) for times in panels.values()]
        for axes, (title, times) in zip(
            figure.subplots(len(panels), 1, sharex=True, height_ratios=heights), panels.items(), strict=True
        ):
            names = list(times)[::-1]
            medians = [float(np.median(times[name])) for name in names]
            colours = ["#0b6bcb" if name.startswith("ipmclab") else "#9aa4b2" for name in names]
            bars = axes.barh(names, medians, color=colours)
            labels = [f"{1e6 * one:.3g} us" if one < 1e-3 else f"{1e3 * one:.3g} ms" for one in medians]
            axes.bar_label(bars, labels, padding=3)
            axes.set_xscale("log")
            axes.set_xlim(1e-6, 2e1)
            axes.xaxis.set_minor_locator(NullLocator())
            axes.set_title(title, loc="left", fontsize=9.5)
            axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("processor time [s]")
        figure.savefig(PICTURE, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=31)
    parser.add_argument(
        "--record", action="store_true", help="write benchmarks/results/peers.md and docs/images/speed.svg"
    )
    options = parser.parse_args()
    linear, leaking = records(options.rounds)
    fitted = fits(options.rounds)
    versions = []
    for name in ("control", "casadi", "diffrax", "jax", "lmfit"):
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{name} not installed")
    body = "\n\n".join(
        [
            f"Processor time, medians of {options.rounds} rounds; {', '.join(versions)}. What is compared, and how "
            "each is held to be right, is said at the head of `benchmarks/peers.py`.",
            f"One record of {ROWS:,} samples of friend-2, a step of 1 V, four outputs:",
            table(linear, 1e-6, "us", "ipmclab.simulate"),
            "The same strip with a cubic leak, a step of 2 V:",
            table(leaking, 1e-6, "us", "ipmclab.simulate"),
            "Long records, linear:",
            long_records(),
            "The electrical fit of two records of 2,000 samples, five parameters with standard errors, each from the "
            "same random starts within a decade:",
            table(fitted, 1e-3, "ms", "ipmclab.identify"),
        ]
    )
    if options.record:
        draw(
            {
                "One record of 2,000 samples, linear": linear,
                "One record of 2,000 samples, with a leak": leaking,
                "The electrical fit of two records": fitted,
            }
        )
    finish("peers", "Beside other tools", body, [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
