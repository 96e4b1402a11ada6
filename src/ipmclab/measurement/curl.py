"""How fast a strip curls with no voltage on it, and whether it can be tested in that air (Friend, section 5.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.special import stdtrit

from ipmclab.errors import InputError
from ipmclab.quality.check import check
from ipmclab.quality.usable import unmasked
from ipmclab.run import FloatArray, Run

Verdict = Literal["yes", "no", "open"]

TEST: Final = 40.0
"""Length of one test [s] (Friend, appendix A.2)."""

SHARE: Final = 0.05
"""Part of the expected displacement that the curl may make during one test."""

NO_VOLTAGE: Final = 0.02
"""Up to which [V] a strip counts as without voltage."""

_NOISE_SHAPES: Final = 2
"""How many shapes of each stretch, the next slower ones in addition to the straight line, show what the noise does to
it."""

_FEWEST: Final = 40  # readings in one test
_ERROR: Final = 0.05  # of an interval of 95 %


@dataclass(frozen=True)
class Curl:
    """How the tip of a strip at rest moves.

    Parameters
    ----------
    rate : float [m/s]
        In the stretch, as long as a test, in which it moves fastest; with its sign.
    interval : (float, float) [m/s]
        95 % of its size; wide enough for the fastest of all stretches.
    since : float [s]
        When this stretch begins.
    stretches : int
        Into how many the record was cut.
    test : float [s]
        Length of one test.
    allowed : float [m]
        How far the tip may move by itself during one test.
    """

    rate: float
    interval: tuple[float, float]
    since: float
    stretches: int
    test: float
    allowed: float

    @property
    def verdict(self) -> Verdict:
        """``"yes"``: tests are possible here; ``"no"``: they are not; ``"open"``: this record does not decide."""
        if self.interval[1] * self.test <= self.allowed:
            return "yes"
        return "no" if self.interval[0] * self.test > self.allowed else "open"

    @property
    def longest_test(self) -> float:
        """How long a test may be [s] for the curl to stay within what is allowed, at the upper end of its interval."""
        return self.allowed / self.interval[1] if self.interval[1] > 0.0 else float("inf")


def curl(run: Run, displacement: float, *, test: float = TEST, share: float = SHARE) -> Curl:
    """How fast a strip curls with no voltage, and whether tests are possible in this air.

    The record is cut into stretches as long as a test, and a straight line laid through each. What the noise does to
    its slope is read off the two next shapes, the polynomials of degree 2 and 3, of all stretches: noise whose
    neighbours are alike moves them as it moves the slope, so that the interval holds for it too (93 to 98 %, while the
    noise forgets itself within a twentieth of a test). A curl that bends within a stretch makes the interval wider.
    Readings that ``check`` masks (a lost laser) do not count.

    Parameters
    ----------
    run : Run
        With displacement, at 0 V.
    displacement : float [m]
        What a test is expected to show.
    test : float [s]
        Length of one test.
    share : float
        Part of ``displacement`` that the curl may make.

    Raises
    ------
    InputError
        No displacement or a measured one that never changes, a voltage, or a record shorter than a test.

    Examples
    --------
    >>> time = np.arange(0.0, 360.0, 0.1)
    >>> noise = 2e-6 * np.random.default_rng(1).standard_normal(len(time))
    >>> run = Run.from_arrays(time=time, voltage=0 * time, displacement=2e-3 * time / 360 + noise)
    >>> found = curl(run, 1.27e-3)  # sample 5 in room air (Friend, figures 5.42 and 5.44)
    >>> found.verdict, f"{1e6 * found.rate:.1f} um/s", f"{found.longest_test:.0f} s"
    ('no', '5.6 um/s', '11 s')
    """
    if not (displacement > 0.0 and test > 0.0 and 0.0 < share < 1.0):
        raise InputError(
            f"a displacement of {displacement:g} m, a test of {test:g} s and a share of {share:g} make no limit",
            code="out-of-range",
            where="baseline",
            repair="give a displacement and a length above 0, and a share between 0 and 1",
        )
    time, readings = _at_rest(run)
    if len(time) < _FEWEST:
        raise _too_few()
    # A simulated tip is where it is: no sensor has to show that it sees it.
    if np.ptp(readings) == 0.0 and run.metadata.origin != "simulated":
        raise InputError(
            "every reading of its displacement that counts is the same: "
            "nothing shows that the tip was seen, or how finely",
            code="no-resolution",
            where=run.name or "run",
            repair="see that the reading follows the tip when it is touched, and record more decimals",
        )
    length = float(time[-1] - time[0])
    # A record of exactly one test ends one row before it.
    count = int(length * len(time) / (len(time) - 1) / test * (1.0 + 1e-9))
    if count < 1:
        raise InputError(
            f"the record is {length:.3g} s long, shorter than one test of {test:g} s",
            code="too-short",
            where=run.name or "run",
            repair="leave the strip at 0 V for some minutes, or say how short a test is",
        )
    if count * _FEWEST > len(time):
        raise _too_few()
    pieces = _pieces(time, readings, count)
    rates, shapes = zip(*(_slope(*piece) for piece in pieces), strict=True)
    factor = float(stdtrit(_NOISE_SHAPES * count, 1.0 - 0.5 * _ERROR / count))
    fastest = int(np.argmax(np.abs(rates)))
    reach = factor * float(np.sqrt(np.mean(np.square(shapes))))
    size = abs(rates[fastest])
    interval = (max(size - reach, 0.0), size + reach)
    return Curl(rates[fastest], interval, float(pieces[fastest][0][0]), count, test, share * displacement)


def _at_rest(run: Run) -> tuple[FloatArray, FloatArray]:
    values = run.channels.get("displacement")
    where = run.name or "run"
    if values is None:
        raise InputError(
            "it has no displacement, which a curl shows in",
            code="no-channel",
            where=where,
            repair="record the displacement with no voltage applied",
        )
    driven = float(np.nanmax(np.abs(run.voltage)))
    if driven > NO_VOLTAGE:
        raise InputError(
            f"its voltage reaches {driven:.3g} V: the strip was driven",
            code="not-at-rest",
            where=where,
            repair="give a run at 0 V (baseline = true in an experiment records one)",
        )
    there = unmasked(run, check(run))["displacement"]
    return run.time[there], values[there]


def _pieces(time: FloatArray, readings: FloatArray, count: int) -> list[tuple[FloatArray, FloatArray]]:
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[1:-1])
    pieces = list(zip(np.split(time, edges), np.split(readings, edges), strict=True))
    if min(len(times) for times, _ in pieces) < _FEWEST:
        raise _too_few()
    return pieces


def _too_few() -> InputError:
    return InputError(
        f"a stretch as long as a test has less than {_FEWEST} readings of the displacement",
        code="too-few-rows",
        where="baseline",
        repair="record more rows a second, or see why readings are missing",
    )


def _slope(time: FloatArray, readings: FloatArray) -> tuple[float, FloatArray]:
    """Slope of a straight line, and what the next slower shapes would have made of it."""
    middle, half = 0.5 * (time[-1] + time[0]), 0.5 * (time[-1] - time[0])
    shapes, scale = np.linalg.qr(np.polynomial.legendre.legvander((time - middle) / half, _NOISE_SHAPES + 1))
    per_second = 1.0 / (float(scale[1, 1]) * half)
    sizes = shapes.T @ readings * per_second
    return float(sizes[1]), sizes[2:]
