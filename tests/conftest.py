"""All tests on one BLAS thread: these matrices are small, and two threads wait for each other.

On a busy machine waiting is all they do: a factorisation of 160 rows took 79 ms instead of 0.3.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest
from threadpoolctl import threadpool_limits

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the processes that tests start
os.environ.setdefault("PINFLEX_TRACEBACK", "full")  # a failing test shows where


@pytest.fixture(scope="session", autouse=True)
def one_blas_thread() -> Iterator[None]:
    with threadpool_limits(limits=1, user_api="blas"):
        yield


@pytest.fixture
def plt() -> Iterator[Any]:
    """Matplotlib's pyplot, drawing nowhere, without the figures that other tests have left."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    pyplot.close("all")
    yield pyplot
    pyplot.close("all")
