"""Feedback: what is measured, what is driven, and the law between them.

    u(t) = law(t, m, dm/dt, int m dt)      m: measured outputs,  u: voltages of patches, torques

A law is any function of these; `pid` makes the usual one. It is evaluated inside the implicit step,
so gains limit the physics, not the step size. With a `period` the law is that of a digital
controller: measured at t = k period, held from then (and a delay) on, saturated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.files import Source
from pinflex.description.reading import schema
from pinflex.description.robots.urdf import Limits, limits
from pinflex.errors import DescriptionError
from pinflex.text import frozen

# Laws of digital controllers, with a state: a linear system, and a PID that does not wind up.
#
# A law is called once a sample, with t, m, dm/dt and the integral of m. One that has a method
# `applied` is told afterwards the output that the limits left of its own.
#
# Source: Astrom, Wittenmark (1997), Computer-Controlled Systems, ch. 8 (Tustin, PID, anti-windup).

_SAME = 1e-6  # relative: two sample times


def is_system(law: Any) -> bool:
    """Whether a law is a scipy or python-control system, of which some are callable too."""
    return hasattr(law, "dt") and any(hasattr(law, name) for name in ("A", "num", "zeros"))


@dataclass
class DigitalPid:
    """u = kp e + ki int e dt + kd de/dt with e = reference - m, once a sample.

    The integral stands still while the output is saturated and e would drive it further
    (conditional integration).

    Attributes:
        kp, ki, kd: Gains, shape (n,). period: Sample time [s].
        reference, rate: Of m, (n,) by time; rate None: the reference stands still.
        limit: Largest |u| that the law itself asks for, shape (n,).
    """

    kp: Array
    ki: Array
    kd: Array
    period: float
    reference: Callable[[float], Array]
    rate: Callable[[float], Array] | None = None
    integral: Array = field(default_factory=lambda: np.zeros(1))
    _error: Array = field(default_factory=lambda: np.zeros(1))
    _asked: Array = field(default_factory=lambda: np.zeros(1))

    def __call__(self, t: float, m: Array, rate: Array, total: Array) -> Array:
        """u at the sample at time t (s)."""
        self._error = e = np.asarray(self.reference(t)) - m
        wanted = 0.0 if self.rate is None else np.asarray(self.rate(t))
        return np.asarray(self.kp * e + self.ki * self.integral + self.kd * (wanted - rate))

    def applied(self, asked: Array, given: Array) -> None:
        """Integrate the error, but not further into a limit, which left `given` of `asked`."""
        more, beyond = self.period * self._error, asked - given
        if beyond.any():
            more = more * ~(beyond * self.ki * self._error > 0.0)
        self.integral = self.integral + more


@public
def digital_pid(
    kp: float | Sequence[float] = 0.0,
    ki: float | Sequence[float] = 0.0,
    kd: float | Sequence[float] = 0.0,
    *,
    period: float,
    reference: float | Sequence[float] | Callable[[float], Array] = 0.0,
    rate: Callable[[float], Array] | None = None,
) -> DigitalPid:
    """A PID law of a digital controller with anti-windup, for `Control(..., period=period)`.

    Args:
        kp, ki, kd: Gains, numbers or one of each per measure; positive ones oppose the error.
        period: Sample time [s], that of the control.
        reference: Values the measures should have, or a function of time that gives them.
        rate: Rates of the reference by time.
    """
    kp_, ki_, kd_, known = _alike(kp, ki, kd, 0.0 if callable(reference) else reference)
    follow = reference if callable(reference) else lambda t: known
    return DigitalPid(kp_, ki_, kd_, period, follow, rate, np.zeros(len(known)))


def _alike(*numbers: Any) -> list[Array]:
    """Numbers, or one of each per measure, as arrays of one size."""
    return list(np.broadcast_arrays(*(np.atleast_1d(np.asarray(x, float)) for x in numbers)))


@dataclass
class LinearLaw:
    """x' = A x + B e, u = C x + D e at sample k, with e = reference - m."""

    A: Array
    B: Array
    C: Array
    D: Array
    reference: Callable[[float], Array] | None
    x: Array

    def __call__(self, t: float, m: Array, rate: Array, total: Array) -> Array:
        """u at the sample at time t (s); the state goes one sample on."""
        e = -m if self.reference is None else np.asarray(self.reference(t)) - m
        u = self.C @ self.x + self.D @ e
        self.x = self.A @ self.x + self.B @ e
        return np.asarray(u)


def linear_law(
    system: Any, period: float, reference: Callable[[float], Array] | None = None
) -> LinearLaw:
    """The law of a scipy or python-control system (state space, transfer function, zpk)."""
    from scipy.signal import cont2discrete

    A, B, C, D, dt = _matrices(system)
    if not dt:
        A, B, C, D, _ = cont2discrete((A, B, C, D), period, method="bilinear")
    elif dt is not True and abs(dt / period - 1.0) > _SAME:
        raise DescriptionError(
            f"control.period: {period:g} s, but the system's sample time is {dt:g} s. Give the "
            "same."
        )
    return LinearLaw(A, B, C, D, reference, np.zeros(len(A)))


def _matrices(system: Any) -> tuple[Array, Array, Array, Array, Any]:
    """A, B, C, D and the sample time (None, 0: continuous; True: not said) of a system."""
    found = system
    if hasattr(system, "to_ss"):  # scipy's transfer functions and zeros-poles-gain
        found = system.to_ss()
    elif hasattr(system, "num") and not hasattr(system, "A"):  # python-control's
        import control

        found = control.ss(system)
    if not all(hasattr(found, name) for name in "ABCD"):
        raise DescriptionError(
            f"control.law: {type(system).__name__} is no function and no linear system. Give a "
            "function of (t, m, rate, total), or a scipy.signal or python-control system."
        )
    A, B, C, D = (np.atleast_2d(np.asarray(getattr(found, name), float)) for name in "ABCD")
    return A.reshape(len(A), -1), B, C, D, getattr(found, "dt", None)


Law = Callable[[float, Array, Array, Array], Array]


def _link(value: object, where: str, urdf: Source) -> str:
    return schema.known(value, where, urdf.links, "link")


@dataclass(frozen=True)
class Deflection:
    """Measures the deflection of a flexible link in its own frame, m.

    Attributes:
        link: Flexible link. x: Where along the beam [m]. direction: y or z of the beam.
    """

    link: str = schema.key(schema.REQUIRED, _link, given=True, form=schema.TEXT, required=False)
    x: float = schema.real(schema.REQUIRED, "place", low=0, key="at", required=False)
    direction: str = schema.word("y", ("y", "z"))


@dataclass(frozen=True)
class Travel:
    """Measures how far a joint of one freedom is from home, rad | m."""

    joint: str


@dataclass(frozen=True)
class Voltage:
    """Drives a piezoelectric patch of a flexible link, V."""

    patch: str


@dataclass(frozen=True)
class Effort:
    """Drives a joint of one freedom, N m | N; a motor only if motors are driven by torque."""

    joint: str


@frozen
class Control:
    """A feedback, usable on any model: `solve(mechanism, control=Control(...))`.

    Attributes:
        measures: What is measured.
        drives: What is driven.
        law: u (nu,) of t [s], m, dm/dt and the integral of m, each of shape (nm,). With a period
            also a scipy or python-control system from `reference` - m to u (a continuous one is
            made discrete by Tustin's rule), or an object with a state of its own: every run works
            on a copy of it.
        names: Name of each drive in the result; default: the patch or the joint.
        period: Sample time of a digital controller [s]; None: the law acts continuously.
        delay: From measurement to output of a digital controller [s].
        limit: Largest |u| of each drive of a digital controller; default: for joints the effort
            limits of the URDF, for patches none.
        reference: Values that m should have, (nm,), by time: what a system is compared with.
        forward: Feed-forward of a digital controller, (nu,), by time; taken in the middle of the
            time that it is held.
        follow: Of each measure whether its reference is the motion's, which moves that motor.
        rigid_torque: Of each drive whether the torque that the motion asks of that motor, links
            rigid, is fed forward.
    """

    measures: tuple[Deflection | Travel, ...]
    drives: tuple[Voltage | Effort, ...]
    law: Law | Any
    names: tuple[str, ...] = ()
    period: float | None = None
    delay: float = 0.0
    limit: tuple[float, ...] = ()
    reference: Callable[[float], Array] | None = None
    forward: Callable[[float], Array] | None = None
    follow: tuple[bool, ...] = ()
    rigid_torque: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        period, sampled = self.period, (self.delay, self.limit, self.reference, self.forward)
        if period is not None and not 0.0 < period < np.inf:
            raise DescriptionError(f"control.period: {period} s. Give a time above 0 s.")
        if not 0.0 <= self.delay < np.inf:
            raise DescriptionError(f"control.delay: {self.delay} s. Give 0 s or more.")
        if period is None and (any(sampled[:2]) or sampled[2] or sampled[3] or _digital(self.law)):
            raise DescriptionError(
                "control: delay, limit, reference, forward, a system as law and a law with a state "
                "are those of a digital controller. Give its period [s]."
            )
        self._require_followed()
        if len(self.limit) not in (0, len(self.drives)) or any(not x > 0 for x in self.limit):
            raise DescriptionError(
                f"control.limit: {list(self.limit)} for {len(self.drives)} drives. Give a number "
                "above 0 for each, or none."
            )

    def _require_followed(self) -> None:
        for what, flags, kind in (
            ("follow", zip(self.follow, self.measures, strict=False), Travel),
            ("rigid_torque", zip(self.rigid_torque, self.drives, strict=False), Effort),
        ):
            if any(on and not isinstance(one, kind) for on, one in flags):
                raise DescriptionError(f"control.{what}: the motion tells what motors do only.")

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each drive."""
        own = (d.patch if isinstance(d, Voltage) else d.joint for d in self.drives)
        return self.names or tuple(own)


def _digital(law: Any) -> bool:
    """Whether a law makes sense at sample instants only: a system, or one with a state."""
    return is_system(law) or hasattr(law, "applied")


@dataclass(frozen=True)
class StateLaw:
    """x' = A x + B e, u = C x + D e + E e', with e = m - target.

    Attributes:
        A, B, C, D, E: Shapes (n, n), (n, nm), (nu, n), (nu, nm), (nu, nm).
        target: Values that the measures should have, shape (nm,).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    E: Array
    target: Array


@dataclass(frozen=True)
class Pid:
    """u_i = kp_i m_i + ki_i int m_i dt + kd_i dm_i/dt; each drive has its own measure.

    Attributes:
        kp, ki, kd: Gains, shape (n,); negative ones oppose what is measured.
        target: Values the measures should have, shape (n,).
    """

    kp: Array
    ki: Array
    kd: Array
    target: Array

    def __call__(self, t: float, m: Array, rate: Array, total: Array) -> Array:
        """u at time t (s)."""
        error = m - self.target
        return np.asarray(self.kp * error + self.ki * (total - self.target * t) + self.kd * rate)

    def linear(self, measures: int) -> StateLaw:
        """The same in state space, of so many measures: states are integrals of e."""
        kp, ki, kd, target = (
            np.broadcast_to(x, measures) for x in (self.kp, self.ki, self.kd, self.target)
        )
        n, one = measures, np.eye(measures)
        return StateLaw(np.zeros((n, n)), one, np.diag(ki), np.diag(kp), np.diag(kd), target)


@public
def pid(
    kp: float | Sequence[float] = 0.0,
    ki: float | Sequence[float] = 0.0,
    kd: float | Sequence[float] = 0.0,
    target: float | Sequence[float] = 0.0,
) -> Pid:
    """A PID law, or without ki a PD law; numbers or one of each per measure.

    Args:
        kp: Gain of the measure.
        ki: Gain of its integral [1/s].
        kd: Gain of its rate [s].
        target: Value that the measure is to have.
    """
    return Pid(*_alike(kp, ki, kd, target))


# The block `control` of a YAML file: {NAME: {measure, drive, ...}}, and `period`, `delay`.

DIGITAL = ("period", "delay")  # of all entries; an entry of such a name is a block
_FORWARD = ("rigid", "none")
_MOTION = "motion"


def read_control(
    value: object, where: str, urdf: Source, motors: Sequence[str] = ()
) -> Control | None:
    """The block `control`."""
    block = schema.mapping(value, where)
    times = {k: block.pop(k) for k in DIGITAL if not isinstance(block.get(k, {}), Mapping)}
    period, delay = _times(times, where)
    entries = dict(schema.entries(block, where, ENTRY))
    read = {name: _entry(one, urdf, motors, period) for name, one in entries.items()}
    if read:
        return _control(read, urdf, period, delay)
    if period is not None:
        raise DescriptionError(
            f"{where}: nothing that is measured and driven. Write NAME: {{measure, drive, kp}}."
        )
    return None


_MEASURE = schema.keys(
    Deflection, "link", "at", "direction", joint=schema.bare(schema.TEXT, required=False)
)
_DRIVE = {"patch": schema.bare(schema.TEXT), "joint": schema.bare(schema.TEXT)}


def _measure(value: object, where: str, urdf: Source) -> Deflection | Travel:
    joint = isinstance(value, dict) and value.get("joint") is not None
    block = schema.Block(value, where, _MEASURE, *(("joint",) if joint else ("link", "at")))
    if joint:
        return Travel(schema.known(block["joint"], where, urdf.joints, "joint"))
    return Deflection(**block.read(urdf))


def _drive(value: object, where: str, urdf: Source) -> Voltage | Effort:
    block = schema.Block(value, where, _DRIVE)
    if len(block) != 1:
        raise block.error("", "name one drive: {patch: NAME} or {joint: NAME}.")
    if "patch" in block:
        return Voltage(schema.text(block["patch"], block.at("patch")))
    return Effort(schema.known(block["joint"], block.at("joint"), urdf.joints, "joint"))


def _target(value: object, where: str) -> float | None:
    """What the measure should be; None: what the motion says."""
    return None if value == _MOTION else schema.number(value, where, of="gain")


@dataclass(frozen=True)
class _Entry:
    """One measure, one drive and what is between them.

    Attributes:
        kp, ki, kd: Gains, which act on measure - target.
        target: Of the measure [rad | m]; None: the motion gives it.
        limit: Largest output [N m | N | V]; 0: the usual one of the drive.
        forward: rigid, where the torque of the rigid mechanism is added, or none.
    """

    measure: Deflection | Travel = schema.key(
        schema.REQUIRED, _measure, given=True, form=schema.block_form(_MEASURE)
    )
    drive: Voltage | Effort = schema.key(
        schema.REQUIRED, _drive, given=True, form={"type": "object"}
    )
    kp: float = schema.real(0.0, "gain")
    ki: float = schema.real(0.0, "gain")
    kd: float = schema.real(0.0, "gain")
    target: float | None = schema.key(
        0.0, _target, form={"anyOf": [schema.measure("gain"), {"const": _MOTION}]}
    )
    limit: float = schema.real(0.0, above=0.0)
    forward: str = schema.word("", _FORWARD)

    @property
    def gains(self) -> tuple[float, float, float]:
        """kp, ki, kd."""
        return self.kp, self.ki, self.kd


ENTRY = schema.keys(_Entry)


def form() -> schema.Form:
    """Entries of the user's names, and the times of a digital controller."""
    entry = schema.block_form(ENTRY)
    times = {"anyOf": [schema.measure("time"), entry, {"type": "null"}]}
    return schema.named_form(entry) | {"properties": dict.fromkeys(DIGITAL, times)}


def _control(
    read: Mapping[str, _Entry], urdf: Source, period: float | None, delay: float
) -> Control:
    """The law of all entries, continuous without a period [s]."""
    entries = tuple(read.values())
    kp, ki, kd = np.array([one.gains for one in entries]).T
    target = [one.target or 0.0 for one in entries]
    drives = tuple(one.drive for one in entries)
    common: dict[str, Any] = {
        "measures": tuple(one.measure for one in entries), "drives": drives, "names": tuple(read)
    }  # fmt: skip
    if period is None:
        return Control(law=pid(kp, ki, kd, target), **common)
    usual = effort_limits(urdf.text, drives)
    return Control(
        # The YAML's gains act on m - target, those of digital_pid on target - m.
        law=digital_pid(-kp, -ki, -kd, period=period, reference=target),
        period=period,
        delay=delay,
        limit=tuple(one.limit or most for one, most in zip(entries, usual, strict=True)),
        follow=tuple(one.target is None for one in entries),
        rigid_torque=tuple(one.forward == _FORWARD[0] for one in entries),
        **common,
    )


def effort_limits(urdf: str, drives: Sequence[Voltage | Effort]) -> tuple[float, ...]:
    """Largest force of each drive that a URDF text allows its joint [N m | N]; inf where none."""
    known = limits(urdf)
    efforts = [known.get(d.joint, Limits()).effort if isinstance(d, Effort) else 0.0
               for d in drives]  # fmt: skip
    return tuple(x if x > 0.0 else np.inf for x in efforts)


def _times(given: Mapping[str, Any], where: str) -> tuple[float | None, float]:
    """Sample time and delay of a digital controller [s]; None: a continuous one."""
    found = {k: schema.number(v, schema.at(where, k), low=0.0, of="time") for k, v in given.items()}
    if "delay" in given and "period" not in given:
        raise DescriptionError(
            f"{schema.at(where, 'delay')}: only a digital controller has one. Write "
            "control.period in s."
        )
    return found.get("period"), found.get("delay", 0.0)


def _entry(
    block: schema.Block, urdf: Source, motors: Sequence[str], period: float | None
) -> _Entry:
    if period is None:
        sampled = [key for key in ("limit", "forward") if key in block]
        sampled += ["target: motion"] if block.get("target") == _MOTION else []
        if sampled:
            raise block.error(
                "",
                f"{sampled[0]}: only a digital controller has it. Write control.period in s.",
            )
    found = _Entry(**block.read(urdf))
    follow = found.target is None
    if not found.forward:
        usual = _FORWARD[0] if follow and _is_motor(found.drive, motors) else _FORWARD[1]
        found = replace(found, forward=usual)
    if follow:
        _require_motor(found.measure, block.at("measure"), motors)
    if found.forward == _FORWARD[0]:
        _require_motor(found.drive, block.at("drive"), motors)
    elif not any(found.gains):
        raise block.error("", "it does nothing. Give kp, ki or kd.")
    return found


def _is_motor(one: Deflection | Travel | Voltage | Effort, motors: Sequence[str]) -> bool:
    return isinstance(one, Travel | Effort) and one.joint in motors


def _require_motor(
    one: Deflection | Travel | Voltage | Effort, where: str, motors: Sequence[str]
) -> None:
    if not _is_motor(one, motors):
        raise DescriptionError(
            f"{where}: no motor, and the motion tells what motors do. Motors: "
            f"{', '.join(motors) or 'none'}."
        )
