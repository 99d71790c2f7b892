"""Guesses of flexible links for a robot that nobody prepared: which links, and their sections.

A section is guessed from what the link looks like across the middle of its span; a wall is not to
be seen, so that it is a tenth of the diameter. Every guess is to be replaced.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import yaml

from pinflex.arrays import Array
from pinflex.description.flexible import FlexibleLink
from pinflex.description.material import MATERIALS
from pinflex.description.section import Section
from pinflex.errors import PinflexError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.mechanics.span import beam_frame
from pinflex.mechanics.tree import Link
from pinflex.results.drawing import drawing_of, urdf_parts
from pinflex.viewer.surfaces import Surface, surfaces_of

_ALIKE = 0.2  # share by which two widths may differ and be those of a tube
_SLENDER = 1 / 3  # of the span: the widest that a section is guessed
_THIN = 1 / 20  # of the span: a diameter where nothing is drawn
_WALL = 0.1  # of the diameter
_MIDDLE = (0.3, 0.7)  # part of the span that is looked at
_SHORT = 0.1  # of the longest span: shorter links are no candidates
_MOST = 8  # candidates
_HERE = 1e-6  # m
_SEEN = 1e-3  # of the span: a drawing that is thinner says nothing


@dataclass(frozen=True)
class Guess:
    """A link that may bend.

    Attributes:
        link: Its name. length: Span [m].
        values: Its block under `flexible`, as YAML.
        why: Where the section is from.
    """

    link: str
    length: float
    values: str
    why: str


def candidates(mechanism: Mechanism, only: tuple[str, ...] = ()) -> list[Guess]:
    """Links with mass and a span, longest first, each of which loads with its guess."""
    description = mechanism.description
    visuals = drawing_of({"drawing": urdf_parts(description.urdf_text)}).visuals
    looks, _ = surfaces_of(visuals, description.package_dirs)
    spans = _spans(mechanism)
    longest = max((length for _, length, _ in spans.values()), default=0.0)
    found: list[Guess] = []
    for name in sorted(spans, key=lambda link: -spans[link][1]):
        end, length, frame = spans[name]
        wanted = name in only if only else length > _SHORT * longest and len(found) < _MOST
        if wanted:
            made = _guess(mechanism, name, end, length, _widths(looks.get(name), frame, length))
            found += [made] if made is not None else []
    return found


def _spans(mechanism: Mechanism) -> dict[str, tuple[str | None, float, Array]]:
    """Far frame (None: the only one), length and beam frame of each link with mass."""
    links = mechanism.links
    closing = {*mechanism.description.tied}
    found = {}
    for number, link in enumerate(links):
        ends = _ends(number, links, closing) if link.parent >= 0 and link.weighs else []
        far = max(ends, key=lambda end: float(np.linalg.norm(end[1])), default=None)
        if far is None or np.linalg.norm(far[1]) < _HERE:
            continue
        spec = FlexibleLink(link.name, MATERIALS["aluminium"], Section.circle(1.0))
        frame, length = beam_frame("", spec, link, np.zeros(3), far[1])
        name = None if len(ends) == 1 and far[2] else far[0]
        found[link.name] = (name, length, np.array(frame.homogeneous))
    return found


def _ends(number: int, links: Sequence[Link], closing: set[str]) -> list[tuple[str, Array, bool]]:
    """Frames on a link that carry something: name, place in the link, whether it is a joint."""
    found = []
    for link in links:
        place, above = link.placement, link.parent
        if not (link.steps or link.name in closing):
            continue
        while above >= 0 and above != number and not links[above].steps:
            place, above = links[above].placement * place, links[above].parent
        if above == number:
            found.append((link.name, np.array(place.translation), bool(link.steps)))
    return found


def _widths(look: Surface | None, frame: Array, length: float) -> tuple[float, float] | None:
    """Extent along beam y and z in the middle of the span [m]; None where nothing is drawn."""
    if look is None:
        return None
    points = (look.vertices - frame[:3, 3]) @ frame[:3, :3]
    corners = points[look.faces]  # a long triangle has no corner in the middle
    low, high = corners[..., 0].min(axis=1), corners[..., 0].max(axis=1)
    middle = (low < _MIDDLE[1] * length) & (high > _MIDDLE[0] * length)
    if not middle.any():
        return None
    seen = corners[middle].reshape(-1, 3)
    y, z = np.ptp(seen[:, 1]), np.ptp(seen[:, 2])
    return (float(y), float(z)) if min(y, z) > _SEEN * length else None


def _section(widths: tuple[float, float] | None, length: float) -> tuple[str, str]:
    """The block `section`, and where it is from."""
    if widths is None:
        d = _digits(_THIN * length)
        return _tube(d), "nothing is drawn there: a twentieth of the length"
    y, z = (min(w, _SLENDER * length) for w in widths)
    if abs(y - z) <= _ALIKE * max(y, z):
        return _tube(_digits((y + z) / 2)), "the width of the drawing at the middle of the span"
    text = f"{{shape: rectangle, width: {_digits(z)}, thickness: {_digits(y)}}}"
    return text, "the two widths of the drawing at the middle of the span, full"


def _tube(diameter: float) -> str:
    return f"{{shape: tube, diameter: {diameter}, wall: {_digits(_WALL * diameter)}}}"


def _digits(value: float) -> float:
    return float(f"{value:.3g}")


def _guess(
    mechanism: Mechanism, name: str, end: str | None, length: float,
    widths: tuple[float, float] | None,
) -> Guess | None:  # fmt: skip
    """The block of a link as the robot loads with it; None where it loads with none."""
    section, why = _section(widths, length)
    values = [f"end: {quoted(end)}"] if end is not None else []
    values += ["material: aluminium", f"section: {section}"]
    for more in ([], ["inertia: beam"]):
        text = f"{{{', '.join([*values, *more])}}}"
        raw = yaml.safe_load(text)
        try:
            load(mechanism.description.with_overrides([f"flexible={json.dumps({name: raw})}"]))
        except PinflexError:
            continue
        return Guess(name, length, text, why)
    return None


def quoted(name: str) -> str:
    """A name as YAML takes it for a text."""
    return str(yaml.safe_dump(name, allow_unicode=True, width=10**6)).splitlines()[0]
