"""The linear system for other tools, in SI units: with a leak, that of small voltages about 0 V."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ipmclab.errors import InputError
from ipmclab.model.actuator import OUTPUTS, Actuator
from ipmclab.model.numerics.reduce import small_signal

if TYPE_CHECKING:
    import control
    import scipy.signal


def to_scipy(actuator: Actuator) -> scipy.signal.StateSpace:
    """The actuator as a ``scipy.signal.StateSpace``: voltage [V] to ``OUTPUTS`` [A, V, m, N].

    A leak is in it with its slope at 0 V, as for small voltages.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> to_scipy(load_actuator("friend-2")).A.shape
    (6, 6)
    """
    import scipy.signal

    system = small_signal(actuator.system)
    return scipy.signal.StateSpace(system.a, system.b, system.c, system.d)


def to_control(actuator: Actuator) -> control.StateSpace:
    """The actuator as a python-control ``StateSpace`` with named signals; dots in names become underscores.

    A leak is in it with its slope at 0 V; the name then says that it holds about 0 V.

    Raises
    ------
    InputError
        When python-control is not installed.
    """
    try:
        import control
    except ImportError as error:
        raise InputError(
            "python-control is not installed",
            code="missing-package",
            where="to_control",
            repair="install it with: pip install 'ipmclab[control]'",
        ) from error

    system = small_signal(actuator.system)
    return control.StateSpace(
        *(system.a, system.b, system.c, system.d),
        inputs=["voltage"],
        outputs=list(OUTPUTS),
        states=[name.replace(".", "_") for name in system.states],
        name=actuator.name.replace(".", "_") + ("" if actuator.system.law_ports is None else " about 0 V"),
    )
