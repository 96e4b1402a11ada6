"""Linear algebra on one thread.

A fit is thousands of products of small matrices. Shared among threads each takes as long as the slowest of them comes
late: twenty times as long on a machine that does something else too. And sums in another order have other last digits,
so that the answer would depend on how many cores there are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def on_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """A function during which the linear algebra of this process has one thread; afterwards as many as before.

    Parameters
    ----------
    function : callable

    Examples
    --------
    >>> from threadpoolctl import threadpool_info
    >>> threads = on_one_thread(lambda: {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"})
    >>> threads()
    {1}
    """

    @wraps(function)
    def alone(*arguments: P.args, **named: P.kwargs) -> R:
        with _libraries().limit(limits=1, user_api="blas"):
            return function(*arguments, **named)

    return alone


@cache
def _libraries() -> Any:
    import scipy.linalg  # noqa: F401  # SciPy brings a library of its own, which must be there to be found
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
