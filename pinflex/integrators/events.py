"""Contacts and releases: what a march does where a law of pieces bends.

The compiled march cuts its steps there (kernel/source/events.c). Behind the border another piece
acts, and accelerations begin anew; or a rigid stop gives back a part e of the speed x' at once:

    M dv - J' L = n p,   J dv = 0,   x'+ = -e x'-

with m = 1 / (n . dv/p) the mass that the stop meets, which loses (1 - e^2) x'^2 m / 2 (Newton).
Bounces that come ever faster have no end in finite steps (Zeno): they are told, and the run stops
there.
"""

from __future__ import annotations

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.errors import ConvergenceError, Ending
from pinflex.integrators.problem import Problem
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.march import MarchKernel
from pinflex.results.views import Event

_FAINT = 1e-7  # of the fastest bounce of a stop: those that are slower have no end
_SOON = 1e-6  # s: so far ahead a run that starts at a border is looked at
_IN_VAIN = 40  # pieces changed at one instant, at the most
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
            march.piece[k], march.hit[k] = piece, 0.0

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
        if row.restitution >= 0.0:
            self._bounce(march, k, t, speed)
            return
        self._usual[k, piece] = float(at.planned)
        old, new = row.pieces[piece], row.pieces[piece + side]
        march.piece[k], march.hit[k] = piece + side, abs(speed)
        if not self._still:
            at.h = min(float(at.h), self._usual.get((k, piece + side), np.inf))
        words = {1: "contact", -1: "release", 0: "bend"}
        stiffer = int(np.sign(new.stiffness - old.stiffness))
        self.found.append(Event(t, row.name, words[stiffer], abs(speed), 0.0, 0.0))

    def _bounce(self, march: MarchKernel, k: int, t: float, speed: float) -> None:
        row = self.kinks.rows[k]
        self._fastest[k] = max(self._fastest[k], abs(speed))
        if row.restitution < 1.0 and abs(speed) < _FAINT * self._fastest[k]:
            raise ConvergenceError(
                f"{self._name}: t = {t:.6g} s: {row.name}: its bounces come faster and faster and "
                "end here: from now on it would rest on the stop, which a coefficient of "
                f"restitution does not say. {Ending.COMES_TO_REST.value} error.result holds the "
                "run so far.", time=t, ending=Ending.COMES_TO_REST,
            )  # fmt: skip
        move = self._unit(march.y, row.v)
        mass = 1.0 / move[row.v]
        impulse = (1.0 + row.restitution) * mass * abs(speed)
        march.v[...] -= np.sign(speed) * impulse * move
        loss = 0.5 * (1.0 - row.restitution**2) * mass * speed**2
        self.found.append(Event(t, row.name, "bounce", abs(speed), impulse, loss))

    def _unit(self, y: Array, row: int) -> Array:
        """What an impulse of one in a row changes of the velocities, shape (nv,)."""
        d, free = self._problem.dynamics, self._problem.free
        M, J = d.mass(y), d.close(y).J[:, free]
        n, rows = len(free), len(J)
        S = np.block([[M[np.ix_(free, free)], -J.T], [J, np.zeros((rows, rows))]])
        pushed = np.concatenate([(free == row).astype(float), np.zeros(rows)])
        move = np.zeros(len(M))
        move[free] = np.linalg.lstsq(S, pushed, rcond=1e-13)[0][:n]
        if not move[row] > 1e-12 / max(abs(M[row, row]), 1e-300):
            raise ConvergenceError(
                f"{self._name}: a rigid stop is met by a motor that follows its motion whatever "
                f"happens. {Ending.STOPS_A_MOTOR.value}",
                ending=Ending.STOPS_A_MOTOR,
            )
        return move

    def losses(self, t: Array) -> Array:
        """Energy that bounces have taken up to times t (nt,), J."""
        when = np.array([event.time for event in self.found])
        each = np.concatenate([[0.0], np.cumsum([event.loss for event in self.found])])
        upto: IntArray = np.searchsorted(when, t, side="right")
        return np.asarray(each[upto])
