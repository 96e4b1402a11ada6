"""The linear system for other tools, in SI units: with a leak, that of small voltages about 0 V."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ipmclab.extras import package
from ipmclab.model.assemble import System
from ipmclab.model.numerics.reduce import small_signal
from ipmclab.model.ports import OUTPUTS

if TYPE_CHECKING:
    import control
    import scipy.signal


def to_scipy(system: System) -> scipy.signal.StateSpace:
    """A system as a ``scipy.signal.StateSpace``: voltage [V] to ``OUTPUTS`` [A, V, m, N].

    A leak is in it with its slope at 0 V, as for small voltages.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> to_scipy(load_actuator("friend-2").system).A.shape
    (6, 6)
    """
    import scipy.signal

    linear = small_signal(system)
    return scipy.signal.StateSpace(linear.a, linear.b, linear.c, linear.d)


def to_control(system: System, name: str) -> control.StateSpace:
    """A system as a python-control ``StateSpace`` with named signals; dots in names become underscores.

    A leak is in it with its slope at 0 V; the name then says that it holds about 0 V.

    Raises
    ------
    InputError
        When python-control is not installed.
    """
    control = package("control", extra="control", where="to_control", known_as="python-control")
    linear = small_signal(system)
    return control.StateSpace(
        *(linear.a, linear.b, linear.c, linear.d),
        inputs=["voltage"],
        outputs=list(OUTPUTS),
        states=[state.replace(".", "_") for state in linear.states],
        name=name.replace(".", "_") + ("" if system.law_ports is None else " about 0 V"),
    )
