"""Rigid motions that mechanisms of one file share: those that each would find, to the last bit.

Claims:
    Pages, pictures, figures
    - rigid motions that mechanisms of one file share = those that each finds | exact | passes
"""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import pinflex as pf
from pinflex.levels.modes import default_motion
from pinflex.mechanics.evaluation.equations import share


@pytest.mark.parametrize("model", ["3rrr", "race_r1"])
def test_a_shared_motion_changes_nothing(model: str) -> None:
    one = pf.load(model)
    pf.solve(one, level="coupled", tol=1e-2)
    alone, other = (one.with_({"damping": {"modal": 0.02}}) for _ in range(2))
    share(one, other)
    assert other.followed.paths is one.followed.paths and default_motion(other) is default_motion(
        one
    )
    own, shared = (dict(pf.solve(x, level="coupled", tol=1e-2).arrays) for x in (alone, other))
    assert own.keys() == shared.keys()
    assert all(np.array_equal(own[key], shared[key]) for key in own)


@pytest.mark.parametrize("change", [{"motion.omega": 30.0}, {"flexible": None}])
def test_what_moves_otherwise_shares_nothing(change: dict[str, object]) -> None:
    one = pf.load("3rrr")
    other = one.with_(change)
    share(one, other)
    assert other.followed.paths is not one.followed.paths


def test_another_home_shares_nothing() -> None:
    one = pf.load("3rrr")
    other = pf.load("3rrr")
    other.home[0] += 1e-3
    share(one, other)
    assert other.followed.paths is not one.followed.paths


def test_motions_stay_where_they_were_found() -> None:
    one = pf.load("3rrr")
    default_motion(one)
    assert one.followed.motions.values
    assert not pickle.loads(pickle.dumps(one.followed)).motions.values
