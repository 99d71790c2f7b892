"""Input shapers: a motion convolved with a few impulses so that chosen vibrations cancel.

Source: Singer, Seering (1990), ZV and ZVD; Singhose, Seering, Singer (1994), EI with its fit for
damped systems; Singhose (2009) for all three.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.motions.laws import Kinematics
from pinflex.description.reading import schema
from pinflex.errors import DescriptionError, nearest

if TYPE_CHECKING:
    from pinflex.description.motions.trajectory import Motion

KEYS = ("kind", "frequencies", "damping", "modes")
KINDS = ("zv", "zvd", "ei")
MODES = 3  # most of those that a motion excites
MOST = 2200  # impulses: 3^7, seven frequencies of the kinds of three
TOLERATED = 0.05  # residual vibration that EI leaves at the frequency it is made for


@dataclass(frozen=True)
class Shaper:
    """Impulses: times [s], shape (n,), the first 0; and their shares, shape (n,), of sum 1."""

    times: Array
    shares: Array

    @property
    def duration(self) -> float:
        """By how much a motion gets longer [s]."""
        return float(self.times[-1])

    def residual(self, frequency: Array | float, damping: float = 0.0) -> Array:
        """Vibration after the last impulse over that after one impulse, by frequency [Hz]."""
        omega = 2.0 * np.pi * np.atleast_1d(np.asarray(frequency, float))[:, None]
        damped = omega * np.sqrt(1.0 - damping**2)
        size = self.shares * np.exp(-damping * omega * (self.duration - self.times))
        phase = damped * self.times
        return np.asarray(np.hypot((size * np.cos(phase)).sum(1), (size * np.sin(phase)).sum(1)))


@dataclass(frozen=True)
class ShaperSpec:
    """The block `shaper` of a motion.

    Attributes:
        kind: One of `KINDS`.
        frequencies: To cancel [Hz]; empty: those that the motion excites.
        damping: Damping ratio of them [-], one or one each; of modes that are looked up, theirs.
        modes: Most modes to look up.
    """

    kind: str
    frequencies: tuple[float, ...] = ()
    damping: tuple[float, ...] = (0.0,)
    modes: int = MODES


def read(value: object, where: str) -> ShaperSpec | None:
    """The block `shaper`: {kind, frequencies, damping} or {kind, modes}, or the kind alone."""
    if value is None:
        return None
    block = {"kind": value} if isinstance(value, str) else value
    block = schema.mapping(block, where, KEYS, ("kind",))
    kind = schema.choice(block["kind"], schema.at(where, "kind"), KINDS)
    given = block.get("frequencies", ())
    found = _each(given, schema.at(where, "frequencies"), above=0.0, of="rate")
    _require_few(kind, len(found))
    if found and "modes" in block:
        raise DescriptionError(f"{where}.modes: frequencies are given. Remove one of them.")
    if "damping" in block and not found:
        raise DescriptionError(
            f"{where}.damping: that of the modes is known. Remove it, or give frequencies [Hz]."
        )
    damping = _each(block.get("damping", 0.0), schema.at(where, "damping"), low=0.0, high=0.9)
    if len(damping) not in (1, len(found)) and found:
        raise DescriptionError(
            f"{where}.damping: {len(damping)} ratios for {len(found)} frequencies. Give one each."
        )
    modes = block.get("modes", MODES)
    if isinstance(modes, bool) or not isinstance(modes, int) or not 1 <= modes <= 9:
        raise DescriptionError(f"{where}.modes: {schema.shown(modes)}. Give 1 to 9.")
    if not found and "modes" in block:
        _require_few(kind, modes)
    return ShaperSpec(kind, found, damping, modes)


def _each(value: object, where: str, **bounds: Any) -> tuple[float, ...]:
    """A number, or a list of numbers."""
    many = value if isinstance(value, list | tuple) else [value]
    return tuple(schema.number(x, where, **bounds) for x in many)


def shaper(
    kind: str, frequencies: Sequence[float] | float, damping: Sequence[float] | float = 0.0
) -> Shaper:
    """The shaper that cancels vibrations at the frequencies [Hz] with a damping ratio [-].

    Raises:
        DescriptionError: An unknown kind, a frequency or damping that makes no sense.
    """
    if kind not in KINDS:
        raise DescriptionError(f"shaper: {kind}.{nearest(kind, KINDS)}")
    every = np.atleast_1d(np.asarray(frequencies, float))
    if not len(every) or not np.all((every > 0.0) & np.isfinite(every)):
        raise DescriptionError(f"shaper: frequencies {every.tolist()}. Give numbers above 0 Hz.")
    ratios = np.atleast_1d(np.asarray(damping, float))
    if len(ratios) not in (1, len(every)) or not np.all((ratios >= 0.0) & (ratios < 1.0)):
        raise DescriptionError(
            f"shaper: damping {damping}. Give a ratio from 0 to below 1, or one for each frequency."
        )
    _require_few(kind, len(every))
    times, shares = np.zeros(1), np.ones(1)
    for frequency, ratio in zip(every, np.broadcast_to(ratios, every.shape), strict=True):
        t, part = _impulses(kind, float(frequency), float(ratio))
        times = np.add.outer(times, t).ravel()
        shares = np.multiply.outer(shares, part).ravel()
    order = np.argsort(times, kind="stable")
    return Shaper(times[order], shares[order])


def _require_few(kind: str, frequencies: int) -> None:
    """Refuse a shaper whose impulses, two or three to the power of the frequencies, take over."""
    each = 2 if kind == "zv" else 3
    most = int(math.log(MOST, each))
    if frequencies > most:
        raise DescriptionError(
            f"shaper: {frequencies} frequencies make {each}^{frequencies} impulses of kind {kind}. "
            f"Give at most {most}, those that shake most."
        )


def _impulses(kind: str, frequency: float, zeta: float) -> tuple[Array, Array]:
    period = 1.0 / (frequency * np.sqrt(1.0 - zeta**2))
    K = np.exp(-zeta * np.pi / np.sqrt(1.0 - zeta**2))
    if kind == "zv":
        return period * np.array([0.0, 0.5]), np.array([1.0, K]) / (1.0 + K)
    if kind == "zvd":
        return period * np.array([0.0, 0.5, 1.0]), np.array([1.0, 2.0 * K, K**2]) / (1.0 + K) ** 2
    V, z = TOLERATED, zeta
    if z == 0.0:
        return period * np.array([0.0, 0.5, 1.0]), np.array([1 + V, 2 - 2 * V, 1 + V]) / 4.0
    first = 0.24968 + 0.24961 * V + 0.80008 * z + 1.23328 * V * z
    first += 0.49599 * z**2 + 3.17316 * V * z**2
    last = 0.25149 + 0.21474 * V - 0.83249 * z + 1.41498 * V * z
    last += 0.85181 * z**2 - 4.90094 * V * z**2
    middle = 0.49990 + 0.46159 * V * z + 4.26169 * V * z**2 + 1.75601 * V * z**3
    middle += V**2 * (8.57843 * z - 108.644 * z**2 + 336.989 * z**3)
    return period * np.array([0.0, middle, 1.0]), np.array([first, 1.0 - first - last, last])


def shaped(
    motion: Motion,
    kind: str,
    frequencies: Sequence[float] | float,
    damping: Sequence[float] | float = 0.0,
) -> Motion:
    """The motion convolved with a shaper; it ends later by the shaper's duration."""
    made = shaper(kind, frequencies, damping)
    law = partial(_convolved, motion, made)
    spec = dict(motion.spec) | {
        "shaper": {"kind": kind, "frequencies": np.atleast_1d(frequencies).tolist(),
                   "damping": np.asarray(damping).tolist()}
    }  # fmt: skip
    corners = np.unique(np.add.outer([0.0, *motion.switches], made.times))
    return replace(
        motion, kind=f"shaped {motion.kind}", duration=motion.duration + made.duration, law=law,
        spec=spec, corners=tuple(corners.tolist()),
    )  # fmt: skip


def _convolved(motion: Motion, made: Shaper, t: Array) -> Kinematics:
    total = [np.zeros((len(t), len(motion.names))) for _ in range(3)]
    for late, share in zip(made.times, made.shares, strict=True):
        for sum_, part in zip(total, motion.evaluate(t - late), strict=True):
            sum_ += share * part
    return total[0], total[1], total[2]
