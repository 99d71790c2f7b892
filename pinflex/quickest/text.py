"""The report of a fastest motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinflex.text import length, number, paragraph, percent, report, table

if TYPE_CHECKING:
    from pinflex.quickest.baselines import Baseline
    from pinflex.quickest.fastest import Fastest
    from pinflex.quickest.robustness import Off

_NAMED = 3  # limits that hold a motion, the most


def text(found: Fastest, rows: Sequence[Baseline] = (), off: Sequence[Off] = ()) -> str:
    """What was found, what holds it, and what stands beside it."""
    holds = ", ".join(
        f"{name} ({percent(x)} of the time)" for name, x in [*found.holds.items()][:_NAMED]
    )
    bound = 1.0 - found.rigid / found.duration
    head = (
        f"{found.name}: the fastest move takes {found.duration:.5g} s. {_settling_words(found)} "
        f"The rigid robot's own least time is {found.rigid:.4g} s, {percent(abs(bound))} "
        f"{'less' if bound >= 0.0 else 'more'}. "
        + (f"At its limit: {holds}." if holds else "No limit is reached for long.")
    )
    return report(
        paragraph(head),
        table("Largest use of each limit", "limit|used [%]",
              [[name, number(100 * x)] for name, x in found.shares.items()], (36,)),
        _robots(found),
        _baselines(found, rows),
        *(paragraph(f"Left out: {name}: {why}") for name, why in left_out(rows).items()),
        robust_table(off),
    )  # fmt: skip


def _settling_words(found: Fastest) -> str:
    if found.box is not None and found.ends is not None:
        (far, fast), (most, top) = found.ends, found.box
        return (
            f"At its end every axis is within {number(far)} m of rest ({number(most)} asked) and "
            f"slower than {number(fast)} m/s ({number(top)} asked)."
        )
    return (
        f"From its end on the platform stays within {length(found.residual)} of where it comes to "
        f"rest ({length(found.band)} asked; runs are right to {length(found.bar, 2)})."
    )


def _robots(found: Fastest) -> str:
    if len(found.runs) < 2:
        return ""
    return paragraph("The same motion leaves these robots as still: "
                     + "; ".join([*found.runs][1:]) + ".")  # fmt: skip


def _baselines(found: Fastest, rows: Sequence[Baseline]) -> str:
    if not rows:
        return ""
    mine = ["fastest", f"{found.duration:.4f}", f"{found.settled:.4f}", "-", length(found.residual),
            number(100 * found.shares_of_torque)]  # fmt: skip
    still = found.settled if 0.0 < found.settled < np.inf else found.duration
    cells = [mine] + [
        [row.name, f"{row.ends:.4f}", f"{row.settled:.4f}" if np.isfinite(row.settled) else "later",
         percent(row.settled / still - 1.0, 3, "+") if np.isfinite(row.settled) else "-",
         length(row.residual), number(100 * row.push)]
        for row in rows
    ]  # fmt: skip
    heads = "motion|ends [s]|still from [s]|longer|shakes after its end|torque [%]"
    return table("Beside it, under the same limits and for the same robots", heads, cells, (22,))


def left_out(rows: Sequence[Baseline]) -> dict[str, str]:
    """Usual motions that could not be made, by name why."""
    return dict(getattr(rows, "left_out", {}))


def robust_table(off: Sequence[Off]) -> str:
    """How far the platform is off, and what it shakes, where the robot is another one."""
    cells = [[one.what, length(one.error), length(one.shake)] for one in off]
    heads = "the robot differs by|platform off|peak to peak after the end"
    return table("How robust is it?", heads, cells, (30,))
