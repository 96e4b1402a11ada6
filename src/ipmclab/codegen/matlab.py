"""An actuator for MATLAB and GNU Octave: the names of the thesis's appendix A.1, the state space, and a check.

The script uses core functions alone (``expm``), so that it needs no toolbox.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ipmclab.destination import replacing
from ipmclab.model import Actuator, simulate
from ipmclab.model.left_open import open_sentence
from ipmclab.model.numerics.reduce import small_signal
from ipmclab.model.ports import OUTPUTS
from ipmclab.named_matrix import matrix_of
from ipmclab.run import FloatArray
from ipmclab.version import __version__

_GAMMA: Final = 1.875  # of the clamped-free beam, as the thesis rounds it
_RATE: Final = 1.0  # Hz, of the check: each row is 1 s after the one before
_ROWS: Final = 20
_UNITS: Final = {"current": "A", "applied_voltage": "V", "displacement": "m", "force": "N"}

_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
_KEYWORDS: Final = (
    "break",
    "case",
    "catch",
    "classdef",
    "continue",
    "else",
    "elseif",
    "end",
    "for",
    "function",
    "global",
    "if",
    "otherwise",
    "parfor",
    "persistent",
    "return",
    "spmd",
    "switch",
    "try",
    "while",
)
_CALLED: Final = ("abs", "assert", "clear", "expm", "max", "size", "zeros")
"""What no script can be called: words of the language, and what it calls itself."""

_GEOMETRY: Final = {
    "Lt": ("geometry.free_length", "m, free length"),
    "Lc": ("geometry.clamped_length", "m, clamped length"),
    "b": ("geometry.width", "m, width"),
    "h": ("geometry.thickness", "m, thickness"),
    "Ls": ("geometry.sensing_length", "m, from the clamp to where it is measured"),
}
_REST: Final = {
    "Rcontact": ("circuit.contact_resistance", "Ohm, in series with the strip"),
    "density": ("beam.density", "kg/m^3"),
    "Y": ("beam.modulus", "Pa, Young's modulus"),
    "zeta": ("beam.damping_ratio", "damping ratio"),
    "Kd": ("coupling.gain", "m/V/s, gain of d(s)"),
    "Zd": ("coupling.zero", "1/s, zero of d(s)"),
    "P1d": ("coupling.p1", "1/s"),
    "P2d": ("coupling.p2", "1/s^2"),
}
"""The thesis's names of parameters, with ours and what they are."""


def is_name(text: str, actuator: Actuator) -> bool:
    """Whether a script of an actuator can be called so: by a name that neither the language nor the script has.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> [is_name(name, load_actuator("friend-2")) for name in ("strip_2", "2_strips", "strip-2", "end", "max", "Lt")]
    [True, False, False, False, False, False]
    """
    return bool(_NAME.fullmatch(text)) and text not in {*_KEYWORDS, *_CALLED, *_parameters(actuator), *"ABCD"}


def write(actuator: Actuator, path: Path, covariance: Mapping[str, Mapping[str, float]]) -> tuple[Path, ...]:
    """Write the script, and its numbers as a MAT file beside it."""
    import scipy.io

    named = _parameters(actuator)
    a, b, c, d = _scaled(actuator)
    names = sorted(covariance)
    mat_file = path.with_suffix(".mat")
    content: dict[str, Any] = {name: value for name, (value, _) in named.items()}
    content |= {"A": a, "B": b, "C": c, "D": d, "outputs": np.array(OUTPUTS, dtype=object)}
    content |= {
        "names": np.array(names, dtype=object),
        "covariance": matrix_of(covariance, names),
    }
    with replacing(mat_file, overwrite=True) as target:
        scipy.io.savemat(target, content, appendmat=False, oned_as="column")
    with replacing(path, overwrite=True) as target:
        target.write_text(_script(actuator, named, (a, b, c, d)), encoding="ascii", errors="replace", newline="\n")
    return path, mat_file


def _without_laser(actuator: Actuator) -> Actuator:
    """The strip itself: what a laser reads of one that bends far is no linear answer."""
    values, known = (
        {name: value for name, value in of.items() if not name.startswith("laser.")}
        for of in (actuator.parameter_values, actuator.standard_uncertainties)
    )
    return replace(actuator, parameter_values=values, standard_uncertainties=known)


def _parameters(actuator: Actuator) -> dict[str, tuple[float, str]]:
    """Each number under the thesis's name, with what it is."""
    values = actuator.parameter_values
    elements = actuator.circuit_elements()
    named = {name: (values[ours], comment) for name, (ours, comment) in _GEOMETRY.items()}
    branches = len(elements.branch_resistances)
    for k in range(branches):
        named[f"e{k + 1}"] = (values[f"circuit.branches.{k}.permittivity"], f"F/m, permittivity of branch {k + 1}")
    for k in range(branches):
        named[f"p{k + 1}"] = (values[f"circuit.branches.{k}.resistivity"], f"Ohm m, resistivity of branch {k + 1}")
    named["pdc"] = (values["circuit.dc_resistivity"], "Ohm m, dc resistivity")
    named["Re"] = (_real(elements.electrode), "Ohm, of one electrode: it is there twice, in series")
    named["R1"] = (_real(elements.dc), "Ohm, dc resistance")
    for k, (resistance, capacitance) in enumerate(
        zip(elements.branch_resistances, elements.branch_capacitances, strict=True), start=1
    ):
        named[f"Rc{k}"] = (_real(resistance), f"Ohm, branch {k}")
        named[f"C{k}"] = (_real(capacitance), f"F, branch {k}")
    named["gamma"] = (_GAMMA, "solution of the characteristic equation, clamped-free beam")
    named |= {name: (values[ours], comment) for name, (ours, comment) in _REST.items() if ours in values}
    return named


def _real(value: complex) -> float:
    return float(np.real(value))


def _scaled(actuator: Actuator) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The state space with states of order 1: displacements are 1e-8, which the tolerances of ODE solvers overlook."""
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov

    linear = small_signal(actuator.system)
    _, (balanced, _) = matrix_balance(linear.a, permute=False, separate=True)
    a, b = linear.a * balanced[None, :] / balanced[:, None], linear.b / balanced[:, None]
    # The square root of this Gramian's diagonal is how far white noise of the voltage drives each state.
    driven = np.sqrt(np.abs(np.diag(solve_continuous_lyapunov(a, -b @ b.T))))
    scale = balanced * 2.0 ** np.round(np.log2(np.where(driven > 0.0, driven, 1.0)))  # powers of two change no digit
    return linear.a * scale[None, :] / scale[:, None], linear.b / scale[:, None], linear.c * scale[None, :], linear.d


def _script(
    actuator: Actuator,
    named: Mapping[str, tuple[float, str]],
    system: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> str:
    lines = [
        f"% {' '.join(actuator.name.split())}: an IPMC strip, written by ipmclab {__version__}. Units are SI.",
        "% The names are those of appendix A.1 of the thesis of Friend, whose Simulink model runs on them.",
    ]
    if doubt := open_sentence(actuator):
        lines.append(f"% {doubt[0].upper()}{doubt[1:]}.")
    if actuator.system.law_ports is not None:
        lines.append("% Its leak is in A, B, C, D with its slope at 0 V: they hold for small voltages.")
    if actuator.structure.environment:
        lines.append(
            "% Its numbers are those of the state of reference: they do not follow water and temperature here."
        )
    if actuator.structure.laser:
        lines.append("% The displacement is that of the strip: what a laser reads of one that bends far is another.")
    lines += ["", *(f"{name} = {value:.17g};  % {comment}" for name, (value, comment) in named.items())]
    lines += ["", "% State space: input voltage [V]; states are scaled to order 1; outputs:"]
    lines += [f"%   {k}. {name.replace('_', ' ')} [{_UNITS[name]}]" for k, name in enumerate(OUTPUTS, start=1)]
    lines += [f"{name} = {_matrix(values)};" for name, values in zip("ABCD", system, strict=True)]
    if actuator.system.law_ports is None:
        run = simulate(_without_laser(actuator), "step 1 V", duration=_ROWS / _RATE, rate=_RATE)
        expected = np.column_stack([run.channels[name] for name in OUTPUTS])
        lines += [
            "",
            f"% Check: the first {_ROWS} rows of a step of 1 V at {_RATE:g} Hz, the voltage held between rows.",
            f"ipmclab_expected = {_matrix(expected)};",
            "ipmclab_n = size(A, 1);",
            f"ipmclab_held = expm([A, B; zeros(1, ipmclab_n + 1)] / {_RATE:g});",
            "ipmclab_x = zeros(ipmclab_n, 1);",
            f"ipmclab_y = zeros({_ROWS}, {len(OUTPUTS)});",
            f"for ipmclab_k = 1:{_ROWS}",
            "    ipmclab_y(ipmclab_k, :) = (C * ipmclab_x + D)';",
            "    ipmclab_x = ipmclab_held(1:ipmclab_n, 1:ipmclab_n) * ipmclab_x + ipmclab_held(1:ipmclab_n, end);",
            "end",
            "ipmclab_error = max(max(abs(ipmclab_y - ipmclab_expected)) ./ max(abs(ipmclab_expected)));",
            "assert(ipmclab_error < 1e-9, 'these numbers do not give what ipmclab gave');",
            "clear ipmclab_expected ipmclab_n ipmclab_held ipmclab_x ipmclab_y ipmclab_k ipmclab_error",
        ]
    return "\n".join(lines) + "\n"


def _matrix(values: FloatArray) -> str:
    rows = ["  " + ", ".join(f"{value:.17g}" for value in row) for row in np.atleast_2d(values)]
    return "[\n" + ";\n".join(rows) + "]"
