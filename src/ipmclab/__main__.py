"""``python -m ipmclab`` is the command line."""

from __future__ import annotations

from ipmclab.cli import main

main()
