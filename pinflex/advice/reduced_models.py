"""A scene with more shapes than it was given, and with fewer: planes, modes, rigid links.

The richer model is what errors are measured against; a smaller one is a subspace of it, so that
leaving something out costs one cheap march (pinflex.advice.probe) and no new model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinflex.advice.probe import Probe
from pinflex.advice.subspace import shapes_of
from pinflex.description import solid_keys
from pinflex.errors import ConvergenceError, DescriptionError, PinflexError
from pinflex.integrators.run import Run
from pinflex.levels.outputs import Outputs
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.parts import FlexiblePart, resolve

Errors = dict[str, float]
SAFETY = 2.0  # an error bar is this many times what was measured
LARGEST = 150  # elastic coordinates: a richer model than this would not be a cheap look
PLANES = {
    "u": ("axial", "stretch (axial)"),
    "p": ("torsion", "twist (torsion)"),
    "w": ("bending_z", "bending out of the joint's plane (bending_z)"),
    "v": ("bending_y", "bending in the joint's plane (bending_y)"),
}
_MODES = {"craig_bampton": ("internal", 0), "assumed": ("modes", 1)}  # key, least number


@dataclass(frozen=True)
class LeftOut:
    """Something tried: what it is, its measured error by output, and whether it may stay out."""

    what: str
    error: Errors
    out: bool


@dataclass(frozen=True)
class Smaller:
    """A model with less in it.

    Attributes:
        parts: Its flexible links. coordinates: Number of its elastic coordinates.
        error: Of all that is left out together. tried: What was tried, in order.
        unsettled: Error of the one mode more that the richer model has, where it is needed.
    """

    parts: Mapping[str, FlexiblePart]
    coordinates: int
    error: Errors
    tried: tuple[LeftOut, ...]
    unsettled: Errors


def worst(error: Errors) -> float:
    """The largest of some errors."""
    return max(error.values(), default=0.0)


def richer(mechanism: Mechanism) -> tuple[Mechanism, str]:
    """The scene with every plane, stretch, twist, second order, a mode more; or itself, and why."""
    changes = []
    for part in beams(mechanism):
        changes += [f"flexible.{part.link}.{key}=true" for key, _ in PLANES.values()]
        changes.append(f"flexible.{part.link}.second_order=true")
        if (size := _size(part)) is not None:
            changes.append(f"flexible.{part.link}.basis.{size[0]}={size[1] + 1}")
    try:
        description = mechanism.description.with_overrides(changes)
        parts = resolve(description, mechanism.links)
        n = sum(body.n for part in parts.values() for body in part.bodies)
        if n > LARGEST:
            return mechanism, f"planes and modes were not tried: that model has {n} coordinates"
        return load(description), ""
    except PinflexError as failed:
        return mechanism, f"planes and modes were not tried: {failed}"


def smaller(rich: Mechanism, probe: Probe, outputs: Outputs, whole: Run, room: float) -> Smaller:
    """Leave out whatever keeps the error bar of all that is left out within `room`.

    Args:
        rich: The model with everything. probe: Its probe. outputs: What errors are of.
        whole: Its motion, corrected once as those of the smaller ones are.
        room: Largest error bar.
    """
    changes: tuple[str, ...] = ()
    kept = Smaller(dict(rich.parts), probe.system.n_eta, {}, (), {})
    before, tried, unsettled, needed = whole, [], {}, False
    for what, more, mode in _candidates(rich):
        if mode is not None and mode > 0 and needed:
            continue  # where three modes are needed, two will not do
        found = _without(rich, probe, (*changes, *more))
        if found is None or found[1] == kept.coordinates:
            continue
        parts, n, run = found
        error, own = outputs.differences(run, whole), outputs.differences(run, before)
        out = SAFETY * worst(error) <= room
        tried.append(LeftOut(what, own, out))
        if mode is not None:
            needed = not out
            if mode == 0 and needed:
                unsettled = own
        if out:
            kept, before = Smaller(parts, n, error, (), {}), run
            changes = (*changes, *more)
    return replace(kept, tried=tuple(tried), unsettled=unsettled)


def _without(
    rich: Mechanism, probe: Probe, changes: tuple[str, ...]
) -> tuple[dict[str, FlexiblePart], int, Run] | None:
    """Parts, coordinates and motion with the YAML changed, or None where that is no model."""
    try:
        parts = resolve(rich.description.with_overrides(changes), rich.links)
        n = sum(body.n for part in parts.values() for body in part.bodies)
        if not n:
            return None
        n += len(rich.flexible.expansion.drives)
        shapes = shapes_of(rich.flexible, parts)
        fewer = probe.corrected(probe.march(shapes), shapes)
    except (DescriptionError, ConvergenceError, np.linalg.LinAlgError):
        return None
    return parts, n, probe.nonlinear(fewer)


def _candidates(rich: Mechanism) -> Iterator[tuple[str, tuple[str, ...], int | None]]:
    """Words, changes of the YAML, and for modes the how manyth this is: likeliest first."""
    links_of = beams(rich)
    for d, (key, words) in PLANES.items():
        yield (
            words,
            tuple(f"flexible.{p.link}.{key}=false" for p in links_of if d in p.planes),
            None,
        )
    sizes = [(p.link, size, _MODES[p.spec.basis.kind][1]) for p in links_of if (size := _size(p))]
    most = max((size[1] for _, size, _ in sizes), default=0)
    for place, count in enumerate(range(most - 1, -1, -1)):
        fewer = tuple(
            f"flexible.{link}.basis.{key}={count}"
            for link, (key, n), least in sizes
            if n > count >= least
        )
        yield f"modes beyond {count} of each link and plane", fewer, place
    alike: dict[str, list[str]] = {}
    for part in rich.parts.values():
        stem = "".join(c for c in part.link if not c.isdigit())
        alike.setdefault(f"{stem} {replace(part.spec, link='')}", []).append(part.link)
    for links in alike.values():
        rigid = tuple(f"flexible.{link}=null" for link in links)
        yield f"all deformation of {', '.join(links)}", rigid, None


def overrides(mechanism: Mechanism, parts: Mapping[str, FlexiblePart]) -> tuple[str, ...]:
    """Changes of the YAML that turn a mechanism's links into `parts`; equal ones by a glob.

    Args:
        mechanism: Mechanism.
        parts: Its flexible links as they should be, by name.
    """
    wanted: dict[str, dict[str, str]] = {}
    for link, old in mechanism.parts.items():
        if link not in parts:
            wanted.setdefault("", {})[link] = "null"
            continue
        new = parts[link]
        for d, (key, _) in PLANES.items():
            if (d in old.planes) != (d in new.planes):
                wanted.setdefault(f".{key}", {})[link] = "true" if d in new.planes else "false"
        size = _size(new)
        if size is not None and size != _size(old):
            wanted.setdefault(f".basis.{size[0]}", {})[link] = str(size[1])
    said: list[str] = []
    for key, values in wanted.items():
        if key and len(values) == len(mechanism.parts) and len(set(values.values())) == 1:
            said.append(f"flexible.*{key}={next(iter(values.values()))}")
        else:
            said += [f"flexible.{link}{key}={value}" for link, value in values.items()]
    return tuple(said)


def second_order(mechanism: Mechanism) -> tuple[str, ...]:
    """Changes of the YAML that give second-order terms to every link without them."""
    off = [p.link for p in beams(mechanism) if not p.spec.second_order]
    if len(off) == len(mechanism.parts):
        return ("flexible.*.second_order=true",)
    return tuple(f"flexible.{link}.second_order=true" for link in off)


def segmented(mechanism: Mechanism) -> tuple[str, ...]:
    """Changes of the YAML that give every beam one more segment."""
    counts = {p.link: p.spec.segments + 1 for p in beams(mechanism)}
    if len(counts) == len(mechanism.parts) and len(set(counts.values())) == 1:
        return (f"flexible.*.segments={next(iter(counts.values()))}",)
    return tuple(f"flexible.{link}.segments={n}" for link, n in counts.items())


def beams(mechanism: Mechanism) -> list[FlexiblePart]:
    """The links with planes: solids deform in every direction."""
    return [p for p in mechanism.parts.values() if p.spec.basis.kind not in solid_keys.KINDS]


def _size(part: FlexiblePart) -> tuple[str, int] | None:
    """The key of the YAML that says how many modes a link has, and how many it has."""
    if part.spec.basis.kind not in _MODES:
        return None
    key = _MODES[part.spec.basis.kind][0]
    return key, int(getattr(part.spec.basis, key))
