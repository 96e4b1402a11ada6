"""The module of what differs between systems, as Windows would load it, with stand-ins for what only Windows has."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import pytest

import ipmclab.platform


def as_on_windows(monkeypatch: pytest.MonkeyPatch, modules: Mapping[str, Any]) -> ModuleType:
    """A copy of ``ipmclab.platform`` that was loaded on Windows; the system stays Windows until the test ends."""
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(sys, "platform", "win32")
    spec = importlib.util.spec_from_file_location("platform_on_windows", ipmclab.platform.__file__)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded
