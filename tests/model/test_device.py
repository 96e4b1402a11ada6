"""The rows of many sets on a GPU: simulated, compiled, and on one that is there; where none is, what is said."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab import InputError, load_actuator, read_sweep, run_sweep, simulate_many
from ipmclab.model import device
from ipmclab.model.numerics import lanes_loop
from ipmclab.model.numerics.lanes import Lanes
from ipmclab.sweep.template import TEMPLATE
from tests.model.on_device import STRUCTURES, deviations
from tests.model.sets import METRICS

SMALL = {"duration": 1.0, "rate": 50.0}
MODULI = {"beam.modulus": [1e9, 1.2e9, 1.4e9]}


def test_a_simulated_gpu_gives_the_numbers_of_the_processors() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "tests.model.on_device"],
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found["apart"]) == len(STRUCTURES) + 4
    assert max(found["apart"].values()) < 1e-12, found["apart"]
    assert "a leak" in found["refused"]


def test_a_gpu_gives_the_numbers_of_the_processors() -> None:
    if (lack := device._lack()) is not None:
        pytest.skip(f"no GPU: {lack[0]}")
    apart = dict(deviations(sets=3000, rows=2000))
    assert max(apart.values()) < 1e-12, apart


@pytest.fixture
def without_gpu() -> Iterator[Any]:
    """Numba-CUDA's compiler, whose device functions compile for a device that nobody has."""
    if importlib.util.find_spec("numba_cuda") is None:
        pytest.skip("numba-cuda is not installed: the extra gpu is half a gigabyte")
    from numba import cuda
    from numba.cuda import dispatcher

    with pytest.MonkeyPatch.context() as patch:
        turing = types.SimpleNamespace(compute_capability=(7, 5))
        patch.setattr(dispatcher, "get_current_device", lambda: turing)
        yield cuda


@pytest.mark.parametrize("gathered", [None, tuple((0, tally) for tally in lanes_loop.TALLIES)])
def test_it_compiles_without_a_gpu_and_nobody_chooses_where_to_round(
    without_gpu: Any, gathered: tuple[tuple[int, str], ...] | None
) -> None:
    """A compiler for GPUs makes one operation of a product and a sum, where it finds them side by side."""
    from ipmclab.model.numerics.device_lanes import kernel_of

    pattern = np.array([[1, 1, 1, 1], [1, 0, 0, 2], [2, 1, 0, 0], [0, 1, 1, 2]], dtype=np.int8)
    kernel = kernel_of(pattern.shape, pattern.tobytes(), 1, gathered)
    double = without_gpu.types.float64
    matrix, written = double[:, ::1], double[:, :, ::1]
    ptx, _ = without_gpu.compile(kernel.py_func, (matrix, matrix, matrix, matrix, written), cc=(7, 5))
    source = lanes_loop.device_source("made", pattern, 1, gathered)
    # The loop over rows stands in the code once, or several times side by side.
    fused, asked = ptx.count("fma.rn.f64"), source.count("plus(")
    assert asked >= 7
    assert fused > 0
    assert fused % asked == 0


def test_without_a_gpu_auto_takes_processors_and_gpu_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    lack = ("numba-cuda is not installed", 'write: uv tool install ".[gpu]"')
    monkeypatch.setattr(device, "_lack", lambda: lack)
    monkeypatch.setattr(device, "WORTH", 1)
    strip = load_actuator("friend-2")
    found = simulate_many(strip, "step 1 V", MODULI, reduce="force.peak", **SMALL)
    assert np.all(found["force.peak"] > 0.0)
    words = r"device: numba-cuda is not installed; write: uv tool install \"\.\[gpu\]\"; or leave the device out"
    for reduce in ("force.peak", None, lambda outputs: outputs):
        with pytest.raises(InputError, match=words):
            simulate_many(strip, "step 1 V", MODULI, reduce=reduce, device="gpu", **SMALL)
        with pytest.raises(InputError, match="no device is called 'gpo'; did you mean 'gpu'"):
            simulate_many(strip, "step 1 V", MODULI, reduce=reduce, device="gpo", **SMALL)
    (tmp_path / "mine.toml").write_text(TEMPLATE, encoding="utf-8")
    sweep = read_sweep(tmp_path / "mine.toml")
    with pytest.raises(InputError, match=words):
        run_sweep(sweep, tmp_path / "out", device="gpu")
    assert not (tmp_path / "out").exists()


def test_what_a_driver_says_is_handed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> None:
        raise RuntimeError("Error at driver init:\n\nno driver\n:")

    stand_in = types.SimpleNamespace(try_it=fails)
    monkeypatch.setitem(sys.modules, "ipmclab.model.numerics.device_lanes", stand_in)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    lack = device._lack.__wrapped__()
    assert lack is not None
    assert lack[0] == "no GPU computes here: Error at driver init: no driver"
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    lack = device._lack.__wrapped__()
    assert lack is not None
    assert lack[0] == "numba-cuda is not installed"


def test_auto_takes_a_gpu_for_metrics_of_much_work(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    sizes: list[int] = []

    class Counting(Lanes):
        def gather(self, *arguments: Any) -> np.ndarray:
            sizes.append(self.sets)
            return super().gather(*arguments)

        def outputs(self, *arguments: Any) -> None:
            raise AssertionError("outputs stay with the processors")

    stand_in = types.SimpleNamespace(DeviceLanes=Counting)
    monkeypatch.setitem(sys.modules, "ipmclab.model.numerics.device_lanes", stand_in)
    monkeypatch.setattr(device, "_lack", lambda: None)
    strip = load_actuator("friend-2")

    def swept(metrics: Any, name: str = "friend-2", **more: Any) -> list[int]:
        sizes.clear()
        simulate_many(load_actuator(name), "step 1 V", MODULI, reduce=metrics, **SMALL, **more)
        return sorted(sizes)

    assert swept(METRICS) == []
    monkeypatch.setattr(device, "WORTH", 1)
    assert sum(swept(METRICS)) == 3
    assert swept(METRICS, device="cpu") == swept(None) == swept(METRICS, "friend-2+leak.exponential") == []
    simulate_many(strip, ["step 1 V", "step 2 V"], reduce=METRICS, **SMALL)
    assert sizes == []
    (tmp_path / "mine.toml").write_text(TEMPLATE.replace("base = 512", "base = 4"), encoding="utf-8")
    run_sweep(read_sweep(tmp_path / "mine.toml"), tmp_path / "out")
    assert sum(sizes) == 20


def test_nothing_of_cuda_is_loaded_before_it_is_asked_for() -> None:
    program = (
        "import sys, ipmclab\n"
        "strip = ipmclab.load_actuator('friend-2')\n"
        "ipmclab.simulate_many(strip, 'step 1 V', duration=1.0, rate=50.0, reduce='force.peak')\n"
        "assert not [name for name in sys.modules if 'cuda' in name and 'redirector' not in name and name != 'cuda']\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=300)
