"""One BLAS thread: the matrices here are small, and a second thread costs more than it brings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from pinflex.linalg import lapack


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """BLAS on one thread; also a decorator, `@one_blas_thread()`."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@cache
def _controller() -> Any:
    """What holds the BLAS libraries: scipy's is one of its own, and has to be loaded by then."""
    from threadpoolctl import ThreadpoolController

    lapack()
    return ThreadpoolController()
