"""The nominal motion: closed-loop inverse kinematics of the rigid mechanism along a path.

Position by Newton on the closures (and the imposed platform coordinates), velocity and acceleration
from the same Jacobian, so they are exact. The branch is kept: every instant starts from the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinflex.actuation.motors import joint_path, motor_axes
from pinflex.arrays import Array, IntArray
from pinflex.description.motion import Motion
from pinflex.errors import DescriptionError, MotionError, SceneError
from pinflex.mechanics import assembly
from pinflex.mechanics.dynamics import Dynamics
from pinflex.mechanics.mechanism import Mechanism


@dataclass(frozen=True)
class Nominal:
    """Rigid motion at given times: t (nt,), q (nt, nq), v and a (nt, nv)."""

    t: Array
    q: Array
    v: Array
    a: Array

    def at(self, k: slice) -> Nominal:
        """Some of the instants."""
        return Nominal(self.t[k], self.q[k], self.v[k], self.a[k])


def nominal(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal:
    """Follow a motion with the rigid mechanism.

    Args:
        mechanism: Mechanism with its home pose.
        motion: Motion of joints or of the platform.
        t: Increasing times, shape (nt,).
    Returns:
        Rigid positions, velocities, accelerations.
    Raises:
        MotionError: A pose that cannot be reached, with the time and the reason.
        SingularityError: The path meets a singular pose, with loop, motion and sigma_min.
    """
    t = np.asarray(t, float)
    system = mechanism.rigid
    if motion.target == "joints" and system.closed.n == 0:
        return _open_tree(mechanism, motion, t)
    path = _Path(mechanism, motion)
    n = len(t)
    q = np.empty((n, system.nq))
    v, a = np.empty((n, system.nv)), np.empty((n, system.nv))
    imposed = path.imposed(t)
    pose = path.start(imposed)
    for k in range(n):
        if k:
            dt = t[k] - t[k - 1]
            guess = path.dynamics.integrate(pose, dt * v[k - 1] + 0.5 * dt * dt * a[k - 1])
            try:
                pose = path.solve(guess, imposed[0][k], t[k])
            except SceneError:
                path.locate(pose, t[k - 1], t[k])
                raise
        v[k], a[k] = path.rates(pose, imposed[1][k], imposed[2][k], t[k])
        path.dynamics.closed.require_on_beams(mechanism.name, float(t[k]))
        q[k] = pose
    return Nominal(t, q, v, a)


def _open_tree(mechanism: Mechanism, motion: Motion, t: Array) -> Nominal:
    """No loops: every joint follows its own law, nothing to solve."""
    system, axes = mechanism.rigid, motor_axes(mechanism)
    passive = system.free
    if len(passive):
        raise _underactuated(mechanism, [mechanism.coordinates[k] for k in passive])
    position, velocity, acceleration = joint_path(mechanism, motion, t)
    q = np.tile(mechanism.home, (len(t), 1))
    axes.write(q, position)
    v, a = np.zeros((len(t), system.nv)), np.zeros((len(t), system.nv))
    v[:, axes.v_at], a[:, axes.v_at] = velocity, acceleration
    return Nominal(np.asarray(t, float), q, v, a)


def _underactuated(mechanism: Mechanism, passive: Sequence[str]) -> MotionError:
    return MotionError(
        f"{mechanism.name}: the motors do not determine the motion of {', '.join(passive)}. "
        "Actuate these joints or close loops over them; level=coupled lets them swing."
    )


class _Path:
    """One run's solver: unknown velocity rows, imposed rows, and the sign of the determinant."""

    def __init__(self, mechanism: Mechanism, motion: Motion) -> None:
        self.mechanism, self.motion = mechanism, motion
        self.dynamics = Dynamics(mechanism.rigid)
        self.axes = motor_axes(mechanism)
        self.names = mechanism.coordinates
        system = mechanism.rigid
        self.passive = system.free
        self.platform = motion.target == "platform"
        self.sign = 0.0
        self.rows = system.closed.n
        if self.platform:
            self._locate_platform()
            self.unknown: IntArray = np.arange(system.nv, dtype=np.intp)
        else:
            self.unknown = self.passive
        equations = self.rows + (len(self.columns) if self.platform else 0)
        if equations != len(self.unknown):
            raise self._wrong_count(equations)

    def _wrong_count(self, equations: int) -> SceneError:
        where, mobility = self.mechanism.name, self.mechanism.report.mobility
        if not self.platform:
            if equations < len(self.unknown):
                J = self.dynamics.close(self.mechanism.home)[1][:, self.passive]
                _, motion = assembly.null_motion(
                    J, self.dynamics.system.closed, self._passive_names
                )
                return _underactuated(self.mechanism, [motion])
            return MotionError(
                f"{where}: {len(self.axes.v_at)} motors drive a mechanism of mobility {mobility}: "
                "their motions fight each other. Take motors out of `actuated`, or move the "
                "platform (motion: platform), which gives consistent motor motions."
            )
        return MotionError(
            f"{where}: motion.platform imposes {len(self.columns)} coordinates "
            f"({', '.join(self.motion.names)}), the mechanism has mobility {mobility}. "
            f"Name exactly {mobility} of x, y, z, rz, ry, rx that it can follow."
        )

    @property
    def _passive_names(self) -> list[str]:
        return [self.names[k] for k in self.passive]

    # The platform --------------------------------------------------------------------------

    def _locate_platform(self) -> None:
        name = self.mechanism.description.platform
        if name is None:
            raise DescriptionError(
                f"{self.mechanism.name}: motion.platform needs `platform: FRAME` in the YAML."
            )
        self.frame = self.dynamics.model.getFrameId(name, pin.FrameType.BODY)
        self.columns = [("x", "y", "z", "rz", "ry", "rx").index(name) for name in self.motion.names]

    def _pose(self, q: Array) -> Array:
        """Platform coordinates x, y, z, rz, ry, rx of the frame, from current kinematics."""
        pin.updateFramePlacement(self.dynamics.model, self.dynamics.data, self.frame)
        placement = self.dynamics.data.oMf[self.frame]
        R = placement.rotation
        rz = np.arctan2(R[1, 0], R[0, 0])
        ry = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
        rx = np.arctan2(R[2, 1], R[2, 2])
        return np.concatenate([placement.translation, [rz, ry, rx]])

    def _euler_rates(self, pose: Array) -> Array:
        """B in omega = B (rz, ry, rx)', columns the current axes of the three turns."""
        cz, sz = np.cos(pose[3]), np.sin(pose[3])
        cy, sy = np.cos(pose[4]), np.sin(pose[4])
        return np.array([[0.0, -sz, cz * cy], [0.0, cz, sz * cy], [1.0, 0.0, -sy]])

    def _platform_jacobian(self, q: Array, pose: Array) -> Array:
        J: Array = pin.getFrameJacobian(
            self.dynamics.model,
            self.dynamics.data,
            self.frame,
            pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
        )
        full = np.vstack([J[:3], np.linalg.solve(self._euler_rates(pose), J[3:])])
        return full[self.columns]

    # One instant ---------------------------------------------------------------------------

    def imposed(self, t: Array) -> tuple[Array, Array, Array]:
        """Imposed coordinates over time: motor positions or platform coordinates."""
        if not self.platform:
            return joint_path(self.mechanism, self.motion, t)
        p, v, a = self.motion.evaluate(t)
        if not self.motion.absolute:
            self.dynamics.close(self.mechanism.home)
            p = p + self._pose(self.mechanism.home)[self.columns]
        return p, v, a

    def start(self, imposed: tuple[Array, Array, Array]) -> Array:
        """First pose of the path: reached from home in small moves, so the branch is kept."""
        home = self.mechanism.home
        if not self.platform:
            begin = self.axes.read(home)
        else:
            self.dynamics.close(home)
            begin = self._pose(home)[self.columns]
        end, pose = imposed[0][0], home
        for part in (1.0,) if np.allclose(begin, end, atol=1e-9) else np.linspace(0.05, 1.0, 20):
            pose = self.solve(pose, begin + part * (end - begin), 0.0)
        return pose

    def _equations(self, pose: Array, target: Array) -> tuple[Array, Array]:
        c, J = self.dynamics.close(pose)
        if not self.platform:
            return c.copy(), J[:, self.unknown]
        place = self._pose(pose)
        error = place[self.columns] - target
        turns = np.array(self.columns) >= 3
        error[turns] = (error[turns] + np.pi) % (2 * np.pi) - np.pi
        return np.concatenate([c, error]), np.vstack([J, self._platform_jacobian(pose, place)])

    def solve(self, guess: Array, target: Array, time: float) -> Array:
        """Closed pose with the imposed coordinates; Newton with step halving.

        Raises:
            MotionError: It cannot be reached from the guess.
        """
        pose = guess.copy()
        if not self.platform:
            self.axes.write(pose, target)
        error, J = self._equations(pose, target)
        size = float(np.max(np.abs(error), initial=0.0))
        for _ in range(40):
            if size < assembly.CLOSED:
                break
            step = -np.linalg.lstsq(J, error, rcond=1e-12)[0] if _bad(J) else _solve(J, -error)
            step *= min(1.0, 0.5 / max(float(np.max(np.abs(step))), 1e-300))
            for _ in range(8):
                dy = np.zeros(self.dynamics.system.nv)
                dy[self.unknown] = step
                trial = self.dynamics.integrate(pose, dy)
                error_trial, J_trial = self._equations(trial, target)
                size_trial = float(np.max(np.abs(error_trial)))
                if size_trial < size or size_trial < assembly.CLOSED:
                    break
                step *= 0.5
            else:
                break
            pose, error, J, size = trial, error_trial, J_trial, size_trial
        if size < assembly.CLOSED * 100:
            return pose
        raise MotionError(
            f"{self.mechanism.name}: t = {time:.6g} s: the mechanism cannot reach this pose "
            f"(closest approach {size:.2g} m or rad). Keep the path inside the workspace, or start "
            "from another branch.",
            time=time,
        )

    def rates(self, pose: Array, v_in: Array, a_in: Array, time: float) -> tuple[Array, Array]:
        """Exact velocity and acceleration at a closed pose; raises where they are not unique."""
        dynamics, nv = self.dynamics, self.dynamics.system.nv
        v, a = np.zeros(nv), np.zeros(nv)
        _, J = dynamics.close(pose)
        if self.platform:
            place = self._pose(pose)
            J = np.vstack([J, self._platform_jacobian(pose, place)])
            self._check(J, "path", time)
            zero = np.zeros(self.rows)
            v = _solve(J, np.concatenate([zero, v_in]))
            gamma = dynamics.closure_bias(pose, v)
            bias = self._platform_bias(pose, v, place)
            a = _solve(J, np.concatenate([-gamma, a_in - bias]))
            return v, a
        motors, passive = self.axes.v_at, self.passive
        if not len(passive):
            v[motors], a[motors] = v_in, a_in
            return v, a
        self._check(J[:, passive], "motors", time)
        v[motors], a[motors] = v_in, a_in
        v[passive] = _solve(J[:, passive], -J[:, motors] @ v_in)
        gamma = dynamics.closure_bias(pose, v)
        a[passive] = _solve(J[:, passive], -J[:, motors] @ a_in - gamma)
        return v, a

    def _platform_bias(self, pose: Array, v: Array, place: Array) -> Array:
        """Imposed accelerations that velocity alone makes, shape (columns,)."""
        model, data = self.dynamics.model, self.dynamics.data
        pin.forwardKinematics(model, data, pose, v, np.zeros_like(v))
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        bias = pin.getFrameClassicalAcceleration(model, data, self.frame, aligned).vector
        omega = pin.getFrameVelocity(model, data, self.frame, aligned).angular
        B = self._euler_rates(place)
        rates = np.linalg.solve(B, omega)
        y_axis, x_axis = B[:, 1], B[:, 2]
        z_axis = np.array([0.0, 0.0, 1.0])
        turned = rates[0] * np.cross(z_axis, y_axis) * rates[1]
        turned += np.cross(rates[0] * z_axis + rates[1] * y_axis, x_axis) * rates[2]
        angular = np.linalg.solve(B, bias[3:] - turned)
        return np.concatenate([bias[:3], angular])[self.columns]

    def _check(self, J: Array, which: str, time: float) -> None:
        """Singular here, or passed a singular pose since the last instant (determinant's sign)."""
        sign = float(np.linalg.slogdet(J)[0])
        ratio = assembly.singular_ratio(J)
        if ratio < assembly.SINGULAR or (self.sign and sign != self.sign):
            raise self._singular(J, which, time)
        self.sign = sign

    def _singular(self, J: Array, which: str, time: float) -> SceneError:
        columns = [self.names[k] for k in self.unknown]
        where = f"{self.mechanism.name}: t = {time:.6g} s"
        if which == "motors":
            return assembly.singularity(J, self.dynamics.system.closed, columns, where, time)
        error = assembly.singularity(J, self.dynamics.system.closed, columns, where, time)
        text = str(error).replace(
            "the passive loop Jacobian", "the Jacobian of loops and imposed platform coordinates"
        )
        text = text.replace("with all motors locked", "with the platform coordinates held")
        return type(error)(text, **error.data)

    def locate(self, pose: Array, good: float, bad: float) -> None:
        """Bisect to the last reachable time and name the singular pose there, if it is one."""
        for _ in range(24):
            middle = 0.5 * (good + bad)
            p, v, a = (x[0] for x in self.imposed(np.array([middle])))
            try:
                pose = self.solve(pose, p, middle)
                self.rates(pose, v, a, middle)
                good = middle
            except SceneError:
                bad = middle
        _, J = self.dynamics.close(pose)
        if self.platform:
            J = np.vstack([J, self._platform_jacobian(pose, self._pose(pose))])
            which = "path"
        else:
            J, which = J[:, self.passive], "motors"
        # At a fold the smallest singular value falls with the square root of the time left, so
        # after 24 halvings of one sample it is far below this.
        if assembly.singular_ratio(J) < 1e-2:
            raise self._singular(J, which, good)


def _bad(J: Array) -> bool:
    return bool(J.shape[0] != J.shape[1])


def _solve(A: Array, b: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(A, b))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(A, b, rcond=1e-12)[0])
