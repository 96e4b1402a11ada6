"""Whether a fit hangs on the processor: the same fits under other kernels of the linear algebra, threads and compilers.

Run ``python -m benchmarks.processors [--fits 100] [--only Haswell,Nehalem] [--record]``. Each configuration is a
process of its own: ``OPENBLAS_CORETYPE`` chooses the kernels of NumPy's and SciPy's linear algebra as another
processor would have them (one that this machine cannot run is left out by name), ``OPENBLAS_NUM_THREADS`` how many
threads share a product, ``NUMBA_CPU_NAME=generic`` has our own loops compiled for any processor at all. Every process
makes the acceptance cases and the same random fits: actuators near those of the library, one or two runs, noise that
is white, fades or walks, and a set of free parameters. Values of determined parameters are compared in units of their
standard error with those of the first configuration; which parameters are determined, the codes of the findings in
their order, and the parameters of each direction in their order must be the same. Seed 20261121.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.signal

from benchmarks.harness import finish

SOURCES = ("src/ipmclab/model", "src/ipmclab/identification", "src/ipmclab/statespace", "src/ipmclab/fit")

SEED: Final = 20261121
PARTS: Final = ("determined", "findings", "directions")
"""Of what a fit said."""

ALLOWED: Final = 1e-6
"""Of a standard error."""

CONFIGURATIONS: Final[Mapping[str, Mapping[str, str]]] = {
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "1"},
    "Haswell, 2 threads": {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "2"},
    "Zen": {"OPENBLAS_CORETYPE": "Zen", "OPENBLAS_NUM_THREADS": "1"},
    "Nehalem": {"OPENBLAS_CORETYPE": "Nehalem", "OPENBLAS_NUM_THREADS": "1"},
    "Nehalem, loops for any processor": {
        "OPENBLAS_CORETYPE": "Nehalem",
        "OPENBLAS_NUM_THREADS": "1",
        "NUMBA_CPU_NAME": "generic",
    },
    "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX", "OPENBLAS_NUM_THREADS": "1"},
    "SkylakeX, 2 threads": {"OPENBLAS_CORETYPE": "SkylakeX", "OPENBLAS_NUM_THREADS": "2"},
}

_KINDS: Final = (
    ("friend-2", "electrical", ("current",)),
    ("friend-2", "electrical,observation.offset.current", ("current",)),
    ("friend-2", "circuit.dc_resistivity,circuit.branches.0.resistivity", ("current",)),
    ("friend-2", "electrical,circuit.sheet_resistance", ("current", "force")),
    ("friend-2", "electrical,coupling", ("current", "force")),
    ("friend-2", "coupling", ("displacement",)),
    ("friend-2", "coupling,beam.modulus", ("displacement", "force")),
    ("friend-2+branches=3", "electrical", ("current",)),
    ("friend-2+relaxation.displacement", "coupling,relaxation", ("displacement",)),
)
_SIGNALS: Final = ("step 1 V delay=1 s", "sine 1 V 0.2 Hz", "square 1 V 0.2 Hz delay=1 s", "chirp 1 V 0.05 Hz 5 Hz")
_NOISE: Final = {"current": 1e-4, "displacement": 2e-6, "force": 1e-5}


@dataclass(frozen=True)
class Told:
    """What a fit said, as far as it must not hang on the processor.

    Parameters
    ----------
    values, errors : mapping of name to float [SI]
        Of the determined parameters.
    said : list
        Which are determined, the codes of the findings, the parameters of each direction: in their order. Where the
        fit was refused, the code of the refusal.
    """

    values: Mapping[str, float]
    errors: Mapping[str, float]
    said: Any


def _noise(generator: np.random.Generator, kind: str, rows: int) -> npt.NDArray[np.float64]:
    white: npt.NDArray[np.float64] = generator.standard_normal(rows)
    if kind == "fades":
        return np.asarray(scipy.signal.lfilter([np.sqrt(1.0 - 0.81)], [1.0, -0.9], white))
    if kind == "walks":
        return np.asarray(white + np.cumsum(generator.standard_normal(rows)) * (3.0 / np.sqrt(rows)))
    return white


def fits(count: int) -> Iterator[tuple[str, Any]]:
    """Name and fit of each case: those of the acceptance tests, then random ones."""
    from ipmclab import identify, load_actuator, simulate

    friend = load_actuator("friend-2")
    demo = [simulate(friend, signal, duration=40.0, rate=50.0) for signal in ("step 1 V", "sine 1 V 0.1 Hz")]
    for free in ("electrical", "electrical,coupling"):
        generator = np.random.default_rng([SEED, 0])
        yield (
            f"acceptance: {free}",
            lambda free=free, generator=generator: identify(
                friend, [_noisy(run, generator, "white", 1.0) for run in demo], free=free
            ),
        )
    for number in range(count):
        yield f"random {number}", lambda number=number: _random_fit(number)


def _noisy(
    run: Any, generator: np.random.Generator, kind: str, size: float, keep: Sequence[str] = tuple(_NOISE)
) -> Any:
    from ipmclab import Run, RunMetadata

    channels = {
        name: run.channels[name] + size * _NOISE[name] * _noise(generator, kind, len(run.time)) for name in keep
    }
    return Run.from_arrays(
        time=run.time, voltage=run.voltage, hold=run.hold, metadata=RunMetadata(starts_from_rest=True), **channels
    )


def _random_fit(number: int) -> Any:
    from ipmclab import identify, load_actuator, simulate

    generator = np.random.default_rng([SEED, 1, number])
    library, free, outputs = _KINDS[int(generator.integers(len(_KINDS)))]
    usual = load_actuator(library)
    moved = {
        name: usual[name] * float(np.exp(0.4 * generator.standard_normal()))
        for name, parameter in usual.parameters().items()
        if name.startswith(("circuit.", "coupling.", "relaxation.")) and parameter.transform == "log" and usual[name]
    }
    strip = usual.replace(**moved)
    kind = ("white", "white", "fades", "walks")[int(generator.integers(4))]
    size = float(10.0 ** generator.uniform(-1.0, 0.7))
    duration = float(generator.choice([8.0, 16.0, 30.0]))
    chosen = generator.choice(len(_SIGNALS), size=int(generator.integers(1, 3)), replace=False)
    runs = [simulate(strip, f"{_SIGNALS[int(k)]} for {duration!r} s", duration=duration, rate=50.0) for k in chosen]
    return identify(usual, [_noisy(run, generator, kind, size, outputs) for run in runs], free=free)


def told(fit: Any) -> Told:
    """What a fit said."""
    known = {name: one for name, one in fit.parameters.items() if one.determined}
    directions = [
        [name for name, part in direction.coefficients.items() if abs(part) > 0.1] for direction in fit.undetermined
    ]
    return Told(
        {name: one.value for name, one in known.items()},
        {name: one.standard_error for name, one in known.items()},
        [list(known), [(finding.code, finding.severity, finding.channel) for finding in fit.findings], directions],
    )


def child(count: int) -> None:
    """Make every fit in this process; one line of JSON each."""
    from ipmclab import InputError

    for name, fit in fits(count):
        try:
            answer = told(fit())
            line = {"values": answer.values, "errors": answer.errors, "said": answer.said}
        except InputError as error:
            line = {"values": {}, "errors": {}, "said": f"refused: {error.code}"}
        print(json.dumps({"name": name, **line}), flush=True)


def measure(configuration: str, count: int) -> dict[str, Told] | None:
    """Every fit under one configuration; None where this machine cannot run it."""
    environment = {**os.environ, **CONFIGURATIONS[configuration]}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "benchmarks.processors", "--child", "--fits", str(count)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode < 0:  # an instruction that this processor lacks
        return None
    if done.returncode:
        sys.exit(f"{configuration}: {done.stderr}")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    return {line["name"]: Told(line["values"], line["errors"], line["said"]) for line in lines}


def _parts(one: Any, other: Any) -> list[str]:
    """Which parts of what two fits said differ; their refusals where one is refused."""
    if isinstance(one, str) or isinstance(other, str):
        return [f"{one} against {other}"]
    return [name for name, own, its in zip(PARTS, one, other, strict=True) if own != its]


def farthest(first: Mapping[str, Told], other: Mapping[str, Told]) -> list[tuple[float, str]]:
    """The largest difference of a determined value in each fit, in standard errors, and whose it is."""
    found = []
    for name, one in first.items():
        away = [
            (abs(other[name].values[key] - value) / one.errors[key], f"{name}: {key}")
            for key, value in one.values.items()
            if key in other[name].values and one.errors[key] > 0.0
        ]
        found.append(max(away, default=(0.0, name)))
    return sorted(found, reverse=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fits", type=int, default=100)
    parser.add_argument("--only", default="", help="configurations, by comma")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/processors.md")
    options = parser.parse_args()
    if options.child:
        child(options.fits)
        return
    asked = options.only.split(",") if options.only else list(CONFIGURATIONS)
    measured = {name: measure(name, options.fits) for name in asked}
    ran = {name: found for name, found in measured.items() if found is not None}
    reference, first = next(iter(ran.items()))
    lines = [
        f"{len(first)} fits; every configuration against {reference}. Determined values may differ by {ALLOWED:g} of "
        "their standard error, all else not at all.",
        "",
        "| configuration | fits whose values differ by more | largest difference [standard errors] "
        "| verdicts, findings or orders that differ |",
        "|---|---|---|---|",
    ]
    apart: list[str] = []
    for name, found in measured.items():
        if found is None:
            lines.append(f"| {name} | not run: this processor lacks its instructions | | |")
            continue
        away = farthest(first, found)
        others = [fit for fit, one in first.items() if one.said != found[fit].said]
        worst = f"{away[0][0]:.1g} ({away[0][1]})"
        lines.append(f"| {name} | {sum(size > ALLOWED for size, _ in away)} | {worst} | {len(others)} |")
        apart += [f"{name}: {fit}: {', '.join(_parts(first[fit].said, found[fit].said))}" for fit in others]
        apart += [f"{name}: {where}: {size:.1g} standard errors" for size, where in away if size > ALLOWED]
    if apart:
        lines += ["", "What differs:", "", *(f"* {one}" for one in apart)]
    finish("processors", "One answer on every processor", "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
