"""What a strip can do: work, work density and efficiency, from a free and a blocked run under the same condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ipmclab.comparison.factors import FACTORS, levels_of
from ipmclab.comparison.table import RunRow
from ipmclab.model.actuator import Actuator


@dataclass(frozen=True)
class Performance:
    """A strip's figures under one condition.

    Parameters
    ----------
    sample, signal : str
    conditions : mapping of factor to float [SI]
    runs : tuple of str
        Those whose means are joined.
    free_displacement : float [m]
    blocked_force : float [N]
    free_of_runs, blocked_of_runs : tuple of float [m, N]
        The values whose means these two are, one a run.
    work : float [J]
        The most that one stroke does against a constant load: a quarter of their product, where force falls with
        displacement along a straight line.
    work_density : float [J/m^3], optional
        Work over the volume of the free length; None where the dimensions are not known.
    efficiency : float, optional
        Work over the electrical energy that went in until the displacement was largest; None where no current was
        recorded.
    """

    sample: str
    signal: str
    conditions: Mapping[str, float]
    runs: tuple[str, ...]
    free_displacement: float
    blocked_force: float
    free_of_runs: tuple[float, ...]
    blocked_of_runs: tuple[float, ...]
    work: float
    work_density: float | None
    efficiency: float | None


def performances(rows: Sequence[RunRow], strips: Mapping[str, Actuator]) -> tuple[Performance, ...]:
    """The figures of each strip that was measured free and blocked with the same signal in the same air.

    Parameters
    ----------
    rows : sequence of RunRow
    strips : mapping of sample id to Actuator
        For the volume.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> from ipmclab.comparison.table import row_of
    >>> strip = load_actuator("friend-2")
    >>> row = row_of(simulate(strip, "step 1 V", duration=40.0, rate=50.0))
    >>> (found,) = performances([row], {row.sample: strip})
    >>> f"{1e6 * found.work:.2f} uJ, {found.work_density:.0f} J/m^3"
    '0.27 uJ, 9 J/m^3'
    """
    groups: dict[tuple[object, ...], list[RunRow]] = {}
    names = ("humidity", "temperature")
    columns = {}
    for name in (*names, "voltage", "frequency", "clamp_pressure"):
        there = [row.values[name] for row in rows if name in row.values]
        levels = iter(levels_of(FACTORS[name], there))
        columns[name] = [next(levels) if name in row.values else None for row in rows]
    for place, row in enumerate(rows):
        if row.waveform:
            own = () if row.sample else (row.run,)  # without a name, the strips of two runs may be two
            key = (row.sample, row.signal or row.waveform, *(column[place] for column in columns.values()), *own)
            groups.setdefault(key, []).append(row)
    found = (_performance(key, members, names, strips) for key, members in groups.items())
    return tuple(one for one in found if one is not None)


def _performance(
    key: tuple[object, ...], rows: Sequence[RunRow], names: Sequence[str], strips: Mapping[str, Actuator]
) -> Performance | None:
    free = [row for row in rows if _value(row, "displacement.largest")]
    blocked = [row for row in rows if _value(row, "force.largest")]
    if not free or not blocked:
        return None
    displacement = _mean(free, "displacement.largest")
    force = _mean(blocked, "force.largest")
    work = 0.25 * displacement * force
    strip = strips.get(str(key[0]))
    energy = [row for row in free if _value(row, "current.energy_to_peak")]
    put_in = _mean(energy, "current.energy_to_peak") if energy else 0.0
    return Performance(
        sample=str(key[0]),
        signal=str(key[1]),
        conditions={
            name: value for name, value in zip(names, key[2 : 2 + len(names)], strict=True) if isinstance(value, float)
        },
        runs=tuple(dict.fromkeys(row.run for row in (*free, *blocked))),
        free_displacement=displacement,
        blocked_force=force,
        free_of_runs=tuple(_value(row, "displacement.largest") for row in free),
        blocked_of_runs=tuple(_value(row, "force.largest") for row in blocked),
        work=work,
        work_density=None if strip is None else work / _volume(strip),
        efficiency=work / put_in if put_in > 0.0 else None,
    )


def _value(row: RunRow, key: str) -> float:
    return abs(row.metrics[key].value) if key in row.metrics else 0.0


def _mean(rows: Sequence[RunRow], key: str) -> float:
    return sum(_value(row, key) for row in rows) / len(rows)


def _volume(strip: Actuator) -> float:
    known = strip.parameters()
    return known["geometry.free_length"].value * known["geometry.width"].value * known["geometry.thickness"].value
