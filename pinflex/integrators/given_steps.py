"""A run in steps that are given: those of another run, so that the two can be subtracted.

Steps that a run chooses for itself change with every number of its scene, and their errors with
them: a difference of two such runs is mostly that. In the same steps, each solved to round-off, the
states are a smooth function of the scene's numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import ConvergenceError
from pinflex.integrators.compiled_march import CompiledMarch
from pinflex.integrators.march import Keeper
from pinflex.integrators.radau import FIRM, SHARP, Stages
from pinflex.integrators.record import Record, spans_of
from pinflex.integrators.run import Run
from pinflex.integrators.steps import StepFailed, Steps

_SAME = 1e-9  # of the run: times nearer than this are one, as in pinflex.integrators.march
_TOGETHER = 8  # steps that are recorded at once
_HALVINGS = 3  # of a step that Newton does not solve, one after the other


class Ends(Record):
    """States at the samples, and where each step ended.

    Attributes:
        ends: Times [s] at which steps ended.
    """

    def __init__(self, stages: Steps, t: Array, resolution: float) -> None:
        """As a record.

        Args:
            stages: The method. t: Samples [s], shape (nt,). resolution: Of the steps.
        """
        super().__init__(stages, t, resolution)
        self.ends: list[float] = []

    def take(self, steps: Sequence[Any], found: Any = None) -> int:
        """Record steps, their ends too."""
        t, h = spans_of(steps)
        self.ends += (t + h).tolist()
        return super().take(steps, found)


@np.errstate(over="ignore", invalid="ignore")
def along(
    name: str,
    stages: Stages,
    start: tuple[Array, Array],
    t: Array,
    breaks: Sequence[float],
    ends: Array,
    keeper: Keeper,
) -> Run:
    """March from t[0] to the last of the given ends and answer at the times t.

    Args:
        name: Of the mechanism, for errors.
        stages: The method, on a mechanism and its motion.
        start: y (nq,) and v (nv,) on the closures.
        t: Samples [s], increasing, up to the last end.
        breaks: Times [s] at which motion or loads are not smooth: each is one of the ends.
        ends: Of the steps [s], increasing.
        keeper: Takes the steps.

    Raises:
        ConvergenceError: A step cannot be solved, or goes over a break.
    """
    span = _SAME * float(ends[-1] - t[0])
    corners = _corners(name, float(t[0]), breaks, ends, span)
    if stages.compiled is not None:
        return _on_kernel(name, stages, start, t, breaks, ends, keeper)
    now, last = stages.first(float(t[0]), *start), None
    keeper.start(now)
    pending: list[Any] = []
    for k, end in enumerate(ends.tolist()):
        found = _steps(name, stages, now, end, last)
        pending += found
        now, last = stages.end(found[-1]), found[-1]
        now.t = end
        if k in corners:
            now, last = stages.first(end, now.y, now.v), None
        if len(pending) >= _TOGETHER or k == len(ends) - 1:
            keeper.take(pending)
            pending = []
            stages.dynamics.require_on_beams(now.y, name, end)
    cost = {"steps": float(len(ends)), **stages.counts}
    dt = float(ends[-1] - t[0]) / len(ends)
    return keeper.run(cost, {**stages.settings, "dt": dt, "steps": "given"}, "")


def _on_kernel(
    name: str,
    stages: Stages,
    start: tuple[Array, Array],
    t: Array,
    breaks: Sequence[float],
    ends: Array,
    keeper: Keeper,
) -> Run:
    stages.closeness, stages.slack = SHARP, FIRM.part / SHARP.part
    span, given = float(ends[-1] - t[0]), tuple(ends.tolist())
    march = CompiledMarch(
        name, stages, start, np.array([t[0], ends[-1]]), breaks, span, False, True, (), given
    )
    keeper.start(march.now)
    while not march.done:
        march.advance()
        keeper.take(march.steps)
        march.settle(len(march.steps), 0.0)
    cost = {key: float(x) for key, x in march.cost().items()}
    settings = {**stages.settings, "dt": span / len(ends), "steps": "given"}
    return keeper.run({**cost, "steps": float(len(ends))}, settings, "")


def _corners(
    name: str, begin: float, breaks: Sequence[float], ends: Array, span: float
) -> set[int]:
    """Places of the ends at which something is not smooth."""
    inside = [x for x in breaks if begin + span < x < ends[-1] - span]
    found = {int(np.argmin(np.abs(ends - x))) for x in inside}
    for x in inside:
        if np.min(np.abs(ends - x)) > span:
            raise ConvergenceError(
                f"{name}: t = {x:.6g} s: the motion or a load switches within a given step."
            )
    return found


def _steps(
    name: str, stages: Stages, now: Any, end: float, last: Any, halvings: int = _HALVINGS
) -> list[Any]:
    """The step up to an end, as far as arithmetic goes, or firmly; or the steps of its halves.

    A half that another design does not need differs by no more than what the step leaves.
    """
    h = end - now.t
    for stages.closeness, before in ((SHARP, last), (FIRM, last), (FIRM, None)):
        try:
            return [stages.step(now, h, before)]
        except (StepFailed, np.linalg.LinAlgError):
            stages.expire()
    if not halvings:
        raise ConvergenceError(
            f"{name}: t = {now.t:.6g} s: a given step of {h:.3g} s cannot be solved.", time=now.t
        )
    first = _steps(name, stages, now, now.t + 0.5 * h, last, halvings - 1)
    middle = stages.end(first[-1])
    return first + _steps(name, stages, middle, end, first[-1], halvings - 1)
