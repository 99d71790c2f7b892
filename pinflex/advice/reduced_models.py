"""A scene with more shapes than it was given, and with fewer: planes, modes, rigid links.

The richer model is what errors are measured against; a smaller one is a subspace of it, so that
leaving something out costs one cheap march (pinflex.advice.probe) and no new model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinflex.advice.probe import Probe
from pinflex.advice.subspace import shapes_of
from pinflex.description.blocks import solid_keys
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.errors import ConvergenceError, DescriptionError, PinflexError
from pinflex.integrators.run import Run
from pinflex.levels.outputs import Outputs
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.cost import per_body
from pinflex.mechanics.model.parts import FlexiblePart, resolve

Errors = dict[str, float]
Changes = dict[str, dict[str, int] | None]  # of keys of links; None: the link is rigid
SAFETY = 2.0  # an error bar is this many times what was measured
LARGEST = 150  # elastic coordinates: a richer model than this would not be a cheap look
PLANES = {
    "u": ("axial", "stretch (axial)"),
    "p": ("torsion", "twist (torsion)"),
    "w": ("bending_z", "bending out of the joint's plane (bending_z)"),
    "v": ("bending_y", "bending in the joint's plane (bending_y)"),
}
TERMS: tuple[tuple[str, ...], ...] = (("second_order",), ("shear", "rotary_inertia"))
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


def richer(mechanism: Mechanism) -> tuple[Mechanism, str]:
    """The scene with every plane, stretch, twist, term and a mode more; or itself, and why."""
    changes: list[str] = []
    for part in beams(mechanism):
        changes += [f"flexible.{part.link}.{key}=true" for key, _ in PLANES.values()]
        if (size := _size(part)) is not None:
            changes.append(f"flexible.{part.link}.basis.{size[0]}={size[1] + 1}")
    said = ""
    for terms in (TERMS, TERMS[:1]):  # not every basis takes shear
        more = [f"flexible.{p.link}.{key}=true" for p in beams(mechanism) for key in sum(terms, ())]
        try:
            rich, n = enlarged(mechanism, [*changes, *more])
            if rich is not None:
                return rich, ""
            said = f"that model has {n} coordinates"
        except PinflexError as failed:
            said = str(failed)
    return mechanism, f"planes and modes were not tried: {said}"


def enlarged(mechanism: Mechanism, changes: list[str]) -> tuple[Mechanism | None, int]:
    """The scene with changes, None where a look at it would not be cheap; elastic coordinates."""
    description = mechanism.description.with_overrides(changes)
    n = sum(_least(mechanism, spec) for spec in description.flexible)  # before bodies are made
    if n <= LARGEST:
        parts = resolve(description, mechanism.links)
        n = sum(body.n for part in parts.values() for body in part.bodies)
    return mechanism.described(description) if n <= LARGEST else None, n


def _least(mechanism: Mechanism, spec: FlexibleLink) -> int:
    """Elastic coordinates that a link has at the least."""
    if spec.basis.kind in solid_keys.KINDS:
        return 0
    before = mechanism.parts[spec.link].planes
    keys = ((d, getattr(spec, key)) for d, (key, _) in PLANES.items())
    return per_body(spec, [d for d, on in keys if on is True or d in before])[0] * spec.segments


def smaller(
    rich: Mechanism,
    probe: Probe,
    outputs: Outputs,
    whole: Run,
    room: float,
    used: Callable[[Errors], float],
    loaded: Mechanism,
) -> Smaller:
    """Leave out whatever keeps the error bar of all that is left out within `room`."""
    kept = Smaller(dict(rich.parts), probe.system.n_eta, {}, (), {})
    before, tried, unsettled, needed = whole, [], {}, False
    accepted: Changes = {}
    for what, more, mode in _candidates(rich, loaded):
        if mode is not None and mode > 0 and needed:
            continue  # where three modes are needed, two will not do
        changes = _together(accepted, more)
        found = _without(rich, probe, kept.parts, changes)
        if found is None or found[1] == kept.coordinates:
            continue
        parts, n, run = found
        error, own = (_output_differences(outputs, run, other) for other in (whole, before))
        out = SAFETY * used(error) <= room
        tried.append(LeftOut(what, own, out))
        if mode is not None:
            needed = not out
            if mode == 0 and needed:
                unsettled = own
        if out:
            kept, before = Smaller(parts, n, error, (), {}), run
            accepted |= changes
    return replace(kept, tried=tuple(tried), unsettled=unsettled)


def _output_differences(outputs: Outputs, run: Run, other: Run) -> Errors:
    """Differences of the outputs asked for: where all are zero, joints would be told too."""
    found = outputs.differences(run, other)
    return {key: e for key, e in found.items() if not key.startswith("joint ")} or found


def _without(
    rich: Mechanism, probe: Probe, parts: Mapping[str, FlexiblePart], changes: Changes
) -> tuple[dict[str, FlexiblePart], int, Run] | None:
    """Parts, coordinates and motion with links changed, or None where that is no model."""
    kept = {link: part for link, part in parts.items() if changes.get(link, {}) is not None}
    specs = [_edited(x, changes[x.link]) for x in rich.description.flexible if x.link in changes]
    wanted = rich.description.replace(flexible=tuple(x for x in specs if x.link in kept))
    try:
        kept |= resolve(wanted, rich.links)
        n = sum(body.n for part in kept.values() for body in part.bodies)
        if not n:
            return None
        n += len(rich.flexible.expansion.drives)
        shapes = shapes_of(rich.flexible, kept)
        _, fewer = probe.marched(1, shapes)
    except (DescriptionError, ConvergenceError, np.linalg.LinAlgError):
        return None
    return kept, n, probe.nonlinear(fewer)


def _edited(spec: FlexibleLink, changes: dict[str, int] | None) -> FlexibleLink:
    """A link with other values of keys of its own or of its basis.

    Shapes do not depend on what mass the URDF leaves to the beam: it is not asked for.
    """
    spec = replace(spec, inertia="beam")
    for key, value in (changes or {}).items():
        named: dict[str, Any] = {key: value}
        of_basis = key in ("internal", "modes")
        named = {"basis": replace(spec.basis, **named)} if of_basis else {key: bool(value)}
        spec = replace(spec, **named)
    return spec


def _together(before: Changes, more: Changes) -> Changes:
    """The changes `more` of links, each with those that it had before."""
    return {
        link: None if new is None else (before.get(link) or {}) | new for link, new in more.items()
    }


def _candidates(rich: Mechanism, loaded: Mechanism) -> Iterator[tuple[str, Changes, int | None]]:
    """Words, changes of links, and for modes the how manyth this is: likeliest first."""
    links_of = beams(rich)
    for d, (key, words) in PLANES.items():
        having = [p.link for p in links_of if d in p.planes]
        added = [link for link in having if d not in loaded.parts[link].planes]
        if added and added != having:
            yield f"{words} of {', '.join(added)}", {link: {key: False} for link in added}, None
        yield words, {link: {key: False} for link in having}, None
    sizes = [(p.link, size, _MODES[p.spec.basis.kind][1]) for p in links_of if (size := _size(p))]
    most = max((size[1] for _, size, _ in sizes), default=0)
    for place, count in enumerate(range(most - 1, -1, -1)):
        fewer: Changes = {
            link: {key: count} for link, (key, n), least in sizes if n > count >= least
        }
        yield f"modes beyond {count} of each link and plane", fewer, place
    alike: dict[str, list[str]] = {}
    for part in rich.parts.values():
        stem = "".join(c for c in part.link if not c.isdigit())
        alike.setdefault(f"{stem} {replace(part.spec, link='')}", []).append(part.link)
    for links in alike.values():
        rigid: Changes = dict.fromkeys(links)
        yield f"all deformation of {', '.join(links)}", rigid, None


def overrides(mechanism: Mechanism, parts: Mapping[str, FlexiblePart]) -> tuple[str, ...]:
    """Changes of the YAML that turn a mechanism's links into `parts`; equal ones by a glob."""
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


def without(mechanism: Mechanism, rich: Mechanism, keys: tuple[str, ...]) -> list[tuple[str, str]]:
    """Links and terms of beams that the richer model has and the scene's own has not."""
    specs = [(p.link, p.spec, rich.parts[p.link].spec) for p in beams(mechanism)]
    every = ((link, key, own, more) for link, own, more in specs for key in keys)
    return [
        (link, key)
        for link, key, own, more in every
        if getattr(more, key) and not getattr(own, key)
    ]


def added(mechanism: Mechanism, terms: list[tuple[str, str]]) -> tuple[str, ...]:
    """Changes of the YAML that give terms to links, by a glob where to all."""
    changes: list[str] = []
    for key in dict.fromkeys(key for _, key in terms):
        links = [link for link, own in terms if own == key]
        every = len(links) == len(mechanism.parts)
        changes += [f"flexible.{link}.{key}=true" for link in (["*"] if every else links)]
    return tuple(changes)


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
