"""The scene with more in it than it has: what the error of a model is measured against."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from pinflex.advice.reduced_models import PLANES, beams, enlarged
from pinflex.description import solid_keys
from pinflex.errors import DescriptionError, PinflexError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.parts import FlexiblePart

_WORDS = {0: "more modes", 1: "one more segment"}
_THICK = ("shear", "rotary_inertia")
_CELLS = 0.6  # of their length: two thirds of an error of second order go, for 5 times the cells
_MORE_MODES = 6  # of a solid: the next six tell what all others leave, to a third


def finer_model(mechanism: Mechanism) -> tuple[Mechanism, str]:
    """The scene with all deformations, second order and twice the segments; and what that is.

    Of solids with more modes, and with shorter cells where pinflex makes the mesh.

    Raises:
        DescriptionError: There is no such model.
    """
    failed: PinflexError | None = None
    for changes, words in _richer(mechanism):
        try:
            more, n = enlarged(mechanism, changes)
            if more is not None:
                return more, f"{words}: {n} coordinates"
        except PinflexError as error:
            failed = error
    raise failed or DescriptionError("a richer model is too large")


def _richer(mechanism: Mechanism) -> Iterator[tuple[list[str], str]]:
    """Changes of the YAML and what they are: from the richest on to what most scenes can take."""
    cut, solid = beams(mechanism), solids(mechanism)
    own, words = _of_solids(solid)
    if not cut:
        yield own, words
        return
    # Shapes that move at the root, under a sleeve, take one segment only.
    most = max(part.spec.segments for part in cut)  # twice as many, else one more, else none
    rungs = [(more, True) for more in sorted({most, 1, 0}, reverse=True)]
    if all(map(_more_shapes, cut)):
        rungs.append((0, False))  # where all planes with all modes would be too much
    for (more, planes), thick in itertools.product(rungs, (True, False)):
        changes = list(own)
        for part in cut:
            at = f"flexible.{part.link}"
            changes += [f"{at}.{key}=true" for key, _ in PLANES.values() if planes]
            added = min(more, part.spec.segments)
            changes += [f"{at}.second_order=true", f"{at}.segments={part.spec.segments + added}"]
            changes += [f"{at}.{key}=true" for key in _THICK] if thick else []
            changes += [] if more else _more_shapes(part)
        said = [words, _WORDS.get(more, "twice the segments"), "second order"]
        said[-1] += ", stretch and twist" if planes else " in the planes that it has"
        yield changes, ", ".join(filter(None, [*said, "shear and rotary inertia" if thick else ""]))


def _more_shapes(part: FlexiblePart) -> list[str]:
    """A richer basis of one segment: half as many modes more where these converge slowly."""
    basis, at = part.spec.basis, f"flexible.{part.link}.basis"
    if basis.kind == "craig_bampton":
        return [f"{at}.internal={basis.internal + 1}"]
    if basis.kind == "assumed":
        return [f"{at}.modes={basis.modes + max(1, basis.modes // 2)}"]
    return []


def solids(mechanism: Mechanism) -> list[FlexiblePart]:
    """The links of meshes and matrices."""
    return [p for p in mechanism.parts.values() if p.spec.basis.kind in solid_keys.KINDS]


def _of_solids(found: list[FlexiblePart]) -> tuple[list[str], str]:
    """Changes that refine solids, and what they are."""
    changes, meshed = [], []
    for part in found:
        basis, at = part.spec.basis, f"flexible.{part.link}.basis"
        changes.append(f"{at}.modes={basis.modes + _MORE_MODES}")
        if basis.rod:
            size = basis.size or min(d for d, _ in basis.rod)
            changes.append(f"{at}.size={_CELLS * size!r}")
            meshed.append(part.link)
    if not found:
        return changes, ""
    if len(meshed) == len(found):
        return (
            changes,
            f"cells of {_CELLS:g} of the length and {_MORE_MODES} more modes of each solid",
        )
    return changes, f"{_MORE_MODES} more modes of each solid (meshes of a file as they are)"
