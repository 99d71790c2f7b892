"""margins(): how far a digital controller is from making the robot oscillate, pose by pose.

The robot, linearised about a pose, between two samples, its input held with a delay (Astrom,
Wittenmark (1997), Computer-Controlled Systems, sections 2.3 and 3.2), and the law once a sample are
one linear map of the state from sample to sample. The loop is stable while all its eigenvalues lie
within the unit circle, so a margin is where the first of them leaves it: no crossing of a frequency
response has to be found among the many resonances of a flexible robot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag, expm

from pinflex.actuation.feedback import Feedback, drives_motors, fresh_law, place
from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.blocks.control import Control, DigitalPid, LinearLaw, Pid
from pinflex.description.solve import SolveSpec
from pinflex.errors import DescriptionError, PinflexError
from pinflex.inversion.linear_model import Balanced
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.report import Table
from pinflex.report import table as report_table
from pinflex.text import frozen, number
from pinflex.threads import one_blas_thread

_GAINS = np.geomspace(1.0, 100.0, 81)  # 0.5 dB from one to the next
_DELAYS = np.arange(0.0, 20.0, 0.1)  # in periods
_EXACT = 1e-6  # relative, of a margin
_BEYOND = 1.001  # of a margin: what oscillates there grows faster than what only stands
_OUTSIDE = 1e-7  # beyond 1: an eigenvalue that is no double one of a joint that nothing holds


@dataclass(frozen=True)
class MarginRow:
    """Margins at a pose.

    Attributes:
        pose: Its number. drive: Whose output is scaled; "all": of all drives together.
        low, high: Factors of the output between which the loop stays stable [-]: 0 where it is
            under 0.01, inf where over 100. nan: it is not stable as it is.
        frequency: At which it oscillates at the largest factor, or as it is if it is not stable
            [Hz]; up to half the sampling frequency.
        delay: Time that may be added to the controller's delay [s], inf where over 20 periods.
    """

    pose: int
    drive: str
    low: float
    high: float
    frequency: float
    delay: float


@frozen
class Margins:
    """Gain and delay margins of a digital controller.

    Attributes:
        name: Of the mechanism. rows: One for each drive, and with several one for all, pose by
            pose.
    """

    name: str
    rows: tuple[MarginRow, ...]

    @property
    def stable(self) -> bool:
        """Whether the loop is stable at every pose."""
        return not any(np.isnan(row.high) for row in self.rows)

    def as_table(self) -> Table:
        """A row for each drive and pose."""
        return report_table(
            f"{self.name}: gain and delay at which the controlled robot starts to oscillate",
            self.rows,
            ("pose", "pose", str),
            "drive",
            ("gain from [-]", "low", _smallest),
            ("gain to [-]", "high", partial(_number, most="over 100")),
            ("oscillates at [Hz]", "frequency", partial(_number, most="-")),
            ("further delay [ms]", "delay", partial(_number, most="over 20 periods")),
            names=(6, 18),
        )

    def __str__(self) -> str:
        return self.as_table().text()


def _number(value: float, most: str = "") -> str:
    return "unstable" if np.isnan(value) else number(value) if np.isfinite(value) else most


def _smallest(value: float) -> str:
    return "under 0.01" if value == 0.0 else _number(value)


@public
@takes_model
@one_blas_thread()
def margins(
    mechanism: Mechanism, control: Control, poses: Sequence[Array] | None = None
) -> Margins:
    """How much gain and delay a digital controller leaves before the robot oscillates.

        law = pf.digital_pid(2000.0, 500.0, 60.0, period=1e-3)
        control = pf.Control((pf.Travel("hub"),), (pf.Effort("hub"),), law, period=1e-3)
        print(pf.margins(robot, control))

    Args:
        mechanism: Mechanism, or what `load` takes.
        control: A digital controller with a linear law: `pid`, `digital_pid`, or a system of scipy
            or python-control. Limits do not count. Motors that it does not drive keep the drive of
            the scene (`solve.kp`, `solve.kd`) if it drives others, and stand still if it drives
            none.
        poses: Rigid poses, default home; links are balanced in each under gravity and loads.
    Raises:
        DescriptionError: The control has no period, or its law is not linear.
        ConvergenceError: No static equilibrium.
    """
    free = drives_motors(mechanism, control)
    placed = place(mechanism, control, prescribed=not free)
    law = _law(mechanism.name, control)
    rows: list[MarginRow] = []
    for k, q in enumerate([None] if poses is None else poses):
        loop = _loop(mechanism, placed, law, free, q, mechanism.description.solve)
        for drive, on in _drives(control):
            rows.append(MarginRow(k, drive, *_found(loop, on)))
    return Margins(mechanism.name, tuple(rows))


def unstable(
    mechanism: Mechanism, control: Control, spec: SolveSpec, t: Array, poses: Array
) -> tuple[str, ...]:
    """A sentence where the loop, linearised at poses that a run had at times t (s), is not stable.

    The last of the times is the end of the run; poses (k, nq) may be of the first k alone. It is
    where something grows by a factor e within the run. None for laws that are any function,
    and for poses without equilibrium: nothing is known there.
    """
    period, free = control.period, drives_motors(mechanism, control) or spec.drive == "torque"
    assert period is not None
    with suppress(PinflexError, np.linalg.LinAlgError), one_blas_thread():
        law, placed = _law(mechanism.name, control), place(mechanism, control, not free)
        for now, q in zip(t, poses, strict=False):
            z = np.linalg.eigvals(_loop(mechanism, placed, law, free, q, spec)._closed(1.0))
            worst = z[np.argmax(np.abs(z))]
            grows = period / np.log(max(abs(worst), 1.0 + _OUTSIDE))
            if grows < t[-1]:
                rate = abs(np.angle(worst)) / (2.0 * np.pi * period)
                return (
                    f"control: linearised at t = {now:.4g} s the loop is not stable: what is at "
                    f"{rate:.4g} Hz grows by a factor e every {grows:.2g} s. Lower its gains or "
                    "its delay, or shorten `period`; pf.margins(robot, control) tells how far.",
                )
    return ()


def _drives(control: Control) -> list[tuple[str, Array]]:
    every = list(zip(control.labels, np.eye(len(control.labels)), strict=True))
    return every if len(every) == 1 else [*every, ("all", np.ones(len(every)))]


def _found(loop: _Loop, on: Array) -> tuple[float, float, float, float]:
    """Least and largest factor of the outputs chosen by `on`, at the latter the frequency [Hz] of
    the oscillation, and the delay that may be added [s].
    """

    def scaled(factor: float) -> bool:
        return loop.stable(1.0 + (factor - 1.0) * on)

    def later(periods: float) -> bool:
        return replace(loop, delay=loop.delay + periods * loop.period * on).stable()

    if not loop.stable():
        return np.nan, np.nan, loop.oscillation(np.ones(len(on))), np.nan
    high = _first(scaled, _GAINS)
    low = 1.0 / _first(lambda x: scaled(1.0 / x), _GAINS)
    frequency = np.inf
    if np.isfinite(high):
        frequency = loop.oscillation(1.0 + (_BEYOND * high - 1.0) * on)
    return low, high, frequency, loop.period * _first(later, _DELAYS)


def _first(holds: Callable[[float], bool], places: Array) -> float:
    """Where a condition that holds at the first place ceases to, to `_EXACT`; inf: nowhere."""
    at = next((k for k, x in enumerate(places) if not holds(float(x))), None)
    if at is None:
        return np.inf
    good, bad = float(places[at - 1]), float(places[at])
    while bad - good > _EXACT * bad:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


# A law once a sample: s' = A s + B m, u = C s + D m + E dm/dt.
_Law = tuple[Array, Array, Array, Array, Array]


def _law(name: str, control: Control) -> _Law:
    T, n, nu = control.period, len(control.measures), len(control.drives)
    if T is None:
        raise DescriptionError(
            f"{name}: margins: the control acts continuously. Give the period [s] of the digital "
            "controller."
        )
    law = fresh_law(control)
    if isinstance(law, LinearLaw):  # of the error, 0 - m
        return law.A, -law.B, law.C, -law.D, np.zeros_like(law.D)
    if not isinstance(law, DigitalPid | Pid):
        raise DescriptionError(
            f"{name}: margins: the law is any function. Give pf.pid, pf.digital_pid, or a linear "
            "system of scipy or python-control."
        )
    if nu != n or law.kp.size not in (1, n):
        raise DescriptionError(
            f"{name}: margins: control.law: gains for {law.kp.size} measures, where {n} are "
            f"measured and {nu} driven. Give one of each."
        )
    kp, ki, kd = (np.diag(np.broadcast_to(x, n)) for x in (law.kp, law.ki, law.kd))
    if isinstance(law, DigitalPid):  # the integral of the error, up to the sample before
        return np.eye(n), -T * np.eye(n), ki, -kp, -kd
    return np.eye(n), T * np.eye(n), ki, kp + 0.5 * T * ki, kd  # of m by the trapezoidal rule


@dataclass(frozen=True)
class _Loop:
    """x' = A x + B u, m = C x, dm/dt = R x; a law; the delay of each output [s]."""

    A: Array
    B: Array
    C: Array
    R: Array
    law: _Law
    period: float
    delay: Array
    known: dict[float, tuple[Array, Array]] = field(default_factory=dict)

    def stable(self, gains: Array | float = 1.0) -> bool:
        """Whether it stays so with its outputs times gains."""
        size = np.abs(np.linalg.eigvals(self._closed(gains)))
        return bool(np.max(size, initial=0.0) < 1.0 + _OUTSIDE)

    def oscillation(self, gains: Array) -> float:
        """Frequency [Hz] of what decays least, or grows most."""
        z = np.linalg.eigvals(self._closed(gains))
        return float(abs(np.angle(z[np.argmax(np.abs(z))])) / (2.0 * np.pi * self.period))

    def _closed(self, gains: Array | float) -> Array:
        """The map of x, of the state of the law and of earlier outputs from sample to sample.

        An output that waits n periods and a part of one acts as the one before it for that part.
        """
        a, b, c, d, e = self.law
        nx, ns, nu = len(self.A), len(a), self.B.shape[1]
        u = np.hstack([d @ self.C + e @ self.R, c]) * np.broadcast_to(gains, nu)[:, None]
        periods = np.round(self.delay / self.period, 9)  # so that parts of them repeat
        waits = periods.astype(int)
        part = (periods - waits) * self.period
        depth = int(waits.max(initial=0)) + 1
        over, kept = nx + ns, nu * depth
        F = np.zeros((over + kept, over + kept))
        F[:over, :over] = block_diag(self._over(self.period)[0], a)
        F[nx:over, :nx] += b @ self.C
        outputs = np.vstack([np.hstack([u, np.zeros((nu, kept))]), np.eye(over + kept)[over:]])
        for k in range(nu):  # outputs: of this sample, of the one before ...
            first = self._over(self.period - float(part[k]))
            late = self._over(float(part[k]))[1][:, k]
            own = outputs[k::nu]
            F[:nx] += np.outer(first[0] @ late, own[waits[k] + 1])
            F[:nx] += np.outer(first[1][:, k], own[waits[k]])
        F[over:] = outputs[:kept]
        return F

    def _over(self, h: float) -> tuple[Array, Array]:
        """Matrices that lead x and a held input over a time h (s): expm of the whole."""
        if h not in self.known:
            n, nu = self.B.shape
            whole = np.zeros((n + nu, n + nu))
            whole[:n] = h * np.hstack([self.A, self.B])
            made = expm(whole)
            self.known[h] = made[:n, :n], made[:n, n:]
        return self.known[h]


def _loop(
    mechanism: Mechanism, placed: Feedback, law: _Law, free: bool, q: Array | None, spec: SolveSpec
) -> _Loop:
    """The loop at a pose."""
    control, about = placed.control, Balanced.of(mechanism, q)
    assert control.period is not None
    motors = about.dynamics.system.motors
    push = np.eye(about.dynamics.system.nv)[:, motors if free else motors[:0]]
    n, nm = len(placed.S), push.shape[1]
    H = np.vstack([placed.S, placed.S, push.T, push.T])
    order = np.repeat([0, 1, 0, 1], [n, n, nm, nm])
    F = np.hstack([push, placed.B])
    A, B, C, _, _ = about.state_space(not free, F, H, order)
    if not free:  # motors stand still: their positions are no states
        size, still = len(A) // 2, len(motors)
        moves = np.r_[: size - still, size : 2 * size - still]
        A, B, C = A[np.ix_(moves, moves)], B[moves, still:], C[:, moves]
    else:  # motors that it does not drive keep theirs
        own = np.any(placed.B[motors] != 0.0, axis=1)
        kp, kd = (np.where(own, 0.0, x) for x in (spec.kp, spec.kd))
        A = A - B[:, :nm] @ (kp[:, None] * C[2 * n : 2 * n + nm] + kd[:, None] * C[2 * n + nm :])
        B = B[:, nm:]
    delay = np.full(len(control.drives), control.delay)
    return _Loop(A, B, C[:n], C[n : 2 * n], law, control.period, delay)
