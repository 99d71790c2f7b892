"""Pinocchio on a model in parts: every call as on the whole model, however it is cut."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from pinflex.arrays import Array
from pinflex.mechanics import split as splitting
from pinflex.mechanics.one_by_one import OneByOne
from pinflex.mechanics.split import Subtree, split
from pinflex.mechanics.subtrees import Subtrees
from pinflex.mechanics.whole import Whole

# Sums in another order, over 60 joints: round-off of the largest term.
_ROUND_OFF = 1e-12
_KINDS: tuple[Callable[[], pin.JointModel], ...] = (
    pin.JointModelRX,
    pin.JointModelPY,
    pin.JointModelSpherical,
    pin.JointModelTranslation,
    pin.JointModelRUBZ,
    lambda: pin.JointModelRevoluteUnaligned(0.6, 0.0, 0.8),
    pin.JointModelFreeFlyer,
)


def _model(seed: int, joints: int, shape: str) -> pin.Model:
    """A random tree of three legs: long chains, bushes, or stars about their first joint."""
    rng, model = np.random.default_rng(seed), pin.Model()
    model.gravity.linear = np.array([1.0, 2.0, -9.0])

    def leg(parent: int, count: int) -> None:
        """Joints depth first, each on the last one or on one before it."""
        path = [parent]
        for _ in range(count):
            back = 1 if shape == "chains" else int(rng.integers(1, min(len(path), 3) + 1))
            del path[2 if shape == "stars" else len(path) - back + 1 :]
            kind = _KINDS[int(rng.integers(2 if shape == "stars" else len(_KINDS)))]()
            place, name = pin.SE3.Random(), f"j{model.njoints}"
            path.append(int(model.addJoint(path[-1], kind, place, name)))
            model.appendBodyToJoint(path[-1], pin.Inertia.Random(), pin.SE3.Random())

    pin.seed(seed)
    for _ in range(3):
        leg(0, joints // 3)
    model.armature = rng.uniform(0.0, 1.0, model.nv)
    return model


def _pair(
    monkeypatch: pytest.MonkeyPatch, model: pin.Model, piece: int
) -> tuple[Whole, Subtrees, tuple[Subtree, ...]]:
    monkeypatch.setattr(splitting, "_WHOLE", 2 * piece)
    monkeypatch.setattr(splitting, "_PIECE", piece)
    parts = split(model, True)
    return Whole(model, pin.Data(model)), Subtrees(model, parts), parts


def _state(model: pin.Model, n: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(1)
    neutral = pin.neutral(model)
    Q = np.array([pin.integrate(model, neutral, rng.normal(size=model.nv)) for _ in range(n)])
    return Q, rng.normal(size=(n, model.nv)), rng.normal(size=(n, model.nv))


def _same(found: object, expected: object) -> None:
    for one, other in zip(found, expected, strict=True):  # type: ignore[call-overload]
        scale = max(float(np.max(np.abs(other), initial=0.0)), 1e-300)
        np.testing.assert_allclose(one, other, rtol=0, atol=_ROUND_OFF * scale)


@pytest.mark.parametrize("shape", ["chains", "bushes", "stars"])
@pytest.mark.parametrize("piece", [8, 200], ids=["cut", "legs"])
def test_a_model_in_parts_answers_as_the_whole(
    monkeypatch: pytest.MonkeyPatch, shape: str, piece: int
) -> None:
    model = _model(3 + (shape == "chains"), 60, shape)
    if piece > model.nv // 2:
        piece = model.nv // 2 - 1  # more than any leg has, less than all have
    whole, parted, parts = _pair(monkeypatch, model, piece)
    assert parted.cut == (piece == 8) and len(parts) >= (9 if parted.cut else 3)
    if shape == "stars":  # of branches too small to be cut one by one
        assert not parted.cut or max(part.model.nv for part in parts) <= piece + 6
    assert sorted(j for part in parts for j in part.joints) == [*range(1, model.njoints)]
    Q, V, A = _state(model, 3)
    joints = [0, 5, model.njoints - 1, *(joint for part in parts for _, joint in part.carriers)]
    acted = sorted({2, *joints[1:]})
    W = np.random.default_rng(2).normal(size=(3, len(acted), 6))
    poses, rates = whole.motions(Q, V, A, joints)
    _same([parted.poses(Q)], [poses])
    _same(parted.motions(Q, V, A, joints), (poses, rates))
    _same(parted.jacobians(Q, V), whole.jacobians(Q, V))
    _same(parted.jacobians(Q)[:2], whole.jacobians(Q)[:2])
    _same([parted.rnea(Q, V, A)], [whole.rnea(Q, V, A)])
    # Base last: what Pinocchio has as its force is nobody's.
    _same(parted.forces(Q, V, A, acted, W, joints[1:]), whole.forces(Q, V, A, acted, W, joints[1:]))
    _same([parted.rnea(Q, V, A)], [whole.rnea(Q, V, A)])  # no wrench is left behind
    _same(parted.energies(Q, V), whole.energies(Q, V))
    _same(parted.from_ground(Q[0], V[0], A[0]), whole.from_ground(Q[0], V[0], A[0]))
    _same([parted.falling(Q[0])], [whole.falling(Q[0])])
    single = OneByOne(model)  # which keeps no workspace
    _same([single.poses(Q)], [poses])
    _same(single.jacobians(Q)[:2], whole.jacobians(Q)[:2])
    _same([single.falling(Q[0])], [whole.falling(Q[0])])
    if not parted.cut:
        M, M_whole = parted.mass(Q[0]), whole.mass(Q[0])
        _same([np.triu(M)], [np.triu(M_whole)])
        _same(
            parted.derivatives(Q[0], V[0], A[0], acted, W[0]),
            whole.derivatives(Q[0], V[0], A[0], acted, W[0]),
        )


def test_equal_legs_share_one_workspace_and_pieces_stay_small(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = pin.Model()
    for k in range(12):
        parent = 0
        for j in range(10):
            place = pin.SE3.Random()
            parent = model.addJoint(parent, pin.JointModelRZ(), place, f"{k}_{j}")
    _, parted, parts = _pair(monkeypatch, model, 20)
    assert len(parts) == 12 and {part.like for part in parts} == {0}
    assert len({id(data) for data in parted._data}) == 1
    _, parted, parts = _pair(monkeypatch, model, 4)
    assert len(parts) == 36 and max(part.model.nv for part in parts) <= 6 + 4


def test_small_models_and_single_children_stay_whole() -> None:
    model, parent = pin.Model(), 0
    for j in range(splitting._WHOLE):
        assert split(model, True) == ()
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), f"{j}")
    model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), "last")
    assert split(model, False) == ()
    assert len(split(model, True)) > 1
