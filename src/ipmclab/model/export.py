"""The linear system for other tools, in SI units."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ipmclab.errors import InputError
from ipmclab.model.actuator import OUTPUTS, Actuator

if TYPE_CHECKING:
    import control
    import scipy.signal


def to_scipy(actuator: Actuator) -> scipy.signal.StateSpace:
    """The actuator as a ``scipy.signal.StateSpace``: voltage [V] to ``OUTPUTS`` [A, V, m, N].

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> to_scipy(load_actuator("friend-2")).A.shape
    (6, 6)
    """
    import scipy.signal

    system = actuator.system
    return scipy.signal.StateSpace(system.a, system.b, system.c, system.d)


def to_control(actuator: Actuator) -> control.StateSpace:
    """The actuator as a python-control ``StateSpace`` with named signals; dots in state names become underscores.

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

    system = actuator.system
    return control.StateSpace(
        *(system.a, system.b, system.c, system.d),
        inputs=["voltage"],
        outputs=list(OUTPUTS),
        states=[name.replace(".", "_") for name in system.states],
        name=actuator.name,
    )
