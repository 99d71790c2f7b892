"""BLAS on one thread while pinflex computes, and as before afterwards."""

from __future__ import annotations

import pytest
import scipy.linalg  # noqa: F401  # its BLAS is not numpy's
from threadpoolctl import threadpool_info, threadpool_limits

import pinflex as pf
from pinflex.mechanics.reference.evaluator import Reference
from pinflex.studies.checking.check import check
from pinflex.threads import one_blas_thread


def blas_threads() -> set[int]:
    return {lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas"}


def test_every_blas_is_held_and_let_go() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = blas_threads()
        with one_blas_thread():
            assert blas_threads() == {1}
        assert blas_threads() == before


@pytest.mark.parametrize("call", [pf.modes, pf.static_equilibrium, check])
def test_what_linearises_holds_it_too(call: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PINFLEX_KERNEL", "0")  # it needs no BLAS
    robot, seen = pf.load("cantilever"), []
    tangent = Reference.tangent

    def watched(*args: object) -> object:
        seen.append(blas_threads())
        return tangent(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(Reference, "tangent", watched)
    with threadpool_limits(limits=2, user_api="blas"):
        call(robot)  # type: ignore[operator]
    assert seen
    assert set.union(*seen) == {1}
