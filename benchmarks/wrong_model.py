"""Fits of models that are not complete, beside plain least squares of the same circuit.

Run ``python -m benchmarks.wrong_model [--trials 100] [--record]``; ``IPMCLAB_REAL_RUNS`` names the real records. No
model of a strip is complete. What is asked here is whether the free-running prediction of the fit is as near to the
readings as what a user writes in ten lines: bounded least squares of the same circuit from six starts, its sheet
resistance and the zero of the current free, the voltage taken as it is recorded.

Real: the current of four records, 5 s before to 60 s after the contact, two and three branches; then fitted up to 30 s
(15 s) and predicted to 60 s (30 s), with the share of readings that lie in the 80 and 95 % bands. Simulated: strips
drawn about friend-2 by a factor of 3 each way, with one branch more than the fit has, a leak, electrodes as a line, or
a contact whose resistance grows once by 1 to 10 ohm; a step of 0.5 to 2.5 V from 5 s on, 40 s, 10 to 100 S/s, white
noise of 0 to 0.03 mA, readings rounded to 0 to 0.1 mA, the hold known or not; two branches are fitted. Of a sixth of
them the displacement is read, which has one slow mode more than the fit (noise 0 to 3 um, rounded to 0 to 10 um, the
circuit known), beside least squares of as many real poles with residues of any size and the zero free. Seed 20261122.

Waves: the current of a strip whose capacitance is spread over all time constants (a constant phase element, in parallel
with the dc path and behind a resistance; of two fifths a leak beside it), which no number of branches is: under a sine,
a square wave, a triangle, five sines, stairs, a step and one that ends, from the first row or after 1 to 5 s, with a
zero of the sensor of 2 % of the range or none, 10 to 50 S/s, 20 to 100 s, noise of 0.01 or 0.1 % of the range. Two and
three branches are fitted. Plain least squares knows that there is no zero where rows at 0 V show it.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.optimize
import scipy.signal

import ipmclab
from benchmarks.harness import finish
from benchmarks.real_records import StepRecord, records
from ipmclab.model import simulate_outputs
from ipmclab.model.variants import with_stages

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "src/ipmclab/prediction",
)
SEED = 20261122
FREE = ("electrical", "circuit.sheet_resistance")
WORST_DRAWN = 1.1
EXACT = 1e-14  # A or m: a millionth of what any bench resolves
LEVELS = 0.80, 0.95
SEEN = 30.0, 15.0  # s, of which fits predict as many again
Array = npt.NDArray[np.float64]


def circuit_current(entries: Array, voltage: Array, period: float) -> Array:
    """Current of R + (R_dc || RC || RC ...), the voltage held from row to row; entries are logarithms [ohm, F]."""
    series, leak = np.exp(entries[:2])
    resistances, capacitances = np.exp(entries[2::2]), np.exp(entries[3::2])
    conductances = 1.0 / resistances
    total = 1.0 / series + 1.0 / leak + conductances.sum()
    # The node's voltage is (v / R + sum u_i / R_i) / total; each capacitor has C_i u_i' = (node - u_i) / R_i.
    scale = 1.0 / np.sqrt(capacitances)
    inner = scale[:, None] * (np.outer(conductances, conductances) / total - np.diag(conductances)) * scale
    rates, vectors = np.linalg.eigh(inner)
    drive = vectors.T @ (scale * conductances / (series * total))
    decays = np.exp(rates * period)
    current = voltage / series - voltage / (series**2 * total)
    for decay, rate, gain, seen in zip(decays, rates, drive, drive, strict=True):
        state = scipy.signal.lfilter([0.0, (decay - 1.0) / rate * gain], [1.0, -decay], voltage)
        current = current - seen * state
    return np.asarray(current)


def plain_fit(
    voltage: Array, current: Array, period: float, branches: int, used: npt.NDArray[np.bool_], most: float = 1.0
) -> Array:
    """Bounded least squares from six starts: the entries, and last the zero [mA], which is ``most`` [A] at most."""
    steady = float(np.abs(voltage).max() / max(np.abs(current[used][-20:]).mean(), 1e-6))
    first = float(np.abs(voltage).max() / max(np.abs(current[used]).max(), 1e-6))
    lower = np.log([1e-1, 1e1, *[1e-1, 1e-6] * branches])
    upper = np.log([1e4, 1e7, *[1e6, 1e2] * branches])
    generator = np.random.default_rng(1)

    def residual(point: Array) -> Array:
        return np.asarray(1e3 * (circuit_current(point[:-1], voltage, period) + 1e-3 * point[-1] - current)[used])

    best: scipy.optimize.OptimizeResult | None = None
    for _ in range(6):
        times = np.sort(np.exp(generator.uniform(np.log(4 * period), np.log(20.0), branches)))
        resistances = np.geomspace(first, 10 * first, branches) * np.exp(generator.uniform(-0.5, 0.5, branches))
        start = [np.log(0.7 * first), np.log(steady)]
        for resistance, constant in zip(resistances, times, strict=True):
            start += [np.log(resistance), np.log(constant / resistance)]
        begin = np.append(np.clip(start, lower + 1e-3, upper - 1e-3), 0.0)
        found = scipy.optimize.least_squares(
            residual,
            begin,
            bounds=(np.append(lower, -1e3 * most), np.append(upper, 1e3 * most)),
            x_scale="jac",
            max_nfev=200,
        )
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    return np.asarray(best.x)


@dataclass(frozen=True)
class Compared:
    """Root mean square of what is left [A or m]: by ``identify``, and by plain least squares; and the times [s]."""

    left: float
    plain: float
    seconds: float

    @property
    def ratio(self) -> float:
        """Of both; 1 where each is rounding, as of a leak too small to show in readings without noise."""
        return max(self.left, EXACT) / max(self.plain, EXACT)


FINE = 16
"""Parts of a row in which the node's voltage is straight: over a row it is not, where the applied voltage steps."""


def poles_left(node: Array, readings: Array, rate: float, count: int) -> float:
    """What real poles of the node's voltage, with residues of any size and a zero, leave at best of some readings.

    The voltage is given ``FINE`` times as often as the readings.
    """
    period = 1.0 / (FINE * rate)
    lower, upper = np.log(1e-3 / (len(node) * period)), np.log(30.0 * rate)
    generator = np.random.default_rng(1)

    def residual(point: Array) -> Array:
        columns = [np.ones(len(readings))]
        for pole in np.exp(point):
            step = pole * period
            first = -np.expm1(-step) / step
            second = (1.0 - first) / step
            moved = period * ((first - second) * node[:-1] + second * node[1:])
            columns.append(np.append(0.0, scipy.signal.lfilter([1.0], [1.0, -np.exp(-step)], moved))[::FINE])
        table = np.column_stack(columns)
        size = np.linalg.norm(table, axis=0)
        table = table / np.where(size > 0.0, size, 1.0)
        return np.asarray(table @ np.linalg.lstsq(table, readings, rcond=1e-12)[0] - readings)

    scale = float(np.ptp(readings))
    found = [
        scipy.optimize.least_squares(
            lambda point: residual(point) / scale,
            np.sort(generator.uniform(np.log(0.3 / (len(node) * period)), np.log(rate), count)),
            bounds=(lower, upper),
            max_nfev=200,
        )
        for _ in range(6)
    ]
    best = min(found, key=lambda one: one.cost)
    return scale * float(np.sqrt(2.0 * best.cost / len(readings)))


def compared_motion(run: ipmclab.Run, actuator: ipmclab.Actuator) -> Compared:
    """A fit of the displacement, its circuit known, beside as many real poles."""
    assert run.displacement is not None
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = ipmclab.identify(actuator, run, free=("coupling", "relaxation"))
    seconds = time.perf_counter() - begin
    left = float(np.sqrt(np.mean(fit.residuals[0]["displacement"] ** 2)))
    time_of = np.arange(FINE * (len(run) - 1) + 1) / (FINE * run.rate)
    voltage = np.repeat(run.voltage, FINE)[: len(time_of)]
    node = np.asarray(simulate_outputs(actuator, time_of, voltage, "zero", outputs=["applied_voltage"])[0])
    return Compared(left, poles_left(node, run.displacement, run.rate, 3), seconds)


def compared(run: ipmclab.Run, actuator: ipmclab.Actuator, branches: int) -> Compared:
    """One fit beside plain least squares."""
    assert run.current is not None
    used = np.isfinite(run.current)
    current = np.where(used, run.current, 0.0)
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = ipmclab.identify(actuator, run, free=FREE)
    seconds = time.perf_counter() - begin
    seen = np.isfinite(fit.residuals[0]["current"])
    left = float(np.sqrt(np.mean(fit.residuals[0]["current"][seen] ** 2)))
    point = plain_fit(run.voltage, current, 1.0 / run.rate, branches, seen)
    away = circuit_current(point[:-1], run.voltage, 1.0 / run.rate) + 1e-3 * point[-1] - current
    return Compared(left, float(np.sqrt(np.mean(away[seen] ** 2))), seconds)


def cut_out(record: StepRecord, last: float) -> ipmclab.Run:
    """The current of a record from 5 s before the contact on."""
    rows = record.rows(-5.0, last)
    assert record.run.current is not None
    current = np.where(record.usable("current")[rows], record.run.current[rows], np.nan)
    # Before the contact no voltage is at the strip.
    on = np.arange(len(record.run.time))[rows] >= record.contact
    time_of = record.run.time[rows] - record.run.time[rows][0]
    return ipmclab.Run.from_arrays(time=time_of, voltage=np.where(on, record.run.voltage[rows], 0.0), current=current)


def predicted(
    record: StepRecord, actuator: ipmclab.Actuator, branches: int, seen: float = 30.0
) -> tuple[Compared, tuple[float, float]]:
    """The same for as many seconds again, of fits that saw so many; and the shares inside the 80 and 95 % bands."""
    whole, first = cut_out(record, 2.0 * seen), cut_out(record, seen)
    assert first.current is not None
    assert whole.current is not None
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = ipmclab.identify(actuator, first, free=FREE)
        found = ipmclab.validate(fit.actuator, whole).runs[0].comparisons["current"]
    seconds = time.perf_counter() - begin
    used = np.isfinite(first.current)
    point = plain_fit(first.voltage, np.where(used, first.current, 0.0), 1.0 / first.rate, branches, used)
    plain = circuit_current(point[:-1], whole.voltage, 1.0 / whole.rate) + 1e-3 * point[-1] - whole.current
    later = found.used & (np.arange(len(whole)) >= len(first))
    left = found.error[later]
    bands = ipmclab.prediction_bands(fit, whole)
    of_80, of_95 = (float(np.mean(np.abs(left) <= bands.reach("current", level)[later])) for level in LEVELS)
    rms = float(np.sqrt(np.mean(left**2))), float(np.sqrt(np.mean(plain[later] ** 2)))
    return Compared(*rms, seconds), (of_80, of_95)


STAGES = {
    "one more branch": "branches=3",
    "cubic leak": "leak.cubic",
    "exponential leak": "leak.exponential",
    "electrodes as a line": "line.segments=10",
    "another contact": "branches=2",
    "one more slow mode": "relaxation.displacement=2",
}
MOTION = "one more slow mode"


def drawn(generator: np.random.Generator) -> tuple[str, ipmclab.Actuator, ipmclab.Run]:
    """A strip with more than the model knows, the actuator that is fitted to it, and its readings."""
    kind = str(generator.choice(list(STAGES)))
    strip = with_stages(ipmclab.load_actuator("friend-2"), STAGES[kind])
    about = np.log(3.0)
    free = ("circuit.", "leak.", "coupling.", "relaxation.")
    moved = [name for name in strip.parameter_values if name.startswith(free) and strip[name] > 0.0]
    strip = strip.replace(**{name: strip[name] * np.exp(generator.uniform(-about, about)) for name in moved})
    rate, volts = float(generator.choice([10.0, 25.0, 50.0, 100.0])), float(generator.uniform(0.5, 2.5))
    clean = ipmclab.simulate(strip, f"step {volts:.4g} V delay=5 s", duration=40, rate=rate)
    output, unit = ("displacement", 0.1) if kind == MOTION else ("current", 1.0)
    readings = getattr(clean, output)
    if kind == "another contact":
        readings = touched(strip, clean, generator)
    readings = readings + unit * generator.choice([0.0, 3e-6, 3e-5]) * generator.standard_normal(len(clean))
    step = unit * float(generator.choice([0.0, 1e-6, 1e-5, 1e-4]))
    readings = np.round(readings / step) * step if step else readings
    hold = clean.hold if generator.random() < 0.5 else "unknown"
    run = ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, hold=hold, **{output: readings})
    fitted = ipmclab.load_actuator("friend-2")
    if kind == MOTION:
        circuit = {name: value for name, value in strip.parameter_values.items() if name.startswith("circuit.")}
        fitted = with_stages(fitted, "relaxation.displacement=1").replace(**circuit)
    return kind, fitted, run


def touched(strip: ipmclab.Actuator, clean: ipmclab.Run, generator: np.random.Generator) -> Array:
    """The current of a strip whose contact is another from some row on; its capacitors keep their charge."""
    row = int(generator.uniform(0.25, 0.9) * len(clean))
    more = float(np.exp(generator.uniform(0.0, np.log(10.0))))
    before = strip.simulator(clean.rate, clean.hold)
    first = before.block(clean.voltage[:row])[0]
    other = strip.replace(**{"circuit.contact_resistance": strip["circuit.contact_resistance"] + more})
    after = other.simulator(clean.rate, clean.hold, initial_state=before.state)
    return np.concatenate([first, after.block(clean.voltage[row:])[0]])


WAVES = ("sine", "square", "multisine", "triangle", "stairs", "stepped down", "step")
SPREAD = np.geomspace(3e-3, 300.0, 24)  # s, time constants of what stands for a constant phase element


def spread_circuit(series: float, leak: float, exponent: float, capacitance: float) -> Array:
    """Entries of a circuit whose branches stand for a constant phase element: some hold more as they are slower."""
    capacitances = 0.3 * capacitance * (SPREAD / 10.0) ** (1.0 - exponent)
    branches = np.column_stack([SPREAD / capacitances, capacitances])
    return np.log(np.concatenate([[series, leak], branches.ravel()]))


def waved(number: int) -> tuple[bool, ipmclab.Run]:
    """A record of a strip whose capacitance is spread over all time constants; and whether it may have a zero."""
    generator = np.random.default_rng([SEED, number])
    kind = WAVES[number % len(WAVES)]
    rate, lasts = float(generator.choice([10.0, 20.0, 25.0, 50.0])), float(generator.choice([20.0, 40.0, 60.0, 100.0]))
    time_of = np.arange(int(rate * lasts) + 1) / rate
    volts, rest = generator.uniform(0.5, 3.0), float(generator.choice([0.0, 1.0, 2.0, 5.0]))
    slow, fast = 2.0 * np.pi * generator.uniform(0.02, 0.3), 2.0 * np.pi * generator.uniform(0.05, 1.0)
    phases = generator.uniform(0.0, 2.0 * np.pi, 5)
    tones = np.geomspace(0.05, min(3.0, rate / 5.0), 5)
    since = time_of - rest
    shape = {
        "sine": np.sin(fast * since),
        "square": np.sign(np.sin(slow * since + 1e-9)),
        "multisine": np.sin(2.0 * np.pi * np.outer(since, tones) + phases).sum(axis=1) / 3.0,
        "triangle": scipy.signal.sawtooth(slow * since + 0.5 * np.pi, 0.5),
        "stairs": np.clip(np.ceil((since + 1e-9) / (0.2 * lasts)), 0.0, 4.0) / 4.0,
        "stepped down": np.where(since < 0.5 * lasts, 1.0, 0.0),
        "step": np.ones_like(since),
    }[kind]
    voltage = volts * shape * (since >= 0.0)
    exponent, series = generator.uniform(0.5, 0.95), np.exp(generator.uniform(np.log(5.0), np.log(60.0)))
    capacitance = np.exp(generator.uniform(np.log(2e-3), np.log(0.2)))
    leak = np.exp(generator.uniform(np.log(100.0), np.log(5000.0)))
    entries = spread_circuit(series, leak, exponent, capacitance)
    current = circuit_current(entries, voltage, 1.0 / rate)
    if generator.random() < 0.4:
        node = voltage - series * current
        current = current + generator.uniform(5e-6, 1e-4) * np.sinh(node / generator.uniform(0.5, 1.5))
    size = float(np.ptp(current))
    noise = float(generator.choice([1e-4, 1e-3])) * size * generator.standard_normal(len(time_of))
    zero = float(generator.choice([0.0, 0.02])) * size
    run = ipmclab.Run.from_arrays(time=time_of, voltage=voltage, current=current + noise + zero, hold="zero")
    return bool(zero or not rest), run


def compared_wave(run: ipmclab.Run, branches: int, *, may_have_zero: bool) -> Compared:
    """A fit of one of these beside plain least squares, which takes the zero for none where it is, and rows show it."""
    assert run.current is not None
    actuator = with_stages(ipmclab.load_actuator("friend-2"), *(["branches=3"] if branches == 3 else []))
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = ipmclab.identify(actuator, run, free=FREE)
    seconds = time.perf_counter() - begin
    left = float(np.sqrt(np.mean(fit.residuals[0]["current"] ** 2)))
    most = 1.0 if may_have_zero else 1e-12
    point = plain_fit(run.voltage, run.current, 1.0 / run.rate, branches, np.ones(len(run), dtype=bool), most)
    away = circuit_current(point[:-1], run.voltage, 1.0 / run.rate) + 1e-3 * point[-1] - run.current
    return Compared(left, float(np.sqrt(np.mean(away**2))), seconds)


def real_part() -> list[str]:
    """The table of the real records."""
    two = ipmclab.load_actuator("friend-2")
    actuators = {2: two, 3: with_stages(two, "branches=3")}
    lines = ["| record | branches | fit, mA | plain, mA | ratio | time |", "|---|---|---|---|---|---|"]
    found = records()
    for name, record in found.items():
        for branches, actuator in actuators.items():
            one = compared(cut_out(record, 60.0), actuator, branches)
            lines.append(
                f"| {name} | {branches} | {1e3 * one.left:.4f} | {1e3 * one.plain:.4f} | {one.ratio:.3f} | "
                f"{one.seconds:.1f} s |"
            )
            print(lines[-1], flush=True)
    for seen in SEEN:
        lines += [
            "",
            f"| the next {seen:g} s | branches | fit, mA | plain, mA | ratio | in the 80 % band | in the 95 % band |",
            "|---|---|---|---|---|---|---|",
        ]
        shares = []
        for name, record in found.items():
            for branches, actuator in actuators.items():
                after, inside = predicted(record, actuator, branches, seen)
                shares.append(inside)
                lines.append(
                    f"| {name} | {branches} | {1e3 * after.left:.3f} | {1e3 * after.plain:.3f} | {after.ratio:.2f} | "
                    f"{100 * inside[0]:.0f} % | {100 * inside[1]:.0f} % |"
                )
                print(lines[-1], flush=True)
        pooled = 100.0 * np.mean(shares, axis=0)
        lines.append(f"| all | | | | | {pooled[0]:.1f} % | {pooled[1]:.1f} % |")
    return lines


def drawn_part(trials: int) -> list[str]:
    """The table of simulated strips."""
    generator = np.random.default_rng(SEED)
    ratios: dict[str, list[float]] = {}
    seconds: list[float] = []
    for number in range(trials):
        kind, actuator, run = drawn(generator)
        one = compared_motion(run, actuator) if kind == MOTION else compared(run, actuator, 2)
        ratios.setdefault(kind, []).append(one.ratio)
        seconds.append(one.seconds)
        print(f"{number + 1} of {trials}: {kind}, {one.ratio:.3f}, {one.seconds:.1f} s", flush=True)
    lines = [
        "| truth has | strips | median ratio | 95 % | largest | above 1.1 |",
        "|---|---|---|---|---|---|",
    ]
    for kind, found in sorted(ratios.items()):
        values = np.array(found)
        lines.append(
            f"| {kind} | {len(values)} | {np.median(values):.3f} | {np.quantile(values, 0.95):.3f} | "
            f"{values.max():.3f} | {int((values > WORST_DRAWN).sum())} |"
        )
    return [
        *lines,
        "",
        f"Time of a fit: median {np.median(seconds):.1f} s, 95 % below {np.quantile(seconds, 0.95):.1f} s.",
    ]


def waves_part(trials: int) -> list[str]:
    """The table of waves."""
    lines = [
        "| wave | branches | records | median ratio | 95 % | largest | above 1.1 |",
        "|---|---|---|---|---|---|---|",
    ]
    ratios: dict[tuple[str, int], list[float]] = {}
    for number in range(trials):
        for branches in (2, 3):
            may_have_zero, run = waved(number)
            one = compared_wave(run, branches, may_have_zero=may_have_zero)
            kind = WAVES[number % len(WAVES)]
            ratios.setdefault((kind, branches), []).append(one.ratio)
            print(
                f"wave {number + 1} of {trials}: {kind}, {branches}, {one.ratio:.3f}, {one.seconds:.1f} s", flush=True
            )
    for (kind, branches), found in ratios.items():
        values = np.array(found)
        lines.append(
            f"| {kind} | {branches} | {len(values)} | {np.median(values):.3f} | {np.quantile(values, 0.95):.3f} | "
            f"{values.max():.3f} | {int((values > WORST_DRAWN).sum())} |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/wrong_model.md")
    options = parser.parse_args()
    body = ["## Real records", "", *real_part(), "", "## Simulated strips", "", *drawn_part(options.trials)]
    body += ["", "## Waves", "", *waves_part(options.trials)]
    finish(
        "wrong_model", "Fits of models that are not complete", "\n".join(body), [], record=options.record, gate=False
    )


if __name__ == "__main__":
    main()
