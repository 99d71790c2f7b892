"""Natural frequencies and mode shapes of the closed mechanism at a pose.

Linearised on the closures: with Z the null space of J, (Z' K Z) x = omega^2 (Z' M Z) x, where K has
the geometric stiffness of the preload, and of the closure forces, unless it is left out. Loads that
follow make K unsymmetric (`levels.quasistatic`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.actuation.drive import nominal
from pinflex.actuation.path import Path, motor_axes, plain_motion
from pinflex.arrays import Array, IntArray, distinct
from pinflex.boundary import public
from pinflex.description.motions.motion import Motion, hold
from pinflex.description.motions.trajectory import read as read_shaper
from pinflex.description.reading.schema import number
from pinflex.doors import door
from pinflex.errors import DescriptionError, nearest
from pinflex.levels.quasistatic import acts_without_potential, balance, coupled, rest
from pinflex.levels.start import Moving, state_of_run
from pinflex.linalg import condensed, negative_directions, null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import FrozenLinks
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.report import card, grid
from pinflex.results.result import Result
from pinflex.text import frozen, table
from pinflex.threads import one_blas_thread

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Vibration about a motion: a steady one, an instant of the nominal motion or of a run.
#
# The residual linearised there, with all that speed and acceleration add (stiffening, gyroscopic
# and Coriolis terms), taken as constant, on the closures J z = 0, Z their null space:
#
#     (s^2 Z' M Z + s Z' C Z + Z' K Z) x = 0
#
# Of a steady rotation this is exact; of an instant it tells how the machine would vibrate if it
# stayed as it is then.

# Steady speeds of motors, an instant [s] of the nominal motion, or a run and an instant of it.
At = Mapping[str, float] | float | tuple[Result, float]
_INFINITE = 1e-9  # of the highest frequency^-1: an eigenvalue without inertia
_REAL = 1e-7  # of the highest frequency: round-off of an imaginary part


def state_at(
    mechanism: Mechanism, dynamics: Equations, at: At, motion: Callable[[], Motion]
) -> Moving:
    """The state that `at` names; links balance the inertia forces of the nominal motion."""
    if isinstance(at, tuple):
        return state_of_run(mechanism, *at)
    if isinstance(at, Mapping):
        path = Path(mechanism, hold(duration=1.0))
        q, (v, a) = (
            mechanism.home,
            path.rates(
                mechanism.home, _speeds(mechanism, at), np.zeros(len(mechanism.motors)), 0.0
            ),
        )
        t, words = 0.0, ", ".join(f"{name} = {speed:g}" for name, speed in at.items())
        about = f"the steady motion {words} (rad/s, m/s)"
    else:
        t = number(at, f"{mechanism.name}: modes: at", low=0.0, of="time")
        one = nominal(mechanism, motion(), np.array([t]))
        q, v, a, about = one.q[0], one.v[0], one.a[0], f"the motion at t = {t:g} s"
    none = np.zeros(mechanism.flexible.n_eta)
    v, a = np.concatenate([v, none]), np.concatenate([a, none])
    where = f"{mechanism.name}: modes about {about}"
    free = mechanism.flexible.free
    links = FrozenLinks(dynamics, mechanism, free)
    found = balance(dynamics, mechanism.undeformed(q), v, a, free, t, None, where, links=links)
    return Moving(found.y, found.v, found.a, found.lam, t, about)


def _speeds(mechanism: Mechanism, given: Mapping[str, float]) -> Array:
    names = list(mechanism.description.actuated)
    speeds = np.zeros(len(motor_axes(mechanism).v_at))
    for name, speed in given.items():
        if name not in names:
            raise DescriptionError(
                f"{mechanism.name}: modes: {name}: not a motor.{nearest(name, names)}"
            )
        speeds[names.index(name)] = speed
    return speeds


def whirl(dynamics: Equations, state: Moving, free: IntArray) -> tuple[Array, Array]:
    """Eigenvalues s (k,) [1/s] of the vibration about a state, slowest first, and shapes (nv, k).

    Both are complex, shapes of unit mass. Of a pair the one that turns forward is kept; of a
    divergence s and -s the growing one.
    """
    system = dynamics.system
    M, C, K = (
        A[np.ix_(free, free)]
        for A in dynamics.tangent(state.y, state.v, state.a, state.lam, state.t)[:3]
    )
    Z = allowed_motions(dynamics, state.y, free)
    M, C, K = (Z.T @ A @ Z for A in (M, C, K))
    s, x = _quadratic(M, C, K)
    mass = np.sqrt(np.abs(np.einsum("ik,ij,jk->k", x.conj(), M, x)))
    shapes = np.zeros((system.nv, len(s)), dtype=complex)
    shapes[free] = Z @ (x / np.where(mass > 0, mass, 1.0))
    return s, shapes


def _quadratic(M: Array, C: Array, K: Array) -> tuple[Array, Array]:
    """Solutions of (s^2 M + s C + K) x = 0 with Im s >= 0, by increasing |s|."""
    from scipy.linalg import eig

    n = len(M)
    if not n:
        return np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex)
    mass = np.diag(M)
    unit = 1.0 / np.sqrt(np.where(mass > 1e-14 * np.max(mass), mass, np.max(mass)))
    M, C, K = (A * unit * unit[:, None] for A in (M, C, K))
    # Rates over the fastest frequency, so that both halves of the pencil are of one size.
    w = max(float(np.sqrt(np.max(np.abs(K)))), 1e-300)
    none, one = np.zeros((n, n)), np.eye(n)
    A = np.block([[none, one], [-K / w**2, -C / w]])
    B = np.block([[one, none], [none, M]])
    (alpha, beta), V = eig(A, B, homogeneous_eigvals=True)
    finite = np.abs(beta) > _INFINITE * np.abs(alpha)
    s, x = w * alpha[finite] / beta[finite], unit[:, None] * V[:n, finite]
    small = _REAL * float(np.max(np.abs(s), initial=0.0))
    real = np.abs(s.imag) <= small
    kept = np.where(real, _growing(s, real), s.imag > 0)
    order = np.flatnonzero(kept)[np.argsort(np.abs(s[kept]), kind="stable")]
    s = np.where(real, s.real, s)
    return s[order], x[:, order]


def _growing(s: Array, real: Array) -> Array:
    """Of real eigenvalues: those that are not the decaying twin of a growing one."""
    up = s[real].real
    twin = np.array([np.any(np.abs(up + x) < 1e-6 * abs(x)) for x in s.real])
    return np.asarray((s.real >= 0) | ~twin)


# Round-off of omega^2 is 1e-16 of the largest one, so 1e-8 of the highest frequency.
_ROUND_OFF = 1e-7

WEIGHT = "weight"  # among the links of a mode: gravity and other loads

_SHOWN = 0.005  # of a mode's energy: half a per cent, what is not shown as 0 %


@frozen
class Modes:
    """Modes at a pose.

    Attributes:
        frequencies: Hz, shape (k,), increasing; negative for an unstable (buckled) direction.
        shapes: Unit-mass shapes in velocity rows, shape (nv, k).
        y: Pose that was linearised about, shape (nq,).
        share: Share of each flexible link, sprung joint and elastic drive in the elastic energy,
            shape (k, links), and of the weight where it holds most of a mode (a pendulum).
        links: Names for `share`.
        preload: "gravity", "none", or "motion". free_motors: Whether motors were free.
        rigid_body: Modes at 0 Hz that were left out: those of a free base, and what
            `first_modes` leaves out.
        growth: About a motion, with complex shapes, or where loads that follow make modes flutter:
            rate of growth of each mode, shape (k,), 1/s.
        about: The motion that was linearised about, "" where there is none.
        mechanism: Whose modes they are, for `plot`.
    """

    frequencies: Array
    shapes: Array
    y: Array
    share: Array
    links: tuple[str, ...]
    preload: str
    free_motors: bool
    rigid_body: int = 0
    growth: Array | None = None
    about: str = ""
    mechanism: Mechanism | None = field(default=None, repr=False, compare=False)

    def plot(self, mode: int | None = None, ax: Axes | None = None) -> Any:
        """Draw the frequencies, or the shape of one mode; returns the matplotlib axes.

            found.plot()        # frequencies, each bar split by what deforms
            found.plot(1)       # shape of the first mode: both ends of its swing

        Args:
            mode: Number of a mode, from 1; default: all frequencies.
            ax: Where to draw; default: axes of a new figure.
        """
        if mode is None:
            return door("viewer.plots.motions", "plot_frequencies")(self, ax)
        return door("studies.pose", "plot_shape")(self, mode, ax)

    def __str__(self) -> str:
        rows = [[str(k), f, what] for k, f, what in self._rows()]
        return table(self._heading(), "mode|frequency [Hz]|deforms", rows, (6,), last_is_text=True)

    def _repr_html_(self) -> str:
        return card(self._heading(), grid(("mode", "frequency [Hz]", "deforms"), self._rows()))

    def _rows(self) -> list[tuple[int, str, str]]:
        each = enumerate(self.frequencies.tolist())
        return [(k + 1, f"{f:.4g}", self._most(k)) for k, f in each]

    def _heading(self) -> str:
        state = "under gravity" if self.preload == "gravity" else "undeformed"
        motors = "free" if self.free_motors else "locked"
        return f"modes, {state}, motors {motors}"

    def _most(self, k: int) -> str:
        """What holds most of the energy of a mode, largest first."""
        if not self.share.size:
            return ""
        largest = [i for i in np.argsort(-self.share[k])[:3] if self.share[k, i] >= _SHOWN]
        return ", ".join(f"{self.links[i]} {100 * self.share[k, i]:.0f} %" for i in largest)


@public
@takes_model
@one_blas_thread()
def modes(
    mechanism: Mechanism,
    q: Array | None = None,
    *,
    count: int = 12,
    preload: str = "gravity",
    free_motors: bool = False,
    at: At | None = None,
    motion: Motion | None = None,
) -> Modes:
    """Natural frequencies and mode shapes at a pose of the closed loop, or about a motion.

    Args:
        mechanism: Mechanism with at least one flexible link, elastic drive or spring.
        q: Rigid pose, default home.
        count: How many.
        preload: "gravity" linearises about the static equilibrium; "none" about the undeformed
            pose with the structure's stiffness alone.
        free_motors: Motors free (they add modes at 0 Hz) instead of locked. A free base moves
            along where nothing weighs on the mechanism, else it is held.
        at: A motion instead of a pose: steady speeds of motors from home by name (rad/s, m/s), a
            time (s) of `motion`, or (result, time) of a run; stiffening and gyroscopic terms count,
            which are kept as they are at that time.
        motion: Motion of `at`; default: that of the YAML.
    Returns:
        The modes.
    Raises:
        DescriptionError: An unknown preload.
        ConvergenceError: No static equilibrium.
        SingularityError: Coordinates without mass or stiffness.
    """
    if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 0:
        raise DescriptionError(f"modes: count: {count!r:.80}. Give a whole number.")
    about_rest = at is None and preload != "none"
    system = mechanism.standing if about_rest else mechanism.flexible
    dynamics = Equations(system)
    if at is not None:
        if q is not None:
            raise DescriptionError("modes: q and at: a pose or a motion. Give one of them.")
        state = state_at(mechanism, dynamics, at, lambda: motion or default_motion(mechanism))
        return _about(mechanism, dynamics, state, count, free_motors)
    y, K = linearised(mechanism, dynamics, q, preload)
    M = dynamics.mass(y)
    free = np.arange(system.nv) if free_motors else vibrating(mechanism)
    drifts = 0 if free_motors else len(free) - len(system.free)
    Z = allowed_motions(dynamics, y, free)
    K, M = (Z.T @ A[np.ix_(free, free)] @ Z for A in (K, M))
    x, _, every = condensed(K, M)
    growth = None
    if preload != "none" and acts_without_potential(system):
        s, x = coupled(0.5 * (K - K.T), x, every)
        s, x = s[:count], x[:, :count]
        frequencies = np.where(s.imag > 0, s.imag, -s.real) / (2 * np.pi)
        if np.any((s.imag > 0) & (s.real != 0)):
            growth = s.real
    else:
        elastic = np.sort(np.argsort(np.abs(every))[drifts:])  # a free base adds as many at 0 Hz
        order = elastic[np.argsort(every[elastic])][:count]
        omega2, x = every[order], x[:, order]
        frequencies = np.sign(omega2) * np.sqrt(np.abs(omega2)) / (2 * np.pi)
    shapes = np.zeros((system.nv, x.shape[1]))
    shapes[free] = Z @ x
    signed = np.sign(frequencies) * (2.0 * np.pi * frequencies) ** 2
    share, links = _shares(mechanism, shapes, None if preload == "none" else signed)
    return Modes(
        frequencies, shapes, y, share, links, preload, free_motors, drifts,
        growth=growth, mechanism=mechanism,
    )  # fmt: skip


def _about(
    mechanism: Mechanism, dynamics: Equations, state: Moving, count: int, free_motors: bool
) -> Modes:
    """Complex modes about a motion; a divergence has a negative frequency, as at a pose."""
    system = mechanism.flexible
    s, shapes = whirl(dynamics, state, np.arange(system.nv) if free_motors else system.free)
    s, shapes = s[:count], shapes[:, :count]
    turning = np.where(s.imag > 0, s.imag, np.where(s.real > 0, -s.real, 0.0))
    share, links = _shares(mechanism, shapes)
    return Modes(
        turning / (2 * np.pi), shapes, state.y, share, links, "motion", free_motors,
        growth=s.real, about=state.about, mechanism=mechanism,
    )  # fmt: skip


def linearised(
    mechanism: Mechanism, dynamics: Equations, q: Array | None, preload: str
) -> tuple[Array, Array]:
    """The pose y that is linearised about, and the stiffness there, as in `modes`."""
    if preload not in ("gravity", "none"):
        raise DescriptionError(f'preload: {preload!r}. Allowed: "gravity", "none".')
    if preload == "none":
        y = mechanism.undeformed(q)
        return y, dynamics.structural_stiffness(y)
    found, still = rest(mechanism, q, dynamics=dynamics), np.zeros(dynamics.system.nv)
    return found.y, dynamics.tangent(found.y, still, still, found.lam, 0.0).K


def vibrating(mechanism: Mechanism) -> IntArray:
    """Velocity rows that vibrate while motors are locked: a free base too, where nothing weighs."""
    if base_state(mechanism) == "held":
        return mechanism.flexible.free
    return distinct(mechanism.flexible.free, mechanism.idle.base)


def rings_below(mechanism: Mechanism, frequency: float) -> bool:
    """Whether a natural frequency of the undeformed mechanism lies within three decades below one.

    By counting, without modes: K - omega^2 M is negative in as many directions as vibrate slower
    than omega (Sylvester's law of inertia).
    """
    dynamics, y, free = Equations(mechanism.flexible), mechanism.undeformed(), vibrating(mechanism)
    K, M = (A[np.ix_(free, free)] for A in (dynamics.structural_stiffness(y), dynamics.mass(y)))
    J, omega2 = dynamics.close(y).J[:, free], (2.0 * np.pi * frequency) ** 2
    slower, still = (negative_directions(K - x * M, J) for x in (omega2, 1e-6 * omega2))
    return slower > still


def base_state(mechanism: Mechanism) -> str:
    """Whether the modes are those of a free base: free, held (it would fall), "" without one."""
    description = mechanism.description
    if not len(mechanism.idle.base):
        return ""
    return "held" if any(description.gravity) or description.forces else "free"


def allowed_motions(dynamics: Equations, y: Array, free: IntArray) -> Array:
    """Basis of what the closures leave of the free coordinates, shape (free, n)."""
    return null_space(dynamics.close(y).J[:, free])


def _shares(
    mechanism: Mechanism, shapes: Array, omega2: Array | None = None
) -> tuple[Array, tuple[str, ...]]:
    """Which links bend in which mode: shares of the elastic energy.

    Where loads hold most of a mode, as the weight of a pendulum does, their share of its energy,
    omega^2 over a unit mass, counts too.
    """
    system = mechanism.flexible
    bent = dict.fromkeys(slot.link for slot in system.expansion.slots)
    springs, names = system.springs, mechanism.coordinates
    gears, n = system.expansion.drives, int(system.rigid.nv)
    links = (*bent, *(names[row] for row in springs.v_at), *(gear.joint for gear in gears))
    energy = np.zeros((shapes.shape[1], len(links)))
    for slot in system.expansion.slots:
        part = shapes[n + slot.eta.start : n + slot.eta.stop]
        own = np.einsum("ik,ij,jk->k", part.conj(), slot.body.K, part)
        energy[:, links.index(slot.link)] += own.real
    turning = [n + gear.eta for gear in gears]
    stiffness = np.concatenate([springs.stiffness, system.K[turning, turning]])
    rows = [*springs.v_at, *turning]
    energy[:, len(bent) :] = (stiffness[:, None] * np.abs(shapes[rows]) ** 2).T
    total = energy.sum(1, keepdims=True)
    if omega2 is not None:
        loads = omega2[:, None] - total
        if np.any(loads > 0.5 * np.abs(omega2[:, None])):
            energy, links = np.hstack([energy, np.maximum(loads, 0.0)]), (*links, WEIGHT)
            total = energy.sum(1, keepdims=True)
    return energy / np.where(total > 0, total, 1.0), links


def first_modes(found: Modes, count: int, zeros: bool = False) -> Modes:
    """The first of all modes that have a stiffness; those at 0 Hz are only counted, or `zeros`.

    A frequency at the round-off of the highest one is zero.
    """
    f = found.frequencies
    alive = np.abs(f) > _ROUND_OFF * np.max(np.abs(f), initial=0.0)
    f, kept = np.where(alive, f, 0.0), np.flatnonzero(alive | zeros)[:count]
    return replace(
        found,
        frequencies=f[kept],
        shapes=found.shapes[:, kept],
        share=found.share[kept],
        growth=None if found.growth is None else found.growth[kept],
        rigid_body=0 if zeros else found.rigid_body + int(np.sum(~alive)),
    )


def rigid_body(found: Modes) -> str:
    """The modes at 0 Hz in words, "" where there are none."""
    n = found.rigid_body
    return f"{n} rigid-body mode{'s'[: n != 1]} at 0 Hz" if n else ""


# The motion of the YAML, shaped where it says so.


def default_motion(mechanism: Mechanism) -> Motion:
    """The motion of the YAML, shaped where it says so; one second at rest where it has none.

    The same object each time: what is known of a motion is found by it.
    """
    known = mechanism.followed.motions  # modes of a shaped one are slow to find
    return known.get(None, None, lambda: _written(mechanism))


def _written(mechanism: Mechanism) -> Motion:
    block = mechanism.description.motion
    if block is None:
        return hold(duration=1.0)
    motion, where = plain_motion(mechanism), f"{mechanism.name}.yaml: motion.shaper"
    asked = read_shaper(block.get("shaper"), where)
    if asked is None:
        return motion
    from pinflex.levels.ringing import shaped_as  # which asks for modes

    return shaped_as(mechanism, motion, asked)


def default_step(mechanism: Mechanism, end: float) -> float:
    """Step from the scene: 1/40 of the third mode's period, at least 400 steps a run."""
    step = end / 400.0
    if not mechanism.compliant:
        return step
    found = modes(mechanism, count=9, preload="none").frequencies
    alive = found[found > 0]
    if not len(alive):
        return step
    third = float(alive[min(2, len(alive) - 1)])
    return min(step, 1.0 / (40.0 * third))
