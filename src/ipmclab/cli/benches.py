"""From a rig to the bench that drives it: the one place where a bench meets its plant."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ipmclab.rig.bench import Bench
    from ipmclab.rig.chambers.chamber import Chamber
    from ipmclab.rig.channels import Rig


def make_bench(rig: Rig) -> Bench:
    """The bench of a rig, not yet open: NI's, or the virtual one with the strip of ``rig.virtual``.

    Raises
    ------
    InputError
        The actuator of a virtual strip cannot be read.

    Examples
    --------
    >>> from ipmclab.rig.files.rig_file import load_rig
    >>> make_bench(load_rig("thesis")).description
    "virtual bench, actuator friend-2, rig of Friend's thesis, chapter 3, seed 20261121"
    """
    if rig.bench == "ni":
        from ipmclab.rig.ni import NiBench

        return NiBench(rig)
    from ipmclab.rig.virtual import VirtualBench

    bench = VirtualBench(rig=rig)
    _ = bench.plant  # whatever is wrong with its actuator is reported now
    return bench


def make_chamber(rig: Rig, bench: Bench) -> Chamber | None:
    """The chamber of a rig; a virtual one at a virtual bench is that around its strip.

    Raises
    ------
    ChamberError
        It cannot be reached.

    Examples
    --------
    >>> from ipmclab.rig.files.rig_file import load_rig
    >>> rig = load_rig("thesis")
    >>> make_chamber(rig, make_bench(rig)) is None
    True
    """
    if rig.chamber is None:
        return None
    from ipmclab.rig.virtual import VirtualBench

    if rig.chamber.is_virtual and isinstance(bench, VirtualBench):
        return bench.plant.chamber
    from ipmclab.rig.chambers.drivers import open_chamber

    return open_chamber(rig.chamber)
