"""The package as a whole: light to import, and its names are what they say."""

from __future__ import annotations

import pkgutil
import subprocess
import sys

import pytest

HEAVY = ("numba", "scipy", "xarray", "matplotlib", "pydantic", "openpyxl", "h5netcdf", "jinja2", "pandas", "numpy")


def imported_by(code: str) -> set[str]:
    script = f"import sys\n{code}\nprint(' '.join(sys.modules))"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(result.stdout.split())


def test_import_is_light() -> None:
    """``import ipmclab`` loads no heavy library."""
    assert not imported_by("import ipmclab").intersection(HEAVY)


def test_help_is_light() -> None:
    """The help text needs none of the libraries that the work needs."""
    code = (
        "from ipmclab.cli import main\nsys.argv = ['ipmclab', '--help']\ntry:\n    main()\nexcept SystemExit:\n    pass"
    )
    assert not imported_by(code).intersection(HEAVY)


def test_results_print_as_a_few_lines() -> None:
    """What a newcomer prints is to be read, not a dump of arrays."""
    import ipmclab

    actuator = ipmclab.load_actuator("friend-2")
    run = ipmclab.simulate(actuator, "step 1 V", duration=20.0, rate=50.0)
    fit = ipmclab.identify(actuator, run, free="circuit.dc_resistivity")
    told = str(run)
    assert "1000 rows, 19.98 s at 50 Hz, hold zero; voltage, current" in told
    lines = str(fit).splitlines()
    assert len(lines) == 2
    assert "circuit.dc_resistivity" in lines[1]
    assert "95 % interval" in lines[1]
    lines = str(ipmclab.validate(fit.actuator, run)).splitlines()
    assert len(lines) == 4
    assert "step 1 V, current: fit 100.0 %" in lines[1]
    assert "(used in the fit)" in lines[1]


def test_no_package_is_named_as_a_public_function() -> None:
    """Packages have nouns for names: ``ipmclab.identify`` is the function, whatever was imported before."""
    import ipmclab

    rooms = {module.name for module in pkgutil.iter_modules(ipmclab.__path__)}
    assert {"identification", "reporting", "signals"} <= rooms
    assert rooms & set(ipmclab.__all__) == {"signals"}, "which is public as a package"


def test_every_name_loads() -> None:
    """Each name of the lazy table is there."""
    import ipmclab

    for name in ipmclab.__all__:
        assert getattr(ipmclab, name) is not None
    assert set(ipmclab.__all__) <= set(dir(ipmclab))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = ipmclab.nonsense
