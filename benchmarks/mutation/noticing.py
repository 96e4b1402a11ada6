"""Which tests could notice a change in a module, the likeliest first.

Coverage would say it exactly, and asks for a run of the whole suite first; the imports say it at once: the module's own
examples, then the tests that it can be reached from, first those that speak of the same things.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

import numpy as np


class Imports:
    """Who imports whom among sources and tests, names followed through the packages that pass them on."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._files = {
            _name(path.relative_to(root / folder)): path
            for folder in ("src", "tests")
            for path in (root / folder).rglob("*.py")
        }
        self._direct = {name: list(self._imports(name)) for name in self._files}
        self._graph = {
            name: ({self._defining(module, what) for module, what in asked} | self._fixtures(name)) - {name}
            for name, asked in self._direct.items()
        }
        self._words = {name: _words(path) for name, path in self._files.items()}
        self._rarity = Counter(word for words in self._words.values() for word in words)

    def tests_of(self, path: str) -> list[str]:
        """Paths for pytest: examples in the module, then test files, the likeliest to notice first."""
        module = _name(Path(path).relative_to("src"))
        reached = self._reached(module)
        rooms = set(Path(path).parts[1:-1]) - {"ipmclab"}
        # What runs in a process of its own is imported by no test: those of its room start it.
        tests = [
            (name, file)
            for name, file in self._files.items()
            if file.name.startswith("test_") and (name in reached or rooms & set(file.parts))
        ]
        ranked = sorted(tests, key=lambda test: -self._likeness(module, test[0]))
        return [path, *(str(file.relative_to(self._root)) for _, file in ranked)]

    def _likeness(self, module: str, test: str) -> float:
        """How much a test speaks of what the module speaks of: common words, rare ones counting more, by its length."""
        common = self._words[module] & self._words[test]
        return float(
            sum(np.log(len(self._words) / self._rarity[word]) for word in common) / np.sqrt(len(self._words[test]))
        )

    def _imports(self, name: str) -> list[tuple[str, str]]:
        tree = ast.parse(self._files[name].read_bytes())
        found = []
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found += [(alias.name, "") for alias in node.names]
                if any(alias.name == "ipmclab" for alias in node.names):
                    found += [
                        ("ipmclab", use.attr)
                        for use in ast.walk(tree)
                        if isinstance(use, ast.Attribute) and getattr(use.value, "id", "") == "ipmclab"
                    ]
            elif isinstance(node, ast.ImportFrom) and node.module:
                found += [(node.module, alias.name) for alias in node.names]
        return [(module, what) for module, what in found if module in self._files]

    def _fixtures(self, name: str) -> set[str]:
        """What pytest imports for a test file without being asked."""
        parts = name.split(".")
        names = {".".join([*parts[:k], "conftest"]) for k in range(1, len(parts))}
        return names & self._files.keys() if parts[0] == "tests" else set()

    def _defining(self, module: str, what: str) -> str:
        """Where a name that a module gives comes from."""
        inside = f"{module}.{what}"
        passed_on = [origin for origin, name in self._direct.get(module, ()) if name == what and origin != module]
        if passed_on and self._files[module].name == "__init__.py":
            return self._defining(passed_on[0], what)
        return inside if inside in self._files else module

    def _reached(self, module: str) -> set[str]:
        """Every file that imports a module, or imports what imports it."""
        importers: dict[str, list[str]] = {}
        for name, imported in self._graph.items():
            for one in imported:
                importers.setdefault(one, []).append(name)
        found, pending = {module}, [module]
        while pending:
            new = set(importers.get(pending.pop(), ())) - found
            found |= new
            pending += new
        return found


def _name(path: Path) -> str:
    parts = path.with_suffix("").parts
    if path.parts[0] not in ("ipmclab", "virtual_cdaq"):
        parts = ("tests", *parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _words(path: Path) -> set[str]:
    return set(re.findall(r"[A-Za-z]{3,}", f"{path.stem} {path.read_text(encoding='utf-8')}".lower()))
