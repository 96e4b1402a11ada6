"""Whether the suite holds with every Python that the README names, and with the oldest and the newest libraries.

Run ``python -m benchmarks.versions [--python 3.13 ...] [--record] [PATH ...]``. Each Python of 3.11 to 3.14 that is
installed here has an environment of its own under ``build/``, with the versions that ``pyproject.toml`` pins. Who
installs ipmclab into an environment of their own has others: there the oldest Python has the oldest version of each
library that the project names, and the newest Python the newest ones. Warnings of these are no errors. An environment
takes a minute, the suite as long as always.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from benchmarks.harness import finish

SOURCES = ("src", "tests", "pyproject.toml")
ROOT = Path(__file__).parents[1]
UV: Final = os.environ.get("UV", "uv")
"""``uv run`` says where it is."""

PYTHONS: Final = ("3.11", "3.12", "3.13", "3.14")
EXTRAS: Final = "bayes,chamber,cluster,control,crate,ni,postgres,sweep,tdms"
SHOWN: Final = ("numpy", "scipy", "numba", "xarray", "typer")
"""Libraries whose versions stand in the table."""

Libraries = Literal["pinned", "oldest", "newest"]
_RESOLUTIONS: Final = {"oldest": "lowest-direct", "newest": "highest"}


@dataclass(frozen=True)
class Environment:
    """One Python with its libraries, in a folder of its own."""

    python: str
    has: Libraries = "pinned"

    @property
    def folder(self) -> Path:
        """Where it is made."""
        return ROOT / "build" / "versions" / f"{self.python}-{self.has}"

    @property
    def interpreter(self) -> str:
        """Its Python."""
        return str(self.folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))

    def make(self) -> None:
        """Install everything: uv keeps what it has fetched."""
        if self.has == "pinned":
            made = {**os.environ, "UV_PROJECT_ENVIRONMENT": str(self.folder)}
            _uv("sync", "--quiet", "--group", "docs", "--python", self.python, environment=made)
            return
        _uv("venv", "--quiet", "--clear", "--python", self.python, str(self.folder))
        install = ("pip", "install", "--quiet", "--no-config", "--python", self.interpreter)
        every = ("--editable", f".[{EXTRAS}]", "--group", "dev", "--group", "docs")
        _uv(*install, "--resolution", _RESOLUTIONS[self.has], *every)

    def suite(self, paths: list[str]) -> str:
        """What pytest says at its end: failures, and how many held."""
        warned = [] if self.has == "pinned" else ["-W", "default", "-p", "no:warnings"]
        command = [self.interpreter, "-m", "pytest", "-q", "--tb=short", *warned, *paths]
        # This environment is not the one that is active here.
        own = {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}
        return subprocess.run(command, cwd=ROOT, env=own, capture_output=True, text=True, check=False).stdout

    def libraries(self) -> str:
        """Python and the versions of some libraries."""
        ask = f"import platform, importlib.metadata as m; print(platform.python_version(), *map(m.version, {SHOWN}))"
        said = subprocess.run([self.interpreter, "-c", ask], capture_output=True, text=True, check=True)
        python, *versions = said.stdout.split()
        named = ", ".join(" ".join(one) for one in zip(SHOWN, versions, strict=True))
        return f"Python {python}, {self.has} libraries: {named}"


def _uv(*words: str, environment: dict[str, str] | None = None) -> None:
    subprocess.run([UV, *words], cwd=ROOT, env=environment, check=True)


def is_here(python: str) -> bool:
    """Whether uv finds this Python on this machine."""
    asked = [UV, "python", "find", "--no-python-downloads", python]
    return subprocess.run(asked, capture_output=True, check=False).returncode == 0


def row(environment: Environment, said: str) -> str:
    """A line of the table, and below it what failed."""
    lines = said.splitlines()
    ended = next((line for line in reversed(lines) if re.search(r"\d+ (passed|failed|error)", line)), "did not run")
    failed = [re.sub(r" - .*", "", line) for line in lines if line.startswith(("FAILED", "ERROR"))]
    return "\n".join([f"* {environment.libraries()}: {ended.strip('= ')}", *(f"    * {line}" for line in failed)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", help="tests, the whole suite when left out")
    parser.add_argument("--python", nargs="+", default=PYTHONS, help="of those that are installed here")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/versions.md")
    options = parser.parse_args()
    here = [one for one in options.python if is_here(one)]
    rows = [f"* Python {one}: not on this machine" for one in options.python if one not in here]
    of_others = [Environment(here[0], "oldest"), Environment(here[-1], "newest")] if here else []
    for environment in [*map(Environment, here), *of_others]:
        environment.make()
        said = environment.suite(options.paths)
        print(said, flush=True)
        rows.append(row(environment, said))
    what = f"`pytest {' '.join(options.paths)}`" if options.paths else "The whole suite"
    body = f"{what} with several Pythons, and with the oldest and the newest libraries.\n\n" + "\n".join(rows)
    finish("versions", "Pythons and libraries", body, [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
