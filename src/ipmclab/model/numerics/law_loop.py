"""Static laws at ports: their values and slopes, and the equations ``p + q law(p) = r`` they make of a sample.

All are odd and monotone, and convex above 0 V. That is what makes every equation here have one solution, and
Newton's method find it.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel, part

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

CUBIC, EXPONENTIAL = 0, 1  # places in ``leak.FORMS``; what is left is Butler-Volmer


@part
def law(form: int, k: FloatArray, p: float) -> tuple[float, float]:
    """The current [A] of one law at a voltage [V], and its slope [A/V] (at a threshold the slope above it).

    Parameters
    ----------
    form : int
    k : float array, shape (3,)
        Coefficients of the form, as in ``leak.Leak.laws``.
    p : float [V]
    """
    size = abs(p)
    if form == CUBIC:
        return p * (k[0] + size * (k[1] + size * k[2])), k[0] + size * (2.0 * k[1] + size * 3.0 * k[2])
    if size < k[1] or k[0] == 0.0:
        return 0.0, 0.0
    if form == EXPONENTIAL:
        grown = math.expm1((size - k[1]) / k[2])
        return math.copysign(k[0] * grown, p), k[0] / k[2] * (grown + 1.0)
    half = 0.5 * (size - k[1]) / k[2]
    return math.copysign(2.0 * k[0] * math.sinh(half), p), k[0] / k[2] * math.cosh(half)


@kernel
def reach(form: int, k: FloatArray, current: float) -> float:
    """A voltage [V] from 0 up at which a law gives at least this current [A, above 0]; infinite where none does."""
    if form == CUBIC:
        enough: float = min(current / k[0], math.sqrt(current / k[1]), np.cbrt(current / k[2]))
    elif form == EXPONENTIAL:
        enough = k[1] + k[2] * math.log1p(current / k[0])
    else:
        enough = k[1] + 2.0 * k[2] * math.asinh(0.5 * current / k[0])
    return enough


@kernel
def solve_one(form: int, k: FloatArray, q: float, r: float) -> tuple[float, float]:
    """The one p and w = law(p) with ``p + q w = r``, q from 0 up.

    For r > 0 the left side is convex and rises with p, so that Newton's steps from above the solution stay above
    it and cannot miss it, kink or no kink. The start is where either term alone makes up r.
    """
    size = abs(r)
    if size == 0.0:
        return 0.0, 0.0
    p = size if q <= 0.0 else min(size, reach(form, k, size / q))
    w = 0.0
    for _ in range(200):
        w, slope = law(form, k, p)
        step = (p + q * w - size) / (1.0 + q * slope)
        # What the straight line through this point gives is the better current where the law is steep.
        w -= slope * step
        p -= step
        if step <= 1e-12 * p:  # what is left is its square
            break
    return math.copysign(p, r), math.copysign(w, r)


@part
def eliminate(matrix: FloatArray, right: FloatArray) -> None:
    """Solve ``matrix z = right`` by elimination; ``right``, shape (m, columns), becomes z and ``matrix`` is lost."""
    m, columns = right.shape
    for i in range(m):
        pivot = i
        for j in range(i + 1, m):
            if abs(matrix[j, i]) > abs(matrix[pivot, i]):
                pivot = j
        if pivot != i:
            for l in range(i, m):  # noqa: E741
                matrix[i, l], matrix[pivot, l] = matrix[pivot, l], matrix[i, l]
            for t in range(columns):
                right[i, t], right[pivot, t] = right[pivot, t], right[i, t]
        for j in range(i + 1, m):
            factor = matrix[j, i] / matrix[i, i]
            if factor != 0.0:
                for l in range(i + 1, m):  # noqa: E741
                    matrix[j, l] -= factor * matrix[i, l]
                for t in range(columns):
                    right[j, t] -= factor * right[i, t]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            for t in range(columns):
                right[i, t] -= matrix[i, j] * right[j, t]
        for t in range(columns):
            right[i, t] /= matrix[i, i]


@kernel
def _newton(
    forms: IndexArray, k: FloatArray, q: FloatArray, r: FloatArray, p: FloatArray, w: FloatArray, most: float
) -> bool:
    """Newton's steps from the points of the laws at p; whether they arrived, with the solution in p and w.

    A step that leads outwards on an exponential ends where the law gives the current of the straight line, not where
    it has that voltage: so it cannot run beyond what the port can carry, and halts at a threshold that it crosses.
    """
    m = p.shape[0]
    slope, jacobian, steps = np.empty(m), np.empty((m, m)), np.empty((m, 1))
    for _ in range(40):
        for i in range(m):
            w[i], slope[i] = law(forms[i], k[i], p[i])
        for i in range(m):
            missing = r[i] - p[i]
            for j in range(m):
                missing -= q[i, j] * w[j]
                jacobian[i, j] = q[i, j] * slope[j]
            jacobian[i, i] += 1.0
            steps[i, 0] = missing
        eliminate(jacobian, steps)
        widest = 0.0
        for i in range(m):
            step = steps[i, 0]
            if not abs(step) < np.inf:
                return False
            widest = max(widest, abs(step))
            w[i] += slope[i] * step
        arrived = widest <= 1e-13 * most
        for i in range(m):
            new = p[i] + steps[i, 0]
            if not arrived and forms[i] != CUBIC and abs(new) > k[i, 1] and abs(new) > abs(p[i]):
                carried = max(w[i] if new > 0.0 else -w[i], 0.0)
                new = math.copysign(min(abs(new), reach(forms[i], k[i], carried)), new)
            p[i] = new
        if arrived:
            return True
    return False


@kernel
def solve_several(forms: IndexArray, k: FloatArray, q: FloatArray, r: FloatArray, p: FloatArray, w: FloatArray) -> bool:
    """The one p and w = law(p) with ``p + q w = r``, for several laws and a symmetric, positive semidefinite q.

    The w that solve it are where a convex function is least, ``w q w/2 - r w`` and what belongs to each law. Going
    there along one law after the other is sure and slow, Newton's steps are fast where they arrive: those are tried
    first, and again after every few rounds of the others.

    Parameters
    ----------
    forms : int array, shape (n_laws,)
    k : float array, shape (n_laws, 3)
    q : float array, shape (n_laws, n_laws) [ohm]
    r : float array, shape (n_laws,) [V]
    p : float array, shape (n_laws,) [V]
        A guess; on return the solution.
    w : float array, shape (n_laws,) [A]
        Written.

    Returns
    -------
    found : bool
        False only where numbers overflow.
    """
    m = p.shape[0]
    if m == 1:
        p[0], w[0] = solve_one(forms[0], k[0], q[0, 0], r[0])
        return not math.isnan(p[0])
    most = 0.0
    for i in range(m):
        most = max(most, abs(r[i]))
    if most == 0.0:
        p[:] = 0.0
        w[:] = 0.0
        return True
    if not most < np.inf:
        return False
    for i in range(m):  # a law that is far beyond what its port can carry tells nothing about the way
        limit = most if q[i, i] <= 0.0 else min(most, reach(forms[i], k[i], 4.0 * most / q[i, i]))
        p[i] = min(max(p[i], -limit), limit)
    if _newton(forms, k, q, r, p, w, most):
        return True
    along = np.zeros(m)
    for rounds in range(2000):
        for i in range(m):
            rest = r[i]
            for j in range(m):
                if j != i:
                    rest -= q[i, j] * along[j]
            p[i], along[i] = solve_one(forms[i], k[i], q[i, i], rest)
            if math.isnan(along[i]) or abs(along[i]) == np.inf:
                return False
        if rounds % 10 == 9 and _newton(forms, k, q, r, p, w, most):
            return True
    return False
