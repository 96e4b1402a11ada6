"""Facts about one strip that are known twice, compared with each other: one check a file."""

from __future__ import annotations

from ipmclab.consistency.cross_check import CHECKS, cross_check
from ipmclab.consistency.fact import Fact
from ipmclab.consistency.facts import facts_of_runs, published_facts, published_of

__all__ = ["CHECKS", "Fact", "cross_check", "facts_of_runs", "published_facts", "published_of"]
