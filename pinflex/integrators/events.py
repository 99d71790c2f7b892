"""Contacts and releases: what a march does where a law of pieces bends.

The compiled march cuts its steps there (kernel/source/events.c). Behind the border another piece
acts, and accelerations begin anew; or a rigid stop gives back a part e of the speed x' at once:

    M dv - J' L = n p,   J dv = 0,   x'+ = -e x'-

with m = 1 / (n . dv/p) the mass that the stop meets, which loses (1 - e^2) x'^2 m / 2 (Newton).
A stop that is at rest already takes part: with p >= 0 of each contact, L its multiplier,

    M dv - J' L = N' p,   0 <= p  complementary to  N v+ + e N v- >= 0        (Moreau, 1988)

Bounces that come ever faster have no end in finite steps (Zeno): one that is slow beside the
fastest gives back nothing, and from there on the stop is held by a stiff spring (`kinks.resting`)
until nothing presses it any more.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import ConvergenceError, Ending, SceneError
from pinflex.integrators.compiled import MarchKernel
from pinflex.integrators.problem import Problem
from pinflex.kernel.evaluate import Evaluator
from pinflex.linalg import saddle_matrix
from pinflex.mechanics.kinks import RINGS
from pinflex.results.views import Event

_FAINT = 1e-6  # of the fastest bounce of a stop: those that are slower come to rest
_SOON = 1e-6  # s: so far ahead a run that starts at a border is looked at
_IN_VAIN = 40  # pieces changed at one instant, at the most
_MEETS = 1e-9  # rad or m: within it several are met at once; landings are within it too
_SINKS = 2.0 / RINGS  # s: first step of what comes to rest
_NEVER = 1e-14  # 1/kg or 1/(kg m^2): what moves by less under an impulse is held by motors
_ALIKE = 1e-14  # contacts of the same direction share their impulse
_SHORTER = 0.25  # step after one of them: what is touched for less than it is too short to be seen


class Events:
    """The pieces that a run is in.

    Attributes:
        found: Events so far.
    """

    def __init__(self, name: str, problem: Problem, evaluator: Evaluator) -> None:
        self._name, self._problem, self._evaluator = name, problem, evaluator
        self.kinks = problem.dynamics.system.kinks
        self.found: list[Event] = []
        self._given: list[tuple[float, float]] = []  # s, J: what motors put in at a bounce
        self._fastest = np.zeros(len(self.kinks.rows))
        self._usual: dict[tuple[int, int], float] = {}
        self._still, self._last = 0, -np.inf

    def begin(self, march: MarchKernel) -> None:
        """The pieces that a run starts in; at a border, those that it moves into."""
        system = self._problem.dynamics.system
        soon = system.integrate(march.y, _SOON * march.v)
        x, later = self._evaluator.elongations(np.array([march.y, soon]))
        for k, row in enumerate(self.kinks.rows):
            piece = int(self.kinks.piece(k, x[k]))
            low = self.kinks.ends(k, piece)[0]
            if later[k] < x[k] and piece and abs(x[k] - low) <= 1e-12 * (1.0 + abs(low)):
                piece -= 1
            if row.restitution >= 0.0:
                piece = row.free
                self._require_within(row.name, float(x[k]), self.kinks.ends(k, piece))
            march.piece[k], march.hit[k] = piece, 0.0

    def _require_within(self, what: str, x: float, ends: tuple[float, float]) -> None:
        if ends[0] - _MEETS * (1.0 + abs(ends[0])) <= x <= ends[1] + _MEETS * (1.0 + abs(ends[1])):
            return
        beyond = max(ends[0] - x, x - ends[1])
        raise SceneError(
            f"{self._name}: the run starts {beyond:.3g} (rad or m) beyond the {what}, which is "
            "rigid. Start within it (`home`), or give the stop `stiffness`."
        )

    def met(self, march: MarchKernel) -> None:
        """Change the piece of the law that the last step has come to the end of, or bounce."""
        at = march.at
        k, side, t = int(at.event), int(at.side), float(at.t)
        row, piece = self.kinks.rows[k], int(march.piece[k])
        self._still = self._still + 1 if t <= self._last else 0
        self._last = t
        if self._still:
            at.h = at.planned * _SHORTER**self._still
        if self._still > _IN_VAIN:
            raise ConvergenceError(
                f"{self._name}: t = {t:.6g} s: {row.name} opens and closes without end. "
                f"{Ending.CHATTERS.value} error.result holds the run so far.",
                time=t, ending=Ending.CHATTERS,
            )  # fmt: skip
        speed = float(march.v[row.v]) if row.v >= 0 else float(at.speed)
        if row.restitution >= 0.0 and piece == row.free:
            self._bounce(march, k, t)
            return
        self._usual[k, piece] = float(at.planned)
        old, new = row.pieces[piece], row.pieces[piece + side]
        march.piece[k], march.hit[k] = piece + side, abs(speed)
        if not self._still:
            at.h = min(float(at.h), self._usual.get((k, piece + side), np.inf))
        words = {1: "contact", -1: "release", 0: "bend"}
        stiffer = int(np.sign(new.stiffness - old.stiffness))
        self.found.append(Event(t, row.name, words[stiffer], abs(speed), 0.0, 0.0))

    def _bounce(self, march: MarchKernel, k: int, t: float) -> None:
        """Speeds after a stop is met, with all that are touched then or rest on theirs."""
        rows, met = self.kinks.rows, self._touched(march)
        laws, sides = list(met), np.array(list(met.values()), float)
        rests = np.array([march.piece[j] != rows[j].free for j in laws])
        N = -sides[:, None] * self._directions(march.y, laws)
        before = N @ march.v
        self._fastest[laws] = np.maximum(self._fastest[laws], -before)
        e = np.array([rows[j].restitution for j in laws])
        least = np.where(e > 0.0, _FAINT, 1.0)  # of no restitution none bounces
        faint = rests | ((e < 1.0) & (-before <= least * self._fastest[laws]))
        e[faint] = 0.0
        move = self._moves(march.y, N, t)
        G = N @ move
        if not G[laws.index(k), laws.index(k)] > _NEVER:
            raise ConvergenceError(
                f"{self._name}: a rigid stop is met by a motor that follows its motion whatever "
                f"happens. {Ending.STOPS_A_MOTOR.value}",
                ending=Ending.STOPS_A_MOTOR,
            )
        p = _impulses(G, -(1.0 + e) * before)
        old = march.v.copy()
        march.v[...] += move @ p
        after = N @ march.v
        lost = -float(p @ (before + after)) / 2.0
        M = self._problem.dynamics.mass(march.y, t)
        gained = 0.5 * float((march.v + old) @ M @ (march.v - old))
        self._given.append((t, gained + lost))
        for i, j in enumerate(laws):
            stays = faint[i] and (p[i] > 0.0 or j == k)
            march.piece[j] = rows[j].free + (met[j] if stays else 0)
            if stays:  # it sinks in
                march.at.h = min(float(march.at.h), _SINKS)
            if j == k or (p[i] > 0.0 and not rests[i]):
                what = "rest" if faint[i] else "bounce"
                loss = -float(p[i] * (before[i] + after[i])) / 2.0
                self.found.append(Event(t, rows[j].name, what, abs(before[i]), float(p[i]), loss))

    def _touched(self, march: MarchKernel) -> dict[int, int]:
        """Rigid stops that are touched, and on which side: 1 or -1."""
        x, found = self._evaluator.elongations(march.y[None])[0], {}
        for j, row in enumerate(self.kinks.rows):
            if row.restitution < 0.0:
                continue
            side = int(march.piece[j]) - row.free
            if not side:
                ends = self.kinks.ends(j, row.free)
                low, high = (abs(x[j] - end) < _MEETS * (1.0 + abs(end)) for end in ends)
                side = int(high) - int(low)
            if side:
                found[j] = side
        return found

    def _directions(self, y: Array, laws: list[int]) -> Array:
        """What laws' coordinates change by velocities, shape (laws, nv)."""
        dynamics, rows = self._problem.dynamics, self.kinks.rows
        touches = [touch.law for touch in dynamics.system.loads.touches]
        met = any(rows[k].v < 0 for k in laws)
        outward = dynamics.reference.outward(y) if met else np.zeros((0, 0))
        N = np.zeros((len(laws), dynamics.system.nv))
        for i, k in enumerate(laws):
            if rows[k].v < 0:
                N[i] = outward[touches.index(k)]
            else:
                N[i, rows[k].v] = 1.0
        return N

    def _moves(self, y: Array, N: Array, t: float) -> Array:
        """What impulses of one along rows N (k, nv) change of the velocities, shape (nv, k)."""
        d, free = self._problem.dynamics, self._problem.free
        M, J = d.mass(y, t), d.close(y).J[:, free]
        n, S = len(free), saddle_matrix(M[np.ix_(free, free)], J)
        pushed = np.concatenate([N[:, free].T, np.zeros((len(J), len(N)))])
        move = np.zeros((len(M), len(N)))
        move[free] = np.linalg.lstsq(S, pushed, rcond=1e-13)[0][:n]
        return move

    def works(self, t: Array) -> Array:
        """Energy that motors which follow their motion have put in at bounces, and that these have
        taken, up to times t (nt,), J, shape (nt, 2).
        """
        lost = [(event.time, event.loss) for event in self.found]
        return np.stack([_upto(t, each) for each in (self._given, lost)], axis=1)


def _upto(t: Array, each: list[tuple[float, float]]) -> Array:
    when, much = np.array(each).reshape(-1, 2).T
    of: IntArray = np.searchsorted(when, t, side="right")
    return np.asarray(np.concatenate([[0.0], np.cumsum(much)])[of])


def _impulses(G: Array, wanted: Array) -> Array:
    """p >= 0, complementary to G p - wanted >= 0, G (k, k) positive."""
    if len(G) == 1:
        return np.asarray(np.maximum(wanted / G[0], 0.0))
    from scipy.optimize import nnls

    scale = np.sqrt(np.maximum(np.diag(G), 1e-300))
    L = np.linalg.cholesky(G / np.outer(scale, scale) + _ALIKE * np.eye(len(G)))
    p = np.asarray(nnls(L.T, np.linalg.solve(L, wanted / scale))[0])
    acts = p > 0.0  # of these exactly
    p[acts] = np.linalg.lstsq(G[np.ix_(acts, acts)], wanted[acts], rcond=_ALIKE)[0]
    return p
