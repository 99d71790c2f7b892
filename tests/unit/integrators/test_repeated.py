"""Runs that repeat: their workspaces are those of the runs before, and never seen in a number.

Claims:
    Tolerances, collocation
    - runs in workspaces, paths and tables of the runs before, and of a fresh load: race_r1,
      race_r2, 3rrr, within a tolerance too | the first run | to the last bit | exact
"""

from __future__ import annotations

import gc
import pickle
import weakref

import numpy as np
import pytest

import pinflex as pf
from pinflex.integrators.collocation import radau
from pinflex.integrators.problem import Run
from pinflex.kernel.library import kernel
from pinflex.solver.scene import Scene
from pinflex.solver.tolerance import solve_to_tolerance
from tests.benchmarks.race.case import scene


def same(found: Run, expected: Run) -> None:
    assert found.cost == expected.cost
    for name in ("y", "v", "a", "lam", "torque", "work"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


def tol(given: Scene, tol: float) -> Run:
    return solve_to_tolerance(given, np.linspace(0.0, given.motion.duration, 101), tol)


@pytest.mark.parametrize("name", ["race_r1", "race_r2", "3rrr"])
def test_a_run_is_the_same_after_others_to_the_last_bit(name: str) -> None:
    """Workspaces of the kernel, motor paths and their tables are those of the runs before."""
    t = np.linspace(0.0, 0.02, 21)
    given, fresh = (scene(pf.load(name), ("torque", "platform")) for _ in range(2))
    first = given.resolved(t, 1e-2)
    given.resolved(np.linspace(0.0, 0.013, 7), 1e-4)  # another end: another table, other stops
    given.resolved(t, 1e-3)
    same(given.resolved(t, 1e-2), first)
    same(fresh.resolved(t, 1e-2), first)


def test_and_so_is_a_run_within_a_tolerance() -> None:
    given, fresh = (scene(pf.load("race_r2"), ("torque", "platform")) for _ in range(2))
    first = tol(given, 1e-2)
    tol(given, 1e-4)
    for again in (tol(given, 1e-2), tol(fresh, 1e-2)):
        same(again, first)
        assert again.settings["error"] == first.settings["error"]


@pytest.mark.skipif(kernel().functions is None, reason=kernel().said)
def test_spare_workspaces_go_with_their_system_and_to_no_other_process() -> None:
    given = scene(pf.load("race_r1"), ())
    given.resolved(np.linspace(0.0, 0.02, 21), 1e-2)
    system, kind = given.mechanism.loose, (radau(6).A.tobytes(), True)  # motors: prescribed
    assert pickle.loads(pickle.dumps(system.spares)).acquire(kind) is None
    spare = system.spares.acquire(kind)
    assert spare is not None and system.spares.acquire(kind) is None
    gone = weakref.ref(spare)
    system.spares.release(kind, spare, 1e12)  # too large
    del spare
    gc.collect()
    assert gone() is None
