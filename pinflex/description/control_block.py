"""The block `control` of a YAML file: {NAME: {measure, drive, ...}}, and `period`, `delay`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from pinflex.description import schema
from pinflex.description.control import Control, Deflection, Effort, Travel, Voltage, pid
from pinflex.description.digital import digital_pid
from pinflex.description.source import Source
from pinflex.description.urdf import Limits, limits
from pinflex.errors import DescriptionError

GAINS = ("kp", "ki", "kd")
DIGITAL = ("period", "delay")  # of all entries; an entry of such a name is a block
SAMPLED = ("limit", "forward")  # of an entry of a digital controller
KEYS = ("measure", "drive", *GAINS, "target", *SAMPLED)
FORWARD = ("rigid", "none")
_MOTION = "motion"


def read_control(
    value: object, where: str, urdf: Source, motors: Sequence[str] = ()
) -> Control | None:
    """The block `control`."""
    block = schema.mapping(value, where)
    times = {k: block.pop(k) for k in DIGITAL if not isinstance(block.get(k, {}), Mapping)}
    period, delay = _times(times, where)
    entries = {
        name: schema.mapping(item, schema.at(where, name), KEYS, ("measure", "drive"))
        for name, item in block.items()
    }
    read = {
        name: _entry(item, schema.at(where, name), urdf, motors, period)
        for name, item in entries.items()
    }
    if read:
        return _control(read, urdf, period, delay)
    if period is not None:
        raise DescriptionError(
            f"{where}: nothing that is measured and driven. Write NAME: {{measure, drive, kp}}."
        )
    return None


@dataclass(frozen=True)
class _Entry:
    """One measure, one drive and what is between them.

    Attributes:
        gains: kp, ki, kd, which act on measure - target.
        target: Of the measure [rad | m]; 0 where the motion gives it.
        follow: Whether the motion gives the target.
        forward: Whether the torque of the rigid mechanism is added.
        limit: Largest output [N m | N | V]; 0: the usual one of the drive.
    """

    measure: Deflection | Travel
    drive: Voltage | Effort
    gains: tuple[float, ...]
    target: float
    follow: bool
    forward: bool
    limit: float


def _control(
    read: Mapping[str, _Entry], urdf: Source, period: float | None, delay: float
) -> Control:
    """The law of all entries, continuous without a period [s]."""
    entries = tuple(read.values())
    kp, ki, kd = np.array([one.gains for one in entries]).T
    target = [one.target for one in entries]
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
        follow=tuple(one.follow for one in entries),
        rigid_torque=tuple(one.forward for one in entries),
        **common,
    )


_limits = lru_cache(maxsize=4)(limits)  # every run of a digital controller asks for them


def effort_limits(urdf: str, drives: Sequence[Voltage | Effort]) -> tuple[float, ...]:
    """Largest force of each drive that a URDF text allows its joint [N m | N]; inf where none."""
    known = _limits(urdf)
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
    block: Mapping[str, Any], where: str, urdf: Source, motors: Sequence[str], period: float | None
) -> _Entry:
    places = {key: schema.at(where, key) for key in KEYS}
    follow = block.get("target") == _MOTION
    if period is None:
        _refuse_sampled(block, where)
    measure = _measure(block["measure"], places["measure"], urdf)
    drive = _drive(block["drive"], places["drive"], urdf)
    gains = tuple(schema.number(block.get(k, 0.0), places[k], of="gain") for k in GAINS)
    target = 0.0 if follow else block.get("target", 0.0)
    target = schema.number(target, places["target"], of="gain")
    limit = schema.number(block["limit"], places["limit"], above=0.0) if "limit" in block else 0.0
    usual = FORWARD[0] if follow and _is_motor(drive, motors) else FORWARD[1]
    forward = FORWARD[0] == schema.choice(block.get("forward", usual), places["forward"], FORWARD)
    if follow:
        _require_motor(measure, f"{where}.measure", motors)
    if forward:
        _require_motor(drive, f"{where}.drive", motors)
    if not any(gains) and not forward:
        raise DescriptionError(f"{where}: it does nothing. Give kp, ki or kd.")
    return _Entry(measure, drive, gains, target, follow, forward, limit)


def _refuse_sampled(block: Mapping[str, Any], where: str) -> None:
    """Keys that only a digital controller has."""
    sampled = [key for key in SAMPLED if key in block]
    sampled += ["target: motion"] if block.get("target") == _MOTION else []
    if sampled:
        raise DescriptionError(
            f"{where}: {sampled[0]}: only a digital controller has it. Write control.period in s."
        )


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


def _measure(value: object, where: str, urdf: Source) -> Deflection | Travel:
    block = schema.mapping(value, where, ("link", "at", "direction", "joint"))
    if "joint" in block:
        return Travel(schema.known(block["joint"], where, urdf.joints, "joint"))
    schema.mapping(value, where, None, ("link", "at"))
    link = schema.known(block["link"], schema.at(where, "link"), urdf.links, "link")
    x = schema.number(block["at"], schema.at(where, "at"), low=0, of="place")
    direction = schema.choice(
        block.get("direction", "y"), schema.at(where, "direction"), ("y", "z")
    )
    return Deflection(link, x, direction)


def _drive(value: object, where: str, urdf: Source) -> Voltage | Effort:
    block = schema.mapping(value, where, ("patch", "joint"))
    if len(block) != 1:
        raise DescriptionError(f"{where}: name one drive: {{patch: NAME}} or {{joint: NAME}}.")
    if "patch" in block:
        return Voltage(schema.text(block["patch"], schema.at(where, "patch")))
    return Effort(schema.known(block["joint"], schema.at(where, "joint"), urdf.joints, "joint"))
