"""A modal test in the computer: hammer hits, response at points of a link, FRFs, identification.

The mechanism is linear about its pose with the motors locked; each mode gets a damping ratio. Hits
are half-sine pulses; responses are accelerations across the link, with noise if wanted.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.levels.modes import modes
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian, frame_pose
from pinflex.mechanics.mechanism import Mechanism
from pinflex.text import brief


@dataclass(frozen=True)
class ModalTest:
    """Records of a test and the frequency response functions made of them.

    Attributes:
        link: Link that was hit and measured.
        x: Measured points along it, shape (np,), m. hits: Points that were hit, (nh,), m.
        t: Times of a record, shape (nt,), s.
        force: Hammer force of the first hit at each point, shape (nh, nt), N.
        response: Accelerations of the first hit, shape (nh, np, nt), m/s^2.
        frequency: Shape (nf,), Hz.
        frf: H1 estimates, acceleration over force, shape (nh, np, nf), 1/kg.
        exact: Frequencies (Hz) and damping ratios of the model that was tested, (modes, 2).
    """

    __repr__ = brief

    link: str
    x: Array
    hits: Array
    t: Array
    force: Array
    response: Array
    frequency: Array
    frf: Array
    exact: Array

    @property
    def mean(self) -> Array:
        """Root mean square of |H| over hits and points, shape (nf,), 1/kg."""
        return np.asarray(np.sqrt(np.mean(np.abs(self.frf) ** 2, axis=(0, 1))))


@dataclass(frozen=True)
class Pole:
    """An identified mode: frequency (Hz), damping ratio, shape at the points of the test."""

    frequency: float
    damping: float
    shape: Array


def modal_test(
    mechanism: Mechanism,
    link: str,
    damping: float | Mapping[float, float] = 0.01,
    points: int = 11,
    hits: tuple[float, ...] = (0.3, 0.6),
    repeats: int = 5,
    rate: float = 4096.0,
    duration: float = 1.0,
    pulse: float = 5e-4,
    noise: float = 0.0,
    across: str = "y",
    seed: int = 0,
) -> ModalTest:
    """Hit a link at several points and measure at equal distances, motors locked at home.

    Args:
        mechanism: Mechanism. link: Flexible link.
        damping: Ratio of every mode, or {frequency in Hz: ratio}: the nearest one counts.
        points: Number of measured points, ends included (they are on the joints).
        hits: Where the hammer hits, as parts of the length.
        repeats: Hits at each point, averaged. rate: Samples a second. duration: Of a record, s.
        pulse: Width of the half sine, s. noise: Rms noise over rms response.
        across: Direction of hits and measurement: beam y or z. seed: Of noise and hit strength.
    """
    from scipy.signal import lfilter

    part = mechanism.parts.get(link)
    if part is None:
        raise DescriptionError(f"modal_test: {link}: not flexible.{nearest(link, mechanism.parts)}")
    if across not in ("y", "z"):
        raise DescriptionError(f"across: {across}.{nearest(across, ('y', 'z'))}")
    x, at = np.linspace(0.0, part.length, points), part.length * np.asarray(hits)
    found = modes(mechanism, count=mechanism.flexible.nv, preload="none")
    # Modes beyond the band only add stiffness that an accelerometer cannot tell from noise.
    used = (found.frequencies > 1e-6) & (found.frequencies < 0.5 * rate)
    if not np.any(used):
        raise DescriptionError(f"modal_test: {link}: no mode below {0.5 * rate:g} Hz.")
    rows = point_rows(mechanism, found.y, link, np.concatenate([at, x]), across)
    shapes = rows @ found.shapes[:, used]
    f = found.frequencies[used]
    zeta = np.array([_ratio(damping, value) for value in f])
    n, generator = round(duration * rate), np.random.default_rng(seed)
    t = np.arange(n) / rate
    hammer = np.where(t < pulse, np.sin(np.pi * t / pulse), 0.0)
    force = np.empty((len(at), repeats, n))
    response = np.empty((len(at), repeats, points, n))
    filters = [_filter(2 * np.pi * a, b, rate) for a, b in zip(f, zeta, strict=True)]
    for i in range(len(at)):
        for k in range(repeats):
            force[i, k] = hammer * (1.0 + 0.2 * generator.standard_normal())
            q = np.array([lfilter(top, below, force[i, k]) for top, below in filters])
            response[i, k] = (shapes[len(at) :] * shapes[i]) @ q
            scale = noise * np.sqrt(np.mean(response[i, k] ** 2))
            response[i, k] += scale * generator.standard_normal((points, n))
    frequency, frf = _h1(force, response, rate)
    exact = np.column_stack([f, zeta])
    return ModalTest(link, x, at, t, force[:, 0], response[:, 0], frequency, frf, exact)


def _filter(omega: float, ratio: float, rate: float) -> tuple[Array, Array]:
    """Digital filter from the force on a mode to its acceleration, sampled `rate` times a second.

    Polynomials of numerator and denominator; exact for a force that is linear between samples.
    """
    from scipy.signal import cont2discrete

    A = np.array([[0.0, 1.0], [-(omega**2), -2 * ratio * omega]])
    B, C, D = np.array([[0.0], [1.0]]), A[1:], np.array([[1.0]])
    Ad, Bd, Cd, Dd, _ = cont2discrete((A, B, C, D), 1 / rate, method="foh")
    top = np.polyadd(np.poly(Ad - Bd @ Cd), (Dd[0, 0] - 1.0) * np.poly(Ad))
    return np.asarray(top, float), np.asarray(np.poly(Ad), float)


def _ratio(damping: float | Mapping[float, float], frequency: float) -> float:
    if not isinstance(damping, Mapping):
        return float(damping)
    return float(damping[min(damping, key=lambda f: abs(f - frequency))])


def _h1(force: Array, response: Array, rate: float) -> tuple[Array, Array]:
    """H1 = S_xf / S_ff over the repeats, up to the middle of the band."""
    F, X = np.fft.rfft(force), np.fft.rfft(response)
    cross = np.sum(np.conj(F)[:, :, None] * X, axis=1)
    H = cross / np.sum(np.abs(F) ** 2, axis=1)[:, None]
    frequency = np.fft.rfftfreq(force.shape[-1], 1 / rate)
    band = frequency <= 0.25 * rate
    return np.asarray(frequency[band], dtype=float), np.asarray(H[:, :, band])


def point_rows(mechanism: Mechanism, y: Array, link: str, x: Array, across: str) -> Array:
    """Rows that give the speed of the centre line at x along the beam's own y or z, (nx, nv).

    Args:
        mechanism: Mechanism.
        y: Coordinates, shape (nq,).
        link: A flexible one.
        x: Places along its beam [m], shape (nx,).
        across: y or z.
    """
    dynamics = Equations(mechanism.flexible)
    system = mechanism.flexible
    slot = next(s for s in system.expansion.slots if s.link == link)
    R = frame_pose(dynamics, y, slot.root).rotation.T
    component = "xyz".index(across)
    out = np.zeros((len(x), system.nv))
    world = frame_jacobian(dynamics, y, slot.root)
    J = np.vstack([R @ world[:3], R @ world[3:]])  # of the root section, in its own frame
    first = int(system.rigid.nv)
    for k, at in enumerate(x):
        out[k] = (J[:3] + np.cross(J[3:].T, [at, 0.0, 0.0]).T)[component]
        out[k, first:][slot.eta] += slot.body.rows(float(at))[0][component]
    return out


def identify(test: ModalTest, count: int = 2, method: str = "fit") -> tuple[Pole, ...]:
    """Frequencies, damping and shapes from the frequency response functions.

    Args:
        test: A test. count: Number of modes, by the highest peaks of the mean |H|.
        method: "fit": one mode and residuals around each peak, least squares (scipy); "lscf":
            least-squares complex frequency of sdypy-EMA (`pip install pinflex[ema]`).
    """
    if method not in ("fit", "lscf"):
        raise DescriptionError(f"method: {method}.{nearest(method, ('fit', 'lscf'))}")
    starts = _peaks(test, count)
    if method == "lscf":
        return _by_lscf(test, starts)
    return tuple(_by_fit(test, start) for start in starts)


def _peaks(test: ModalTest, count: int) -> list[float]:
    from scipy.signal import find_peaks

    # Divided by frequency: accelerances grow with it.
    height = test.mean / np.maximum(test.frequency, test.frequency[1])
    at, info = find_peaks(height, prominence=0.02 * np.max(height))
    best = at[np.argsort(-info["prominences"])][:count]
    if len(best) < count:
        raise DescriptionError(
            f"identify: {len(best)} peaks found, {count} wanted. Hit elsewhere, or ask for fewer."
        )
    return sorted(float(test.frequency[k]) for k in best)


def _by_fit(test: ModalTest, start: float) -> Pole:
    """One pole with residues of every function; the others' tails are a polynomial in s^2."""
    from scipy.optimize import least_squares

    inside = np.abs(test.frequency - start) < 0.15 * start
    s = 2j * np.pi * test.frequency[inside]
    H = test.frf[:, :, inside].reshape(-1, len(s)).T
    H = H[:, np.max(np.abs(H), axis=0) > 1e-9 * np.max(np.abs(H))]

    def solve(p: Array) -> tuple[Array, Array]:
        pole = 2 * np.pi * p[0] * (-p[1] + 1j * np.sqrt(1 - p[1] ** 2))
        basis = np.column_stack([s**2 / ((s - pole) * (s - np.conj(pole))), s**2, np.ones_like(s)])
        real, right = np.vstack([basis.real, basis.imag]), np.vstack([H.real, H.imag])
        scale = np.max(np.abs(real), axis=0)
        x = np.linalg.lstsq(real / scale, right, rcond=None)[0]
        return (right - (real / scale) @ x).ravel(), x[0] / scale[0]

    fitted = least_squares(
        lambda p: solve(p)[0], [start, 0.02], x_scale=[start, 0.01],
        bounds=([0.8 * start, 1e-6], [1.2 * start, 0.5]), xtol=1e-14, ftol=1e-14,
    )  # fmt: skip
    return Pole(float(fitted.x[0]), float(fitted.x[1]), _shape(test, float(fitted.x[0])))


def _by_lscf(test: ModalTest, starts: list[float]) -> tuple[Pole, ...]:
    try:
        from sdypy import EMA
    except ImportError:
        raise DescriptionError(
            'identify: method lscf needs sdypy-EMA. Install pinflex[ema], or take method="fit".'
        ) from None
    H = test.frf.reshape(-1, test.frf.shape[-1])
    H = H[np.max(np.abs(H), axis=1) > 1e-6 * np.max(np.abs(H))]
    low, high = 0.3 * starts[0], min(1.5 * starts[-1], test.frequency[-1])
    with contextlib.redirect_stderr(io.StringIO()):  # it draws a progress bar
        model = EMA.Model(H, test.frequency, lower=low, upper=high, pol_order_high=30)
        model.get_poles(method="lscf", show_progress=False)
        model.select_closest_poles(starts)
    return tuple(
        Pole(float(f), float(xi), _shape(test, float(f)))
        for f, xi in zip(model.nat_freq, model.nat_xi, strict=True)
    )


def _shape(test: ModalTest, frequency: float) -> Array:
    """Quadrature picking: imaginary part at the line next to the peak, largest entry one."""
    k = int(np.argmin(np.abs(test.frequency - frequency)))
    best = int(np.argmax(np.max(np.abs(test.frf[:, :, k]), axis=1)))
    shape = test.frf[best, :, k].imag
    return np.asarray(shape / shape[np.argmax(np.abs(shape))])
