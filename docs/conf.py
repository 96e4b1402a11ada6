"""How the documentation is built: Sphinx with MyST, every warning an error."""

import ipmclab

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
