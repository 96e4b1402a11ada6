"""How often hypothesis draws: in the suite, in CI, and in ``python -m benchmarks.properties``.

``pytest --hypothesis-profile thorough`` takes another than the one that is loaded here.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

# No example is judged by the clock of a busy machine, and no test here needs a fixture made anew for each example.
settings.register_profile(
    "suite",
    deadline=None,
    max_examples=100,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

# The same examples every time: whether a change lands hangs on the change.
settings.register_profile("ci", settings.get_profile("suite"), derandomize=True, database=None, print_blob=True)

# What the suite's few examples do not meet is looked for here, anew each time.
settings.register_profile(
    "thorough",
    settings.get_profile("suite"),
    derandomize=False,
    max_examples=50_000,
    print_blob=True,
    suppress_health_check=list(HealthCheck),
)


def load() -> None:
    """Take the profile of this run, before any test is read."""
    settings.load_profile("ci" if os.environ.get("CI") else "suite")


def costly(part: int = 10) -> settings:
    """A tenth of the examples, or another part: for a property that fits or simulates at length in each."""
    return settings(max_examples=max(1, settings.default.max_examples // part))
