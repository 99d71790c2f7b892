"""How far two runs of one system differ in what follows from accelerations: forces and stresses.

Stress and section forces relative to their largest values, all sections of all links together;
the acceleration of the platform likewise. They take a pass over the samples: few are looked at,
those that differ most, and only where strain differs enough, or somebody asks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.integrators.collocation import radau
from pinflex.integrators.corrector import Inside
from pinflex.integrators.problem import Run
from pinflex.levels.outputs import ROUND_OFF, output_differences
from pinflex.linalg import null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.kinematics import Samples
from pinflex.recovery.links import forces, sections
from pinflex.results.result import Result
from pinflex.threads import one_blas_thread

_SAMPLES = 51  # the worst of so many pieces
_FORCES = ("stress", "section forces", "platform acceleration")

Told = Callable[[], Mapping[str, float]]


def force_errors(mechanism: Mechanism, coarse: Run, fine: Run, gain: float) -> Told:
    """Function that finds the estimated errors, once.

    Under a digital controller with what the jumps of its forces wake and steps do not follow.
    """

    @cache
    def told() -> dict[str, float]:
        some = _worst_of_run(coarse, fine)
        with one_blas_thread():
            runs = coarse.at(some), fine.at(some)
            if isinstance(settle := fine.settle, Inside) and settle is coarse.settle:
                runs = settle.both(*runs)
            a, b = (_of_forces(mechanism, run) for run in runs)
            found = output_differences(a, b, of=_FORCES)
            lost = _lost(mechanism, fine, b)
        return {key: max(e / gain, ROUND_OFF) + lost.get(key, 0.0) for key, e in found.items()}

    return told


def _of_forces(mechanism: Mechanism, run: Run) -> Result:
    """What `_FORCES` are of in a run, and no more."""
    samples, links = Samples(mechanism, run), [*mechanism.parts] if run.system.n_eta else []
    arrays = {"torque": run.torque, **samples.kinematics.arrays}
    if links:
        arrays |= sections(samples) | forces(samples)
    return Result(run.t, arrays, {"platform": mechanism.description.platform, "links": links})


def _worst_of_run(coarse: Run, fine: Run) -> IntArray:
    """Of samples in a row the one at which elastic forces, or what they accelerate, differ most."""
    every, m = np.arange(len(fine.t)), int(fine.system.rigid.nv)
    if len(every) <= _SAMPLES or not fine.system.n_eta:
        return every
    lift = _lift(Equations(fine.system).mass(fine.y[0])[m:, m:])
    squares = _squares(fine, coarse.y - fine.y, lift)
    size = np.max(squares / np.maximum(squares.max(axis=1, keepdims=True), 1e-300), axis=0)
    return np.array([row[np.argmax(size[row])] for row in np.array_split(every, _SAMPLES)])


def elastic_apart(coarse: Run, fine: Run, mass: Array) -> tuple[float, float]:
    """Difference of two runs in strain, and in what elastic forces accelerate; of the largest."""
    m = int(fine.system.rigid.nv)
    lift = _lift(mass[m:, m:])
    apart, whole = (
        _squares(fine, y, lift).max(axis=1, initial=0.0) ** 0.5 for y in (coarse.y - fine.y, fine.y)
    )
    strain, force = (float(x / y) if y > 0.0 else 0.0 for x, y in zip(apart, whole, strict=True))
    return strain, force


def _lift(M: Array) -> Array:
    """L with L L' the inverse of a mass matrix, without the coordinates that have no mass."""
    w, V = np.linalg.eigh(M)
    some = w > 1e-13 * max(float(w[-1]), 0.0) if len(w) else np.zeros(0, bool)
    return np.asarray(V[:, some] / np.sqrt(w[some]))


def _squares(run: Run, y: Array, lift: Array) -> Array:
    """Energy of strain, and its forces squared over the mass (`_lift` of it), shape (2, nt)."""
    m, eta = int(run.system.rigid.nv), y[:, int(run.system.rigid.nq) :]
    force = eta @ run.system.K[m:, m:]
    lifted = force @ lift
    return np.abs([np.einsum("ki,ki->k", *x) for x in ((force, eta), (lifted, lifted))])


# What the jumps of held forces wake, and steps too long for it let die.
#
# Both of two runs may do so, and then agree. Linearised about the middle of the run, mode by mode,
# a jump p of its force adds p to its acceleration, which goes on by exp(z T) over a hold T, and by
# R(z T / n)^n in n steps of Radau, R its stability function (Hairer and Wanner 1996, IV.3):
#
#     z = -damping + i omega,     R(z) = last of (I - z A)^-1 1
#
# The loop is left open: what the controller answers is in the forces that it held.

_STILL = 1e-3  # of the highest frequency: what is slower moves as a rigid body


def _lost(mechanism: Mechanism, run: Run, seen: Result) -> dict[str, float]:
    """Parts of outputs that steps lose, of their largest values at the samples that are seen."""
    if run.signals is None or run.signals.held is None or not run.system.n_eta:
        return {}
    (t, force, free), system, k = run.signals.held, run.system, len(run.t) // 2
    if len(t) < 2:
        return {}  # nothing has jumped
    dynamics = Equations(system)
    state = run.y[k], run.v[k], run.a[k], run.lam[k], float(run.t[k])
    M, C, K, J = dynamics.tangent(*state)
    at = np.ix_(free, free)
    shapes, squares, damping = _modes(M[at], C[at], K[at], J[:, free])
    z, hold = 1j * squares**0.5 - damping, float(np.median(np.diff(t)))
    n = max(round(hold / run.settings["dt"]), 1)
    A = radau(run.settings["stages"]).A
    one, h = np.ones(len(A)), hold / n
    step = np.array([np.linalg.solve(np.eye(len(A)) - x * h * A, one)[-1] for x in z])
    jumps = np.diff(force[:, free] @ shapes, axis=0)
    left = _rung(np.exp(z * hold), jumps) - _rung(step**n, jumps)
    found = dict[str, float]()
    if (platform := mechanism.description.platform) is not None:
        place = system.expansion.frames[platform]
        moved = frame_jacobian(dynamics, state[0], place)[:3, free] @ shapes
        whole = np.abs(seen.array(f"frame/{platform}/acceleration")[:, :3]).max()
        found["platform acceleration"] = float(np.abs(left @ moved.T).max() / max(whole, 1e-300))
    fast = squares > (_STILL**2) * squares.max()
    bent = (left[:, fast] / squares[fast]) @ shapes[free >= dynamics.n_rigid][:, fast].T
    rows = slice(dynamics.n_rigid, None)
    K, eta = system.K[rows, rows], run.y[:, dynamics.nq_rigid :]
    energy = [np.einsum("ki,ij,kj->k", x.conj(), K, x).real.max() for x in (bent, eta)]
    part = float((energy[0] / energy[1]) ** 0.5) if energy[1] > 0.0 else 0.0
    return found | {"stress": part, "section forces": part}


def _modes(M: Array, C: Array, K: Array, J: Array) -> tuple[Array, Array, Array]:
    """Shapes of unit modal mass, squared frequencies [1/s^2] and decay [1/s] of what has mass."""
    Z = null_space(J)
    L = Z @ _lift(Z.T @ M @ Z)
    squares, U = np.linalg.eigh(L.T @ (0.5 * (K + K.T)) @ L)
    shapes = L @ U
    decay = 0.5 * np.einsum("im,ij,jm->m", shapes, C, shapes)
    return shapes, np.maximum(squares, 0.0), np.maximum(decay, 0.0)


def _rung(factor: Array, jumps: Array) -> Array:
    """Accelerations of modes, (holds, modes), just after each of the jumps that wake them."""
    found = np.empty(jumps.shape, dtype=complex)
    now = np.zeros(len(factor), dtype=complex)
    for k, jump in enumerate(jumps):
        found[k] = now = factor * now + jump
    return found
