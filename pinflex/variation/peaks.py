"""Peaks of a run between its samples, and their derivatives by the logarithm of a parameter.

Where a curve y(t, p) has its largest value inside a smooth piece, dy/dt = 0: the derivative of the
peak is that of y at the instant of the peak (the envelope theorem). The largest of samples lies at
another instant in every design, and steps that a run chooses for itself differ in every design. So
a first look finds the instants and places that may be largest. About each of them every design is
read at the same few instants, in the same steps; the peak is that of the polynomial through them,
as smooth a function of p as the states are. The errors told are the sum of what

    extrapolating the differences to none,
    halving the steps, and
    fewer points of the polynomial change,

and of the difference of two peaks of which it is not known which is higher.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from pinflex.arrays import Array, BoolArray, IntArray
from pinflex.errors import SceneError
from pinflex.levels.modes import allowed_motions, modes, vibrating
from pinflex.levels.quasistatic import rest
from pinflex.linalg import condensed, saddle_matrix
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result
from pinflex.results.views import rms
from pinflex.solver.same_steps import RESOLUTION, SameSteps
from pinflex.studies.outputs import yield_strengths

# Derivatives of outputs by the logarithm of a parameter: implicit, or extrapolated differences.
#
# For a state of rest r(y, lam; p) = 0 on closures c(y; p) = 0 and modes of (K, M) on J x = 0:
#
#     [K  -J'; J  0] (y', lam') = -(dr/dp, dc/dp)
#     (omega^2)' = x' (K' - omega^2 M') x - 2 mu' J' x,     J' mu = (K - omega^2 M) x,  x'M x = 1
#
# K', M', J' are taken along (y', lam'). Repeated frequencies: the eigenvalues of that form on their
# subspace. dr/dp and the matrices' derivatives are differences at a held state, which need no
# Newton iteration and follow no mode; those of whole outputs are differences of solved designs.
# Central differences at h, h/2 and h/4 are extrapolated to h = 0 (Romberg); what the third one
# changed is the estimated error.
#
# Source: Nelson 1976, Simplified Calculation of Eigenvector Derivatives; Seyranian, Lund, Olhoff
# 1994, Multiple eigenvalues in structural optimization problems.

STEP = 4e-3  # of the logarithm, at a held state: h^6 is 4e-15
SOLVED = 2e-2  # the same of solved designs, which carry more noise: h^6 is 6e-11
_PARTS = (1.0, 0.5, 0.25)
_ROUND_OFF = 1e-12  # of matrices at a held state
_NOISE = 2e-9  # of a solved output: Newton stops at 1e-9 of a turn
_SAME = 1e-6  # relative gap of frequencies that are one, repeated

At = Callable[[float], Mechanism]


def extrapolated(
    outputs: Callable[[float], Mapping[str, float]], step: float = SOLVED, steps: int = 3
) -> tuple[dict[str, float], dict[str, float]]:
    """d ln(output) / d ln(parameter) by central differences, extrapolated to h = 0.

    The difference is of logarithms, exact for a power law; of the values where they change sign.
    With the estimated errors, by name.
    """
    sides = {h: (outputs(-h), outputs(h)) for h in (part * step for part in _PARTS[:steps])}
    slopes, errors = {}, {}
    for name in sides[step][1]:
        found = [_slope(below[name], above[name], h) for h, (below, above) in sides.items()]
        slope, error = _romberg([np.array(value) for value in found], step, _NOISE)
        slopes[name], errors[name] = float(slope), float(error)
    return slopes, errors


def _romberg(found: list[Array], step: float, noise: float) -> tuple[Array, Array]:
    """The limit of differences at h, h/2, ..., whose errors are even powers of h, and its error."""
    rows, power, last = found, 4.0, found[-1]
    while len(rows) > 1:
        last = rows[-1]
        rows = [(power * b - a) / (power - 1.0) for a, b in itertools.pairwise(rows)]
        power *= 4.0
    return rows[0], np.abs(rows[0] - last) + noise / (step * 0.5 ** (len(found) - 1))


def _slope(below: float, above: float, h: float) -> float:
    if below * above > 0 and np.isfinite(below * above):
        return float(np.log(above / below) / (2.0 * h))
    middle = 0.5 * (below + above)
    if below == above:
        return 0.0
    return float((above - below) / (2.0 * h * middle)) if middle else float("nan")


def of_frequencies(
    base: Mechanism, at: At, count: int, step: float = STEP
) -> tuple[Array, Array, Array]:
    """Lowest frequencies [Hz], their d ln(frequency) / d ln(parameter), implicitly, and errors."""
    state = ModalState(base)
    slope, error = _romberg(
        [state.derivatives(at, part * step) for part in _PARTS], step, _ROUND_OFF
    )
    shown = state.elastic[:count]
    return state.frequencies[shown], slope[shown], error[shown]


class ModalState:
    """The rest of a design and its modes.

    Attributes:
        y, lam: Rest: pose, shape (nq,), and multipliers.
        x: Unit-mass shapes of the free coordinates, shape (free, modes). omega2: (modes,).
        mu: Multipliers of the modes, shape (rows, modes).
        elastic: Places of the modes that are not rigid-body ones, lowest first.
    """

    def __init__(self, base: Mechanism) -> None:
        self.base, system = base, base.flexible
        dynamics = Equations(system)
        found = rest(base, dynamics=dynamics)
        self.still, self.free = np.zeros(system.nv), vibrating(base)
        self.y, self.lam = found.y, found.lam
        K, M, J = self._matrices(dynamics, self.y, self.lam)
        Z = allowed_motions(dynamics, self.y, self.free)
        x, _, omega2 = condensed(Z.T @ K @ Z, Z.T @ M @ Z)
        self.order = np.argsort(omega2)
        self.x, self.omega2 = Z @ x[:, self.order], omega2[self.order]
        left = K @ self.x - M @ self.x * self.omega2
        self.mu = (
            np.linalg.lstsq(J.T, left, rcond=None)[0] if len(J) else np.zeros((0, len(omega2)))
        )
        self.frequencies = np.sign(self.omega2) * np.sqrt(np.abs(self.omega2)) / (2 * np.pi)
        size = np.abs(self.frequencies)
        self.elastic = np.flatnonzero(size > 1e-7 * np.max(size, initial=0.0))
        self.saddle = saddle_matrix(K, J)

    def _matrices(self, dynamics: Equations, y: Array, lam: Array) -> tuple[Array, Array, Array]:
        """K, M and J of the free coordinates."""
        M, _, K, J = dynamics.tangent(y, self.still, self.still, lam, 0.0)
        square = np.ix_(self.free, self.free)
        return K[square], M[square], J[:, self.free]

    def derivatives(self, at: At, h: float) -> Array:
        """d ln(frequency) of all modes by differences of +-h at the held, then the led state."""
        found = np.zeros(len(self.omega2))
        for group, form in self.forms(at, h):
            found[group] = np.linalg.eigvalsh(form)
        return found

    def forms(self, at: At, h: float) -> list[tuple[Array, Array]]:
        """d ln(frequency) as a form on the shapes of each frequency, with their places."""
        designs = [at(s) for s in (-h, h)]
        sides = [Equations(design.flexible) for design in designs]
        held = [self._held(side, d) for side, d in zip(sides, designs, strict=True)]
        forces = [self._unbalanced(side, y) for side, y in zip(sides, held, strict=True)]
        n = len(self.free)
        right, fixed = -(forces[1] - forces[0]) / (2.0 * h), n == len(self.base.flexible.free)
        # A free base has no stiffness, and nothing pushes it: any of its poses will do.
        led = np.asarray(
            np.linalg.solve(self.saddle, right)
            if fixed
            else np.linalg.lstsq(self.saddle, right, rcond=None)[0],
            dtype=float,
        )
        below, above = (
            self._matrices(side, self._moved(side, y, s * led[:n]), self.lam + s * led[n:])
            for side, y, s in zip(sides, held, (-h, h), strict=True)
        )
        dK, dM, dJ = ((b - a) / (2.0 * h) for a, b in zip(below, above, strict=True))
        found = []
        for group in self._groups():
            x, value = self.x[:, group], float(np.mean(self.omega2[group]))
            closing = (dJ @ x).T @ self.mu[:, group]
            form = x.T @ (dK - value * dM) @ x - closing - closing.T
            found.append((group, 0.25 * (form + form.T) / value))
        return found

    def _held(self, dynamics: Equations, design: Mechanism) -> Array:
        """The held pose, moved by the difference of the two designs' homes."""
        if np.array_equal(design.home, self.base.home):
            return self.y
        moved = dynamics.difference(self.base.undeformed(), design.undeformed())
        return dynamics.integrate(self.y, moved)

    def _unbalanced(self, dynamics: Equations, y: Array) -> Array:
        """Residual and closures of another design at a held pose."""
        r, c = dynamics.residual(y, self.still, self.still, self.lam, 0.0)
        return np.concatenate([r[self.free], c])

    def _moved(self, dynamics: Equations, y: Array, step: Array) -> Array:
        dy = np.zeros(dynamics.system.nv)
        dy[self.free] = step
        return dynamics.integrate(y, dy)

    def _groups(self) -> list[Array]:
        """Places of the modes, those of one frequency together."""
        f = self.frequencies[self.elastic]
        if not len(f):
            return []
        cuts = np.flatnonzero(np.diff(f) > _SAME * np.abs(f[1:])) + 1
        return [np.asarray(group) for group in np.split(self.elastic, cuts)]


# Largest values of curves between their samples, by polynomials in short windows of time.

NODES = 9  # instants in a window: a polynomial of degree 8, and of 4 by every other one
_FINE = 161  # places in a window where its polynomial is looked at first
_REFINED = 4  # Newton iterations from the best of them


@dataclass(frozen=True)
class Windows:
    """Short spans of time, each with the instants at which curves are read there.

    Attributes:
        nodes: Instants [s], shape (windows, NODES).
        closed: Whether the first and the last of them end a smooth piece, shape (windows, 2).
    """

    nodes: Array
    closed: BoolArray

    def tops(self, windows: IntArray, values: Array) -> tuple[Array, Array, Array]:
        """Largest values in windows, shape (n,); the same by fewer points; whether it is inside."""
        x = _unit(self.nodes[windows])
        top, place = _largest(x, values)
        fewer, _ = _largest(x[:, ::2], values[:, ::2])
        low, high = self.closed[windows].T
        return top, fewer, (low | (place > -1.0)) & (high | (place < 1.0))


def around(centre: float, half: float, piece: tuple[float, float]) -> tuple[Array, BoolArray]:
    """Nodes of a window about an instant inside a smooth piece, and which sides end that."""
    half = min(half, 0.5 * (piece[1] - piece[0]))
    middle = min(max(centre, piece[0] + half), piece[1] - half)
    turns = np.linspace(np.pi, 0.0, NODES)
    nodes = np.clip(middle + half * np.cos(turns), *piece)
    return nodes, np.abs(nodes[[0, -1]] - np.array(piece)) < 1e-3 * half


def steps_around(k: int, t: Array) -> tuple[Array, BoolArray]:
    """The same at steps t (n,) about the k-th of them."""
    first = min(max(k - NODES // 2, 0), len(t) - NODES)
    last = first + NODES
    return t[first:last], np.array([first == 0, last == len(t)])


def highest(curve: Array, part: float, most: int) -> IntArray:
    """Places of the local maxima of a curve that come within a part of its largest value.

    An end that nothing beside exceeds is one.
    """
    beside = np.concatenate([[-np.inf], curve, [-np.inf]])
    tops = np.flatnonzero((curve >= beside[:-2]) & (curve > beside[2:]))
    tops = tops[curve[tops] >= (1.0 - part) * np.max(curve)]
    return np.asarray(tops[np.argsort(-curve[tops], kind="stable")][:most])


def _unit(nodes: Array) -> Array:
    """Nodes of windows mapped to -1 ... 1."""
    low, high = nodes[:, :1], nodes[:, -1:]
    return np.asarray((2.0 * nodes - low - high) / (high - low))


def _largest(x: Array, values: Array) -> tuple[Array, Array]:
    """Largest values on -1 ... 1 of the polynomials through values at x (n, k), and where."""
    k = values.shape[1]
    c = np.linalg.solve(chebyshev.chebvander(x, k - 1), values[:, :, None])[:, :, 0].T
    fine = np.linspace(-1.0, 1.0, _FINE)
    place = fine[np.argmax(chebyshev.chebval(fine, c), axis=1)]
    first, second = chebyshev.chebder(c), chebyshev.chebder(c, 2)
    best, height = place, chebyshev.chebval(place, c, tensor=False)
    for _ in range(_REFINED):
        slope = chebyshev.chebval(place, first, tensor=False)
        bend = chebyshev.chebval(place, second, tensor=False)
        step = np.where(bend < 0.0, -slope / np.where(bend < 0.0, bend, 1.0), 0.0)
        place = np.clip(place + np.clip(step, -2.0 / _FINE, 2.0 / _FINE), -1.0, 1.0)
        now = chebyshev.chebval(place, c, tensor=False)
        best, height = np.where(now > height, place, best), np.maximum(now, height)
    return height, best


_MARCHED = 1e-4  # h of a logarithm, of runs: a phase of 1000 rad then turns by 0.1
_STILL = 1e-3  # the same of instants by themselves, which have no phase
_WIDE = 4.0  # half a window is at least so many times what h moves a phase by
_RIVAL = 0.02  # a peak that is lower by less may become the largest
_MOST = 6  # windows of an output
_SWITCH = 0.01  # of the parameter: a change at which another peak takes over is told
_TIED = 1e-6  # relative difference of peaks that a run cannot tell apart
_ALIKE = 1e-3  # difference of derivatives that does not matter
# Relative noise of an output: 3e-13 to 8e-9 was seen of runs; instants are solved to round-off.
_NOISY, _QUIET = 3e-9, 1e-10
_RESOLVED = 2.5  # steps in a period that collocation of six stages follows
_MODES = 200


@dataclass(frozen=True)
class Slope:
    """A derivative d ln(peak) / d ln(parameter).

    Attributes:
        value, error: The derivative and its estimated error.
        remark: Which other peak is about to become the largest, or "".
    """

    value: float
    error: float
    remark: str = ""


@dataclass(frozen=True)
class _Peak:
    """An output: the places and windows whose largest values come near the largest of all.

    Attributes:
        labels: Of the places. places: Columns of the curves, shape (n,), the highest first.
        windows: Of each, shape (n,). heights: In the first design, shape (n,).
    """

    labels: tuple[str, ...]
    places: IntArray
    windows: IntArray
    heights: Array


@dataclass(frozen=True)
class _Curves:
    """An output over time at several places.

    Attributes:
        labels: Of the places. groups: Of which only the highest place is looked at, shape (n,).
        values: Not negative, shape (nt, n).
    """

    labels: tuple[str, ...]
    groups: IntArray
    values: Array


class Peaks:
    """Outputs of a run of one scene, and of designs that differ from it in a few numbers.

    Attributes:
        values: Of the first design, by name: peaks between the samples.
        remarks: What the errors of derivatives leave out, a sentence each.
    """

    def __init__(self, base: Mechanism, names: Iterable[str], level: str | None) -> None:
        """Run the first design and find its peaks."""
        self.base, self.steps = base, SameSteps(base, level)
        self._names = tuple(names)
        self._rigid = self._reference()
        self._h = _MARCHED if self.steps.stepped else _STILL
        look = self.steps.look
        seen = self._curves(base, look, True)
        # nothing changes by a share of what stays zero, as a panel's tip that turns on the spot
        self._names = tuple(name for name, of in seen.items() if np.any(of.values))
        seen = {name: seen[name] for name in self._names}
        self._windows = self._around(look, seen)
        self._grid = self.steps.grid if any(map(_is_rms, seen)) else np.zeros(0)
        self._t = np.unique(np.concatenate([[0.0], self._windows.nodes.ravel(), self._grid]))
        read = self._curves(base, self._t, True)
        self._peaks = {name: self._candidates(name, of) for name, of in read.items()}
        self.values = {name: float(peak.heights[0]) for name, peak in self._peaks.items()}
        self.remarks = self._unresolved()

    def slopes(self, at: At) -> dict[str, Slope]:
        """Derivatives by a parameter, by output."""
        h, noise = self._h, _NOISY if self.steps.stepped else _QUIET
        wide, near = self._differences(at, h), self._differences(at, 0.5 * h)
        rough = self._differences(at, 0.5 * h, halved=False) if self.steps.stepped else near
        found = {}
        for name, peak in self._peaks.items():
            (a, _), (b, fewer), (c, _) = wide[name], near[name], rough[name]
            slope = (4.0 * b - a) / 3.0
            error = np.abs(slope - b) + np.abs(b - c) + np.abs(b - fewer) + noise / h
            found[name] = self._judged(name, peak, slope, error)
        return found

    def _judged(self, name: str, peak: _Peak, slope: Array, error: Array) -> Slope:
        """The derivative of the highest, and which other one takes over at a small change."""
        value, doubt = float(slope[0]), float(error[0])
        gap, steeper = 1.0 - peak.heights / peak.heights[0], slope - value
        apart = np.abs(steeper) > max(_ALIKE, 2.0 * doubt)
        doubt += float(np.max(np.abs(steeper[apart & (gap < _TIED)]), initial=0.0))
        change = np.where(apart, gap / np.where(apart, steeper, 1.0), np.inf)
        k = int(np.argmin(np.abs(change)))
        if not np.isfinite(doubt) or abs(change[k]) > _SWITCH:
            return Slope(value, doubt)
        size = f"{100 * abs(change[k]):.2g} %" if gap[k] > _TIED else "Anything"
        said = f"{size} {'more' if steeper[k] > 0 else 'less'}"
        t = float(np.mean(self._windows.nodes[peak.windows[k]]))
        where = ", ".join(x for x in (peak.labels[peak.places[k]], f"t = {t:.4g} s") if x)
        return Slope(value, doubt, (
            f"{said} of it makes another peak the largest of {name} ({where}), which changes by "
            f"{slope[k]:+.2f} %."
        ))  # fmt: skip

    def _differences(self, at: At, h: float, halved: bool = True) -> dict[str, tuple[Array, Array]]:
        """Differences of the logarithms over 2 h, by output; by fewer points too, shape (n,)."""
        below, above = (self._heights(self._curves(at(s), self._t, halved)) for s in (-h, h))
        with np.errstate(divide="ignore", invalid="ignore"):
            return {
                name: (
                    np.log(above[name][0] / below[name][0]) / (2.0 * h),
                    np.log(above[name][1] / below[name][1]) / (2.0 * h),
                )
                for name in self._peaks
            }

    def _heights(self, curves: Mapping[str, _Curves]) -> dict[str, tuple[Array, Array]]:
        """Heights of all peaks of one design, and by fewer points, not a number where it left."""
        found = {}
        for name, peak in self._peaks.items():
            found[name] = self._height(name, curves[name], peak.windows, peak.places)
        return found

    def _height(
        self, name: str, curves: _Curves, windows: IntArray, places: IntArray
    ) -> tuple[Array, Array]:
        if _is_rms(name):
            rows = np.searchsorted(self._t, self._grid)
            values = np.array([rms(curves.values[rows, k]) for k in places])
            return values, values
        rows = np.searchsorted(self._t, self._windows.nodes[windows])
        values = curves.values[rows, places[:, None]]
        top, fewer, inside = self._windows.tops(windows, values)
        return top, np.where(inside, fewer, np.nan)

    def _candidates(self, name: str, curves: _Curves) -> _Peak:
        """Places and windows that come near the largest value of the first design."""
        count = curves.values.shape[1]
        all_windows = np.zeros(1, int) if _is_rms(name) else np.arange(len(self._windows.nodes))
        windows, places = (x.ravel() for x in np.meshgrid(all_windows, np.arange(count)))
        heights, fewer = self._height(name, curves, windows, places)
        inside = np.isfinite(fewer)  # else the flank of a peak beside the window
        windows, places, heights = (x[inside] for x in (windows, places, heights))
        order = np.argsort(-heights, kind="stable")
        order = order[heights[order] >= (1.0 - _RIVAL) * heights[order[0]]]
        return _Peak(curves.labels, places[order], windows[order], heights[order])

    def _around(self, look: Array, seen: Mapping[str, _Curves]) -> Windows:
        """Windows about all instants at which an output may be largest."""
        found: list[tuple[Array, BoolArray]] = []
        span = _WIDE * self._h * float(self.steps.marks[-1])
        centres: set[int] = set()
        for name, curves in seen.items():
            if not _is_rms(name):
                centres |= _instants(curves)
        for k in sorted(centres):
            if self.steps.linear:
                found.append(steps_around(k, look))
                continue
            beside = look[[max(k - 1, 0), min(k + 1, len(look) - 1)]]
            half = max(span, float(np.max(np.abs(beside - look[k]))))
            found.append(around(float(look[k]), half, self.steps.inside(float(look[k]))))
        nodes, closed = (np.array(x) for x in zip(*found, strict=True)) if found else (
            np.zeros((0, 0)), np.zeros((0, 2), bool)
        )  # fmt: skip
        return Windows(nodes, closed)

    def _unresolved(self) -> tuple[str, ...]:
        """A sentence where vibration that nothing damps is too fast for the steps.

        It may be as large as their resolution, and acts on a derivative as its phase turns.
        """
        if not self.steps.marched or not self.base.compliant:
            return ()
        last = float(self._t[-1])
        dt = 0.5 * last / max(int(np.searchsorted(self.steps.ends, last)), 1)
        found = modes(self.base, count=_MODES, preload="none")
        turned = 2.0 * np.pi * np.maximum(found.frequencies, 0.0) * last
        decay = 0.5 * self.base.flexible.dissipation(found.shapes.T) * last
        alive = (found.frequencies * dt * _RESOLVED > 1.0) & (
            RESOLUTION * turned * np.exp(-decay) > _ALIKE
        )
        if not np.any(alive):
            return ()
        low, high = found.frequencies[alive][[0, -1]]
        return (
            f"{', '.join(self.values)}: what rings at {low:.4g} to {high:.4g} Hz is hardly "
            f"damped and too fast for the steps of {dt:.2g} s. One per cent turns its phase by up "
            f"to {0.01 * np.max(turned[alive]):.2g} rad: no derivative of that would last, and "
            "these and their errors leave it out. `damping: {modal: 0.01}` lets it die.",
        )

    def _reference(self) -> SameSteps | None:
        """The steps of the rigid run that deviations are from; None where there is none."""
        wanted = any(name.startswith("deviation") for name in self._names)
        if not wanted or self.steps.level == "rigid" or self.base.description.platform is None:
            return None
        try:
            return SameSteps(self.base, "rigid")
        except SceneError:
            return None

    def _curves(self, design: Mechanism, t: Array, halved: bool) -> dict[str, _Curves]:
        """Curves of a design at instants of the first one, by output."""
        run = self.steps.run(design, t, halved)
        rigid = None if self._rigid is None else self._rigid.run(design, t, halved)
        found = {name: curves_of(name, design, run, rigid) for name in self._names}
        return {name: curves for name, curves in found.items() if curves is not None}


def _is_rms(name: str) -> bool:
    return name.startswith("torque.rms")


def _instants(curves: _Curves) -> set[int]:
    """Instants at which the highest place of a group comes near the largest value."""
    tops = []
    for group in np.unique(curves.groups):
        curve = np.max(curves.values[:, curves.groups == group], axis=1)
        tops += [(float(curve[k]), int(k)) for k in highest(curve, _RIVAL, _MOST)]
    least = (1.0 - _RIVAL) * max(height for height, _ in tops)
    return {k for height, k in sorted(tops, reverse=True)[:_MOST] if height >= least}


def over_time(name: str, design: Mechanism, run: Result, rigid: Result | None) -> Array:
    """An output at every sample, by motor or link: values whose largest is the peak, shape (n,)."""
    curves = curves_of(name, design, run, rigid)
    if curves is None:
        return np.zeros(0)
    groups = [curves.values[:, curves.groups == group] for group in np.unique(curves.groups)]
    return np.concatenate([np.max(values, axis=1) for values in groups])


def curves_of(name: str, design: Mechanism, run: Result, rigid: Result | None) -> _Curves | None:
    """An output over time; None where the scene does not have it."""
    head, _, rest = name.partition(".")
    if head == "torque":
        _, _, motor = rest.partition(".")
        motors = [motor] if motor else list(run.motors)
        columns = [run.motors.index(name) for name in motors]
        return _flat(motors, [np.abs(run.torque[:, [k]]) for k in columns])
    if head == "deviation":
        if rigid is None:
            return None
        off = run.deviation_from(rigid, str(design.description.platform))
        return _flat([""], [(off.angle if rest == "rotation" else off.norm)[:, None]])
    strengths = yield_strengths(design) if rest == "yield" else dict.fromkeys(run.links, 1.0)
    links = [link for link in run.links if link in strengths]
    return _flat(links, [run.link(link).von_mises / strengths[link] for link in links])


def _flat(labels: list[str], values: list[Array]) -> _Curves | None:
    """Curves of several groups side by side; None if there is no group."""
    if not values:
        return None
    counts = [x.shape[1] for x in values]
    names = tuple(name for name, count in zip(labels, counts, strict=True) for _ in range(count))
    groups = np.repeat(np.arange(len(counts)), counts)
    return _Curves(names, groups, np.concatenate(values, axis=1))
