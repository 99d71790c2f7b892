"""All tests on one BLAS thread: these matrices are small, and two threads wait for each other.

On a busy machine waiting is all they do: a factorisation of 160 rows took 79 ms instead of 0.3.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from threadpoolctl import threadpool_limits

from pinflex.kernel.evaluate import Tables
from tests.sound_tables import require_sound

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the processes that tests start
os.environ.setdefault("PINFLEX_TRACEBACK", "full")  # a failing test shows where


@pytest.fixture(scope="session", autouse=True)
def one_blas_thread() -> Iterator[None]:
    with threadpool_limits(limits=1, user_api="blas"):
        yield


@pytest.fixture(scope="session", autouse=True)
def sound_tables() -> Iterator[None]:
    """Every index in the tables that a test makes is within what it points into."""
    made = Tables.__init__

    def checked(self: Tables, counts: Mapping[str, int], arrays: Mapping[str, Any]) -> None:
        made(self, counts, arrays)
        require_sound(self, arrays)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Tables, "__init__", checked)
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
