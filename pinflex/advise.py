"""What a scene needs: level, links, planes and modes for a tolerance, with error bars.

Everything is measured on the motion itself by cheap runs (pinflex.linear_probe) of a model richer
than the scene's: every plane, stretch and twist on, one more mode. Against its linear vibration,
twice corrected for what is not linear, stand the rigid torques, the balance of every instant, the
linear vibration, and the same with planes, modes and links left out. An error bar is twice what was
measured, plus what the corrections still leave; errors are relative as in pinflex.tolerance.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinflex import solid_keys
from pinflex.arrays import Array
from pinflex.errors import ConvergenceError, DescriptionError, MotionError, SceneError, nearest
from pinflex.linear_probe import Probe, subspace
from pinflex.mechanism import Mechanism, load
from pinflex.motion import Motion
from pinflex.parts import FlexiblePart, resolve
from pinflex.run import Run
from pinflex.supplement import ASKED
from pinflex.tolerance import Outputs

Errors = dict[str, float]
SAFETY = 2.0  # an error bar is this many times what was measured
_LARGEST = 150  # elastic coordinates: a richer model than this would not be a cheap look
_CONTRACTION = 0.7  # corrections that shrink by less say nothing
_KEYS = {"u": "axial", "p": "torsion", "w": "bending_z", "v": "bending_y"}
_WORDS = {
    "u": "stretch (axial)",
    "p": "twist (torsion)",
    "w": "bending out of the joint's plane (bending_z)",
    "v": "bending in the joint's plane (bending_y)",
}
_SIZES = {"craig_bampton": ("internal", 0), "assumed": ("modes", 1)}  # key and least number


@dataclass(frozen=True)
class LeftOut:
    """Something that may stay out of the model, or may not, and its measured error by output."""

    what: str
    error: Errors
    out: bool


@dataclass(frozen=True)
class Advice:
    """A proposal and what it rests on.

    Attributes:
        name: Of the scene. tol: Relative error wanted of every output asked for.
        asked: Some of torque, deflection, platform.
        level: rigid, quasistatic, ked or coupled.
        run_tol: `tol` to solve with (levels ked and coupled), or None.
        overrides: "key=value" changes of the YAML, for `load` or --set.
        error: Error bar of each output if the proposal is followed.
        levels: Error bar of each output at each level; empty where none could be had.
        left_out: Planes, modes and links that were tried.
        coordinates: Elastic coordinates (as loaded, richer model, proposed).
        why: The reason for the level, in one sentence.
        notes: What weakens the advice.
        seconds: What it cost.
    """

    name: str
    tol: float
    asked: tuple[str, ...]
    level: str
    run_tol: float | None
    overrides: tuple[str, ...]
    error: Errors
    levels: dict[str, Errors]
    left_out: tuple[LeftOut, ...]
    coordinates: tuple[int, int, int]
    why: str
    notes: tuple[str, ...]
    seconds: float


def advise(
    mechanism: Mechanism,
    motion: Motion | None = None,
    *,
    tol: float = 1e-2,
    asked: Sequence[str] = (),
    until: float | None = None,
    fixed: bool = False,
) -> Advice:
    """Propose level, links, planes, modes and tolerance for a scene.

    Args:
        mechanism: From `load`. motion: Default: the motion of the YAML.
        tol: Error that each output may have, relative to its largest value; of the platform, to
            its largest deviation from the rigid motion.
        asked: Of torque, deflection and platform; default: the YAML's `solve.asked`, or all.
        until: End in s; default: the YAML's, or the motion's duration.
        fixed: Take the flexible links as they are: propose level and tolerance only.
    Returns:
        The advice.
    Raises:
        DescriptionError: An unknown output or a tolerance outside 1e-6 to 0.1.
        MotionError, SingularityError: The nominal motion does not exist.
    """
    began, spec = time.perf_counter(), mechanism.description.solve
    asked = tuple(asked) or spec.asked or ASKED
    for name in asked:
        if name not in ASKED:
            raise DescriptionError(f"asked: {name}: no such output.{nearest(name, ASKED)}")
    if not 1e-6 <= tol <= 0.1:
        raise DescriptionError(f"tol: {tol}. Give a relative error, 1e-6 to 0.1.")
    from pinflex.solve import default_motion

    motion = motion if motion is not None else default_motion(mechanism)
    end = until or spec.until or motion.duration
    given = mechanism.flexible.n_eta
    blank = Advice(
        mechanism.name, tol, asked, "coupled", tol, (), {}, {}, (), (given,) * 3, "", (), 0.0
    )
    only = _only_coupled(mechanism)
    if not given and not only:
        return replace(blank, level="rigid", run_tol=None, error=dict.fromkeys(asked, 0.0),
                       why="no link is flexible")  # fmt: skip
    if only:
        return replace(blank, error=dict.fromkeys(asked, tol), why=only)
    rich, notes = (mechanism, ()) if fixed else _richer(mechanism)
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        found = _Study(rich, motion, end, tol, asked).advice(blank, mechanism, fixed, notes)
    return replace(found, seconds=time.perf_counter() - began)


def _only_coupled(mechanism: Mechanism) -> str:
    """Why no level but coupled applies, "" if others do."""
    spec = mechanism.description.solve
    if spec.drive == "torque":
        return "the motors push (drive: torque): only coupled lets them feel the links"
    if mechanism.description.control is not None:
        return "a control feeds vibration back, which only coupled has"
    if mechanism.report.mobility != len(mechanism.rigid.motors):
        return "the motors do not determine the motion: only coupled lets the rest swing"
    return ""


def _richer(mechanism: Mechanism) -> tuple[Mechanism, tuple[str, ...]]:
    """The scene with every plane, stretch and twist, and one more mode; itself where that fails."""
    changes = []
    for part in mechanism.parts.values():
        if part.spec.basis.kind in solid_keys.KINDS:
            continue
        changes += [f"flexible.{part.link}.{key}=true" for key in _KEYS.values()]
        size = _size(part)
        if size is not None:
            changes.append(f"flexible.{part.link}.basis.{size[0]}={size[1] + 1}")
    try:
        rich = load(mechanism.description, changes)
    except SceneError as error:
        return mechanism, (f"planes and modes were not tried: {error}",)
    if rich.flexible.n_eta > _LARGEST:
        why = f"with every plane the model has {rich.flexible.n_eta} coordinates"
        return mechanism, (f"planes and modes were not tried: {why}",)
    return rich, ()


def _size(part: FlexiblePart) -> tuple[str, int] | None:
    """The key of the YAML that says how many modes a link has, and how many it has."""
    basis = part.spec.basis
    key = _SIZES.get(basis.kind, (None, 0))[0]
    return None if key is None else (key, int(getattr(basis, key)))


class _Study:
    """The probes of one scene."""

    def __init__(
        self, rich: Mechanism, motion: Motion, end: float, tol: float, asked: tuple[str, ...]
    ) -> None:
        self.rich, self.tol, self.asked = rich, tol, asked
        static = rich.description.solve.start == "static"
        self.probe = Probe(rich, motion, end, static)
        self.outputs = Outputs(rich, motion, self.probe.t, asked)
        self.open: LeftOut | None = None  # the last mode tried, where it is needed

    def advice(
        self, blank: Advice, mechanism: Mechanism, fixed: bool, notes: tuple[str, ...]
    ) -> Advice:
        """Levels first; then, where links bend at all, what they can do without."""
        tol, probe = self.tol, self.probe
        notes = (*notes, *self._notes())
        try:
            levels, why = self._levels()
        except ConvergenceError as error:
            why = f"{error} Only coupled has what stops it"
            return replace(blank, error=dict.fromkeys(self.asked, tol), why=why, notes=notes)
        level = next((x for x in ("rigid", "quasistatic") if _worst(levels[x]) <= tol), "coupled")
        if level == "coupled" and any(mechanism.description.system_damping):
            level = "ked"  # the only one that has damping of the whole machine
        left_out: tuple[LeftOut, ...] = ()
        overrides: tuple[str, ...] = ()
        n, error = probe.system.n_eta, levels[level]
        if level != "rigid" and not fixed:
            room = 0.5 * tol if level == "coupled" else tol - _worst(error)
            left_out, state = self._leave_out(room)
            overrides, n = _overrides(mechanism, state.parts), state.coordinates
            error = {k: x + SAFETY * state.error.get(k, 0.0) for k, x in error.items()}
            if self.open:  # the next mode brings no more than the last one did
                error = {k: x + self.open.error.get(k, 0.0) for k, x in error.items()}
                what = f"{self.open.what} still change an output by {_worst(self.open.error):.2g}"
                notes = (*notes, f"{what}: more of them than were tried here may be needed")
        return replace(
            blank, level=level, run_tol=0.5 * tol if level in ("ked", "coupled") else None,
            overrides=overrides, error=error, levels=levels, left_out=left_out, notes=notes,
            coordinates=(mechanism.flexible.n_eta, probe.system.n_eta, n), why=why,
        )  # fmt: skip

    def _notes(self) -> Iterator[str]:
        probe = self.probe
        if probe.rough > 1e-2:
            yield (
                f"the motion has corners: interpolation misses {100 * probe.rough:.0f} % of its "
                "acceleration there, and so may the error bars"
            )
        each = 1.0 / max(probe.third * probe.h, 1e-300)
        if each < 8:
            yield (
                f"the third mode, {probe.third:.3g} Hz, was seen with {each:.1f} steps a period "
                "only: a long run for so fast a mode"
            )

    def _levels(self) -> tuple[dict[str, Errors], str]:
        """Error bars by level, and the reason in words."""
        probe, differ = self.probe, self.outputs.differences
        linear = probe.march()
        once = probe.corrected(linear)
        best = probe.nonlinear(probe.corrected(once))
        self.once = probe.nonlinear(once)
        first, second = differ(probe.linear(linear), best), differ(self.once, best)
        ratio = max((second[k] / e for k, e in first.items() if e > 1e-6), default=0.0)
        left = {k: e * ratio / (1.0 - ratio) if ratio < _CONTRACTION else np.inf
                for k, e in second.items()}  # fmt: skip

        def bars(run: Run) -> Errors:
            return {k: SAFETY * e + left[k] for k, e in differ(run, best).items()}

        levels = {"rigid": bars(probe.rigid())}
        try:
            levels["quasistatic"] = bars(probe.quasistatic())
        except ConvergenceError:
            levels["quasistatic"] = dict.fromkeys(left, np.inf)
        levels["ked"] = {k: SAFETY * e + left[k] for k, e in first.items()}
        levels["coupled"] = dict.fromkeys(left, 0.5 * self.tol)
        rigid, still, ked = (_worst(levels[x]) for x in ("rigid", "quasistatic", "ked"))
        why = (
            f"error bars: rigid {rigid:.2g}, quasistatic {still:.2g}, ked {ked:.2g} at worst, "
            f"{self.tol:g} wanted"
        )
        return levels, why

    # Planes, modes, links ------------------------------------------------------------------

    def _leave_out(self, room: float) -> tuple[tuple[LeftOut, ...], _Reduced]:
        """Leave out whatever keeps the error bars of all that is left out within `room`."""
        run = self.once
        kept = _Reduced((), dict(self.rich.parts), run, {}, self.probe.system.n_eta)
        told: list[LeftOut] = []
        for what, changes, more in self._candidates():
            if more and told and not told[-1].out:
                continue  # where three modes are needed, two will not do
            trial = self._without((*kept.changes, *changes))
            if trial is None or trial.coordinates == kept.coordinates:
                continue
            out = SAFETY * _worst(trial.error) <= room
            told.append(LeftOut(what, self.outputs.differences(trial.run, kept.run), out))
            if what.startswith("modes") and not more and not out:
                self.open = told[-1]
            kept = trial if out else kept
        return tuple(told), kept

    def _candidates(self) -> Iterator[tuple[str, tuple[str, ...], bool]]:
        """What to try, likeliest first: planes, then modes, then links that are all alike.

        Words, changes of the YAML, and whether it goes on from the one before.
        """
        parts = [p for p in self.rich.parts.values() if p.spec.basis.kind not in solid_keys.KINDS]
        for d in "upwv":
            links = [p.link for p in parts if d in p.planes]
            yield _WORDS[d], tuple(f"flexible.{link}.{_KEYS[d]}=false" for link in links), False
        sizes = {p.link: _size(p) for p in parts}
        most = max((s[1] for s in sizes.values() if s is not None), default=0)
        for count in range(most - 1, -1, -1):
            less = tuple(
                f"flexible.{p.link}.basis.{s[0]}={count}"
                for p in parts
                if (s := sizes[p.link]) is not None
                and s[1] > count >= _SIZES[p.spec.basis.kind][1]
            )
            yield f"modes beyond {count} in each direction", less, count < most - 1
        alike: dict[str, list[str]] = {}
        for part in self.rich.parts.values():
            stem = "".join(c for c in part.link if not c.isdigit())
            key = f"{stem} {replace(part.spec, link='')} {part.length:.6g}"
            alike.setdefault(key, []).append(part.link)
        for links in alike.values():
            null = tuple(f"flexible.{link}=null" for link in links)
            yield f"all bending of {', '.join(links)}", null, False

    def _without(self, changes: tuple[str, ...]) -> _Reduced | None:
        """The error of leaving something out, or None where that is no model."""
        try:
            description = self.rich.description.with_overrides(changes)
            parts = resolve(description, self.rich.links)
        except DescriptionError:
            return None
        shapes: Array = subspace(self.rich.flexible, parts)
        n = sum(body.n for part in parts.values() for body in part.bodies)
        if not n:
            return None
        try:
            fewer = self.probe.corrected(self.probe.march(shapes), shapes)
        except (ConvergenceError, np.linalg.LinAlgError):
            return None
        run = self.probe.nonlinear(fewer)
        return _Reduced(changes, parts, run, self.outputs.differences(run, self.once), n)


@dataclass(frozen=True)
class _Reduced:
    """A model with something left out: YAML changes, parts, run, its error, coordinates."""

    changes: tuple[str, ...]
    parts: dict[str, FlexiblePart]
    run: Run
    error: Errors
    coordinates: int


def _worst(error: Errors) -> float:
    return max(error.values(), default=0.0)


def _overrides(mechanism: Mechanism, parts: dict[str, FlexiblePart]) -> tuple[str, ...]:
    """Changes of the YAML that make the parts of a mechanism into others; equal ones by a glob."""
    wanted: dict[str, dict[str, str]] = {}
    for link, part in mechanism.parts.items():
        if link not in parts:
            wanted.setdefault("", {})[link] = "null"
            continue
        new = parts[link]
        for d, key in _KEYS.items():
            if (d in part.planes) != (d in new.planes):
                wanted.setdefault(f".{key}", {})[link] = "true" if d in new.planes else "false"
        old_size, size = _size(part), _size(new)
        if size is not None and size != old_size:
            wanted.setdefault(f".basis.{size[0]}", {})[link] = str(size[1])
    said = []
    for key, values in wanted.items():
        if key and len(values) == len(mechanism.parts) and len(set(values.values())) == 1:
            said.append(f"flexible.*{key}={next(iter(values.values()))}")
        else:
            said += [f"flexible.{link}{key}={value}" for link, value in values.items()]
    return tuple(said)
