"""Where compiled functions are kept on the disk, and what is done where nothing can be kept."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import ipmclab
from ipmclab.model.numerics import compiled
from ipmclab.model.numerics.compiled import cache_folder, kernel, sources
from ipmclab.platform import lock_file

PROGRAM = """
from ipmclab.model.numerics.compiled import kernel

@kernel
def twice(x):
    return 2.0 * x

assert twice(21.0) == 42.0
assert twice.nopython_signatures
"""


def test_a_kernel_is_compiled_where_no_folder_can_hold_it(tmp_path: Path) -> None:
    nowhere = tmp_path / "a file"
    nowhere.write_text("", encoding="utf-8")
    environment = {**os.environ, "IPMCLAB_CACHE": str(nowhere)}
    subprocess.run([sys.executable, "-c", PROGRAM], check=True, timeout=300, env=environment)
    assert nowhere.is_file()


ANOTHER = "import sums; print(sums.added(1.0), sum(sums.added.stats.cache_hits.values()))"

SUMS = """
from ipmclab.model.numerics.compiled import kernel

@kernel
def added(x):
    return x + {step}
"""


def test_another_installation_compiles_only_what_is_not_the_same(tmp_path: Path) -> None:
    told = []
    for folder, step in (("first", "1.0"), ("second", "1.0"), ("third", "2.0")):
        file = tmp_path / folder / "sums.py"
        file.parent.mkdir()
        file.write_text(SUMS.format(step=step), encoding="utf-8")
        environment = {**os.environ, "IPMCLAB_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(file.parent)}
        words = [sys.executable, "-c", ANOTHER]
        done = subprocess.run(words, check=True, timeout=300, env=environment, capture_output=True, text=True)
        told.append(done.stdout.split())
    assert told == [["2.0", "0"], ["2.0", "1"], ["3.0", "0"]]


AT_ONCE = """
import sys
import sums

print("ready", flush=True)
sys.stdin.readline()
sums.added(1.0)
print(sum(sums.added.stats.cache_hits.values()))
"""


def test_of_processes_that_need_a_kernel_at_once_one_compiles_it(tmp_path: Path) -> None:
    long = " + ".join(f"{k}.0 * x**{k}" for k in range(200))  # others begin long before the first of them has ended
    (tmp_path / "sums.py").write_text(SUMS.format(step=long), encoding="utf-8")
    environment = {**os.environ, "IPMCLAB_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", AT_ONCE]
    all_of_them = [
        subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    for one in all_of_them:
        assert one.stdout is not None
        assert one.stdout.readline() == "ready\n"
    for one in all_of_them:
        assert one.stdin is not None
        one.stdin.write("now\n")
        one.stdin.flush()
    told = [one.communicate(timeout=300)[0] for one in all_of_them]
    assert sorted(told) == ["0\n", "1\n", "1\n", "1\n"]


def test_a_process_that_stopped_as_it_compiled_is_not_waited_for_long(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(compiled, "_LONGEST_TURN", 0.1)
    file = tmp_path / "a kernel.turn"
    with file.open("ab") as stream:
        assert lock_file(stream.fileno())
        with compiled._turn(file):
            pass


def test_threads_that_compile_at_once_all_keep_their_code_where_it_belongs() -> None:
    """Numba has one setting for the folder, which one thread must not put back while another reads it."""

    def folder_of(_: int) -> str:
        def nothing() -> None:
            pass

        return kernel(nothing)._cache.cache_path

    with ThreadPoolExecutor(8) as pool:
        folders = set(pool.map(folder_of, range(400)))
    assert len(folders) == 1
    assert next(iter(folders)).startswith(str(cache_folder()))


def test_whatever_a_kernel_takes_from_the_package_is_in_the_name_of_its_cache() -> None:
    """Numba freezes constants into a kernel: one that changes alone must start a fresh cache."""
    known = {source.resolve() for source in sources()}
    package = Path(ipmclab.__file__).parent
    own = [source for source in known if source.name == "kernels.py" or source.name.endswith("_loop.py")]
    assert len(own) > 20
    for source in own:
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ipmclab."):
                place = package.joinpath(*str(node.module).split(".")[1:])
                files = [place / name.name for name in node.names] if place.is_dir() else [place]
                taken = {file.with_suffix(".py").resolve() for file in files}
                taken -= {package / "model/numerics/compiled.py"}
                assert taken <= known, f"{source.name} takes from {node.module}"
