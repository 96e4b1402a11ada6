"""The solver of a fit against certified answers: the 27 nonlinear regression problems of NIST's StRD, both starts.

The problems go through ``identify.solve.minimise`` as a fit's do: rows of weighted residuals and their exact
derivatives. Only the tolerance is tighter: a fit stops where another step would move no parameter by a visible part of
its standard error, and six digits are more than that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy import arctan, cos, exp, pi, sin

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.search.solve import Solution, minimise
from ipmclab.identification.search.tangent import entry_errors

FOLDER = Path(__file__).parent / "nist_strd"
DIGITS = 6.0
TIGHTEST = float(np.finfo(float).eps)
EVALUATIONS = 2000
"""The long valleys of Bennett5 and MGH17 from their far starts take some 1,400 and 900; no other case takes 300."""
ROUNDED = "Lanczos1"
"""Its data are the model to 13 digits: what is left of them is rounding, and so is its standard deviation."""


def rise(b, x):
    return b[0] * (1 - exp(-b[1] * x))


def chwirut(b, x):
    return exp(-b[0] * x) / (b[1] + b[2] * x)


def seasons(b, x):
    year = b[1] * cos(2 * pi * x / 12) + b[2] * sin(2 * pi * x / 12)
    second = b[4] * cos(2 * pi * x / b[3]) + b[5] * sin(2 * pi * x / b[3])
    return b[0] + year + second + b[7] * cos(2 * pi * x / b[6]) + b[8] * sin(2 * pi * x / b[6])


def peaks(b, x):
    return (
        b[0] * exp(-b[1] * x) + b[2] * exp(-((x - b[3]) ** 2) / b[4] ** 2) + b[5] * exp(-((x - b[6]) ** 2) / b[7] ** 2)
    )


def cubics(b, x):
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def three_decays(b, x):
    return b[0] * exp(-b[1] * x) + b[2] * exp(-b[3] * x) + b[4] * exp(-b[5] * x)


MODELS = {
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": rise,
    "Chwirut1": chwirut,
    "Chwirut2": chwirut,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": seasons,
    "Eckerle4": lambda b, x: b[0] / b[1] * exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": peaks,
    "Gauss2": peaks,
    "Gauss3": peaks,
    "Hahn1": cubics,
    "Kirby2": lambda b, x: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "Lanczos1": three_decays,
    "Lanczos2": three_decays,
    "Lanczos3": three_decays,
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * exp(-x * b[3]) + b[2] * exp(-x * b[4]),
    "Misra1a": rise,
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** (-2)),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** (-0.5)),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * exp(-b[2] * x[1]),
    "Rat42": lambda b, x: b[0] / (1 + exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - arctan(b[2] / (x - b[3])) / pi,
    "Thurber": cubics,
}
CASES = [(name, start) for name in MODELS for start in (0, 1)]


@dataclass(frozen=True)
class Certified:
    """One file: two starts, parameters and standard deviations as NIST certifies them, and the data."""

    starts: np.ndarray
    parameters: np.ndarray
    deviations: np.ndarray
    residual_deviation: float
    x: np.ndarray
    y: np.ndarray

    @classmethod
    def read(cls, name: str) -> Certified:
        lines = (FOLDER / f"{name}.dat").read_text(encoding="ascii").splitlines()
        count = int(lines[31].split()[0])
        table = np.array([[float(word) for word in line.split("=")[1].split()] for line in lines[40 : 40 + count]])
        (deviation,) = (line.split(":")[1] for line in lines[:60] if line.startswith("Residual Standard Deviation"))
        data = np.array([[float(word) for word in line.split()] for line in lines[60:] if line.strip()])
        y = np.log(data[:, 0]) if name == "Nelson" else data[:, 0]
        x = data[:, 1] if data.shape[1] == 2 else data[:, 1:].T
        return cls(table[:, :2].T, table[:, 2], table[:, 3], float(deviation), x, y)


class Regression:
    """A problem as the solver takes it; the derivatives are exact, by a complex step."""

    def __init__(self, model: Callable, certified: Certified) -> None:
        self.model, self.certified = model, certified
        self.lower = np.full(len(certified.parameters), -np.inf)
        self.upper = -self.lower
        self.linear = np.zeros(len(self.lower), dtype=bool)
        self.added = self.linear

    def evaluate(self, theta: np.ndarray) -> Evaluation:
        x, y, step = self.certified.x, self.certified.y, 1e-100
        rows = [self.model(theta + 1j * step * direction, x).imag / step for direction in np.eye(len(theta))]
        rows.append(self.model(theta, x) - y)
        return Evaluation(np.array(rows) / self.certified.residual_deviation)


def solved(name: str, start: int, **settings: float) -> tuple[Certified, Solution]:
    certified = Certified.read(name)
    problem = Regression(MODELS[name], certified)
    # A trial step may go where a model overflows; the solver turns back from there.
    with np.errstate(all="ignore"):
        return certified, minimise(problem, certified.starts[start], **settings)


def digits(found: np.ndarray, certified: np.ndarray) -> float:
    """Fewest digits that agree, as NIST counts them, at most the 11 that are certified."""
    error = np.max(np.abs(found - certified) / np.abs(certified))
    return float(min(11.0, -np.log10(max(error, 1e-300))))


@pytest.fixture(scope="module")
def answers() -> dict[tuple[str, int], tuple[Certified, Solution]]:
    return {case: solved(*case, evaluations=EVALUATIONS, tolerance=TIGHTEST) for case in CASES}


def test_there_are_27_problems() -> None:
    assert sorted(MODELS) == sorted(path.stem for path in FOLDER.glob("*.dat"))
    assert len(CASES) == 54


def test_the_models_leave_the_certified_residuals() -> None:
    """Before the solver is asked: formulas and data belong together."""
    for name, model in MODELS.items():
        certified = Certified.read(name)
        here = Regression(model, certified).evaluate(certified.parameters)
        freedom = len(certified.y) - len(certified.parameters)
        if name == ROUNDED:
            assert np.abs(here.residual * certified.residual_deviation).max() < 1e-9
        else:
            assert here.cost / freedom == pytest.approx(1.0, rel=1e-6), name


def test_six_certified_digits_from_both_starts(answers) -> None:
    missed = {}
    for case, (certified, solution) in answers.items():
        assert solution.converged, case
        agree = digits(solution.theta, certified.parameters)
        if agree < DIGITS:
            missed[case] = round(agree, 1)
    assert not missed  # two of the 54 may be missed, each with its reason: none is


def test_six_digits_of_the_standard_deviations(answers) -> None:
    """The uncertainty of a fit comes from the same decomposition."""
    for case, (certified, solution) in answers.items():
        if case[0] == ROUNDED:
            continue
        freedom = len(certified.y) - len(certified.parameters)
        found = entry_errors(solution.evaluation) * (solution.evaluation.cost / freedom) ** 0.5
        assert digits(found, certified.deviations) >= DIGITS, (case, found, certified.deviations)


def test_the_tolerance_of_a_fit_is_far_below_any_standard_deviation() -> None:
    """With the default tolerance nothing is off by more than a thousandth of its certified standard deviation."""
    for case in CASES:
        certified, solution = solved(*case, evaluations=EVALUATIONS)
        if case[0] != ROUNDED:
            assert np.all(np.abs(solution.theta - certified.parameters) < 1e-3 * certified.deviations), case
