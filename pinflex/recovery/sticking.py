"""Stick and slip: what the Stribeck speed of a joint's friction leaves of it.

A joint breaks away where the load meets the top of its friction, and is late there by a time that
goes with the cube root of (stribeck^2 / rate of the load): its swings and periods are off by

    0.6 (stribeck / fastest slip)^(2/3)

0.6 by masses on belts (tests/verification/test_stick_slip.py), over sixteen of which it is 0.5 to
2.6 times the true error.
"""

from __future__ import annotations

import numpy as np

from pinflex.integrators.run import Run
from pinflex.mechanics.mechanism import Mechanism
from pinflex.text import percent

_SHARE = 0.6
_TELL = 0.01  # errors below are not worth a sentence
_ASK = 0.003  # error of the Stribeck speed that is proposed


def sticking(mechanism: Mechanism, run: Run) -> list[str]:
    """Sentences on joints that stick and slip, where friction changes too slowly with speed."""
    system, rubs = run.system, run.system.friction
    pushed = run.settings.get("drive") == "torque"
    if not np.any(rubs.excess) or (
        not pushed and mechanism.report.mobility <= len(system.motors)
    ):  # a joint whose speed the motors determine does not choose to stick
        return []
    moving, texts = (system.unheld if pushed else system.free), []
    for row, excess, stribeck in zip(rubs.rows, rubs.excess, rubs.stribeck, strict=True):
        speed = np.abs(run.v[:, row])
        fastest = float(np.max(speed, initial=0.0))
        if not excess or row not in moving or fastest <= stribeck:
            continue
        slow = speed < stribeck
        leaves = slow[:-2] & slow[1:-1] & ~slow[2:]
        error = _SHARE * (stribeck / fastest) ** (2 / 3)
        if not np.any(leaves) or error < _TELL:
            continue
        ask = float(f"{fastest * (_ASK / _SHARE) ** 1.5:.1g}")
        texts.append(
            f"{mechanism.coordinates[row]}: it sticks and slips, at {fastest:.2g} at the most, and "
            f"its friction falls from breakaway to sliding over stribeck = {stribeck:g}: swings "
            f"and periods are off by about {percent(error)} for it. Unless that speed was "
            f"measured, write friction: {{stribeck: {ask:g}, speed: {ask:g}, ...}} there "
            "(smaller ones cost steps)."
        )
    return texts
