"""Starts from a state that is given: that of a run at some time, or coordinates and velocities.

Motors move as their motion says. Where the state has another speed of theirs, the start is a blow:
it leaves the momenta of all other coordinates as they are, but for what the closures carry,

    M_fm (v_m - v_m') + M_ff dv_f = J_f' p,     J (v + dv) = 0
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from pinflex.actuation.drive import MotorPath
from pinflex.actuation.motors import motor_axes
from pinflex.arrays import Array
from pinflex.description.schema import shown
from pinflex.errors import DescriptionError
from pinflex.levels.moving_modes import state_of_run
from pinflex.levels.speeds import corrected, misses
from pinflex.levels.start import Start
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.result import Result

_SAME = 1e-6  # [rad | m] what a state may miss of the motion that goes on with it
_ABOUT = "the state (y, v)"


def start_from(
    mechanism: Mechanism, dynamics: Equations, path: MotorPath, given: object, driven: bool = False
) -> Start:
    """The start from a given state; loads and motion may be others than those it comes from.

    Raises:
        DescriptionError: No such state, or one whose motors stand elsewhere, whose loops are open
            or whose velocities would open them.
    """
    where = f"{mechanism.name}: solve.start"
    y, v, about = _state(mechanism, given, where)
    stands = y.copy()
    if not driven:
        motor_axes(mechanism).write(stands, path.position[0])
    off = float(np.max(np.abs(stands - y), initial=0.0))
    gap = float(np.max(np.abs(dynamics.close(y)[0]), initial=0.0)) if dynamics.looped else 0
    if off > _SAME or gap > _SAME:
        what = (
            f"its motors stand {off:.3g} (rad or m) away" if off > _SAME else "its loops are open"
        )
        raise DescriptionError(
            f"{where}: {about} is no start of this motion: {what}. Give a motion (absolute) "
            "that begins there, or the mechanism that was solved."
        )
    if not driven:
        v = _struck(dynamics, y, v, path.velocity[0])
    if about == _ABOUT:
        _require_closed(dynamics, y, v, where)
        return Start(y, v, "state")
    return Start(y, v, "run")


def _state(mechanism: Mechanism, given: Any, where: str) -> tuple[Array, Array, str]:
    """y, v and their name in words; copies."""
    pair = given if isinstance(given, tuple) and len(given) == 2 else (given, np.inf)
    if isinstance(pair[0], Result):
        time = min(float(pair[1]), float(pair[0].t[-1]))
        state = state_of_run(mechanism, pair[0], time)
        return state.y.copy(), state.v.copy(), state.about
    system = mechanism.flexible
    try:
        y, v = (np.array(part, dtype=float) for part in pair)
    except (TypeError, ValueError):
        y = v = np.zeros(())
    if not y.ndim:
        raise DescriptionError(
            f"{where}: {shown(given)} is not valid. Allowed: auto, static, straight, a result of "
            "level coupled, (result, time in s), or (y, v), coordinates and velocities."
        )
    if y.shape != (system.nq,) or v.shape != (system.nv,):
        raise DescriptionError(
            f"{where}: y and v have shapes {y.shape} and {v.shape}. Allowed: ({system.nq},) and "
            f"({system.nv},), as y and the columns of shapes in pf.modes(robot)."
        )
    if not (np.all(np.isfinite(y)) and np.all(np.isfinite(v))):
        raise DescriptionError(f"{where}: {_ABOUT} has entries that are no finite numbers.")
    n = int(system.rigid.nq)
    y[:n] = pin.normalize(system.rigid, y[:n])  # cos and sin, quaternions
    return y, v, _ABOUT


def _struck(dynamics: Equations, y: Array, v: Array, speed: Array) -> Array:
    """v with the motors at their speed (rad/s | m/s), and what a jump of it makes of the rest."""
    system = dynamics.system
    v, free = v.copy(), system.free
    jump = speed - v[system.motors]
    v[system.motors] = speed
    if not np.any(np.abs(jump) > _SAME * np.max(np.abs(speed), initial=0.0)):
        return v
    M = dynamics.mass(y)
    pull = M[np.ix_(free, system.motors)] @ jump
    # Coordinates without mass have no momentum to keep: they stay as they move.
    v[free] -= np.linalg.lstsq(M[np.ix_(free, free)], pull, rcond=1e-12)[0]
    if not dynamics.looped:
        return v
    J = dynamics.close(y)[1]
    return corrected(dynamics, y, v, J, np.zeros(len(J)), free)


def _require_closed(dynamics: Equations, y: Array, v: Array, where: str) -> None:
    """Raise where velocities would open the loops."""
    if not dynamics.looped:
        return
    J = dynamics.close(y)[1]
    if misses(J, np.zeros(len(J)), v, _SAME):
        raise DescriptionError(
            f"{where}: the velocities of {_ABOUT} open the loops by "
            f"{np.max(np.abs(J @ v)):.3g} (m/s or rad/s). Take v = 0 with start_speeds, which "
            "moves all joints of a loop, or velocities that fit."
        )
