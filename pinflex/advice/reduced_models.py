"""A scene with more shapes than it was given, and with fewer: planes, modes, rigid links.

The richer model is what errors are measured against; a smaller one is a subspace of it, so that
leaving something out costs one cheap march (pinflex.advice.probe) and no new model.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf, isfinite
from typing import Any

import numpy as np

from pinflex.advice.probe import Probe, shapes_of
from pinflex.arrays import Array, distinct
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.errors import ConvergenceError, DescriptionError, PinflexError
from pinflex.integrators.problem import Run
from pinflex.levels.outputs import Outputs
from pinflex.mechanics.evaluation.compiled import per_body
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.parts import FlexiblePart, resolve
from pinflex.report import Block, Report, Reported, bullets, lines, table
from pinflex.results.verdict import BAND, criterion, rounded_length
from pinflex.text import frozen, percent

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
    """Something tried: what it is, its measured error by output, and whether it may stay out.

    Where some outputs show that it may not, only theirs.
    """

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
    if n > LARGEST:
        return None, n
    found = mechanism.described(description)
    n = sum(body.n for part in found.parts.values() for body in part.bodies)
    return found if n <= LARGEST else None, n


def _least(mechanism: Mechanism, spec: FlexibleLink) -> int:
    """Elastic coordinates that a link has at the least."""
    if spec.basis.solid:
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
    corrections: int = 1,
) -> Smaller:
    """Leave out whatever keeps the error bar of all that is left out within `room`.

    Motions are corrected as often as that of the `whole` was; what equilibria alone show to be
    needed is not marched.
    """
    kept = Smaller(dict(rich.parts), probe.system.n_eta, {}, (), {})
    before, tried, unsettled, settled = whole, [], {}, False
    accepted: Changes = {}
    still = _Equilibria(probe, outputs, whole)
    for what, more, count in _candidates(rich, loaded):
        if count is not None and settled:
            continue
        changes = _together(accepted, more)
        found = _without(rich, kept.parts, changes)
        if found is None or found[1] == kept.coordinates:
            continue
        parts, n, shapes = found
        own, out, last = dict[str, float](), False, count == _most(rich) - 1
        if not last:  # whose price of every output is asked for
            own = still.needed(shapes, lambda error: SAFETY * used(error) > _PLAINLY * room)
        if not own:
            try:
                run = probe.motion(corrections, shapes)
            except (ConvergenceError, np.linalg.LinAlgError):
                continue
            error, own = (_output_differences(outputs, run, other) for other in (whole, before))
            out = SAFETY * used(error) <= room
        tried.append(LeftOut(what, own, out))
        if count is not None:  # where three modes are needed, two will not do
            settled = out == (count == 0)
            if last and not out:
                unsettled = own
        if out:
            kept, before = Smaller(parts, n, error, (), {}), run
            accepted |= changes
            still.leave(shapes)
    return replace(kept, tried=tuple(tried), unsettled=unsettled)


_STILL = 21  # instants at which links are balanced: deflections follow the motion
# Times as much as there is room for: prices of equilibria alone are at most 1.72 times those with
# the vibration, and often far less (297 prices, of the scenes of tests/benchmarks/verdicts.py).
_PLAINLY = 2.5


class _Equilibria:
    """What leaving something out costs where nothing vibrates: a hundredth of a march."""

    def __init__(self, probe: Probe, outputs: Outputs, moved: Run) -> None:
        """Nothing is left out yet; `moved`: the run with its vibration, for its size."""
        some = np.linspace(0, probe.steps - 1, _STILL)
        self._probe, self._at = probe, distinct(some.astype(np.intp))
        self._outputs = outputs.at(self._at)
        self._whole = self._before = self._run(None)
        self._sizes = outputs.sizes(moved)

    def needed(self, shapes: Array, plainly: Callable[[Errors], bool]) -> Errors:
        """The price of having only these shapes, of outputs in which it is `plainly` too much."""
        run = self._run(shapes)
        if run is None or self._whole is None or self._before is None:
            return {}
        every, own = (self._prices(run, other) for other in (self._whole, self._before))
        return {key: own[key] for key, e in every.items() if plainly({key: e}) and key in own}

    def _prices(self, run: Run, other: Run) -> Errors:
        """Parts of the whole motion, which a resonance makes many times as large as at rest."""
        found, still = _output_differences(self._outputs, run, other), self._outputs.sizes(other)
        shares = {k: min(still[k] / self._sizes[k], 1.0) for k in still if self._sizes.get(k)}
        return {key: shares.get(key, 1.0) * e for key, e in found.items()}

    def leave(self, shapes: Array) -> None:
        """Hold what comes against these shapes."""
        self._before = self._run(shapes)

    def _run(self, shapes: Array | None) -> Run | None:
        try:
            return self._probe.still(self._at, shapes)
        except np.linalg.LinAlgError:  # nothing holds it there
            return None


def _output_differences(outputs: Outputs, run: Run, other: Run) -> Errors:
    """Differences of the outputs asked for: where all are zero, joints would be told too."""
    found = outputs.differences(run, other)
    return {key: e for key, e in found.items() if not key.startswith("joint ")} or found


def _without(
    rich: Mechanism, parts: Mapping[str, FlexiblePart], changes: Changes
) -> tuple[dict[str, FlexiblePart], int, Array] | None:
    """Parts, coordinates and shapes with links changed, or None where that is no model."""
    kept = {link: part for link, part in parts.items() if changes.get(link, {}) is not None}
    specs = [_edited(x, changes[x.link]) for x in rich.description.flexible if x.link in changes]
    wanted = rich.description.replace(flexible=tuple(x for x in specs if x.link in kept))
    try:
        kept |= resolve(wanted, rich.links)
    except DescriptionError:
        return None
    n = sum(body.n for part in kept.values() for body in part.bodies)
    if not n:
        return None
    return kept, n + len(rich.flexible.expansion.drives), shapes_of(rich.flexible, kept)


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


_BEYOND = "modes beyond"


def _most(rich: Mechanism) -> int:
    """The largest number of modes that a beam has in each plane."""
    return max((size[1] for part in beams(rich) if (size := _size(part))), default=0)


def _candidates(rich: Mechanism, loaded: Mechanism) -> Iterator[tuple[str, Changes, int | None]]:
    """Words, changes of links, and for modes how many are left: likeliest first.

    Of modes none at first: where that will do, no other number is asked for.
    """
    links_of = beams(rich)
    for d, (key, words) in PLANES.items():
        having = [p.link for p in links_of if d in p.planes]
        added = [link for link in having if d not in loaded.parts[link].planes]
        if added and added != having:
            yield f"{words} of {', '.join(added)}", {link: {key: False} for link in added}, None
        yield words, {link: {key: False} for link in having}, None
    sizes = [(p.link, size, _MODES[p.spec.basis.kind][1]) for p in links_of if (size := _size(p))]
    for count in sorted(range(_most(rich)), key=lambda n: (n > 0, -n)):
        fewer: Changes = {
            link: {key: count} for link, (key, n), least in sizes if n > count >= least
        }
        yield f"{_BEYOND} {count} of each link and plane", fewer, count
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
    return _written(mechanism, wanted)


def _written(mechanism: Mechanism, wanted: Mapping[str, Mapping[str, str]]) -> tuple[str, ...]:
    """Changes of the YAML: values of keys of links, by a glob where all links get the same."""
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
    """Changes of the YAML that give terms to links."""
    wanted: dict[str, dict[str, str]] = {}
    for link, key in terms:
        wanted.setdefault(f".{key}", {})[link] = "true"
    return _written(mechanism, wanted)


def segmented(mechanism: Mechanism) -> tuple[str, ...]:
    """Changes of the YAML that give every beam one more segment."""
    counts = {p.link: str(p.spec.segments + 1) for p in beams(mechanism)}
    return _written(mechanism, {".segments": counts})


def beams(mechanism: Mechanism) -> list[FlexiblePart]:
    """The links with planes: solids deform in every direction."""
    return [p for p in mechanism.parts.values() if not p.spec.basis.solid]


def _size(part: FlexiblePart) -> tuple[str, int] | None:
    """The key of the YAML that says how many modes a link has, and how many it has."""
    if part.spec.basis.kind not in _MODES:
        return None
    key = _MODES[part.spec.basis.kind][0]
    return key, int(getattr(part.spec.basis, key))


# The advice itself: a proposal and what it rests on.


def error_bar(e: float) -> str:
    """An error bar in words: beyond the whole output it says only that nothing is right."""
    return "over 100 %" if 1.0 < e < inf else percent(e)


@frozen
class Advice(Reported):
    """A proposal and what it rests on.

    Attributes:
        name: Of the scene. tol: Relative error that every output asked for may have.
        asked: Some of torque, deflection, platform.
        band: Distance of the platform that does no harm [m].
        allowed: Errors that may be, by output: more than `tol` where they are within the band.
        sizes: Of what the band decides, largest in the run [m | rad]: errors are shares of it.
        level: rigid, quasistatic, ked or coupled.
        run_tol: `solve.tol` of the run (levels quasistatic and coupled), or None.
        overrides: "key=value" changes of the YAML, for `load` or --set.
        error: Error bar of each output if the proposal is followed.
        levels: Error bar of each output at each level of the richer model.
        left_out: Planes, modes and links that were tried.
        coordinates: Elastic coordinates: as loaded, of the richer model, proposed.
        why: The reason for the level.
        notes: What weakens the advice.
        seconds: What it cost.
    """

    name: str
    tol: float
    asked: tuple[str, ...]
    level: str = "coupled"
    band: float = BAND
    allowed: Errors = field(default_factory=dict)
    sizes: Errors = field(default_factory=dict)
    run_tol: float | None = None
    overrides: tuple[str, ...] = ()
    error: Errors = field(default_factory=dict)
    levels: dict[str, Errors] = field(default_factory=dict)
    left_out: tuple[LeftOut, ...] = ()
    coordinates: tuple[int, int, int] = (0, 0, 0)
    why: str = ""
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    def used(self, error: Errors) -> float:
        """The largest error, each as a share of what is allowed."""
        return max((e / self.allowed.get(k, self.tol) for k, e in error.items()), default=0.0)

    def bar(self, output: str, error: float) -> str:
        """An error bar in words, of what the band decides as a length or an angle.

        Args:
            output: Such as "torque". error: Relative.
        """
        if output not in self.sizes or error == inf:
            return error_bar(error)
        said = rounded_length(error * self.sizes[output])
        return re.sub("m$", "rad", said) if output.endswith("rotation") else said

    def worst(self, error: Errors) -> str:
        """The bar that uses most of what is allowed; where the band decides, of which output."""
        output = max(error, key=lambda k: error[k] / self.allowed.get(k, self.tol), default="")
        said = self.bar(output, error.get(output, 0.0))
        return f"{said} ({output})" if self.sizes and output else said

    def as_report(self) -> Report:
        """Proposal, how to follow it, its error bars, and the price of what is left out."""
        return report(self)


# The report of an advice.

_DOES = {
    "rigid": "no link has to bend",
    "quasistatic": "links bend, but do not vibrate",
    "ked": "linear vibration",
    "coupled": "everything",
}


def report(a: Advice, model: str | None = None, whole: bool = True) -> Report:
    """Proposal, error bars, how to follow it; and the price of what is out."""
    n, rich, elastic = a.coordinates
    far = a.worst(a.error)
    most = f"up to {far}" if far[0].isdigit() else far
    reached = f"NOT REACHED: error bars {most}" if a.used(a.error) > 1.0 else "reached"
    of = f" (levels: model of {rich} coordinates)" if a.levels else ""
    deflection = f", deflection within {percent(a.tol)}" * ("deflection" in a.asked)
    return Report(f"{a.name}: advice", (
        (f"{a.name}: {reached}.", f"Suffices: {criterion(a.tol, a.band)}{deflection}."),
        f"Proposal: level {a.level} ({_DOES[a.level]})"
        + (f", {elastic} elastic coordinates ({n} as loaded)" if a.level != "rigid" else ""),
        lines(_command(a, model or a.name), indent="      ", first="  "),
        lines(a.why, indent="     ", first="why: "),
        _bars(f"Error bars (twice what was measured) of time integration and model{of}", a),
        _left_out(a) if whole else _sentence(a),
        bullets(a.notes),
    ))  # fmt: skip


def _command(a: Advice, model: str) -> str:
    changes = [*a.overrides, *([] if a.run_tol is None else [f"solve.tol={a.run_tol:g}"])]
    return f"pinflex solve {model} --level {a.level}" + "".join(f" --set {x}" for x in changes)


def _bars(title: str, a: Advice) -> Block:
    """Levels that were measured, and the proposal."""
    known = {name: e for name, e in a.levels.items() if all(map(isfinite, e.values()))}
    rows = known | ({"the proposal": a.error} if all(map(isfinite, a.error.values())) else {})
    if not rows:
        return ""
    outputs = list(next(iter(rows.values())))
    rows["allowed"] = {k: a.allowed.get(k, a.tol) for k in outputs}
    records = [{"level": name, **error} for name, error in rows.items()]
    columns = [(k, k, partial(a.bar, k)) for k in outputs]
    missing = [name for name in a.levels if name not in known]
    return (
        table(title, records, "level", *columns, names=(18,)),
        f"Not measured: {', '.join(missing)}." if missing else "",
    )


def _sentence(a: Advice) -> str:
    """What is left out, in words."""
    out = [x.what for x in a.left_out if x.out]
    if not a.left_out:
        return ""
    fewest = [what for what in out if what.startswith(_BEYOND)][-1:]  # it says the others too
    out = [what for what in out if not what.startswith(_BEYOND) or what in fewest]
    return f"Left out: {', '.join(out) or 'nothing'}. -v says what each costs."


def _left_out(a: Advice) -> Block:
    outputs = dict.fromkeys(k for x in a.left_out for k in x.error)
    columns = [(k, lambda x, k=k: x.error.get(k), _price) for k in outputs]
    return table(
        "What leaving it out costs, relative (blank: another output decides)", a.left_out,
        ("", lambda x: "out" if x.out else "kept"), "what", *columns, names=(4, 44),
    )  # fmt: skip


def _price(x: float | None) -> str:
    if x is None:
        return ""
    # Below this it is round-off of the comparison: nothing excites it.
    return "not excited" if x < 1e-9 else f"{x:.1e}"
