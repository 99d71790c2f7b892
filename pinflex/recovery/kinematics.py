"""Kinematics of the expanded model at the samples of a run: poses, rates, energies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, cast

import numpy as np

from pinflex.actuation.drive import Nominal
from pinflex.arrays import Array
from pinflex.description.blocks.external import FrameForce
from pinflex.errors import DescriptionError
from pinflex.integrators.problem import Run, Settings, states_of
from pinflex.kernel.evaluate import JointForces
from pinflex.mechanics.closure import Contact
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import motion_of
from pinflex.mechanics.kinks import pins
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import AddedMasses, Attachment, Interface, Loads
from pinflex.results.result import Result
from pinflex.rotations import cross
from pinflex.text import frozen

# Work of loads that have no potential: those that change in time or follow, and moments.
#
# With s(t) the share of a load that acts and P(t) the work that it would do acting in full, its
# work is the integral of s dP. P is F . p for a force that keeps its direction, else the integral
# of its power by the corrected trapezium rule. Between the instants at which s jumps or bends, s is
# linear: by parts that is [s P] less the slope of s times the integral of P, which P and two
# derivatives at both ends give to the sixth power of the step (Hermite; constant s needs P at the
# ends alone). Inside a step of the samples, P at such an instant follows from both sides: its first
# derivative is continuous there, its second jumps with the load.

_SAME = 1e-9  # of a step: an instant so close to a sample is at it


class _Knot(NamedTuple):
    """An instant, and the work done in full until then with its first two derivatives."""

    t: float
    P: float
    rate: float
    rise: float


def without_potential(loads: Loads) -> list[tuple[FrameForce, Attachment]]:
    """Loads whose work, or a part of it, is no change of a potential."""
    return [(f, place) for f, place in loads.forces if not f.potential or any(f.moment)]


def load_work(
    force: FrameForce, t: Array, position: Array, rotation: Array, rate: Array, rise: Array
) -> Array:
    """Work of a load until each instant, without that of a potential, J, shape (nt,)."""
    near = _SAME * float(np.min(np.diff(t), initial=np.inf))
    on = [k for x in force.corners for k in np.flatnonzero(np.abs(t - x) <= near).tolist() if k]
    P, power, slope = _in_full(force, t, position, rotation, rate, rise, on)
    after, before = (
        [_Knot(*map(float, k)) for k in zip(t, P, power, each, strict=True)]
        for each in (slope, _just_before(t, power, slope, on))
    )
    steps = [_step(force, a, b) for a, b in zip(after[:-1], before[1:], strict=True)]
    return np.concatenate([[0.0], np.cumsum(steps)])


def _just_before(t: Array, values: Array, slope: Array, on: Sequence[int]) -> Array:
    """Slopes (nt,), at samples `on` which they jump those before: of the parabola up to there."""
    found = slope.copy()
    for k in on:
        found[k] = 2.0 * (values[k] - values[k - 1]) / (t[k] - t[k - 1]) - slope[k - 1]
    return found


def _in_full(
    force: FrameForce, t: Array, position: Array, rotation: Array, rate: Array, rise: Array,
    on: Sequence[int],
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Work if the load acted in full all along, its power and the slope of that, (nt,) each."""
    push = np.zeros(3) if force.potential else np.array(force.force)
    wrench = np.concatenate([push, force.moment])
    if not force.follower:
        power, slope = rate @ wrench, rise @ wrench
        P = position @ push + _integral(t, rate[:, 3:] @ wrench[3:], rise[:, 3:] @ wrench[3:], on)
        return P, power, slope
    turned = np.concatenate([rotation @ push, rotation @ wrench[3:]], axis=1)
    spin = cross(rate[:, 3:], turned[:, :3])  # a following moment turns across its own power
    power = np.sum(turned * rate, axis=1)
    slope = np.sum(turned * rise, axis=1) + np.sum(spin * rate[:, :3], axis=1)
    return _integral(t, power, slope, on), power, slope


def _integral(t: Array, values: Array, slope: Array, on: Sequence[int]) -> Array:
    """Integral from the first instant on, by the trapezium rule with its end correction, (nt,)."""
    h, late = np.diff(t), _just_before(t, values, slope, on)[1:]
    each = h * (values[1:] + values[:-1]) / 2 + h**2 * (slope[:-1] - late) / 12
    return np.concatenate([[0.0], np.cumsum(each)])


def _step(force: FrameForce, a: _Knot, b: _Knot) -> float:
    """Work between two samples."""
    near = _SAME * (b.t - a.t)
    inside = [t for t in force.corners if a.t + near < t < b.t - near]
    if not inside:
        return _piece(force, a, b)
    if len(inside) == 1:
        left, right = _between(a, b, inside[0])
        return _piece(force, a, left) + _piece(force, right, b)
    # A pulse shorter than a step of the samples: each side alone, and straight between.
    first, last = _ahead(a, inside[0]), _ahead(b, inside[-1])
    middle = [
        _Knot(t, float(np.interp(t, (first.t, last.t), (first.P, last.P))), first.rate, 0.0)
        for t in inside[1:-1]
    ]
    knots = [a, first, *middle, last, b]
    return sum(_piece(force, k, m) for k, m in pairwise(knots))


def _piece(force: FrameForce, a: _Knot, b: _Knot) -> float:
    """Work where the share of the load is linear in time."""
    h = b.t - a.t
    early, late = force.scale(a.t + h / 3), force.scale(b.t - h / 3)
    s_a, s_b = 2 * early - late, 2 * late - early  # what it tends to at the ends, from inside
    whole = h / 2 * (a.P + b.P) + h**2 / 10 * (a.rate - b.rate) + h**3 / 120 * (a.rise + b.rise)
    return s_b * b.P - s_a * a.P - (s_b - s_a) / h * whole


def _between(a: _Knot, b: _Knot, t: float) -> tuple[_Knot, _Knot]:
    """An instant at which the second derivative jumps: cubics from both sides, before and after."""
    x, y = t - a.t, t - b.t
    left, right = _ahead(a, t), _ahead(b, t)
    matrix = np.array([[x**3 / 6, -(y**3) / 6], [x**2 / 2, -(y**2) / 2]])
    third = np.linalg.solve(matrix, [right.P - left.P, right.rate - left.rate])
    P, rate = left.P + third[0] * x**3 / 6, left.rate + third[0] * x**2 / 2
    before, after = left.rise + third[0] * x, right.rise + third[1] * y
    return _Knot(t, P, rate, before), _Knot(t, P, rate, after)


def _ahead(k: _Knot, t: float) -> _Knot:
    """The parabola through a knot, at another instant."""
    x = t - k.t
    return _Knot(t, k.P + k.rate * x + k.rise * x * x / 2, k.rate + k.rise * x, k.rise)


def brought(added: AddedMasses, rates: Mapping[int, Array], t: Array) -> Array:
    """Kinetic energy that masses which came have brought until each instant, less that of those
    which went, J, shape (nt,). `rates`: motions of their joints, (nt, 2, 6).
    """
    total = np.zeros(len(t))
    for k, clock in added.clocks.items():
        M, (v, a) = added.inertia[k], rates[added.joints[k]].swapaxes(0, 1)
        energy, rate = 0.5 * np.sum(v @ M * v, axis=1), np.sum(v @ M * a, axis=1)
        found = np.searchsorted(t, np.array(clock.corners) - _SAME * (t[-1] - t[0]))
        for x, after in zip(clock.corners, found.tolist(), strict=True):
            if 0 < after < len(t):
                # in a step in which it comes and goes, each side tells of its own instant alone
                sign, alone = (1.0, 0.0) if x == clock.start else (-1.0, 1.0)
                share = alone if np.sum(found == after) > 1 else None
                total[after:] += sign * _reached(t, energy, rate, x, after, share)
    return total


def _reached(
    t: Array, values: Array, rates: Array, x: float, after: int, share: float | None
) -> float:
    """A value at a time x, whose rate jumps there: parabolas of the samples on either side.

    `share`: that of the later side; None: by its distance.
    """
    found = []
    for near, far in ((after - 1, after - 2), (after, after + 1)):
        s, bend = x - t[near], 0.0
        if 0 <= far < len(t):
            bend = (rates[far] - rates[near]) / (t[far] - t[near])
        found.append(values[near] + s * rates[near] + 0.5 * s * s * bend)
    if share is None:
        share = (x - t[after - 1]) / (t[after] - t[after - 1])
    return float((1.0 - share) * found[0] + share * found[1])


@frozen
class Kinematics:
    """Kinematics of one run.

    Attributes:
        poses: Of the joints that outputs look at, shape (nt, 3, 4) each.
        arrays: Those of a Result, by flat key: reported frames and energies.
        spins: Angular speeds [rad/s] of the joints that carry a flexible body, shape (nt,) each.
    """

    poses: Mapping[int, Array]
    arrays: dict[str, Array]
    spins: dict[int, Array]


def kinematics(mechanism: Mechanism, run: Run) -> Kinematics:
    """Kinematics of a run."""
    # as if marched: at hundreds of samples the kernel serves rigid systems, too
    dynamics, expansion = Equations(run.system, marched=True), run.system.expansion
    frames = {name: expansion.frames[name] for name in mechanism.description.reported}
    working = without_potential(run.system.loads)
    bearing = {slot.root.joint for slot in expansion.slots}
    joints = run.system.looked_at
    found = dynamics.motions(run.y, run.v, run.a, joints)
    poses, rates = (dict(zip(joints, each, strict=True)) for each in found)
    energies = dynamics.energies(run.y, run.v, run.t)
    arrays = {f"energy/{name}": x for name, x in energies._asdict().items()}
    for name, frame in frames.items():
        seen = motion_of(poses[frame.joint], rates[frame.joint], frame.placement)
        keys = ("position", "rotation", "velocity", "acceleration")
        arrays |= {f"frame/{name}/{key}": x for key, x in zip(keys, seen, strict=True)}
    if working:
        arrays["energy/loads"] = sum(
            (
                load_work(force, run.t, *motion_of(poses[at.joint], rates[at.joint], at.placement))
                for force, at in working
            ),
            brought(run.system.added, rates, run.t),
        )
    spins = {joint: np.linalg.norm(rates[joint][:, 0, 3:], axis=1) for joint in bearing}
    return Kinematics(poses, arrays, spins)


def joint_poses(mechanism: Mechanism, path: Nominal) -> Mapping[int, Array]:
    """Poses of the rigid joints along a nominal motion, shape (nt, 3, 4) each."""
    dynamics = Equations(mechanism.rigid, marched=True)  # as above
    return dict(enumerate(dynamics.joint_poses(path.q).swapaxes(0, 1)))


def pose_of(poses: Mapping[int, Array], here: Attachment) -> Array:
    """Poses (nt, 3, 4) of something attached to a joint."""
    joint = poses[here.joint]
    local = np.column_stack([here.placement.rotation, here.placement.translation])
    moved: Array = joint[:, :, :3] @ local
    moved[:, :, 3] += joint[:, :, 3]
    return moved


# Kinematics and forces at the samples of a run, and a run again from a stored result.

# Forces of a run: of the expanded model, of joints, loops and sleeves.


@frozen
class Forces:
    """Forces of one run.

    Attributes:
        g: Expanded forces rnea - J_Q' lam, shape (nt, nV).
        f: Forces of the joints that outputs look at, shape (nt, 6) each.
        sleeves: Sleeves, each with its contact forces, shape (nt, 3, 8).
        arrays: Those of a Result, by flat key: loops, reactions and what the equations leave.
    """

    g: Array
    f: Mapping[int, Array]
    sleeves: tuple[tuple[Contact, Array], ...]
    arrays: dict[str, Array]


def forces(mechanism: Mechanism, run: Run) -> Forces:
    """Forces of a run."""
    equations, nt, system = Equations(run.system, marched=True), len(run.t), run.system
    model, joints = equations.model, system.looked_at[1:]
    y, v = run.y, run.v
    if run.linear:
        y, v = (np.array(x) for x in zip(*(run.acting(k) for k in range(nt)), strict=True))
    u = None if run.signals is None else run.signals.u @ run.signals.B.T
    found = equations.joint_forces(y, v, run.a, run.lam, run.t, joints, u)
    f = dict(zip(joints, found.f.swapaxes(0, 1), strict=True))
    c = equations.close(run.y).c if run.linear else found.c
    out: dict[str, Array] = {
        f"loop/{name}/wrench": found.wrenches[:, k]
        for k, (name, kind) in enumerate(zip(system.closed.names, system.closed.kinds, strict=True))
        if kind != "coupling"
    }
    if system.kinks.rows and any(one.clearance for one in mechanism.description.loops):
        for name, (place, wrench) in pins(equations, y, v, run.a).items():
            out[f"loop/{name}/orbit"] = place
            out[f"loop/{name}/wrench"] = out[f"loop/{name}/wrench"] + wrench
    for name in mechanism.rigid.rigid.names[1:]:
        out[f"reaction/{name}"] = f[model.getJointId(name)]
    out["residual/closure"] = np.abs(c).max(axis=1, initial=0.0)
    left = _left(mechanism, equations, run, found)
    out["residual/newton"] = np.abs(left[:, system.free]).max(axis=1, initial=0.0)
    contacts = system.closed.contacts if system.n_eta else ()
    sleeves = tuple((one, found.sleeves[:, k]) for k, one in enumerate(contacts))
    return Forces(found.g, f, sleeves, out)


def _left(mechanism: Mechanism, equations: Equations, run: Run, found: JointForces) -> Array:
    """What the equations leave, shape (nt, nv); a linear run has forces of its own."""
    if not run.linear:
        return found.r
    linear = [_linear_forces(mechanism, equations, run, k) for k in range(len(run.t))]
    return found.r + np.array(linear)


def _linear_forces(mechanism: Mechanism, equations: Equations, run: Run, k: int) -> Array:
    """Elastic and damping forces of the deviation of a linear run, shape (nv,)."""
    y, v = run.acting(k)
    d, dv = equations.difference(y, run.y[k]), run.v[k] - v
    K = equations.structural_stiffness(y)
    alpha, beta = mechanism.description.system_damping
    force = K @ (d + beta * dv) + run.system.D @ dv
    inertia = alpha * (equations.mass(y, float(run.t[k])) @ dv) if alpha else 0.0
    return np.asarray(force + inertia)


class Samples:
    """Passes over the samples of one run, each made once, when a group of arrays needs it.

    Attributes:
        mechanism: Mechanism that was solved.
    """

    def __init__(
        self, mechanism: Mechanism, run: Run, rigid_path: Callable[[], Nominal | None] | None = None
    ) -> None:
        """Nothing is computed yet."""
        self.mechanism, self._run, self._rigid_path = mechanism, run, rigid_path

    @cached_property
    def run(self) -> Run:
        """States at the samples, with accelerations that solve the equations there."""
        return self._run if self._run.settle is None else self._run.settle(self._run)

    @cached_property
    def kinematics(self) -> Kinematics:
        """Poses, rates and energies."""
        return kinematics(self.mechanism, self.run)

    @cached_property
    def forces(self) -> Forces:
        """Expanded forces, and those of joints, loops and sleeves."""
        return forces(self.mechanism, self.run)

    @cached_property
    def rigid_poses(self) -> Mapping[int, Array] | None:
        """Joint poses of the rigid mechanism, (nt, 3, 4) each; None: the run is its own."""
        return None if self._path is None else joint_poses(self.mechanism, self._path)

    def said(self) -> list[str]:
        """Where the rigid mechanism is left out, as a warning."""
        return [self._path.said] if self._path is not None and self._path.said else []

    @cached_property
    def _path(self) -> Nominal | None:
        return None if self._rigid_path is None else self._rigid_path()

    def interface_load(self, interface: Interface) -> tuple[Array, Array]:
        """Force (N) and moment (N m), (nt, 3) each in the beam frame, that an interface bears."""
        joint = interface.bottom(self.run.system.expansion.model)
        f = self.forces.f[joint]
        return f[:, :3], f[:, 3:]


def run_of(mechanism: Mechanism, result: Result) -> Run:
    """The states of a result as a run of the mechanism that it came from."""
    system = mechanism.flexible if "eta" in result.arrays else mechanism.rigid
    (y, v, a), lam = states_of(result), result.array("multiplier")
    sizes = (y.shape[1], v.shape[1], lam.shape[1])
    wanted = (system.nq, system.nv, system.closed.n)
    if sizes != wanted or result.meta["name"] != mechanism.name:
        raise DescriptionError(
            f"{result.meta['name']}: the result has {sizes} coordinates, rates and closure rows, "
            f"the mechanism {mechanism.name} has {wanted}. Give the mechanism that was solved."
        )
    path = None
    if "nominal/q" in result.arrays:
        rigid = [result.array(f"nominal/{x}") for x in "qva"]
        path = Nominal(result.t, rigid[0], rigid[1], rigid[2])
    settings = cast("Settings", dict(result.meta["settings"]))
    return Run(system, result.t, y, v, a, lam, result.torque, {}, settings, path=path)


def samples_of(mechanism: Mechanism, result: Result) -> Samples:
    """Kinematics and forces over a run that was stored."""
    return Samples(mechanism, run_of(mechanism, result))
