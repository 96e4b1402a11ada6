"""What the tests of the page need."""

from __future__ import annotations

import warnings

with warnings.catch_warnings():
    # Starlette wants the successor of httpx for its test client; NiceGUI brings httpx itself.
    warnings.simplefilter("ignore")
    import starlette.testclient  # noqa: F401
