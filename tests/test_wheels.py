"""The gate that looks for wheels: what it finds missing, said in a sentence."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[1] / ".ci" / "wheels.py"


@pytest.fixture(scope="module")
def gate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("wheels_gate", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["wheels_gate"] = module  # its dataclasses look for it there
    spec.loader.exec_module(module)
    return module


def package(name: str, *files: str, **more: Any) -> dict[str, Any]:
    wheels = [{"url": f"https://files/{name}-1.0-{file}.whl"} for file in files]
    return {"name": name, "version": "1.0", "wheels": wheels, **more}


def test_a_wheel_that_is_missing_is_said_in_a_sentence(gate: ModuleType) -> None:
    fast = [f"cp3{minor}-cp3{minor}-{system}" for minor in range(11, 15) for system in SYSTEMS]
    lock = {
        "package": [
            package(
                "ipmclab",
                dependencies=[
                    {"name": "pure"},
                    {"name": "fast"},
                    {"name": "windows_only", "marker": "sys_platform == 'win32'"},
                ],
                **{"optional-dependencies": {"extra": [{"name": "late", "marker": "python_version >= '3.14'"}]}},
            ),
            package("pure", "py3-none-any"),
            package("fast", *(file for file in fast if file != "cp313-cp313-win_amd64")),
            package("windows_only", "cp39-abi3-win_amd64"),
            package("late"),
        ]
    }
    sentences, looked_at = gate.without_wheels(lock)
    assert looked_at == 4 * 4 * 2 + 4 + 4
    assert len(sentences) == 2
    assert "fast 1.0 has no wheel for Python 3.13 on Windows: users there need a compiler." in " ".join(sentences)
    assert any(text.startswith("late 1.0 has no wheel for Python 3.14 on Windows, Python 3.14") for text in sentences)


SYSTEMS = ("win_amd64", "macosx_11_0_arm64", "manylinux_2_27_aarch64", "manylinux2014_x86_64.manylinux_2_17_x86_64")
