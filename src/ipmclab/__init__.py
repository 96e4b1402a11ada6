"""ipmclab: an open laboratory for ionic polymer metal composite (IPMC) actuators.

``import ipmclab`` is light: a name loads its part of the house on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from ipmclab.version import __version__ as __version__

if TYPE_CHECKING:
    from ipmclab import signals as signals
    from ipmclab.choosing.choice import Choice as Choice
    from ipmclab.choosing.choose import choose as choose
    from ipmclab.codegen import export_actuator as export_actuator
    from ipmclab.comparison.compare import Comparison as Comparison
    from ipmclab.comparison.compare import compare as compare
    from ipmclab.comparison.frequency_response import frequency_response as frequency_response
    from ipmclab.errors import InputError as InputError
    from ipmclab.errors import IpmclabError as IpmclabError
    from ipmclab.fit.fit import Fit as Fit
    from ipmclab.fit.fit_file import read_fit as read_fit
    from ipmclab.fit.fit_file import write_fit as write_fit
    from ipmclab.forecasting.forecast import forecast as forecast
    from ipmclab.identification.identify import identify as identify
    from ipmclab.model import Actuator as Actuator
    from ipmclab.model import load_actuator as load_actuator
    from ipmclab.model import simulate as simulate
    from ipmclab.model import simulate_many as simulate_many
    from ipmclab.model import write_actuator as write_actuator
    from ipmclab.planning.candidates import Allowance as Allowance
    from ipmclab.planning.identifiable import identifiability as identifiability
    from ipmclab.planning.propose import propose_runs as propose_runs
    from ipmclab.posterior.posterior import sample_posterior as sample_posterior
    from ipmclab.posterior.posterior import write_posterior as write_posterior
    from ipmclab.prediction.bands import prediction_bands as prediction_bands
    from ipmclab.prediction.left_out import leave_one_run_out as leave_one_run_out
    from ipmclab.prediction.validate import Validation as Validation
    from ipmclab.prediction.validate import validate as validate
    from ipmclab.procedure.follow import follow_procedure as follow_procedure
    from ipmclab.procedure.procedure_file import read_procedure as read_procedure
    from ipmclab.publication.crate import export_crate as export_crate
    from ipmclab.quality import check as check
    from ipmclab.quality import measure as measure
    from ipmclab.refitting.bootstrap import bootstrap as bootstrap
    from ipmclab.refitting.profiles import profile as profile
    from ipmclab.refitting.refit import Refits as Refits
    from ipmclab.refitting.refit import refit as refit
    from ipmclab.reporting import plot as plot
    from ipmclab.reporting import report as report
    from ipmclab.reporting.comparison import write_comparison as write_comparison
    from ipmclab.reporting.comparison import write_comparison_data as write_comparison_data
    from ipmclab.run import Finding as Finding
    from ipmclab.run import Mark as Mark
    from ipmclab.run import Run as Run
    from ipmclab.run import RunMetadata as RunMetadata
    from ipmclab.sample import Sample as Sample
    from ipmclab.store.exporting import export_run as export_run
    from ipmclab.store.guess import guess_map as guess_map
    from ipmclab.store.importing import import_run as import_run
    from ipmclab.store.run_file import read_run as read_run
    from ipmclab.store.run_file import write_run as write_run
    from ipmclab.sweep import read_sweep as read_sweep
    from ipmclab.sweep import run_sweep as run_sweep

_HOMES: Final = {
    "InputError": "ipmclab.errors",
    "IpmclabError": "ipmclab.errors",
    "Choice": "ipmclab.choosing.choice",
    "Fit": "ipmclab.fit.fit",
    "Validation": "ipmclab.prediction.validate",
    "bootstrap": "ipmclab.refitting.bootstrap",
    "choose": "ipmclab.choosing.choose",
    "Comparison": "ipmclab.comparison.compare",
    "compare": "ipmclab.comparison.compare",
    "frequency_response": "ipmclab.comparison.frequency_response",
    "write_comparison": "ipmclab.reporting.comparison",
    "write_comparison_data": "ipmclab.reporting.comparison",
    "follow_procedure": "ipmclab.procedure.follow",
    "forecast": "ipmclab.forecasting.forecast",
    "Refits": "ipmclab.refitting.refit",
    "refit": "ipmclab.refitting.refit",
    "identifiability": "ipmclab.planning.identifiable",
    "identify": "ipmclab.identification.identify",
    "leave_one_run_out": "ipmclab.prediction.left_out",
    "Allowance": "ipmclab.planning.candidates",
    "propose_runs": "ipmclab.planning.propose",
    "prediction_bands": "ipmclab.prediction.bands",
    "profile": "ipmclab.refitting.profiles",
    "read_fit": "ipmclab.fit.fit_file",
    "sample_posterior": "ipmclab.posterior.posterior",
    "read_procedure": "ipmclab.procedure.procedure_file",
    "validate": "ipmclab.prediction.validate",
    "write_fit": "ipmclab.fit.fit_file",
    "write_posterior": "ipmclab.posterior.posterior",
    "Actuator": "ipmclab.model",
    "load_actuator": "ipmclab.model",
    "simulate": "ipmclab.model",
    "simulate_many": "ipmclab.model",
    "write_actuator": "ipmclab.model",
    "export_actuator": "ipmclab.codegen",
    "export_crate": "ipmclab.publication.crate",
    "check": "ipmclab.quality",
    "measure": "ipmclab.quality",
    "plot": "ipmclab.reporting",
    "report": "ipmclab.reporting",
    "Finding": "ipmclab.run",
    "Mark": "ipmclab.run",
    "Run": "ipmclab.run",
    "RunMetadata": "ipmclab.run",
    "Sample": "ipmclab.sample",
    "export_run": "ipmclab.store.exporting",
    "guess_map": "ipmclab.store.guess",
    "import_run": "ipmclab.store.importing",
    "read_run": "ipmclab.store.run_file",
    "write_run": "ipmclab.store.run_file",
    "read_sweep": "ipmclab.sweep",
    "run_sweep": "ipmclab.sweep",
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
