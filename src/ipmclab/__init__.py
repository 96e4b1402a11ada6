"""ipmclab: an open laboratory for ionic polymer metal composite (IPMC) actuators.

``import ipmclab`` is light: a name loads its part of the house on first use.
"""

from __future__ import annotations

import importlib
import sys
import types
from typing import TYPE_CHECKING, Any, Final

from ipmclab.version import __version__ as __version__

if TYPE_CHECKING:
    from ipmclab import signals as signals
    from ipmclab.errors import InputError as InputError
    from ipmclab.errors import IpmclabError as IpmclabError
    from ipmclab.identify import Choice as Choice
    from ipmclab.identify import Fit as Fit
    from ipmclab.identify import Validation as Validation
    from ipmclab.identify import bootstrap as bootstrap
    from ipmclab.identify import choose as choose
    from ipmclab.identify import follow_procedure as follow_procedure
    from ipmclab.identify import forecast as forecast
    from ipmclab.identify import identifiability as identifiability
    from ipmclab.identify import identify as identify
    from ipmclab.identify import leave_one_run_out as leave_one_run_out
    from ipmclab.identify import prediction_bands as prediction_bands
    from ipmclab.identify import profile as profile
    from ipmclab.identify import read_fit as read_fit
    from ipmclab.identify import read_procedure as read_procedure
    from ipmclab.identify import sample_posterior as sample_posterior
    from ipmclab.identify import validate as validate
    from ipmclab.identify import write_fit as write_fit
    from ipmclab.identify import write_posterior as write_posterior
    from ipmclab.model import Actuator as Actuator
    from ipmclab.model import load_actuator as load_actuator
    from ipmclab.model import simulate as simulate
    from ipmclab.model import write_actuator as write_actuator
    from ipmclab.quality import check as check
    from ipmclab.quality import measure as measure
    from ipmclab.report import plot as plot
    from ipmclab.report import report as report
    from ipmclab.run import Finding as Finding
    from ipmclab.run import Mark as Mark
    from ipmclab.run import Run as Run
    from ipmclab.run import RunMetadata as RunMetadata
    from ipmclab.sample import Sample as Sample
    from ipmclab.store import export_run as export_run
    from ipmclab.store import import_run as import_run
    from ipmclab.store import read_run as read_run
    from ipmclab.store import write_run as write_run

_HOMES: Final = {
    "InputError": "ipmclab.errors",
    "IpmclabError": "ipmclab.errors",
    "Choice": "ipmclab.identify",
    "Fit": "ipmclab.identify",
    "Validation": "ipmclab.identify",
    "bootstrap": "ipmclab.identify",
    "choose": "ipmclab.identify",
    "follow_procedure": "ipmclab.identify",
    "forecast": "ipmclab.identify",
    "identifiability": "ipmclab.identify",
    "identify": "ipmclab.identify",
    "leave_one_run_out": "ipmclab.identify",
    "prediction_bands": "ipmclab.identify",
    "profile": "ipmclab.identify",
    "read_fit": "ipmclab.identify",
    "sample_posterior": "ipmclab.identify",
    "read_procedure": "ipmclab.identify",
    "validate": "ipmclab.identify",
    "write_fit": "ipmclab.identify",
    "write_posterior": "ipmclab.identify",
    "Actuator": "ipmclab.model",
    "load_actuator": "ipmclab.model",
    "simulate": "ipmclab.model",
    "write_actuator": "ipmclab.model",
    "check": "ipmclab.quality",
    "measure": "ipmclab.quality",
    "plot": "ipmclab.report",
    "report": "ipmclab.report",
    "Finding": "ipmclab.run",
    "Mark": "ipmclab.run",
    "Run": "ipmclab.run",
    "RunMetadata": "ipmclab.run",
    "Sample": "ipmclab.sample",
    "export_run": "ipmclab.store",
    "import_run": "ipmclab.store",
    "read_run": "ipmclab.store",
    "write_run": "ipmclab.store",
}
_MODULES: Final = ("signals",)

__all__ = ["__version__", *_HOMES, *_MODULES]  # noqa: PLE0604  # names of the lazy table


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"ipmclab.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'ipmclab' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(types.ModuleType):
    """Keeps ``ipmclab.identify`` and ``ipmclab.report`` the functions, though packages of that name exist.

    The import system sets every imported subpackage as an attribute of its parent, which would
    hide the function as soon as anything from inside that subpackage is imported.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (isinstance(value, types.ModuleType) and name in _HOMES):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
