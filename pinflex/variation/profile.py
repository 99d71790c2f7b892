"""Confidence intervals of least squares: linear where residuals are, else by profile likelihood.

An end of the interval of parameter k is the last x_k at which the others, fitted again, keep

    S(x) = |r(x)|^2 <= S(best) + z^2,

z the quantile of the normal law where standard deviations are known, of Student's with the freedom
left where one was estimated. Intervals that are to hold all at once take z^2 of chi^2 with as many
freedoms as parameters, n, or n times that of Fisher's F: they are the box about the joint region,
and hold at least as often. In a linear problem that is x_k -+ z sqrt(C_kk). Whether it is one is
asked of the residuals at these two ends: r departs from r(best) + J d by little of z, and S rises
by z^2. Elsewhere the end is sought by a sequence of small problems: most x_k under that limit with

    r + J d + d'H d / 2 for r(x + d),   |d| no longer than the last step allows,

the second derivatives H those of the best point, J led along with them and by Broyden's correction,
and taken anew by differences at the end, where it judges whether the others are fitted. A valley
that bends has several such ends: where another search went through a point within the limit that is
further out, that for this end goes on from there.

Source: Bates, Watts (1988), Nonlinear Regression Analysis, ch. 6; Venzon, Moolgavkar (1988), A
method for computing profile-likelihood-based confidence intervals, Appl. Statist. 37, 87; Scheffe
(1959), The Analysis of Variance, sec. 3.5: all at once; Raue et
al. (2009), Structural and practical identifiability analysis, Bioinformatics 25, 1923: ends that
are not told; Broyden (1965), A class of methods for solving nonlinear simultaneous equations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinflex.arrays import Array, BoolArray, IntArray

_LEVEL = 0.95
_NARROW = 1e-4  # half width [ln]: residuals are straight over that, but for their own noise
_STRAIGHT = 0.1  # departure from straight residuals, of z: about that share of the half width
_RISE = 0.2  # the same of S, of z^2
_AT_BOUND = 1e-4  # of a logarithm
_CURVE = (1e-3, 0.1)  # least and largest step of second derivatives [ln]
_SLOPE = 1e-4  # step of last slopes [ln]: they err by that share of the curvature
_FIRST, _LONGEST = 0.5, 1.0  # steps [ln]
_SHORTEST = 1e-5  # step [ln]: beyond it there are no designs
_POOR = 0.3  # departure from the model, of z: the next step is shorter
_LOST = 4.0  # S above the limit, of z^2, from which a step teaches nothing: another mode is paired
_STALE = 10  # steps after which derivatives are taken anew
_OVER = 0.5  # S above the limit, of z^2, from which steps still lead back
_ENDED = 0.01  # next step, of the half width
_MOST = 40  # steps to an end; some ten are taken
_AGAIN = 3  # searches for an end, each from further out, once all have been through
_HELD, _TURNS = 12, 30  # fits with a parameter held where those do not get there; steps of one
_FAR = 1e3  # residual, of z, where there is no design

Rows = Callable[[Array], Array | None]


def quantile(freedom: int | None, count: int = 1) -> float:
    """Half the 95 % interval of a parameter in standard deviations."""
    from scipy.stats import chi2, f

    if freedom is None:
        return float(np.sqrt(chi2.ppf(_LEVEL, count)))
    return float(np.sqrt(count * f.ppf(_LEVEL, count, freedom))) if freedom > 0 else math.nan


@dataclass(frozen=True)
class Ends:
    """Ends of the intervals of each parameter alone.

    Attributes:
        x: Lower and upper, shape (n, 2); -inf and inf: not told within the bounds.
        profiled: Whether they are of the profile, shape (n,); else of straight residuals.
        leaning: Other parameters that are at a bound of theirs at an end, of each parameter.
        unsure: Whether the search for a lower and an upper end gave up before the bound, of each.
    """

    x: Array
    profiled: tuple[bool, ...]
    leaning: tuple[tuple[int, ...], ...]
    unsure: tuple[tuple[bool, bool], ...]

    @property
    def own(self) -> Array:
        """Ends that the measurements tell alone, shape (n, 2); infinite where bounds take part."""
        rests = np.array([bool(others) for others in self.leaning])
        return np.where(rests[:, None], np.array([-math.inf, math.inf]), self.x)


@dataclass(frozen=True)
class Best:
    """The best point and what is known of the residuals there.

    Attributes:
        x: Shape (n,). r: Residuals, in standard deviations, shape (rows,).
        J: Their derivatives, shape (rows, n).
        C: Covariance of straight residuals, shape (n, n); infinite for what they do not tell.
    """

    x: Array
    r: Array
    J: Array
    C: Array


def ends(rows: Rows, best: Best, bounds: Array, z: float) -> Ends:
    """Ends of the interval of each parameter."""
    half = z * np.sqrt(np.diag(best.C))
    found = best.x[:, None] + half[:, None] * np.array([-1.0, 1.0])
    curved = [k for k in range(len(half)) if not _straight(rows, best, bounds, z, k)]
    leaning: list[tuple[int, ...]] = [()] * len(half)
    unsure = [(False, False)] * len(half)
    if curved:
        steps = np.clip(0.25 * half, *_CURVE)
        profile = _Profile(rows, best, _curvature(rows, best, bounds, steps), bounds, z)
        first = {(k, sign): profile.end(k, sign) for k in curved for sign in (-1.0, 1.0)}
        for k in curved:
            low, high = (profile.furthest(k, sign, first[k, sign]) for sign in (-1.0, 1.0))
            found[k] = [sign * math.inf if end.x is None else end.x[k]
                        for sign, end in ((-1.0, low), (1.0, high))]  # fmt: skip
            leaning[k] = _leaning(k, [end.x for end in (low, high) if end.x is not None], bounds)
            unsure[k] = low.unsure, high.unsure
    return Ends(found, tuple(k in curved for k in range(len(half))), tuple(leaning), tuple(unsure))


def _leaning(k: int, points: list[Array], bounds: Array) -> tuple[int, ...]:
    """Parameters but k that are at a bound at one of the points."""
    at = [np.min(np.abs(bounds - x[:, None]), axis=1) < _AT_BOUND for x in points]
    places: list[int] = np.flatnonzero(np.any(at, axis=0)).tolist() if at else []
    return tuple(j for j in places if j != k)


def _straight(rows: Rows, best: Best, bounds: Array, z: float, k: int) -> bool:
    """Whether residuals are linear across the linear interval of a parameter."""
    spread = math.sqrt(best.C[k, k])
    if math.isnan(z) or not math.isfinite(spread):
        return math.isnan(z)  # no scale, and so no ends
    if z * spread < _NARROW:
        return True
    step = z * best.C[:, k] / spread
    for d in (-step, step):
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(d > 0, bounds[:, 1] - best.x, best.x - bounds[:, 0]) / np.abs(d)
        share = min(1.0, float(np.nanmin(room)))
        if share < _STRAIGHT:
            return False
        there = rows(best.x + share * d)
        if there is None:
            return False
        departs = float(np.linalg.norm(there - best.r - share * (best.J @ d)))
        rise = float(there @ there - best.r @ best.r) / (share * z) ** 2
        if departs > _STRAIGHT * share * z or abs(rise - 1.0) > _RISE:
            return False
    return True


def _curvature(rows: Rows, best: Best, bounds: Array, steps: Array) -> Array:
    """Second derivatives of the rows by differences away from the nearer bound, (rows, n, n)."""
    n = len(best.x)
    h = np.where(best.x - bounds[:, 0] > bounds[:, 1] - best.x, -steps, steps)
    H = np.zeros((len(best.r), n, n))
    moved = np.eye(n) * h
    alone = [rows(best.x + d) for d in moved]
    for i in range(n):
        one = alone[i]
        if one is None:
            continue
        H[:, i, i] = 2.0 * (one - best.r - h[i] * best.J[:, i]) / h[i] ** 2
        for j in range(i):
            other, both = alone[j], rows(best.x + moved[i] + moved[j])
            if other is not None and both is not None:
                H[:, i, j] = H[:, j, i] = (both - one - other + best.r) / (h[i] * h[j])
    return H


@dataclass(frozen=True)
class _Local:
    """The rows about a point, to second order."""

    x: Array
    r: Array
    J: Array
    H: Array

    def at(self, d: Array) -> Array:
        """The rows at x + d."""
        return np.asarray(self.r + self.J @ d + 0.5 * (self.H @ d) @ d)

    def slope(self, d: Array) -> Array:
        """Their derivatives at x + d."""
        return np.asarray(self.J + self.H @ d)

    def corrected(self, d: Array, gap: Array) -> _Local:
        """With Broyden's correction, by which the rows at x + d are greater by `gap`."""
        return replace(self, J=self.J + np.outer(gap, d) / (d @ d))

    def moved(self, d: Array, rows: Array) -> _Local:
        """About x + d, where the rows are known; those at x are kept."""
        there = _Local(self.x + d, rows, self.slope(d), self.H)
        return there.corrected(d, rows - self.at(d))


@dataclass(frozen=True)
class _End:
    """An end of an interval: the point there; None: none before the bound, or not to be had."""

    x: Array | None
    unsure: bool = False


class _Profile:
    """The search for ends.

    Attributes:
        limit: Of S.
        within: Points that were found to be within it, and their rows.
    """

    def __init__(self, rows: Rows, best: Best, H: Array, bounds: Array, z: float) -> None:
        self.best, self.H, self.bounds, self.z = best, H, bounds, z
        self.limit = float(best.r @ best.r) + z**2
        self.within = [(best.x, best.r)]
        self._rows = rows

    def rows(self, x: Array) -> Array | None:
        """Residuals at x."""
        r = self._rows(x)
        if r is not None and self._over(r) <= 0:
            self.within.append((x.copy(), r))
        return r

    def end(self, k: int, sign: float) -> _End:
        """Where x_k is last within the limit on the way from the best point, before its bound.

        A search that stops on the way is followed by fits with x_k held, at the bound first.
        """
        at = _Local(self.best.x, self.best.r, self.best.J, self.H)
        return self._searched_from(at, k, sign)

    def furthest(self, k: int, sign: float, found: _End) -> _End:
        """The end found, or one further out, searched from a point of another search."""
        for _ in range(_AGAIN):
            x, r = max(self.within, key=lambda point: sign * point[0][k])
            if found.x is None and not found.unsure:
                break
            far = self.best.x if found.x is None else found.x
            if sign * (x[k] - far[k]) <= _ENDED * abs(far[k] - self.best.x[k]):
                break
            found = self._searched_from(self._anew(_Local(x, r, self.best.J, self.H)), k, sign)
        return found

    def _searched_from(self, at: _Local, k: int, sign: float) -> _End:
        bound = self.bounds[k, int(sign > 0)]
        if abs(bound - at.x[k]) < _AT_BOUND:
            return _End(None)
        found, last = self._followed(at, k, sign, bound)
        return self._by_held_fits(k, bound, last) if found is None else found

    def _followed(self, at: _Local, k: int, sign: float, bound: float) -> tuple[_End | None, Array]:
        """The end by small problems, and the last point within the limit; None: it gave up."""
        last = at.x
        longest, judged, old = _FIRST, False, 0
        for _ in range(_MOST):
            over = self._over(at.r)
            last = at.x if over <= 2 * _ENDED else last
            if abs(bound - at.x[k]) < 1e-9 and over <= 2 * _ENDED:
                return _End(None), last
            d = self._step(at, k, sign, longest)
            width = abs(at.x[k] - self.best.x[k])
            ended = abs(d[k]) <= (3 if judged else 1) * _ENDED * width and abs(over) <= 2 * _ENDED
            if ended and judged:
                return _End(np.asarray(at.x + d)), last
            if ended or old >= _STALE:
                longest = max(longest, min(width, _FIRST))
                at, judged, old = self._anew(at), True, 0
                continue
            moved, longest = self._moved(at, d, longest)
            if not longest:
                return None, last
            judged, old = judged and moved.x is at.x, old + 1
            at = moved
        return None, last

    def _by_held_fits(self, k: int, bound: float, inside: Array) -> _End:
        """The end between a point within the limit and the bound, by fits with x_k held.

        sqrt(S - S(best)) is straight where rows are: false position on it.
        """
        x, g = inside, self._beyond(self.rows(inside))
        there, g_there = self._held(k, bound, inside)
        if g_there <= _ENDED:
            return _End(None)
        for _ in range(_HELD):
            share = np.clip(g / (g - g_there), 0.1, 0.9) if np.isfinite(g_there) else 0.5
            between, g_between = self._held(k, float(x[k] + share * (there[k] - x[k])), x)
            if abs(g_between) <= _ENDED:
                return _End(between)
            if g_between < 0:
                x, g = between, g_between
            else:
                there, g_there = between, g_between
        return _End(None, unsure=True)

    def _beyond(self, r: Array | None) -> float:
        """sqrt(S - S(best)) above z, over z; infinite where there is no design."""
        if r is None:
            return math.inf
        more = float(r @ r - self.best.r @ self.best.r)
        return math.sqrt(max(more, 0.0)) / self.z - 1.0

    def _held(self, k: int, value: float, start: Array) -> tuple[Array, float]:
        """The others fitted with x_k at a value, and how far that is beyond the limit."""
        from scipy.optimize import least_squares

        x = start.copy()
        x[k] = value
        others = np.arange(len(x)) != k
        far = np.full(len(self.best.r), _FAR * self.z)

        def rows(u: Array) -> Array:
            x[others] = u
            r = self.rows(x.copy())
            return far if r is None else r

        if np.any(others):
            low, high = self.bounds[others].T
            begin = np.clip(start[others], low + 1e-9, high - 1e-9)
            x[others] = least_squares(
                rows,
                begin,
                bounds=(low, high),
                diff_step=_SLOPE,
                max_nfev=_TURNS,
                ftol=1e-6,
            ).x
        return x, self._beyond(self.rows(x))

    def _over(self, r: Array) -> float:
        """S above the limit, over z^2."""
        return (float(r @ r) - self.limit) / self.z**2

    def _moved(self, at: _Local, d: Array, longest: float) -> tuple[_Local, float]:
        """About x + d, or x again with what was learned there; and the longest next step.

        That is 0 where designs end.
        """
        there, size = self.rows(at.x + d), float(np.max(np.abs(d)))
        if there is None or self._over(there) > _LOST:
            return at, 0.3 * size if size > _SHORTEST else 0.0
        gap = there - at.at(d)
        if self._over(there) > _OVER:
            return at.corrected(d, gap), 0.5 * size
        poor = float(np.linalg.norm(gap)) > _POOR * self.z
        return at.moved(d, there), 0.5 * size if poor else min(2.0 * longest, _LONGEST)

    def _anew(self, at: _Local) -> _Local:
        """With derivatives by one-sided differences, away from the nearer bound."""
        J = at.J.copy()
        for i, (low, high) in enumerate(self.bounds):
            h = -_SLOPE if at.x[i] - low > high - at.x[i] else _SLOPE
            there = self.rows(at.x + h * np.eye(len(at.x))[i])
            if there is not None:
                J[:, i] = (there - at.r) / h - 0.5 * h * self.H[:, i, i]
        return replace(at, J=J)

    def _step(self, at: _Local, k: int, sign: float, longest: float) -> Array:
        """The step to the most x_k within the limit, of the local rows."""
        from scipy.optimize import minimize

        n = len(at.x)
        room = np.clip(self.bounds - at.x[:, None], -longest, longest)
        aim = -sign * np.eye(n)[k]

        def spare(d: Array) -> float:
            r = at.at(d)
            return float(self.limit - r @ r) / self.z**2

        def slope(d: Array) -> Array:
            return np.asarray(-2.0 / self.z**2 * (at.at(d) @ at.slope(d)))

        tried = []
        for start in (np.zeros(n), -0.5 * longest * aim):
            found = minimize(
                lambda d: float(aim @ d), np.clip(start, *room.T), jac=lambda d: aim,
                method="SLSQP", bounds=room, options={"maxiter": 60, "ftol": 1e-7},
                constraints=[{"type": "ineq", "fun": spare, "jac": slope}],
            )  # fmt: skip
            d = np.clip(found.x, *room.T)
            broken = max(0.0, -spare(d) - 1e-4)
            tried.append((broken, float(aim @ d), d))
        return np.asarray(min(tried, key=lambda row: row[:2])[2])


# What measurements say of parameters: covariance, and what they cannot tell apart.
#
# J holds the derivatives of residuals, in standard deviations, by logarithms of parameters; the
# covariance of the logarithms is (J' J)^-1. A column without size is a parameter that nothing
# measured depends on; a singular vector without size, of J with unit columns, is a change of
# several parameters that nothing measured sees.
#
# Source: Belsley, Kuh, Welsch (1980), Regression Diagnostics, ch. 3.

_SILENT = 1e-6  # column over the largest: derivatives by differences carry 1e-7
_SAME = 1e-3  # singular value of unit columns: a thousandth of what one parameter does
_UNKNOWN = 1.0  # standard deviation of the logarithm of a hidden parameter
_SHARE = 0.05  # of a singular vector: a parameter that takes part in it
_POORLY_KNOWN = 0.5  # a quarter of the width of an interval [ln]: known to a factor 2.7 either way
_TWINS = 0.98  # correlation at which two estimates are one


def unseen(J: Array) -> tuple[IntArray, Array]:
    """Silent parameters, and changes of the others that nothing measured sees.

    Returns:
        Places of silent parameters; directions of the logarithms, shape (directions, n).
    """
    size = np.linalg.norm(J, axis=0)
    silent = size <= _SILENT * np.max(size, initial=0.0)
    loud = np.flatnonzero(~silent)
    unit = J[:, loud] / size[loud]
    _, values, V = np.linalg.svd(unit, full_matrices=True)
    values = np.concatenate([values, np.zeros(len(loud) - len(values))])
    found = np.zeros((int(np.sum(values < _SAME)), J.shape[1]))
    found[:, loud] = V[values < _SAME] / size[loud]
    return np.flatnonzero(silent), found


def covariance(J: Array, hidden: BoolArray) -> Array:
    """Covariance of the logarithms, shape (n, n); infinite for what takes part in hidden changes.

    The errors of the others include what the hidden ones do to them: these may be wrong by a
    factor e either way.
    """
    guesses = np.eye(J.shape[1])[hidden] / _UNKNOWN
    whole = np.vstack([J, guesses])
    scale = np.linalg.norm(whole, axis=0)
    inverse = np.linalg.pinv(whole / scale)
    found = np.asarray(inverse @ inverse.T / np.outer(scale, scale))
    found[hidden, :] = found[:, hidden] = 0.0
    found[hidden, hidden] = np.inf
    return found


def takes_part(direction: Array) -> BoolArray:
    """Which parameters a direction changes, shape (n,)."""
    return np.asarray(np.abs(direction) > _SHARE * np.max(np.abs(direction), initial=0.0))


def hidden(J: Array) -> BoolArray:
    """Parameters that no row of J tells, a boolean per parameter, shape (n,)."""
    silent, directions = unseen(J)
    found = np.zeros(J.shape[1], bool)
    found[silent] = True
    for direction in directions:
        found |= takes_part(direction)
    return found


def sentences(J: Array, C: Array, names: Sequence[str], ends: Array | None = None) -> list[str]:
    """Sentences on parameters that the measurements do not determine."""
    silent, directions = unseen(J)
    spread = np.sqrt(np.diag(C))
    if ends is None:
        ends = np.stack([-2.0 * spread, 2.0 * spread], axis=1)
    told = np.any(np.isfinite(ends), axis=1)
    said = [f"Nothing measured depends on {names[k]}." for k in silent.tolist() if not told[k]]
    said += [_same(direction, names, bool(np.any(told[takes_part(direction)])))
             for direction in directions]  # fmt: skip
    width = ends[:, 1] - ends[:, 0]
    for k in np.flatnonzero(np.isfinite(width) & (width > 4.0 * _POORLY_KNOWN)).tolist():
        said.append(
            f"{names[k]} is hardly told: its interval spans a factor {np.exp(width[k]):.2g}"
            ". Measure something that depends on it, or give it a prior."
        )
    blind = hidden(J)
    for i in range(len(names)):
        for j in range(i):
            known = not (blind[i] or blind[j]) and spread[i] * spread[j] > 0
            if known and abs(C[i, j]) > _TWINS * spread[i] * spread[j]:
                said.append(
                    f"{names[j]} and {names[i]} are hard to tell apart: the correlation of their "
                    f"errors is {C[i, j] / (spread[i] * spread[j]):+.3f}."
                )
    return said


def _same(direction: Array, names: Sequence[str], bent: bool) -> str:
    """A change that nothing measured sees, in words."""
    places = np.flatnonzero(takes_part(direction))
    places = places[np.argsort(-np.abs(direction[places]), kind="stable")]
    change = direction / direction[places[0]]
    order: list[int] = places.tolist()
    listed = ", ".join(names[k] for k in order[:-1]) + f" and {names[order[-1]]}"
    moves = ", ".join(f"{change[k]:+.2g} % of {names[k]}" for k in order)
    if bent:
        return (
            f"{listed} are hard to tell apart: nothing measured changes with a little of {moves} "
            "together, and little with more."
        )
    return f"{listed} cannot be told apart: nothing measured changes with {moves} together."
