"""Steps end where motion and loads are not smooth.

Claims:
    Documentation, other systems
    - breaks that differ by round-off are one: no step between them | the same load in one | 2 tol |
      passes
"""

from __future__ import annotations

import numpy as np

import pinflex as pf

LATER = 0.1 + 0.2  # 0.30000000000000004: one unit of round-off after 0.3


def deflection(**starts: float) -> np.ndarray:
    """Height of the tip under loads of 0.2 N in all that begin at these times, shape (41,)."""
    size = 0.2 / len(starts)
    load = f"at: tip, force: [0, 0, {size}], start: "
    loads = [f"{name}: {{{load}{start}}}" for name, start in starts.items()]
    robot = pf.load("cantilever", [f"forces={{{', '.join(loads)}}}"])
    run = pf.solve(robot, tol=1e-2, until=0.4, samples=41)
    assert run.t[-1] == 0.4
    return run.frame("tip").position[:, 2]


def test_two_breaks_that_differ_by_round_off_are_one() -> None:
    one, two = deflection(a=0.3), deflection(a=0.3, b=LATER)
    # each is within tol of its largest value
    assert np.abs(one - two).max() < 2e-2 * np.abs(one).max()
