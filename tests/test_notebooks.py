"""Every notebook of the docs is executed, cell by cell, by the shell that a kernel of Jupyter wraps.

IPython runs the cells and formats what stands last in them; what is left out is the wire to a browser.
"""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib
import pytest
from IPython.core.interactiveshell import InteractiveShell
from traitlets.config import Config

DOCS = Path(__file__).parent.parent / "docs"
NOTEBOOKS = sorted(path for path in DOCS.rglob("*.ipynb") if "_build" not in path.parts)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_runs_and_shows_itself(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    matplotlib.use("agg")
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    shell = InteractiveShell(config=Config({"HistoryManager": {"enabled": False}}))
    shown = []
    for number, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] != "code":
            continue
        assert not cell["outputs"], f"cell {number} keeps an output: clear it, an old number would stay for ever"
        done = shell.run_cell("".join(cell["source"]))
        done.raise_error()
        if done.result is not None:
            formats, _ = shell.display_formatter.format(done.result)
            shown.append((type(done.result).__name__, formats))
    assert {"Actuator", "Run", "Fit", "Validation"} <= {name for name, formats in shown if "text/html" in formats}
    for name in ("step.nc", "fitted.toml", "report.html"):
        assert (tmp_path / name).stat().st_size > 0


def test_there_is_a_notebook_of_the_first_hour() -> None:
    assert [path.name for path in NOTEBOOKS] == ["first_hour.ipynb"]
