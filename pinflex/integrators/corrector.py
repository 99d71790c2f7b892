"""The error of a Radau run from that run alone: every step taken once more with one stage more.

One Newton correction of s + 1 stages, from the polynomials of the step, by the step's own tangent,
from the start that the corrections so far have led to (source/correct.c). What the corrected run
differs from the run by is an estimate of the run's error, carried along from step to step (defect
correction: Zadunaisky 1976; Skeel 1982). A corrected run can be corrected in its turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinflex.arrays import Array, IntArray, distinct
from pinflex.integrators.collocation import with_one_more
from pinflex.integrators.compiled import STATE, Batch, MarchKernel, Stages
from pinflex.integrators.problem import Problem, Run, on_marks
from pinflex.linalg import saddle_matrix
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import closure_motion

# Above this contraction of the step's own iteration one correction leaves too much: it takes two.
_SLOW = 0.1


class Corrector(Stages):
    """Corrects the steps of a run, one after the other.

    Attributes:
        march: Arrays of the corrected steps, from the first on.
    """

    def __init__(self, run: Stages, slow: float = _SLOW) -> None:
        """`run`: the stages of the steps, or another corrector.

        `slow`: the contraction above which a step takes two corrections.
        """
        super().__init__(run.problem, with_one_more(run.method))
        self.weights, self._slow = run.method.at(self.method.c), slow
        self.march: MarchKernel | None = None
        self.begin_anew()

    @property
    def iterations(self) -> int:
        """Newton corrections so far."""
        return 0 if self.march is None else int(self.march.at.iterations)

    def begin_anew(self) -> None:
        """Let the next steps be the first of a run."""
        self._end_a: Array | None = None
        self._end: dict[str, Array] = {}

    def correct(self, steps: Batch) -> Batch:
        """Steps corrected, from where those that were kept have led to.

        Raises:
            LinAlgError: Their equations are singular with one stage more.
        """
        march, given, c = self.march or self.workspace(steps), None, self.method.c
        self.march = march
        for name, x in self._end.items():
            getattr(march, name)[...] = x
        if steps.kernel.table is None:
            pairs = zip(steps.t, steps.h, strict=True)
            given = np.array([self.inside(t + h * c) for t, h in pairs])
        if not march.correct(steps.kernel, self.weights, self._end_a, given):
            raise np.linalg.LinAlgError("singular iteration matrix")
        return Batch(self, march, int(march.at.count))

    def keep(self, steps: Batch) -> None:
        """Go on behind the last of steps, before others are made: where it ended, and corrected."""
        march, n = self.march, len(steps)
        assert march is not None
        self._end_a = steps.kernel.steps["a"][n, -1].copy()
        here = n == march.at.count  # the last of them all is where the march is
        self._end = {
            name: (getattr(march, name) if here else march.steps[f"{name}0"][n + 1]).copy()
            for name in STATE
        }

    def workspace(self, steps: Batch) -> MarchKernel:
        """Arrays for the corrections of the steps of a run."""
        none = np.zeros(0, dtype=np.intp)  # nothing is judged
        room = len(steps.kernel.steps["t"]) - 1, 0  # of its largest batch
        given = {"measured_at": none, "weight": none, "stop_at": none, "kind": none}
        made = self.kernel.march(vars(self.method) | given, steps.kernel.table, room)
        made.at.slow, made.at.same_step = self._slow, steps.kernel.at.same_step
        return made


# Accelerations and multipliers at samples inside long steps, from the equations of motion there.
#
#     [ S  -J' ] [ da   ]     [ r  ]
#     [ J   0  ] [ dlam ] = - [ c'']          S = M + h C / 7 + h^2 K / 50
#
# The polynomial of a step's accelerations is of two orders less than that of its poses: forces and
# stresses, which follow from accelerations, would be much less accurate inside a step than at its
# end. What the polynomial leaves in the equations is taken away. Its poses are off too, by about
# h^2 / 50 of what its accelerations are: S lets stiff vibration, which the pose of a sample does
# not resolve, follow the polynomial as before.

# Errors of velocities and poses over those of accelerations, of h and h^2: of polynomials through
# seven points, 1 / s and 1 / s (s + 1).
_BY_V, _BY_Y = 1.0 / 7.0, 1.0 / 50.0
_BLOCKS = 13  # of neighbours that share matrices: one correction more is cheaper than new ones
_NEIGHBOURS = 8  # in a block, where there are few samples: matrices cost as much as 8 corrections
_ROUNDS = 8
_LEFT = 1e-6  # of the first correction: no output shows it
_FAINT = 1e-6  # of the largest acceleration: of a smaller first one, as at rest, round-off is left
_SINGULAR = 1e13  # condition: coordinates without mass have no acceleration of their own
_AFTER = 1e-9  # s: what stiffness counts beside damping in the rate of a balance
_NONE = 1e-11  # of the largest, roots of the diagonal: what is below is no mass


@dataclass(frozen=True)
class Inside:
    """Solves the equations of a run at its samples.

    Attributes:
        free: Velocity rows that are solved for.
        push: From a run to what motors and a controller push with, shape (n, nv).
        jumps: Times in s at which accelerations jump, the start among them.
        h: Length of the steps in s that samples away from jumps lie in; 0: those at jumps are
            solved, as they are just after.
    """

    free: IntArray
    push: Callable[[Run], Array]
    jumps: Sequence[float]
    h: float

    def __call__(self, run: Run) -> Run:
        """The run with accelerations and multipliers that solve the equations.

        As it was where corrections do not shrink.
        """
        return self.at(run, np.flatnonzero(on_marks(run.t, self.jumps) == (self.h == 0.0)))

    def both(self, one: Run, other: Run) -> tuple[Run, Run]:
        """Two runs that are near each other at the same samples: they share matrices."""

        def mixed(name: str) -> Array:  # in turn, sample by sample
            pair = np.stack([getattr(one, name), getattr(other, name)], axis=1)
            return pair.reshape(2 * len(pair), *pair.shape[2:])

        y, v, moved, lam, torque = map(mixed, ("y", "v", "a", "lam", "torque"))
        found = self(Run(one.system, mixed("t"), y, v, moved, lam, torque, cost={}))
        a, b = (slice(k, None, 2) for k in (0, 1))
        return (
            replace(one, a=found.a[a], lam=found.lam[a], settle=None),
            replace(other, a=found.a[b], lam=found.lam[b], settle=None),
        )

    def at(self, run: Run, some: IntArray) -> Run:
        """The same at some of its samples."""
        if not len(some):
            return run
        at, dynamics = run.at(some), Equations(run.system)
        push, a, lam = self.push(at), run.a.copy(), run.lam.copy()
        instants = 1 + int(np.count_nonzero(np.diff(at.t)))
        blocks = min(_BLOCKS, -(-instants // _NEIGHBOURS))
        faint = _FAINT * float(np.max(np.abs(a[:, self.free]), initial=0.0))
        for block in np.array_split(np.arange(len(some)), blocks):
            if not self._solve(dynamics, at, push, block, faint):
                return run
        a[some], lam[some] = at.a, at.lam
        return replace(run, a=a, lam=lam)

    def _solve(
        self, dynamics: Equations, run: Run, push: Array, block: IntArray, faint: float
    ) -> bool:
        """Solve at neighbouring samples, in place; whether that was possible.

        `faint`: what the first correction counts as at the least.
        """
        y, v, a, lam, t = (x[block] for x in (run.y, run.v, run.a, run.lam, run.t))
        found = self._matrices(dynamics, run.at(block[[len(block) // 2]]))
        if found is None:
            return False
        inverse, soft, J = found
        free, n, first = self.free, len(self.free), faint
        moved = np.zeros((len(block), len(inverse)))
        for _ in range(_ROUNDS):
            left = np.zeros_like(moved)
            left[:, :n] = (dynamics.residual(y, v, a, lam, t).r - push[block])[:, free]
            left[:, :n] += moved[:, :n] @ soft.T
            if len(J):
                left[:, n:] = closure_motion(dynamics, y, v, a)[2]
            change = -left @ inverse.T
            moved += change
            a[:, free] += change[:, :n]
            lam += change[:, n:]
            far = float(np.max(np.abs(change[:, :n]), initial=0.0))
            first = max(first, far)
            if far <= _LEFT * first:
                run.a[block], run.lam[block] = a, lam
                return True
        halves = np.array_split(block, 2)
        return len(block) > 1 and all(
            self._solve(dynamics, run, push, half, faint) for half in halves
        )

    def _matrices(self, dynamics: Equations, run: Run) -> tuple[Array, Array, Array] | None:
        """Inverse of [[S, -J'], [J, 0]], S - M and J in a state; None: it is singular."""
        y, v, a, lam, t = run.y[0], run.v[0], run.a[0], run.lam[0], float(run.t[0])
        M, C, K, J = dynamics.tangent(y, v, a, lam, t)
        at, n = np.ix_(self.free, self.free), len(self.free)
        soft = (self.h * _BY_V * C + self.h**2 * _BY_Y * K)[at]
        S = saddle_matrix(M[at] + soft, J[:, self.free])
        size = np.ones(len(S))
        size[:n] = np.sqrt(np.abs(np.diag(S)[:n]))
        size[size <= _NONE * size[:n].max(initial=0.0)] = 1.0
        scaled = S / (size[:, None] * size)
        try:
            inverse = np.linalg.inv(scaled)
        except np.linalg.LinAlgError:
            inverse = np.full_like(scaled, np.inf)
        if not np.linalg.norm(scaled, 1) * np.linalg.norm(inverse, 1) < _SINGULAR:
            if self.h > 0.0:
                return None
            inverse = _inverse_of_rest(
                scaled, (C[at] + _AFTER * K[at]) / np.outer(size[:n], size[:n])
            )
        return inverse / (size[:, None] * size), soft, J


def _inverse_of_rest(S: Array, rates: Array) -> Array:
    """Inverse of a saddle matrix (m, m) where coordinates have no mass.

        S x = b,     U' rates x = 0

    What nothing accelerates, U (m, k) of it, is in balance before and after a jump: the balance's
    own rate does not jump, that of dampers or, where there are none, of springs.
    """
    U, sigma, _ = np.linalg.svd(S)
    U, n = U[:, sigma * _SINGULAR < sigma[0]], len(rates)
    rows = U[:n].T @ rates
    rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    whole = S.copy()
    whole[:, :n] += U @ rows
    return np.asarray(np.linalg.pinv(whole) @ (np.eye(len(S)) - U @ U.T))


def after_jumps(problem: Problem, run: Run, breaks: Sequence[float]) -> Run:
    """The run with accelerations and forces just after a jump at each sample that lies on one.

    A step that ends there has those just before it; the motion and all other levels have those
    after. At breaks without a jump the run stays as it is.

    Under a digital controller, whose signals the run has, every instant is a jump. Stiff
    coordinates that die away in microseconds begin there with accelerations that no polynomial of a
    step knows: where motors are driven they are solved for when they are asked for.
    """
    t, motors, marks = run.t, problem.motors, tuple[float, ...]()
    if problem.sampler is not None:
        marks = (*problem.sampler.instants(float(t[-1])), *breaks)
        at = np.flatnonzero(on_marks(t, marks))
    else:
        kicks = [x for f, _ in run.system.loads.forces for x in f.corners if x > 0.0]
        on = np.flatnonzero(on_marks(t, breaks))
        if len(on):
            moved = run.a[:, motors] if problem.prescribed else problem.path(t).acceleration
            on = on[problem.jumps(t[on], moved)]
        at = distinct(on, np.flatnonzero(on_marks(t, kicks))) if kicks else on
    settle = Inside(problem.free, problem.push, marks, 0.0)
    if marks and not problem.prescribed:
        return replace(run, torque=settle.push(run)[:, motors], settle=settle)
    if not len(at):
        return run
    if problem.prescribed:
        a = run.a.copy()
        a[np.ix_(at, motors)] = problem.path(t[at]).acceleration
        run = replace(run, a=a)
    run, torque = settle.at(run, at), run.torque.copy()
    some = run.at(at)
    push = settle.push(some)
    if problem.prescribed:
        push = problem.dynamics.residual(some.y, some.v, some.a, some.lam, some.t).r - push
    torque[at] = push[:, motors]
    return replace(run, torque=torque)
