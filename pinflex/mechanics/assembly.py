"""Newton on the loops, their independent rows, singular poses by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from pinflex import linalg
from pinflex.arrays import Array, IntArray, others
from pinflex.errors import SingularityError
from pinflex.mechanics.closure import Closures, size_of
from pinflex.mechanics.manifold import translations
from pinflex.mechanics.model.loads import DIRECTION
from pinflex.text import frozen

if TYPE_CHECKING:
    from pinflex.mechanics.evaluation.equations import Equations

# Closure residual (m, or sine of an angle) below which a pose is closed: round-off of a metre-size
# mechanism is 1e-16, and Newton squares the error, so the last step ends far below this.
CLOSED = 1e-12
_DIGITS = 1e-8  # [m | rad] below, a gap is what eight decimals of a file leave: not worth a word
# Ratio of singular values below which rows or motions count as dependent: genuine dependence gives
# 1e-16 (exact zero rows) to 1e-10 (rows that cancel), a usable mechanism stays above 1e-4.
RANK = 1e-8
_ITERATIONS = 60  # of Newton on the closures; a step is 1 rad or m at most
# Ratio at which a pose counts as singular for the motors.
SINGULAR = 1e-6


@frozen
class LoopReport:
    """What closing the loops showed.

    Attributes:
        rows: All closure rows. rank: Independent ones. redundant: Names of the rest.
        mobility: Degrees of freedom of the closed rigid mechanism.
        sigma_min: Smallest singular value over the largest of the passive closure Jacobian
            (motors locked), without units (`Units`): zero where the motors lose command (nan
            without loops).
        starts: Poses tried to close the loops; 0 where Newton closed them from the home guess.
        gaps: How far loops are open that are built in so (`pinflex.mechanics.closing`), by name:
            m and rad.
        coupled: Joints that follow others: one row each, not among `rows` and `rank`.
    """

    rows: int
    rank: int
    redundant: tuple[str, ...]
    mobility: int
    sigma_min: float
    starts: int = 0
    coupled: int = 0
    gaps: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def built_in(self) -> str:
        """A sentence on the loops that are open at home by more than digits of a file, or ""."""
        open_by = [
            f"{name} ({' and '.join(f'{x:.3g} {unit}' for x, unit in parts if x > _DIGITS)})"
            for name, parts in (
                (n, zip(gap, ("m", "rad"), strict=True))
                for n, gap in self.gaps.items()
                if max(gap) > _DIGITS
            )
        ]
        if not open_by:
            return ""
        return (
            f"open at home, in directions that no joint moves: {', '.join(open_by)}. Built in as "
            "it is: it bears no force of its own."
        )


@frozen
class Units:
    """What makes a closure Jacobian one of pure numbers: metres over the mechanism's size.

    Attributes:
        length: Size of the mechanism [m], the largest distance of two joints at home.
        rows: Factor of each row, shape (rows,): 1 / length for what is open in m.
        columns: Factor of each velocity row, shape (nv,): length for a joint that slides.
    """

    length: float
    rows: Array
    columns: Array

    def of(self, J: Array) -> Array:
        """J (..., rows, nv) without units."""
        scaled: Array = J * (self.rows[:, None] * self.columns)
        return scaled


def units(dynamics: Equations, home: Array) -> Units:
    """Units of the closure Jacobian of a rigid mechanism."""
    closed, length = dynamics.system.closed, size_of(dynamics, home)
    rows = np.full(closed.n, 1.0 / length)
    rows[closed.sorts == DIRECTION] = 1.0
    for one in closed.contacts:
        turns = [sort in ("tilt", "twist") for sort, _ in one.sleeve.sorts]
        rows[one.rows[turns]] = 1.0
    columns = np.where(translations(dynamics.system.rigid) > 0, length, 1.0)
    for row, J in zip(closed.coupled.rows, closed.coupled.J, strict=True):
        rows[row] = 1.0 / columns[int(np.argmax(J == 1.0))]
    return Units(length, rows, columns)


def close_loops(dynamics: Equations, y: Array, moving: IntArray) -> tuple[Array, float]:
    """Newton with step halving on c(y) = 0 over some velocity rows: pose, largest |c| there."""
    c, J = dynamics.close(y)
    size = float(np.max(np.abs(c), initial=0.0))
    for _ in range(_ITERATIONS):
        if size < CLOSED * 1e-2:
            break
        step = -np.linalg.lstsq(J[:, moving], c, rcond=1e-10)[0]
        # A joint never needs more than half a turn; longer steps come from nearly singular rows.
        longest = float(np.max(np.abs(step), initial=0.0))
        step = step * min(1.0, 1.0 / max(longest, 1e-300))
        accepted = False
        for _ in range(12):
            dy = np.zeros(J.shape[1])
            dy[moving] = step
            trial = dynamics.integrate(y, dy)
            c_trial, J_trial = dynamics.close(trial)
            size_trial = float(np.max(np.abs(c_trial), initial=0.0))
            if size_trial < size * (1 - 1e-4) or size_trial < CLOSED * 1e-2:
                accepted = True
                break
            step = 0.5 * step
        if not accepted:
            break
        y, J, c, size = trial, J_trial, c_trial, size_trial
    return y, size


def independent_rows(
    J: Array, labels: Sequence[str], small: float = RANK
) -> tuple[IntArray, tuple[str, ...]]:
    """Rows that carry the rank of a closure Jacobian, rising, and the labels of the others."""
    kept = np.sort(linalg.independent_rows(J, small))
    dropped = sorted(set(range(len(J))) - set(kept.tolist()))
    return kept, tuple(labels[k] for k in dropped)


def rank_beside(dynamics: Equations, full: Equations, home: Array, small: float = RANK) -> int:
    """Largest rank of all closure rows at poses beside a closed one."""
    J, rank = dynamics.close(home).J, 0
    Vt = np.linalg.svd(J)[2] if len(J) else np.eye(dynamics.n_rigid)
    for motion in Vt[len(J) :]:
        # Far enough to lift a dependent row over round-off, near enough to keep the branch.
        beside = dynamics.integrate(home, 1e-3 * motion)
        beside, size = close_loops(dynamics, beside, np.arange(dynamics.n_rigid))
        if size < 1e-9:
            rows, _ = independent_rows(full.close(beside).J, full.system.closed.labels, small)
            rank = max(rank, len(rows))
    return rank


def singular_ratio(J: Array) -> float:
    """Smallest over largest singular value (0 when there are more columns than rows)."""
    if J.shape[1] == 0:
        return float("nan")
    if J.shape[0] < J.shape[1]:
        return 0.0
    sigma = np.linalg.svd(J, compute_uv=False)
    return float(sigma[-1] / sigma[0]) if sigma[0] > 0 else 0.0


def null_motion(J: Array, rows: Closures, columns: Sequence[str]) -> tuple[str, str]:
    """Names of the loop and of the coordinates in the weakest motion of a closure Jacobian."""
    U, _, Vt = np.linalg.svd(J, full_matrices=True)
    weak = np.abs(Vt[-1])
    largest = [columns[k] for k in np.argsort(-weak)[:3] if weak[k] > 0.2 * weak.max()]
    loop = "-"
    if len(rows.loop_of):
        # The loop whose rows the near-null motion touches with the joints it moves.
        share, n = np.zeros(len(rows.names)), len(rows.loop_of)
        np.add.at(share, rows.loop_of, (np.abs(J) @ weak + np.abs(U[:, -1]))[:n])
        loop = rows.names[int(np.argmax(share))]
    return loop, ", ".join(largest)


def require_regular(
    dynamics: Equations, y: Array, motors: IntArray, names: Sequence[str], where: str
) -> float:
    """Singular-value ratio of the passive closure Jacobian; raises where motors lose command."""
    if not dynamics.looped:
        return float("nan")
    scale = units(dynamics, y)
    J = scale.of(dynamics.close(y).J)
    passive = others(dynamics.n_rigid, motors)
    if len(passive) > len(J):
        return 0.0
    ratio = singular_ratio(J[:, passive])
    if ratio < SINGULAR:
        raise singularity(J[:, passive], dynamics.system.closed, [names[k] for k in passive], where)
    return ratio


def singularity(
    J: Array,
    rows: Closures,
    columns: Sequence[str],
    where: str,
    time: float | None = None,
    what: tuple[str, str] = ("passive loop Jacobian", "all motors locked"),
) -> SingularityError:
    """The error that names a singular pose: which loop, which motion, sigma_min.

    `time` [s] of a motion; None: the pose is home.
    """
    loop, motion = null_motion(J, rows, columns)
    sigma = np.linalg.svd(J, compute_uv=False)
    ratio = singular_ratio(J)
    rank = int(np.sum(sigma > SINGULAR * sigma[0]))
    lost = rank < J.shape[1]
    kind = "singular pose" if lost else "nearly singular pose"
    advice = "Choose a path that avoids this pose, or start from another branch."
    if time is None:
        advice = "Give a `home` away from this pose."
    measure = f"has rank {rank} of {J.shape[1]} (" if lost else "is losing rank ("
    return SingularityError(
        f"{where}: {kind}: the {what[0]} {measure}sigma_min = {ratio:.2g}, where 1 is best); "
        f'with {what[1]} loop "{loop}" can still move{"" if lost else " almost freely"}: '
        f"{motion}. {advice}",
        loop=loop,
        motion=motion,
        sigma_min=ratio,
        time=time,
    )
