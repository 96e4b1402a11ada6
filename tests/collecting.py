"""How the suite is collected, which each worker does for itself: nothing is looked at in vain."""

from __future__ import annotations

import gc
from collections.abc import Generator, Sequence
from pathlib import Path

import pytest

from tests.workers import FITTING


class Collecting:
    """Looks for examples only in files that have some, and takes nothing for garbage meanwhile."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        """All that is made while tests are collected stays: a collector would look through it again and again."""
        gc.disable()
        try:
            return (yield)
        finally:
            gc.enable()
            gc.freeze()

    def pytest_ignore_collect(self, collection_path: Path, config: pytest.Config) -> bool | None:
        """Pass over modules of which none can be chosen: most are not among those repeated on another processor."""
        if config.option.markexpr != "other_processor" or collection_path.suffix != ".py":
            return None
        return None if collection_path.relative_to(config.rootpath).as_posix().startswith(FITTING) else True

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(
        self, file_path: Path
    ) -> Generator[None, Sequence[pytest.Collector], Sequence[pytest.Collector]]:
        """Of a file without examples its tests alone: most modules have none, and would be imported to see that.

        A package is imported before its modules are: by itself pytest would import a module once more than the package
        that it comes with has done, and its classes would be there twice.
        """
        found = yield
        if file_path.suffix != ".py" or file_path.name == "__init__.py" or b">>>" in file_path.read_bytes():
            return found
        return [one for one in found if type(one) is pytest.Module]
