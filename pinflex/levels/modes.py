"""Natural frequencies and mode shapes of the closed mechanism at a pose.

Linearised on the closures: with Z the null space of J, (Z' K Z) x = omega^2 (Z' M Z) x, where K has
the geometric stiffness of the preload, and of the closure forces, unless it is left out. Loads that
follow make K unsymmetric (`levels.quasistatic`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.boundary import public
from pinflex.cards import card, grid
from pinflex.description.motions.motion import Motion
from pinflex.doors import door
from pinflex.errors import DescriptionError, SingularityError
from pinflex.levels.moving_modes import At, Moving, state_at, whirl
from pinflex.levels.quasistatic import acts_without_potential, coupled, rest
from pinflex.linalg import eigh, lapack, null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.text import brief, table
from pinflex.threads import one_blas_thread

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LOW = 1e-8  # omega^2 below this share of the highest: half its digits are round-off
_STIFF = 1e-6  # least pivot of K with unit diagonal at which nothing is free to move

# Round-off of omega^2 is 1e-16 of the largest one, so 1e-8 of the highest frequency.
_ROUND_OFF = 1e-7

_SHOWN = 0.005  # of a mode's energy: half a per cent, what is not shown as 0 %


@dataclass(frozen=True)
class Modes:
    """Modes at a pose.

    Attributes:
        frequencies: Hz, shape (k,), increasing; negative for an unstable (buckled) direction.
        shapes: Unit-mass shapes in velocity rows, shape (nv, k).
        y: Pose that was linearised about, shape (nq,).
        share: Share of each flexible link, sprung joint and elastic drive in the elastic energy,
            shape (k, links).
        links: Names for `share`.
        preload: "gravity", "none", or "motion". free_motors: Whether motors were free.
        rigid_body: Modes at 0 Hz that were left out: those of a free base, and what
            `first_modes` leaves out.
        growth: About a motion, with complex shapes, or where loads that follow make modes flutter:
            rate of growth of each mode, shape (k,), 1/s.
        about: The motion that was linearised about, "" where there is none.
        mechanism: Whose modes they are, for `plot`.
    """

    __repr__ = brief

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
            return door("viewer.plots.shapes", "plot_frequencies")(self, ax)
        return door("studies.mode_shapes", "plot_shape")(self, mode, ax)

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
        """What holds most of the elastic energy of a mode, largest first."""
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
        state = state_at(mechanism, dynamics, at, motion)
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
    share, links = _shares(mechanism, shapes)
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
    return np.union1d(mechanism.flexible.free, mechanism.idle.base).astype(np.intp)


def base_state(mechanism: Mechanism) -> str:
    """Whether the modes are those of a free base: free, held (it would fall), "" without one."""
    description = mechanism.description
    if not len(mechanism.idle.base):
        return ""
    return "held" if any(description.gravity) or description.forces else "free"


def allowed_motions(dynamics: Equations, y: Array, free: IntArray) -> Array:
    """Basis of what the closures leave of the free coordinates, shape (free, n)."""
    if not dynamics.system.closed.n:
        return np.eye(len(free))
    return null_space(dynamics.close(y).J[:, free])


def condensed(K: Array, M: Array) -> tuple[Array, Array, Array]:
    """Unit-mass modes of what has mass, and the compliance of what has none.

    Returns:
        Modes x (n, k), the massless coordinates following statically; compliance (n, n) of the
        massless ones with the others held; omega^2 (k,).
    """
    K, M = 0.5 * (K + K.T), 0.5 * (M + M.T)
    if not len(K):
        return np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(M), 1e-300))
    scale = np.where(
        np.diag(M) > 1e-14 * np.max(np.diag(M)), scale, 1.0 / np.sqrt(np.max(np.diag(M)))
    )
    values, V = np.linalg.eigh(M * scale * scale[:, None])
    heavy = values > 1e-13 * values[-1]
    V = scale[:, None] * V
    if np.all(heavy):
        omega2, x = _lowest_again(K, M, *eigh(K, M))
        return x, np.zeros_like(K), omega2
    H, L = V[:, heavy], V[:, ~heavy]
    soft = L.T @ K @ L
    if np.linalg.eigvalsh(soft)[0] < 1e-12 * float(np.max(np.abs(K * scale * scale[:, None]))):
        raise SingularityError(
            "modes: a coordinate has neither mass nor stiffness: two coordinates make one motion "
            "(a basis with free ends on a joint that moves the same way), or a massless link "
            "swings freely. Take a basis clamped at its root, fix the joint, or give the link "
            "a mass."
        )
    T = H - L @ np.linalg.lstsq(soft, L.T @ K @ H, rcond=None)[0]
    K, M = T.T @ K @ T, T.T @ M @ T
    omega2, x = _lowest_again(K, M, *eigh(K, M))
    return T @ x, L @ np.linalg.lstsq(soft, L.T, rcond=None)[0], omega2


def _lowest_again(K: Array, M: Array, omega2: Array, x: Array) -> tuple[Array, Array]:
    """Eigenpairs of (K, M), those far below the highest again from (M, K).

    Each way errs by round-off of its largest eigenvalue: omega^2 of the lowest is lost where the
    highest is 1e13 times larger (a payload of 1e10 times the beam), 1/omega^2 of the lowest is not.
    """
    highest = float(np.max(np.abs(omega2), initial=0.0))
    low = np.abs(omega2) < _LOW * highest
    if not np.any(low):
        return omega2, x
    # Round-off of a zero frequency is 1e-16 of the largest omega^2: shown as zero.
    shown = np.where(np.abs(omega2) < 1e-13 * highest, 0.0, omega2)
    size = np.diag(K)
    if np.any(size <= 0):
        return shown, x
    scale = 1.0 / np.sqrt(size)
    try:
        L = np.linalg.cholesky(K * scale * scale[:, None])
    except np.linalg.LinAlgError:
        return shown, x
    if np.min(np.diag(L)) < _STIFF:  # something is free to move, or nearly so
        return shown, x
    trtrs = lapack().dtrtrs
    half = trtrs(L, M * scale * scale[:, None], lower=True)[0]
    flexibility, z = np.linalg.eigh(trtrs(L, half.T, lower=True)[0])
    again = slice(None, -int(np.sum(low)) - 1, -1)
    found = trtrs(L.T, z[:, again])[0] * scale[:, None]
    shown, x = shown.copy(), x.copy()
    shown[low] = 1.0 / flexibility[again]
    x[:, low] = found / np.sqrt(flexibility[again])
    return shown, x


def _shares(mechanism: Mechanism, shapes: Array) -> tuple[Array, tuple[str, ...]]:
    """Which links bend in which mode: shares of the elastic energy."""
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
