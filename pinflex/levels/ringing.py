"""Which vibrations a motion excites, and which of them shake the platform after its end.

With motors locked each mode is an oscillator, x'' + 2 zeta omega x' + omega^2 x = -phi' f, f the
inertia forces of the rigid motion, so what it leaves after the stop is the spectrum of phi' f at
its frequency. The largest within 20 % of it counts: a motion whose end meets a phase by chance
leaves more as soon as the robot is a little different. Stiffness is that about the equilibrium
under gravity and loads: a hanging payload has no other.
"""

from __future__ import annotations

import numpy as np

from pinflex.actuation.drive import Nominal, nominal
from pinflex.actuation.path import motor_axes
from pinflex.arrays import Array, IntArray, others
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion
from pinflex.description.motions.trajectory import MODES, ShaperSpec
from pinflex.errors import DescriptionError
from pinflex.levels.modes import Modes, allowed_motions, modes, vibrating
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.loads import require_staying
from pinflex.text import frozen

_INSTANTS = 9  # at which the modes are found, matched with those before by their shapes
_LOOKED_AT = 9  # lowest modes
_SEEN = 0.01  # of what the loudest mode leaves at the platform: a mode that is to be shaped
_SAME = 0.05  # relative: modes so close are one to a shaper
_ONE = 1e-3  # relative: modes so close have no shapes of their own
_OFF = np.linspace(0.8, 1.2, 81)  # of a frequency
_SAMPLES = 2000, 16000  # of the motion, at least and at most; 8 for a period of the third mode
_QUIET = 1e-9  # of the deflection under way: less after the stop is round-off


@frozen
class Ringing:
    """Modes with locked motors that a motion excites, in the order of their frequencies.

    Attributes:
        number: Of each, from 1, as in `modes` at the start of the motion, shape (k,).
        frequencies: In the middle of their range along the motion [Hz], shape (k,); of modes that
            count as one, of the loudest.
        low, high: Ends of the range [Hz], shape (k,); of modes that count as one, of all of them
            that leave more than 1 % of what the loudest does.
        damping: Damping ratio in the middle [-], shape (k,).
        share: What each leaves at the platform after the stop, over the sum of all modes [-], (k,).
    """

    number: IntArray
    frequencies: Array
    low: Array
    high: Array
    damping: Array
    share: Array

    @property
    def others(self) -> float:
        """What the modes that are not listed leave at the platform, over the sum of all [-]."""
        return max(0.0, 1.0 - float(self.share.sum()))


@public
@takes_model
def ringing(mechanism: Mechanism, motion: Motion, count: int | None = None) -> Ringing:
    """The vibrations that a motion excites: those that shake the platform most after its end.

    Modes that lie within 5 % of each other count once. Where there is no platform that they move,
    their energy counts instead.

    Args:
        mechanism: With a flexible link or an elastic joint.
        motion: Its motion.
        count: Number of modes; default: up to 3 that leave more than 1 % of what the loudest does.
    Raises:
        DescriptionError: Nothing vibrates, or the motion excites nothing.
        ConvergenceError, MotionError: No equilibrium, or the motion cannot be followed.
    """
    if not mechanism.compliant:
        raise DescriptionError(
            f"{mechanism.name}: nothing vibrates. Describe flexible links or elastic joints."
        )
    then = "Leave out both, or give the shaper its frequencies."
    require_staying(mechanism.description, "vibrations that a motion excites", then)
    f, damping, left = _excited(mechanism, motion)
    if not np.any(left > 0.0):
        raise DescriptionError(
            f"{mechanism.name}: the motion excites no vibration. Leave the shaper out, or give "
            "another motion."
        )
    low, high = f.min(axis=0), f.max(axis=0)
    middle = 0.5 * (low + high)
    kept: list[int] = []
    share = np.zeros(len(left))
    for k in np.argsort(-left, kind="stable"):
        loud = left[k] >= _SEEN * left.max()
        same = [j for j in kept if abs(middle[k] / middle[j] - 1.0) <= _SAME]
        if same:
            share[same[0]] += left[k]
            if loud:
                low[same[0]], high[same[0]] = min(low[k], low[same[0]]), max(high[k], high[same[0]])
        elif len(kept) < (count or MODES) and left[k] > 0.0 and (loud or count):
            kept.append(int(k))
            share[k] += left[k]
    at = np.array(sorted(kept, key=lambda k: middle[k]))
    return Ringing(
        at + 1, middle[at], low[at], high[at], damping.mean(axis=0)[at], share[at] / left.sum()
    )


def shaped_as(mechanism: Mechanism, motion: Motion, asked: ShaperSpec) -> Motion:
    """A motion with a shaper, of given frequencies or of the modes that it excites."""
    if asked.frequencies:
        return motion.shaped(asked.kind, asked.frequencies, asked.damping)
    found = ringing(mechanism, motion, asked.modes)
    return motion.shaped(asked.kind, found.frequencies.tolist(), found.damping.tolist())


def _excited(mechanism: Mechanism, motion: Motion) -> tuple[Array, Array, Array]:
    """Frequencies [Hz] and damping along a motion, (instants, k); what each leaves [m], (k,)."""
    from scipy.interpolate import CubicSpline

    at = np.linspace(0.0, motion.duration, _INSTANTS)
    omega, damping, by_motor, rest, moved = _along(mechanism, nominal(mechanism, motion, at))
    w, zeta = omega.mean(axis=0), damping.mean(axis=0)
    least, most = _SAMPLES
    n = int(np.clip(8.0 * motion.duration * w[:3].max(initial=0.0) / (2.0 * np.pi), least, most))
    t = motion.duration * (np.arange(n) + 0.5) / n
    a = nominal(mechanism, motion, t).a[:, motor_axes(mechanism).v_at]
    between = CubicSpline(at, np.eye(_INSTANTS))(t)
    force = np.einsum("ti,ikm,tm->tk", between, by_motor, a, optimize=True)
    # squares of the speed start and end level, where the motion does from and to rest
    force += CubicSpline(at, rest, bc_type="clamped")(t)
    fading = np.exp(-zeta * w * (motion.duration - t[:, None]))
    spectrum = np.abs(np.fft.rfft(force * fading, 8 * n, axis=0)) * motion.duration / n
    known = np.fft.rfftfreq(8 * n, motion.duration / n)
    after = [
        np.interp(x * _OFF / (2.0 * np.pi), known, spectrum[:, k], right=0.0).max()
        for k, x in enumerate(w)
    ]
    bent = np.abs(force).max(axis=0, initial=0.0) / w
    return omega / (2.0 * np.pi), damping, np.maximum(after, _QUIET * bent) / w * moved


def _along(mechanism: Mechanism, path: Nominal) -> tuple[Array, ...]:
    """The modes at instants of a rigid motion, each followed by its shape, and what pushes them.

    Returns:
        omega [1/s] and damping ratio, (instants, k); force on the modes by the motors'
        accelerations, (instants, k, motors), and the rest of it, of velocities, (instants, k); how
        far each moves the platform at the last instant, (k,).
    """
    from scipy.optimize import linear_sum_assignment

    system, dynamics = mechanism.flexible, Equations(mechanism.flexible)
    motors, (v, a) = motor_axes(mechanism).v_at, np.zeros((2, system.nv))
    X, free = np.zeros((system.nv, len(motors))), vibrating(mechanism)
    rows: list[tuple[Array, ...]] = []
    shapes, n = np.zeros((system.nv, 0)), path.a.shape[1]
    # pins with clearance have rows of their own at rest: there the ideal mechanism, unloaded
    preload = "gravity" if mechanism.standing is system else "none"
    for q, v[:n], a[:n] in zip(path.q, path.v, path.a, strict=True):
        found = modes(mechanism, q, count=_LOOKED_AT, preload=preload)
        omega, M, y = 2.0 * np.pi * found.frequencies, dynamics.mass(found.y), found.y
        own, omega = found.shapes[:, omega > 0.0], omega[omega > 0.0]
        if rows:  # they may have changed places
            alike = shapes.T @ M @ own
            before, now = linear_sum_assignment(-np.abs(alike))
            rows = [tuple(part[before] for part in row) for row in rows]
            own, omega = own[:, now], omega[now]
            # within those of one frequency any turn will do: the one nearest to those before
            one = np.abs(omega[:, None] / omega - 1.0) < _ONE
            left, _, right = np.linalg.svd(np.where(one, alike[np.ix_(before, now)], 0.0))
            own = own @ (left @ right).T
        damping = np.einsum("ik,ij,jk->k", own, system.D, own) / (2.0 * omega)
        X[:n] = _by_motor(mechanism, q, motors)
        by_motor, rest = _pushes(dynamics, found, free, (own, omega), (X, v, a, a[motors]))
        rows.append((omega, damping, by_motor, rest))
        shapes = own
    columns = (np.array(part) for part in zip(*rows, strict=True))
    return *columns, _moved(mechanism, dynamics, y, shapes, omega)


def _pushes(
    dynamics: Equations,
    found: Modes,
    free: IntArray,
    modal: tuple[Array, Array],
    rates: tuple[Array, ...],
) -> tuple[Array, Array]:
    """Force on modes by the motors' accelerations (k, motors), and that of speeds alone (k,).

    The shape that balances gravity moves along with the motors: where it does not, their motion X
    strains it by K X, which bends it on by the modes' own stiffness.

    Args:
        free: Rows that vibrate. modal: Modes of unit mass (nv, k), and their omega (k,) [1/s].
        rates: Of the rigid mechanism: by the motors (nv, motors); velocity and acceleration (nv,);
            accelerations of the motors.
    """
    (own, omega), y = modal, found.y
    still, loose = np.zeros(len(own)), np.zeros(dynamics.system.closed.n)
    J, weight = dynamics.close(y).J, dynamics.residual(y, still, still, loose, 0.0).r
    back = np.linalg.pinv(J[:, free], rcond=1e-10)

    def fitted(rigid: Array, bias: Array | float = 0.0) -> Array:
        """On the closures of the loaded shape."""
        fit = rigid.copy()
        fit[free] -= back @ (J @ rigid + bias)
        return fit

    X, v = fitted(rates[0]), fitted(rates[1])
    a = fitted(rates[2], dynamics.closure_bias(y, v))
    rest = own.T @ (dynamics.residual(y, v, a, loose, 0.0).r - weight)
    pushed = own.T @ (dynamics.mass(y) @ X)
    rest -= pushed @ rates[3]
    if found.preload != "none":
        K = dynamics.tangent(y, still, still, back.T @ weight[free], 0.0).K
        pushed -= own.T @ (K @ X) / omega[:, None] ** 2
    return pushed, rest


def _by_motor(mechanism: Mechanism, q: Array, motors: IntArray) -> Array:
    """Velocity rows of the rigid mechanism by the motors' speeds, shape (nv, motors).

    What passive joints do belongs to one pose; by the motors, forces change slowly along a motion.
    """
    rigid = mechanism.rigid
    moving = others(rigid.nv, rigid.held)
    allowed = allowed_motions(Equations(rigid), q, moving)
    Z = np.zeros((rigid.nv, allowed.shape[1]))
    Z[moving] = allowed
    return np.asarray(Z @ np.linalg.pinv(Z[motors]))


def _moved(
    mechanism: Mechanism, dynamics: Equations, y: Array, shapes: Array, omega: Array
) -> Array:
    """How far each shape moves the platform's origin, shape (k,); without one, by energy."""
    name = mechanism.description.platform
    if name is not None:
        J = frame_jacobian(dynamics, y, dynamics.system.expansion.frames[name])[:3]
        moved: Array = np.linalg.norm(J @ shapes, axis=0)
        if np.any(moved > 1e-12):  # a place that no vibration moves tells nothing
            return moved
    return omega
