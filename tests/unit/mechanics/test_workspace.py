"""Kept workspaces: found by any model of the same tree, and never seen in a number."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.arrays import Array
from pinflex.mechanics import workspace
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.whole import Whole

_HEAVIER = [
    "flexible.*.material.rho=9000",
    "flexible.*.section.thickness=0.004",
    "gravity=[1, 2, 0]",
]


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workspace, "_spare", {})
    monkeypatch.setenv("PINFLEX_KERNEL", "0")  # which needs none


def _tree(*joints: pin.JointModel, parents: tuple[int, ...] | None = None) -> pin.Model:
    model = pin.Model()
    for k, joint in enumerate(joints):
        parent = k if parents is None else parents[k]
        model.addJoint(parent, joint, pin.SE3.Identity(), f"joint {k}")
    return model


def _all_numbers(m: pf.Mechanism) -> list[Array]:
    """What every algorithm that runs on a workspace gives, at one moving, bent state."""
    rng, system, d = np.random.default_rng(3), m.flexible, Equations(m.flexible)
    y = d.integrate(m.undeformed(), 1e-3 * rng.standard_normal(system.nv))
    v, a = rng.standard_normal((2, system.nv))
    lam = rng.standard_normal(system.closed.n)
    found = [*d.residual(y, v, a, lam, 0.0), d.mass(y), *d.tangent(y, v, a, lam, 0.0), *d.close(y)]
    return [np.array(one) for one in (*found, d.closure_bias(y, v), d.energies(y, v, 0.0))]


@pytest.mark.parametrize("name", ["race_r1", "3rrs"])
def test_the_workspace_of_a_heavier_twin_gives_the_same_numbers_to_the_last_bit(name: str) -> None:
    m, heavier = pf.load(name), pf.load(name, _HEAVIER)
    workspace._spare.clear()
    expected = _all_numbers(m)
    workspace._spare.clear()
    _all_numbers(heavier)
    left = [data for _, data in workspace._spare.values()]
    there = Equations(m.flexible).pinocchio
    used = [there.data] if isinstance(there, Whole) else [data for _, data in there._owned.values()]
    assert used and all(data in left for data in used)
    for found, number in zip(_all_numbers(m), expected, strict=True):
        np.testing.assert_array_equal(found, number)


@pytest.mark.parametrize(
    "other",
    [
        _tree(pin.JointModelRX(), pin.JointModelRY()),
        _tree(pin.JointModelRX(), pin.JointModelRX(), parents=(0, 0)),
        _tree(pin.JointModelRX(), pin.JointModelRevoluteUnaligned(1, 0, 0)),
        _tree(pin.JointModelRX()),
    ],
    ids=["axis", "parent", "kind", "number"],
)
def test_another_tree_gets_another_workspace(other: pin.Model) -> None:
    model = _tree(pin.JointModelRX(), pin.JointModelRX())
    data = pin.Data(model)
    workspace.release(model, data)
    assert workspace.acquire(other) is not data
    assert workspace.acquire(model) is data
    assert workspace.acquire(model) is not data  # it is in use


def test_the_oldest_make_room_and_what_is_too_large_is_not_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    small = _tree(pin.JointModelRX(), pin.JointModelRX())
    large = _tree(*[pin.JointModelRX() for _ in range(5)])
    monkeypatch.setattr(workspace, "_BUDGET", 2 * workspace.size(small))
    first, second, third = (pin.Data(small) for _ in range(3))
    for data in (first, second, third):
        workspace.release(small, data)
    workspace.release(large, pin.Data(large))
    assert [data for _, data in workspace._spare.values()] == [second, third]


def test_the_oldest_make_room_before_a_new_one_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    small = _tree(pin.JointModelRX(), pin.JointModelRX())
    large = _tree(*[pin.JointModelRX() for _ in range(5)])
    monkeypatch.setattr(workspace, "_BUDGET", workspace.size(small) + workspace.size(large))
    first, second = pin.Data(small), pin.Data(small)
    workspace.release(small, first)
    workspace.release(small, second)
    workspace.acquire(large)
    assert [data for _, data in workspace._spare.values()] == [second]


def test_ked_needs_one_workspace_its_start_included(monkeypatch: pytest.MonkeyPatch) -> None:
    m = pf.load("3rrr")
    workspace._spare.clear()
    made = []
    new = pin.Data
    monkeypatch.setattr(pin, "Data", lambda model: made.append(model.nv) or new(model))
    pf.solve(m, until=1e-3, dt=1e-4, level="ked", start="static")
    assert made.count(m.flexible.expansion.model.nv) == 1


def test_a_run_on_a_large_model_makes_one_workspace_and_leaves_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    m = pf.load("race_r1")
    workspace._spare.clear()
    monkeypatch.setattr(workspace, "_BUDGET", 0.5 * workspace.size(m.flexible.expansion.model))
    made = []
    new = pin.Data
    monkeypatch.setattr(pin, "Data", lambda model: made.append(model.nv) or new(model))
    pf.solve(m, until=1e-3, dt=1e-4, level="coupled")
    assert made.count(m.flexible.expansion.model.nv) == 1
    assert not [owner for owner, _ in workspace._spare.values() if owner.nv > 20]
