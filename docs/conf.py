"""How the documentation is built: Sphinx with MyST, every warning an error."""

import sys
from pathlib import Path

import ipmclab

_DOCS = Path(__file__).parent
_CARRIED_OUT = _DOCS / "_build" / "chapter_5.md"
_RECORDED = _DOCS.parent / "benchmarks" / "results" / "chapter_5.md"
# The campaign takes two minutes: where nobody carried it out since, the page shows what was recorded.
if not _CARRIED_OUT.exists() or _CARRIED_OUT.stat().st_mtime < _RECORDED.stat().st_mtime:
    _CARRIED_OUT.parent.mkdir(exist_ok=True)
    _CARRIED_OUT.write_text(_RECORDED.read_text(encoding="utf-8").split("\n\n", 2)[2], encoding="utf-8")

sys.path.insert(0, str(_DOCS))
import constants  # noqa: E402

(_DOCS / "_build" / "constants.md").write_text(constants.page(), encoding="utf-8")

project = "ipmclab"
author = "The ipmclab developers"
copyright = "2026, The ipmclab developers"  # noqa: A001  # the name Sphinx reads
release = ipmclab.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
html_theme = "alabaster"
html_static_path = []
# Mathematics is shown from its source when there is no network: no page needs one to be read.
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_param = False
