"""Whether everybody can install it without a compiler: every package of the resolution has a wheel on every system.

``uv run python .ci/wheels.py`` reads what ``uv sync`` has resolved, for all systems and Pythons at once, and asks
nobody. Exit status 1, and a sentence for each wheel that is missing.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from packaging.markers import Marker
from packaging.tags import Tag, compatible_tags, cpython_tags, mac_platforms
from packaging.utils import parse_wheel_filename

ROOT = Path(__file__).parents[1]
HOUSE = "ipmclab"
PYTHONS = ((3, 11), (3, 12), (3, 13), (3, 14))


@dataclass(frozen=True)
class System:
    """A system that the README promises: what markers and wheels call it."""

    name: str
    sys_platform: str
    machine: str
    platforms: tuple[str, ...]


def _linux(machine: str) -> tuple[str, ...]:
    # glibc 2.28 is that of the oldest distributions that are still looked after.
    older = (f"manylinux{year}_{machine}" for year in ("2014", "2010", "1"))
    return (*(f"manylinux_2_{minor}_{machine}" for minor in range(28, 4, -1)), *older)


SYSTEMS = (
    System("Windows", "win32", "AMD64", ("win_amd64",)),
    System("macOS on Apple's processors", "darwin", "arm64", tuple(mac_platforms((14, 0), "arm64"))),
    System("Linux on ARM", "linux", "aarch64", _linux("aarch64")),
    System("Linux", "linux", "x86_64", _linux("x86_64")),
)


def main() -> int:
    """Look at every package for every system and Python."""
    missing, looked_at = without_wheels(tomllib.loads((ROOT / "uv.lock").read_text(encoding="utf-8")))
    for sentence in missing:
        print(sentence, file=sys.stderr)
    print(f"{looked_at} packages on {len(SYSTEMS)} systems and {len(PYTHONS)} Pythons, {len(missing)} without a wheel")
    return 1 if missing else 0


def without_wheels(lock: dict[str, Any], systems: tuple[System, ...] = SYSTEMS) -> tuple[list[str], int]:
    """A sentence for each package that lacks a wheel somewhere, and how many were looked at."""
    places: dict[str, list[str]] = {}
    looked_at = 0
    for system, python in product(systems, PYTHONS):
        own = cpython_tags(python, platforms=system.platforms)
        tags = {*own, *compatible_tags(python, f"cp{python[0]}{python[1]}", system.platforms)}
        for package in needed(lock, environment(system, python)):
            looked_at += 1
            if not has_wheel(package, tags):
                name = f"{package['name']} {package['version']}"
                places.setdefault(name, []).append(f"Python {python[0]}.{python[1]} on {system.name}")
    return [
        f"{name} has no wheel for {', '.join(lacking)}: users there need a compiler. Ask in pyproject.toml for a "
        "version that has one, or take the system off the list in .ci/wheels.py and out of the README."
        for name, lacking in places.items()
    ], looked_at


def environment(system: System, python: tuple[int, int]) -> dict[str, str]:
    """What markers ask about."""
    version = f"{python[0]}.{python[1]}"
    return {
        "python_version": version,
        "python_full_version": f"{version}.0",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
        "sys_platform": system.sys_platform,
        "platform_machine": system.machine,
        "platform_system": {"win32": "Windows", "darwin": "Darwin", "linux": "Linux"}[system.sys_platform],
        "os_name": "nt" if system.sys_platform == "win32" else "posix",
        "extra": "",
    }


def needed(lock: dict[str, Any], markers: dict[str, str]) -> Iterator[dict[str, Any]]:
    """The packages that ipmclab with all its extras brings along there."""
    seen: set[tuple[str, str]] = set()
    house = next(package for package in lock["package"] if package["name"] == HOUSE)
    waiting: list[dict[str, Any]] = [{"name": HOUSE, "extra": sorted(house.get("optional-dependencies", {}))}]
    while waiting:
        wanted = waiting.pop()
        package = chosen(lock, wanted, markers)
        lists = [package.get("dependencies", [])]
        lists += [package.get("optional-dependencies", {}).get(extra, []) for extra in wanted.get("extra", ())]
        key = (package["name"], ",".join(wanted.get("extra", ())))
        if key in seen:
            continue
        if not any(name == package["name"] for name, _ in seen) and package["name"] != HOUSE:
            yield package
        seen.add(key)
        waiting += [one for each in lists for one in each if applies(one.get("marker"), markers)]


def chosen(lock: dict[str, Any], wanted: dict[str, Any], markers: dict[str, str]) -> dict[str, Any]:
    """The version of a package that is taken there: a resolution has several where systems need different ones."""
    for package in lock["package"]:
        if package["name"] == wanted["name"] and wanted.get("version", package.get("version")) == package.get(
            "version"
        ):
            forks = package.get("resolution-markers", [])
            if "version" in wanted or not forks or any(applies(one, markers) for one in forks):
                found: dict[str, Any] = package
                return found
    raise SystemExit(f"{wanted['name']} is not in the resolution: run uv sync")


def applies(marker: str | None, markers: dict[str, str]) -> bool:
    """Whether a marker holds there."""
    return marker is None or Marker(marker).evaluate(markers)


def has_wheel(package: dict[str, Any], tags: set[Tag]) -> bool:
    """Whether one of its files is for these tags."""
    files = (str(wheel.get("url") or wheel.get("path") or wheel.get("filename")) for wheel in package.get("wheels", ()))
    return any(
        not tags.isdisjoint(parse_wheel_filename(file.rpartition("/")[2].replace("%2B", "+"))[3]) for file in files
    )


if __name__ == "__main__":
    sys.exit(main())
