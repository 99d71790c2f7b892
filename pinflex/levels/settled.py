"""Equilibria with play: where what is loose comes to rest.

In a gap nothing resists, so that Newton's matrix is singular there, and beyond it resists at once.
The balance is sought as something falls and comes to rest in a viscous fluid (implicit Euler of
h^-2 M y'' without speeds, or the proximal point method of the potential),

    (K + s M) dy - J' dlam = -r,    J dy = -c

s so large at first that a step is short beside any gap. A step is kept where the forces
along it have not turned against it by more than half (the potential has fallen then); s is lowered
after it, and raised after one that is not. What nothing pushes stays where it is: pins and gears in
the middle of their play.
Source: Rockafellar (1976), SIAM J. Control Optim. 14; Kelley and Keyes (1998), SIAM J. Numer. Anal.
35, on the choice of s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError
from pinflex.linalg import null_space, saddle_matrix
from pinflex.mechanics.evaluation.compiled import serves
from pinflex.mechanics.evaluation.equations import Equations

if TYPE_CHECKING:
    from pinflex.levels.quasistatic import Equilibrium

_STEPS = 400
_TURNED = 0.5  # of the force along a step, at its end against it: beyond that it went too far
_LOWER, _RAISE = 0.2, 6.0
_BALANCED = 1e-10  # of the largest force: what may be left
_STILL = 1e-11  # m or rad: of a last step
_LEAST = 1e-13  # of the stiffness: s where nothing else resists
_LOOSE = 1e-9  # of the largest stiffness, by the masses: what has none
_STEP = 1e-5  # m or rad: of the first step
_FAINT = 1e-9  # of the mean mass

At = Callable[[Array, Array, int], "tuple[Equilibrium, Array]"]


def settle(
    dynamics: Equations, at: At, y: Array, lam: Array, free: IntArray, t: float, left: Array | float
) -> Equilibrium | None:
    """Where the free coordinates come to rest from y (nq,); None where they do not.

    `at` gives the forces at a pose, and how open the closures are there; `left`: see `_Newton`.
    """
    pieces = (piece for row in dynamics.system.kinks.rows for piece in row.pieces)
    if any(piece.power != 1.0 for piece in pieces) and not serves(dynamics.system, True):
        raise DescriptionError(
            "equilibrium: pins with clearance need the compiled kernel, whose tangents see "
            "contacts: those of the plain equations are differences wider than a hole. Switch it "
            "on, or leave `clearance` out."
        )
    now, c = at(y, lam, 0)
    if not np.any(now.r[free] - left) and np.max(np.abs(c), initial=0.0) < 1e-12:
        return now
    n, M = len(free), _masses(dynamics, y, free)
    pushed = np.linalg.solve(M, now.r[free] - left)
    s = max(float(np.max(np.abs(pushed), initial=0.0)) / _STEP, 1e-300)
    size, tangent = 0.0, None
    for step in range(1, _STEPS):
        if tangent is None:
            tangent = dynamics.tangent(now.y, now.v, now.a, now.lam, t)
            K, J = tangent.K[np.ix_(free, free)], tangent.J[:, free]
            least = _LEAST * float(np.max(np.abs(K), initial=0.0)) / float(np.max(np.diag(M)))
        s = max(s, least)
        try:
            x = np.linalg.solve(
                saddle_matrix(K + s * M, J), -np.concatenate([now.r[free] - left, c])
            )
        except np.linalg.LinAlgError:
            s *= _RAISE
            continue
        dy = np.zeros(dynamics.system.nv)
        dy[free] = x[:n]
        trial, opened = at(dynamics.integrate(now.y, dy), now.lam + x[n:], step)
        before = float(x[:n] @ ((K + s * M) @ x[:n]))  # of the force along the step, against it
        after = float(x[:n] @ (trial.r[free] - left))
        if not np.isfinite(after) or before < 0.0 or after > _TURNED * before:
            s *= _RAISE
            if s > 1e300:
                return None
            continue
        eased = s * M @ x[:n]  # what of the force the step has left
        now, c, tangent, s = trial, opened, None, s * _LOWER
        size = max(size, _largest(now.r), _largest(now.lam))
        if _largest(eased) <= _BALANCED * size and _largest(c) < 1e-11 and _largest(x[:n]) < _STILL:
            return now
    return None


def loose_directions(dynamics: Equations, found: Equilibrium, free: IntArray, t: float) -> int:
    """How many directions nothing holds at an equilibrium: there the position is one of many."""
    _, _, K, J = dynamics.tangent(found.y, found.v, found.a, found.lam, t)
    Z = null_space(J[:, free])
    M = _masses(dynamics, found.y, free)
    root = np.linalg.inv(np.linalg.cholesky(Z.T @ M @ Z))
    held = root @ (Z.T @ (0.5 * (K + K.T)[np.ix_(free, free)]) @ Z) @ root.T
    values = np.abs(np.linalg.eigvalsh(held))
    return int(np.sum(values <= _LOOSE * np.max(values, initial=0.0)))


def beyond(dynamics: Equations, y: Array) -> tuple[str, ...]:
    """Names of rigid stops that y has passed: they give speeds back, and bear no force."""
    kinks = dynamics.system.kinks
    compiled = dynamics.compiled or Equations(dynamics.system, marched=True).compiled
    if not kinks.rigid or compiled is None:
        return ()
    x = compiled.elongations(y[None])[0]
    rigid = ((k, row) for k, row in enumerate(kinks.rows) if row.restitution >= 0.0)
    return tuple(row.name for k, row in rigid if kinks.piece(k, x[k]) != row.free)


def _masses(dynamics: Equations, y: Array, free: IntArray) -> Array:
    """Masses of the free coordinates; what has none is held a little too."""
    M = dynamics.mass(y)[np.ix_(free, free)]
    return np.asarray(M + _FAINT * np.trace(M) / max(len(free), 1) * np.eye(len(free)))


def _largest(x: Array) -> float:
    return float(np.max(np.abs(x), initial=0.0))


def slack(dynamics: Equations, y: Array) -> tuple[str, ...]:
    """Names of gears within their play, pins off their holes and cables that bear no force at y."""
    kinks = dynamics.system.kinks
    if not kinks.rows or dynamics.compiled is None:
        return ()
    x = dynamics.compiled.elongations(y[None])[0]
    found = []
    for k, row in enumerate(kinks.rows):
        at = int(kinks.piece(k, x[k]))
        piece = row.pieces[at]
        gear = len(row.pieces) == 3 and row.pieces[1].stiffness < 0.0  # a dead zone
        idle = at == 1 if gear else piece.force == 0.0 and piece.stiffness == 0.0
        if idle and not row.name.startswith("stop of "):
            found.append(row.name)
    return tuple(found)
