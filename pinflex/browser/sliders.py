"""Numbers of a scene that a page may change, and what each does to the tables of the kernel.

A slider p stands for overrides `key = value * p^power`, which the page writes as `--set`. Tables
are made at some p: where they are straight lines of p the page takes the line; where all that
changes is in proportion to p, the factor; else the polynomial through Chebyshev points, whose error
between them is measured here and told there. The speed of the move stretches time.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array, IntArray
from pinflex.browser.recipe import TableArrays as Tables
from pinflex.browser.recipe import pattern_of, widened
from pinflex.description.description import Description
from pinflex.errors import PinflexError
from pinflex.levels.modes import default_motion
from pinflex.levels.ringing import ringing
from pinflex.mechanics.mechanism import Mechanism, load

TIMES = "times"  # unit of factors
_NODES = 6  # of what is no straight line
_NOTHING = 1e-13  # of the largest entry: round-off of shapes
_MOST = 30_000  # bytes of all such sliders in a page
# Binary digits that changes of an entry are rounded to: fewer where links get shorter as they
# bend, which is of second order, and for lines that are drawn, in 24.
_DIGITS, _DIGITS_OF = 38, {"g": 31, "way": 26}
# Of the largest entry: a slider whose tables are so far off is left out. What is computed by them
# may be off by many times that, which is then still below the tolerance.
_BEYOND = 1e-6
_SAFE = 2.0  # told of what is found midway between nodes: elsewhere it may be more
_SHARE = 0.5  # of the robot's mass: the largest payload
_STRAIGHT = 1e-12  # of the largest entry: round-off of the tables
_MOTION = ("time", "motion")  # what needs no tables of its own
PAYLOAD = "payload"  # name of the block that a payload is written as


@dataclass(frozen=True)
class Slider:
    """A number of a scene.

    Attributes:
        name, label, unit: What it is. low, high, value: Range, and where it stands at first.
        keys: Overrides: key, value and power of p. shown: What p is shown times.
        made_by: Overrides that say the same so that tables are straight lines of p; (): `keys`.
        acts: On "tables", a "section", "time", or the "motion", which it turns on (1) or off (0).
    """

    name: str
    label: str
    unit: str
    low: float
    high: float
    value: float
    keys: tuple[tuple[str, Any, int], ...]
    shown: float = 1.0
    acts: str = "tables"
    made_by: tuple[tuple[str, Any, int], ...] = ()

    def overrides(self, p: float) -> list[str]:
        """As `pinflex.load` takes them."""
        return _overrides(self.keys, p)

    def for_tables(self, p: float) -> list[str]:
        """Overrides that tables are made by."""
        return _overrides(self.made_by or self.keys, p)


def _overrides(keys: Sequence[tuple[str, Any, int]], p: float) -> list[str]:
    found = ((key, _times(value, p**power)) for key, value, power in keys)
    return [f"{key}={json.dumps(value)}" for key, value in found]


@dataclass(frozen=True)
class Coded:
    """Values at nodes (nodes, entries) in few bytes: +-2^steps basis @ whole.

    Attributes:
        basis: Directions among the nodes, the most used first, shape (nodes, rank). whole: Whole
            numbers, shape (rank, columns). steps: Powers of two of the columns.
        which, negative: Of each entry, its column and whether that is turned round.
    """

    basis: Array
    whole: Array
    steps: Array
    which: IntArray
    negative: npt.NDArray[np.bool_]

    @property
    def values(self) -> Array:
        """Values at nodes, shape (nodes, entries)."""
        columns = self.basis @ self.whole * np.exp2(self.steps)
        return np.asarray(columns[:, self.which] * np.where(self.negative, -1.0, 1.0))

    @property
    def size(self) -> float:
        """Bytes in a page, in characters of six bits."""
        return float(np.log2(1.0 + np.abs(self.whole)).sum() / 6.0)


def _coded(values: Array, digits: Array) -> Coded:
    """Values at nodes (nodes, entries), none of them zero throughout, to as many digits."""
    largest = np.take_along_axis(values, np.abs(values).argmax(axis=0)[None], axis=0)[0]
    steps, negative = np.ceil(np.log2(np.abs(largest))) - digits, largest < 0
    rounded = np.round(np.where(negative, -1.0, 1.0) * values / np.exp2(steps))
    every, first, which = np.unique(
        np.vstack([rounded, steps]), axis=1, return_index=True, return_inverse=True
    )
    order = np.argsort(first)  # neighbours have neighbouring columns
    columns, steps = every[:-1, order], every[-1, order]
    basis, size, _ = np.linalg.svd(columns / np.abs(columns).max(axis=0), full_matrices=False)
    basis = basis[:, size > 1e-14 * size[0]]
    return Coded(
        basis, np.round(basis.T @ columns), steps, np.argsort(order)[which.ravel()], negative
    )


@dataclass(frozen=True)
class Change:
    """What a slider does to arrays: entries by array, and values of these at the nodes.

    Attributes:
        kind: "line" (values, slopes), "factor" or "polynomial" (nodes, entries; any
            constant may be added to a column).
        entries, values: By array. error: Largest one between the nodes, relative to the array.
        coded: Values of a polynomial in few bytes.
    """

    kind: str
    nodes: Array
    entries: dict[str, IntArray]
    values: dict[str, Array]
    error: float = 0.0
    coded: Coded | None = None


@dataclass(frozen=True)
class Changes:
    """Sliders that work, with what they do; and those that do not, with the reason.

    Attributes:
        pattern: Entries that the tables have to have, see `pinflex.browser.recipe`.
    """

    sliders: tuple[Slider, ...]
    changes: dict[str, Change]
    pattern: dict[str, IntArray]
    left_out: dict[str, str] = field(default_factory=dict)


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, dict):
        return {key: _times(x, factor) for key, x in value.items()}
    if isinstance(value, list | tuple):
        return [_times(x, factor) for x in value]
    return value * factor if isinstance(value, float | int) else value


def proposed(mechanism: Mechanism) -> list[Slider]:
    """Sliders that a scene may have, from its YAML."""
    raw = mechanism.description.blocks()
    moved = [*_speed(raw), *_shaper(mechanism, raw)]
    return [*_payload(mechanism), *moved, *_damping(raw), *_gears(raw), *_sections(mechanism, raw)]


def _payload(mechanism: Mechanism) -> list[Slider]:
    """A point mass at the platform: inertia there, and its weight as a force."""
    description = mechanism.description
    at, g = description.platform, [float(x) for x in description.gravity]
    if not at:
        return []
    mass: dict[str, Any] = {"at": at, "mass": [1.0, 1.0, 1.0]}
    made_by: list[tuple[str, Any, int]] = [(f"added_masses.{PAYLOAD}", mass, 1)]
    if any(g):
        made_by.append((f"forces.{PAYLOAD}", {"at": at, "force": g}, 1))
    keys = [(PAYLOAD, {"at": at, "mass": 1.0}, 1)]
    if description.payload is not None:  # this one comes on top of it
        keys = made_by
    whole = sum(float(body.mass) for body in mechanism.rigid.rigid.inertias)
    whole = whole or sum(float(part.mass) for part in mechanism.parts.values())
    if not whole:
        return []
    ends = 0.0, _round(_SHARE * whole), 0.0
    return [Slider(PAYLOAD, "payload", "kg", *ends, tuple(keys), made_by=tuple(made_by))]


def _round(x: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above a positive number."""
    power = 10.0 ** np.floor(np.log10(x))
    return float(max(k for k in (1, 2, 5) if k * power <= x * (1 + 1e-9) or k == 1) * power)


_TIMES, _RATES = ("duration", "ramp", "start", "smooth"), ("omega", "frequency", "speed")


def _speed(raw: dict[str, Any]) -> list[Slider]:
    motion, solve = raw.get("motion"), raw.get("solve") or {}
    if not isinstance(motion, dict):
        return []
    keys = [(f"motion.{k}", float(motion[k]), -1) for k in _TIMES if _is_number(motion.get(k))]
    keys += [(f"motion.{k}", float(motion[k]), 1) for k in _RATES if _is_number(motion.get(k))]
    if _is_number(solve.get("until")):
        keys.append(("solve.until", float(solve["until"]), -1))
    if not any(key.startswith("motion.") for key, _, _ in keys):
        return []
    return [Slider("speed", "speed of the move", TIMES, 0.5, 2.0, 1.0, tuple(keys), acts="time")]


def _shaper(mechanism: Mechanism, raw: dict[str, Any]) -> list[Slider]:
    """An input shaper for the mode that a move to a stop excites most, on or off.

    Its frequency is that of the scene as it is written: other sliders leave it, but speed, which
    stretches it with the move.
    """
    block = raw.get("motion")
    if not isinstance(block, dict) or "shaper" in block:
        return []
    motion = default_motion(mechanism)
    v = motion.evaluate(np.linspace(0.0, motion.duration, 101))[1]
    if not np.any(v) or np.abs(v[[0, -1]]).max() > 1e-6 * np.abs(v).max():
        return []  # no move from rest to rest
    try:
        found = ringing(mechanism, motion, 1)
    except PinflexError:
        return []
    numbers = {"frequencies": found.frequencies, "damping": found.damping}
    value: dict[str, Any] = {"kind": "zvd"}
    value |= {key: [float(f"{x:.4g}") for x in array] for key, array in numbers.items()}
    keys = (("motion.shaper", value, 0),)
    return [Slider("shaper", "input shaper", "Hz", 0.0, 1.0, 0.0, keys, acts="motion")]


def _damping(raw: dict[str, Any]) -> list[Slider]:
    block = raw.get("damping")
    keys: list[tuple[str, Any, int]] = []
    if isinstance(block, dict) and any(block.get("rayleigh") or ()):
        keys.append(("damping.rayleigh", [float(x) for x in block["rayleigh"]], 1))
    if isinstance(block, dict) and block.get("modal"):
        keys.append(("damping.modal", float(block["modal"]), 1))
    return [Slider("damping", "damping", TIMES, 0.2, 5.0, 1.0, tuple(keys))] if keys else []


def _gears(raw: dict[str, Any]) -> list[Slider]:
    joints = raw.get("joints")
    blocks = joints.items() if isinstance(joints, dict) else ()
    keys = [
        (f"joints.{name}.drive.stiffness", float(block["drive"]["stiffness"]), 1)
        for name, block in blocks
        if isinstance(block, dict)
        and isinstance(block.get("drive"), dict)
        and _is_number(block["drive"].get("stiffness"))
    ]
    return [Slider("gear", "gear stiffness", TIMES, 0.3, 3.0, 1.0, tuple(keys))] if keys else []


def _sections(mechanism: Mechanism, raw: dict[str, Any]) -> list[Slider]:
    """The wall or thickness of the sections of each block of flexible links."""
    links, found = raw.get("flexible"), list[Slider]()
    for name, block in (links or {}).items() if isinstance(links, dict) else ():
        section = block.get("section") if isinstance(block, dict) else None
        for key in ("wall", "thickness"):
            if isinstance(section, dict) and _is_number(section.get(key)):
                value = float(section[key])
                keys = ((f"flexible.{name}.section.{key}", value, 1),)
                called, label = (f"{key} of {x}" for x in (name, _spanned(name, mechanism.parts)))
                ends = 0.7, 1.4, 1.0
                found.append(Slider(called, label, "mm", *ends, keys, 1e3 * value, "section"))
                break
    return found


def _spanned(key: str, links: Iterable[str]) -> str:
    """Links of a key of `flexible` by the first and the last: arm_1–3 of arm_?."""
    parts = [part.strip() for part in key.split(",")]
    some = [link for link in links if any(fnmatchcase(link, part) for part in parts)]
    if len(some) < 2:
        return key
    alike = next((k for k, x in enumerate(zip(*some, strict=False)) if len(set(x)) > 1), 0)
    return f"{some[0]}\u2013{some[-1][alike:]}"


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def changes(
    description: Description,
    sliders: Sequence[Slider],
    tables: Callable[[Mechanism], Tables],
    base: Sequence[str],
) -> Changes:
    """What sliders do to the tables of a scene, whose other overrides are `base`."""
    known: dict[tuple[str, float], Tables] = {}
    left, usable = dict[str, str](), list[Slider]()

    def plain(slider: Slider, p: float) -> Tables:
        if (slider.name, p) not in known:
            changed = load(description, [*base, *slider.for_tables(p)])
            known[slider.name, p] = tables(changed)
        return known[slider.name, p]

    def fitting(slider: Slider) -> tuple[Slider, list[Tables]] | None:
        own = [plain(slider, p) for p in _places(slider)]
        pattern = pattern_of([*seen, *own])
        if pattern is None:
            return None
        if slider.acts != "section":
            return slider, own
        wide = {p: widened(x, pattern) for p, x in zip(_places(slider), own, strict=True)}
        return (slider, own) if _polynomial(slider, wide).error <= _BEYOND else None

    seen = [tables(load(description, base))]
    for slider in sliders:
        try:
            found = next(filter(None, (fitting(x) for x in _ranges(slider))), None)
        except PinflexError as error:
            left[slider.label] = str(error)
            continue
        if found is None:
            left[slider.label] = "it changes how the model is built"
            continue
        usable.append(found[0])
        seen += found[1]
    pattern = pattern_of(seen)
    assert pattern is not None  # of those that fit, which the first alone does

    def at(slider: Slider, p: float) -> Tables:
        return widened(plain(slider, p), pattern)

    works, done = list[Slider](), dict[str, Change]()
    for slider in usable:
        change = None if slider.acts in _MOTION else _change(slider, at)
        if change is None:
            works.append(slider)
        elif change.error > _BEYOND:
            left[slider.label] = f"tables between those made are off by {change.error:.1g}"
        elif change.entries:
            works.append(slider)
            done[slider.name] = change
    room = float(_MOST)
    for slider in sorted(works, key=lambda x: done[x.name].error if x.name in done else 0.0):
        change = done.get(slider.name)
        size = change.coded.size if change is not None and change.coded is not None else 0.0
        if size > room:
            works.remove(slider)
            del done[slider.name]
            left[slider.label] = f"the page would grow by {1e-3 * size:.0f} kB more"
        else:
            room -= size
    return Changes(tuple(works), done, pattern, left)


def _ranges(slider: Slider) -> list[Slider]:
    """A slider, and if it is of a section, its thinner and its thicker part.

    What of a link's mass in the URDF a section does not carry is added to it: a heavier section may
    leave nothing, and the model is built without.
    """
    if slider.acts != "section":
        return [slider]
    return [slider, replace(slider, high=slider.value), replace(slider, low=slider.value)]


def _places(slider: Slider) -> list[float]:
    """Values of a slider at which tables are made."""
    if slider.acts in _MOTION:
        return []
    if slider.acts == "section":
        return [*_nodes(slider).tolist(), *_between(_nodes(slider)).tolist()]
    low = slider.low or 0.1 * slider.high
    return [low, 0.5 * (low + slider.high), slider.high]


def _nodes(slider: Slider) -> Array:
    """Chebyshev points of the second kind in its range, shape (nodes,)."""
    angles = np.pi * np.arange(_NODES) / (_NODES - 1)
    middle, half = 0.5 * (slider.low + slider.high), 0.5 * (slider.high - slider.low)
    return np.asarray(middle - half * np.cos(angles))


def _between(nodes: Array) -> Array:
    """Places where a polynomial through the nodes is judged."""
    return np.asarray(0.5 * (nodes[1:] + nodes[:-1]))


def _change(slider: Slider, at: Callable[[Slider, float], Tables]) -> Change:
    if slider.acts == "section":
        return _polynomial(slider, {p: at(slider, p) for p in _places(slider)})
    low, middle, high = _places(slider)
    first, half, last = (at(slider, p) for p in (low, middle, high))
    moved = {
        name: np.flatnonzero((first[name] != last[name]) | (first[name] != half[name]))
        for name in first
    }
    moved = {name: entries for name, entries in moved.items() if len(entries)}
    slopes = {n: (last[n][e] - first[n][e]) / (high - low) for n, e in moved.items()}
    off = [_off(half[n][e], first[n][e] + slopes[n] * (middle - low), last[n])
           for n, e in moved.items()]  # fmt: skip
    error = max(off, default=0.0)
    error = error if error > _STRAIGHT else 0.0
    through = [_off(first[n][e], slopes[n] * low, last[n]) for n, e in moved.items()]
    if max(through, default=0.0) < _STRAIGHT and slider.value:
        return Change("factor", np.zeros(0), moved, {n: np.zeros(0) for n in moved}, error)
    origin = {n: first[n][e] - slopes[n] * low for n, e in moved.items()}
    values = {n: np.concatenate([origin[n], slopes[n]]) for n in moved}
    return Change("line", np.zeros(0), moved, values, error)


def _polynomial(slider: Slider, tables: Mapping[float, Tables]) -> Change:
    """Of tables by place, which are of one pattern."""
    nodes = _nodes(slider)
    between = _between(nodes)
    found, wanted = ([tables[float(p)] for p in some] for some in (nodes, between))
    weights = np.where(np.arange(_NODES) % 2, -1.0, 1.0)
    weights[[0, -1]] *= 0.5
    W = weights / (between[:, None] - nodes)
    W /= W.sum(axis=1, keepdims=True)
    every = {name: np.array([x[name] for x in found]) for name in found[0]}
    entries = {
        name: np.flatnonzero(np.ptp(x, axis=0) > _NOTHING * np.abs(x).max(initial=0.0))
        for name, x in every.items()
    }
    entries = {name: e for name, e in entries.items() if len(e)}
    if not entries:
        return Change("polynomial", nodes, {}, {})
    # The page adds differences, which are small: fewer digits are enough.
    apart = [every[name][:, e] - every[name][0, e] for name, e in entries.items()]
    digits = [_DIGITS_OF.get(name.split("/")[-1], _DIGITS) for name in entries]
    counts = [len(e) for e in entries.values()]
    coded = _coded(np.concatenate(apart, axis=1), np.repeat(digits, counts))
    values = np.split(coded.values, np.cumsum(counts)[:-1], axis=1)
    error = 0.0
    for (name, e), made in zip(entries.items(), values, strict=True):
        missed = W @ made - (np.array([x[name][e] for x in wanted]) - every[name][0, e])
        error = max(error, _off(missed, 0.0 * missed, every[name]))
    flat = {name: made.ravel() for name, made in zip(entries, values, strict=True)}
    return Change("polynomial", nodes, entries, flat, _SAFE * error, coded)


def _off(a: Array, b: Array, of: Array) -> float:
    size = float(np.abs(of).max(initial=0.0))
    return float(np.abs(a - b).max(initial=0.0)) / size if size else 0.0
