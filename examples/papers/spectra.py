"""Amplitude spectra on a record's own grid, and the forces that drive a link's modes, by origin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Slot
from pinflex.recovery.kinematics import Samples, run_of
from pinflex.results.result import Result
from pinflex.text import brief
from pinflex.viewer.plot import maxima


@dataclass(frozen=True)
class Spectrum:
    """Amplitudes of the harmonics of a record.

    Attributes:
        frequency: k / (n dt), shape (n // 2 + 1,), Hz: the last sample counts as one of n.
        amplitude: Amplitudes, shape (n // 2 + 1,), in the unit of the record.
    """

    __repr__ = brief

    frequency: Array
    amplitude: Array

    @property
    def resolution(self) -> float:
        """Distance of two lines, Hz."""
        return float(self.frequency[1])

    def peaks(self, count: int = 3) -> tuple[tuple[float, float], ...]:
        """The highest local maxima: (frequency, amplitude), highest first."""
        at = np.array(maxima(self.amplitude), dtype=int)
        best = at[np.argsort(-self.amplitude[at])][:count]
        return tuple((float(self.frequency[k]), float(self.amplitude[k])) for k in best)


def spectrum(t: Array, x: Array) -> Spectrum:
    """Spectrum without window, padding or removal of the mean, as the papers show it.

    Args:
        t: Equal steps, shape (n,), s. x: Record, shape (n,).
    """
    t, x = np.asarray(t, float), np.asarray(x, float)
    n = len(t)
    if n < 4 or x.shape != t.shape:
        raise DescriptionError(
            f"spectrum: {t.shape} times and {x.shape} values. Give one record of 4 samples or more."
        )
    step = (t[-1] - t[0]) / (n - 1)
    if not np.allclose(np.diff(t), step, rtol=1e-6, atol=0.0):
        raise DescriptionError("spectrum: the steps differ. Resample the record at equal steps.")
    amplitude = np.abs(np.fft.rfft(x)) * (2.0 / n)
    amplitude[0] *= 0.5
    return Spectrum(np.arange(len(amplitude)) / (n * step), amplitude)


@dataclass(frozen=True)
class ModalForces:
    """What drives the coordinates eta of one link: M eta_a + D eta_v + K eta = sum of the terms.

    Attributes:
        t: Times, shape (nt,), s.
        labels: Names of the coordinates.
        eta: Coordinates, shape (nt, n).
        inertia: Of the link were it rigid in the same motion, gravity with it, shape (nt, n).
        coupling: Of deflection and motion together: Coriolis, centrifugal, (nt, n).
        ends: Of what hangs on the link's ends: joint forces and end masses, (nt, n).
        own: M eta_a + D eta_v + K eta, (nt, n): their sum.
    """

    __repr__ = brief

    t: Array
    labels: tuple[str, ...]
    eta: Array
    inertia: Array
    coupling: Array
    ends: Array
    own: Array

    def terms(self) -> dict[str, Array]:
        """The three terms by name."""
        return {"inertia": self.inertia, "coupling": self.coupling, "ends": self.ends}


def modal_forces(mechanism: Mechanism, result: Result, link: str) -> ModalForces:
    """Separate the forces on a link's coordinates by their origin.

    Args:
        mechanism: The mechanism that was solved. result: A coupled or quasistatic run.
        link: Flexible link of one segment.
    """
    if link not in mechanism.parts:
        raise DescriptionError(
            f"modal_forces: {link}: not flexible.{nearest(link, mechanism.parts)}"
        )
    run = run_of(mechanism, result)
    slots = [s for s in run.system.expansion.slots if s.link == link]
    if len(slots) != 1 or run.linear:
        raise DescriptionError(
            f"modal_forces: {link}: needs one segment and a run that is not ked=structural."
        )
    slot, body = slots[0], slots[0].body
    nq, nv = int(run.system.rigid.nq), int(run.system.rigid.nv)
    full = Samples(mechanism, run)
    y, v, a = run.y.copy(), run.v.copy(), run.a.copy()
    eta, rate, second = (x[:, n:][:, slot.eta] for x, n in ((run.y, nq), (run.v, nv), (run.a, nv)))
    y[:, nq:], v[:, nv:], a[:, nv:] = 0.0, 0.0, 0.0
    stiff = Samples(mechanism, replace(run, y=y, v=v, a=a, lam=0.0 * run.lam))
    inertia = -_stations(stiff, slot, 0.0 * eta)
    M = np.einsum("s,sdi,sdj->ij", body.mass, body.Phi, body.Phi)
    M += np.einsum("s,si,sj->ij", body.It, body.Phi_t, body.Phi_t)
    moved = -_stations(full, slot, eta)
    coupling = moved - inertia + second @ M.T
    own = second @ M.T + rate @ body.D.T + eta @ body.K.T
    # The ends take the rest: r = 0 holds in these rows of a solved run.
    ends = own - inertia - coupling
    return ModalForces(run.t, body.labels, eta, inertia, coupling, ends, own)


def _stations(samples: Samples, slot: Slot, eta: Array) -> Array:
    """X' g over a link's own stations, shape (nt, n)."""
    body = slot.body
    pull, twist = samples.forces.g[:, slot.stations], samples.forces.g[:, slot.twists]
    force = np.einsum("tsd,sdn->tn", pull, body.Phi) + twist @ body.Phi_t
    if body.G is not None:
        force += np.einsum("tsd,sdnm,tm->tn", pull, body.G, eta, optimize=True)
    if body.G_t is not None and len(body.xt):
        force += np.einsum("ts,snm,tm->tn", twist, body.G_t, eta, optimize=True)
    return np.asarray(force)
